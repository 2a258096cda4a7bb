"""The graph of a study's session: it presents one touch after the other, without force between.

Between two touches the wall is :data:`AWAY`, so that no force is asked for, wherever the hand is.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Event as Flag
from typing import Any, Literal, NamedTuple, Protocol

from forcebound.errors import ConfigError, ForceboundError, RunError
from forcebound.graph.graph import KINDS, GraphConfig
from forcebound.graph.names import LAW
from forcebound.graph.parameters import differences, parameters
from forcebound.graph.resolved import kind_of, to_document
from forcebound.haptics.hands.pointer import PointerHand
from forcebound.haptics.laws import LAWS
from forcebound.lab.study.plan import Study, wall_of
from forcebound.messages.control import EmitEvent, Parameters
from forcebound.messages.events import TrialEvent
from forcebound.messages.packets import TOPIC_OF, DeviceState
from forcebound.messages.topology import flat
from forcebound.observe.control import ask
from forcebound.observe.kernels import Kernels
from forcebound.observe.page.controls import Pointer
from forcebound.observe.recorder import record_running
from forcebound.observe.tuning import configuration, every_parameter, set_parameters
from forcebound.results.surface import scale_of
from forcebound.roles import LAUNCHER
from forcebound.run.process.reader import Reader
from forcebound.run.run_directory import RunDocument
from forcebound.stop import Stop

AWAY = 10.0  # m, where the wall is between two touches
LONGEST = 86_400.0  # s, of a graph
SILENCE = 5.0  # s without a reading, after which the device is said to be lost
RUN_UP, PUSH = 0.030, 0.015  # m, where a dragged hand begins before the line, and ends in the wall
SPARE = ("certified", "more_conservative")  # one of them is taken for a moment between two touches

#: What moves the hand: a person at a device, a pointer on the page, or the launch file's operator.
Mover = Literal["person", "pointer", "itself"]


class Running(Protocol):
    """A launched graph."""

    run_dir: Path

    @property
    def is_running(self) -> bool:
        """Whether it runs."""
        ...

    def wait(self, seconds: float) -> None:
        """Let time pass; RunError if it has failed."""
        ...

    def close(self) -> None:
        """End it, with zero force first."""
        ...


class Sample(NamedTuple):
    """A reading of the device."""

    time: float  # s, the device's clock
    position: float  # m, on the first axis
    buttons: int  # bit i: button i is down


def wall_at_hand(config: GraphConfig) -> float:
    """Return where the hand feels the wall, in m; ConfigError if it moves."""
    scale, wall = scale_of(flat(to_document(config))), wall_of(config)
    if (
        wall is None
        or scale is None
        or kind_of("environment", config.environment.model) == "time_varying_wall"
    ):
        raise ConfigError("a study with a person needs a wall that stays where and as it is")
    return (wall - scale.origin) / scale.motion


def mover_of(config: GraphConfig) -> Mover:
    """Return the mover of the hand of a graph."""
    device = config.only.device
    if device.port:  # an emulator follows no pointer
        return "itself" if device.port == "emulated" else "person"
    is_simulated = KINDS["device"].is_shipped(kind_of("device", device))
    return "pointer" if is_simulated or config.only.operator is not None else "person"


def played(config: GraphConfig, line: float) -> GraphConfig:
    """Return the graph of a touch as it is launched, with the hand that its mover has.

    A hold limit of one period is that of a clock that is never late, such as the virtual one: on a
    live clock each late tick would drop the force, so it becomes ``auto``.
    """
    wall, mover = wall_at_hand(config), mover_of(config)
    if mover == "pointer":
        start = wall - line - RUN_UP
        reach = wall + PUSH - start
        hand = PointerHand(stiffness=400.0, damping=2.0, start=start, reach=reach)
        config = config.with_hand(operator=hand)
    elif mover == "person":
        config = config.with_hand(operator=None)
    if config.only.servo.hold_limit == 1:
        servo = replace(config.only.servo, hold_limit="auto")
        config = config.with_hand(servo=servo)
    return replace(config, duration=LONGEST, seed=1, phases=())


class StudyGraph:
    """The graph of a session, launched when a touch needs it; to be closed.

    Args:
        study: What is presented.
        launch: Launches a configuration; returns when the force is engaged.
    """

    def __init__(self, study: Study, launch: Callable[[GraphConfig], Running]) -> None:
        self._line, self._launch = study.guidance.line, launch
        configs = [study.config(one) for pair in study.pairs for one in pair]
        for config in configs:
            wall_at_hand(config)
        self.movers = {mover_of(config) for config in configs}
        laws = {config.only.servo.law for config in configs}
        self._laws = sorted(law for law in {*laws, *SPARE} if LAWS.is_shipped(law))
        self._graph: Running | None = None
        self._fixed: Parameters = {}
        self._heard = 0.0  # s, when the last reading came

    def prepare(self, config: GraphConfig) -> None:
        """Have a graph run that can present a touch; no force is asked for."""
        config = played(config, self._line)
        is_new = self._graph is None or not self._graph.is_running
        if not is_new and self._fixed == _fixed(config) and LAWS.is_shipped(_law(config)):
            return
        self.close()
        model: Any = config.environment.model
        environment = replace(config.environment, model=replace(model, position=AWAY))
        self._fixed = _fixed(config)
        self._graph = self._launch(replace(config, environment=environment))
        run_dir = self._graph.run_dir
        run = RunDocument.read(run_dir)
        streams = [one for one in run.graph.streams if one.topic == TOPIC_OF[DeviceState]]
        self._reader, self._heard = Reader(run_dir, streams, run.core), time.monotonic()
        self._pointer = Pointer(run_dir, lambda _: None)
        self._kernels = Kernels(run_dir, _law(config))
        self._kernels.begin(self._laws)

    def place(self, config: GraphConfig) -> None:
        """Put the wall of a touch in its place, under its law with a new ledger."""
        config = played(config, self._line)
        now = configuration(self._run_dir)
        changes = differences(now, config)
        if LAW not in changes and LAWS.is_shipped(_law(config)):  # its ledger is of the last touch
            spare = next(law for law in SPARE if law != _law(config))
            set_parameters(self._run_dir, {LAW: spare}, self._kernels)
            changes[LAW] = _law(config)
        set_parameters(self._run_dir, changes, self._kernels)

    def clear(self) -> None:
        """Take the wall away; return when no force is asked for. Without a graph there is none."""
        if self._graph is not None:
            set_parameters(self._run_dir, {"environment.position": AWAY}, self._kernels)

    @contextmanager
    def recording(self, file: Path) -> Iterator[None]:
        """Record all that the graph sends; RunError if it cannot be kept."""
        begun, stop = Flag(), Stop()
        run = partial(record_running, self._run_dir, file, None, lambda _: begun.set(), stop)
        with closing(stop), ThreadPoolExecutor(1) as pool:
            done = pool.submit(run)
            done.add_done_callback(lambda _: begun.set())
            try:
                begun.wait()
                if done.done():
                    done.result()
                yield
            finally:
                stop.request()
            done.result()

    def samples(self) -> Sequence[Sample]:
        """Return the readings since the last look; RunError if there have been none for long."""
        if self._graph is None:
            return ()
        self._pointer.send()
        packets = [one.packet for one in self._reader.take()]
        if packets:
            self._heard = time.monotonic()
        elif not self._graph.is_running or time.monotonic() - self._heard > SILENCE:
            problem = self.failure or "the graph has ended, or its device is lost"
            self.close()  # the next touch launches it again
            raise RunError(problem)
        return [
            Sample(one.time_ns * 1e-9, one.position[0], one.buttons or 0)
            for one in packets
            if isinstance(one, DeviceState)
        ]

    @property
    def failure(self) -> str:
        """Why the graph has ended; empty: it runs, or has ended in order."""
        try:
            if self._graph is not None:
                self._graph.wait(0.0)
        except ForceboundError as error:
            return str(error)
        return ""

    def point(self, place: object) -> None:
        """Move the pointer that the hand follows to a place on the first axis, in m."""
        if self._graph is not None and "pointer" in self.movers:
            self._pointer.point([place])

    def publish(self, kind: TrialEvent, message: str, data: Mapping[str, str]) -> None:
        """Send an event of the session on the graph's topic ``event``."""
        if self._graph is not None:
            ask(self._run_dir, LAUNCHER, EmitEvent(kind, message, dict(data)))

    def close(self) -> None:
        """End the graph, with zero force first."""
        graph, self._graph = self._graph, None
        if graph is not None:
            self._kernels.close()
            self._pointer.close()
            self._reader.close()
            graph.close()

    @property
    def _run_dir(self) -> Path:
        assert self._graph is not None
        return self._graph.run_dir


def _law(config: GraphConfig) -> str:
    return config.only.servo.law


def _fixed(config: GraphConfig) -> Parameters:
    """Return the parameters that cannot change while a graph runs."""
    changing = parameters(config)
    return {name: one for name, one in every_parameter(config).items() if name not in changing}
