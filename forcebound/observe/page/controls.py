"""What a page may do: change parameters, nodes, links; record; move the hand."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from forcebound.axes import Axis, common_kind, units_on
from forcebound.errors import ConfigError, ForceboundError
from forcebound.graph.graph import GraphConfig
from forcebound.graph.names import LAW, ParameterName, parameter_name
from forcebound.graph.parameters import parameters, takeable_laws
from forcebound.graph.resolved import to_document
from forcebound.haptics.environments import StatelessEnvironment
from forcebound.haptics.environments.fixtures import WithFixtures
from forcebound.haptics.environments.touching import Touchable
from forcebound.haptics.hands import Operator
from forcebound.haptics.hands.pointer import PointerHand
from forcebound.messages.control import DeviceStatus, GetStatus, Point, Pointed
from forcebound.messages.packets import SceneObject, Vector
from forcebound.messages.topology import HAND, Document, endpoint, flat, is_bound
from forcebound.network.sockets import Network
from forcebound.observe.control import (
    ANSWER_TIMEOUT,
    ask_all,
    ask_launcher,
    start_node,
    stop_node,
)
from forcebound.observe.episodes import ACTIONS, mark
from forcebound.observe.formatting import as_written, meanings_of, ranges
from forcebound.observe.kernels import Kernels
from forcebound.observe.page.feed import Message
from forcebound.observe.page.reason import Reason, Recent
from forcebound.observe.page.recording import PageRecording
from forcebound.observe.page.state import Judged
from forcebound.observe.tuning import (
    configuration,
    cut_links,
    find_parameters,
    read_settings,
    set_parameters,
)
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.promises import broken_promises
from forcebound.results.samples import Samples
from forcebound.roles import DEVICE, ENVIRONMENT
from forcebound.run.run_directory import RunDocument, graph_in
from forcebound.units import EVERYDAY

DELAYED = ("links.environment_query.delay", "links.environment_reply.delay")
BROKEN = {LAW: "none"} | dict.fromkeys(DELAYED, "5 ms")
SAFE = {LAW: "certified"} | dict.fromkeys(DELAYED, "0 ms")
STATUS_TIMEOUT = 0.3  # s for the device's answer of each second
OVERDUE = 0.5  # s without an answer, after which a device is asked again: it has restarted


class Controls:
    """The controls of one running graph; to be closed."""

    def __init__(self, run_dir: Path, recordings: Path) -> None:
        self._run_dir = run_dir
        self.recording = PageRecording(run_dir, recordings)
        self._config = configuration(run_dir, with_code=False)
        hands = self._config.hands_here
        self.period = min(hand.servo.period_ns for hand in hands.values()) * 1e-9  # s
        pointed = {name: _pointer(hand.operator) for name, hand in hands.items()}
        #: Where the pointers of hands that follow one begin, in m.
        self.starts = {name: one["start"] for name, one in pointed.items() if one}
        graph = graph_in(run_dir)
        devices = [graph.nodes[graph.of_role(DEVICE, hand)] for hand in hands]
        #: Whether a device may be there already: one that is yet to start has spent no energy.
        self.is_started = any(is_bound(run_dir, one) for one in devices)
        known = self._statuses(ANSWER_TIMEOUT) if self.is_started else {}
        self.energies_before = {
            hand: known[hand].energy_before if hand in known else 0.0 for hand in hands
        }
        self._reasons = {hand: Reason() for hand in hands}
        (loaded, *others) = {hand.servo.law for hand in hands.values()}
        self._kernels = Kernels(run_dir, "" if others else loaded)
        self.episodes: Message = {}  # that were counted last, as a message
        with suppress(ForceboundError):
            self.count_episodes()
        self._law_requests = 0
        self._newest: dict[str, int] = {}  # number of the newest request for each hand's law
        self._actions: dict[str, Callable[[Message], None]] = {
            "set": lambda request: self._set(request["settings"]),
            "stop": lambda request: stop_node(run_dir, str(request["node"])),
            "start": lambda request: start_node(run_dir, str(request["node"])),
            "outage": lambda request: self._cut(str(request["time"])),
            "record": lambda _: self.recording.begin(),
            "end_recording": lambda _: self.recording.end(),
            "episode": lambda request: self._mark(request["action"]),
            "break": lambda _: self._set_all(BROKEN),
            "safe": lambda _: self._set_all(SAFE),
        }

    def describe(self) -> Message:
        """Return the description of the graph for a page, before its first frame."""
        hands = self._config.hands_here
        axes = next(iter(hands.values())).named_axes  # all have as many, of these kinds
        si = {"position": "m", "force": "N", "stiffness": "N/m"}
        return {
            "type": "hello",
            "name": RunDocument.read(self._run_dir).file,
            "description": self._config.description,
            "axes": len(axes),
            "names": [axis.name for axis in axes],
            "joints": _joints(axes),
            "si": {name: units_on(axes, unit) for name, unit in si.items()},
            "units": {si: (one.factor, one.unit) for si, one in EVERYDAY.items()},
            "laws": takeable_laws(),
            "hands": [_described(self._config, name) for name in hands],
        }

    def parameters(self) -> Message:
        """Return the parameters that can change, each as text with its unit, and their ranges."""
        config = configuration(self._run_dir, with_code=False)
        places = ((name, ParameterName.parse(name)) for name in parameters(config))
        hands = config.hands_here
        names = [name for name, at in places if at.section == ENVIRONMENT or at.hand in hands]
        found = find_parameters(config, names)
        return {
            "type": "parameters",
            "values": as_written(config, found),
            "ranges": ranges(config, found),
            "help": meanings_of(config, found),
            "wall": _wall(config),
        }

    def scene(self) -> tuple[SceneObject, ...]:
        """Return what the environment will show, as far as its parameters say so; it may take 1 s.

        A page draws this until the environment itself answers: the first start compiles.
        """
        model = self._config.environment.model
        fixtures = model.fixtures.drawn() if isinstance(model, WithFixtures) else ()
        solid = model.model if isinstance(model, WithFixtures) else model
        return (*(solid.scene() if isinstance(solid, Touchable) else ()), *fixtures)

    def judge(self, recent: Mapping[str, Recent]) -> dict[str, Judged]:
        """Return what is known of each hand whose device answers, from its newest packets."""
        document = to_document(configuration(self._run_dir, with_code=False))
        judged = {}
        if statuses := self._statuses(STATUS_TIMEOUT):  # before, the nodes need the processor
            self._kernels.begin((BROKEN[LAW], SAFE[LAW]))
        for hand, status in statuses.items():
            own = flat(document, hand)
            own["device"]["law"] = status.law
            cause = self._reasons[hand].look(recent[hand], partial(_run, own, status))
            columns = TelemetryColumns.from_packets(recent[hand][0])
            sections: Document = {name: own[name] for name in ("device", "axes") if name in own}
            run = _run(sections, status, columns)
            judged[hand] = Judged(own, status.bounder, cause, broken_promises(run))
        return judged

    def _statuses(self, timeout: float) -> dict[str, DeviceStatus]:
        """Return the status of the device of each hand that answers; ConfigError without a run."""
        graph = RunDocument.read(self._run_dir).graph
        devices = {graph.of_role(DEVICE, hand): hand for hand in self._config.hands_here}
        answers = ask_all(self._run_dir, dict.fromkeys(devices, GetStatus()), timeout)
        return {
            devices[node]: answer
            for node, answer in answers.items()
            if isinstance(answer, DeviceStatus)
        }

    def receive(self, request: Message) -> Callable[[], bool]:
        """Take note of a request; return what says whether it still counts.

        A request for a hand's law replaces those that still wait: nobody who wants to be safe waits
        for a law that is being prepared.
        """
        settings = request.get("settings")
        names = list(map(str, settings)) if isinstance(settings, Mapping) else []
        laws = [name for name in names if ParameterName.parse(name).is_law]
        if request.get("do") in ("break", "safe"):
            laws = [parameter_name(hand, LAW) for hand in self._config.hands_here]
        if not laws:
            return lambda: True
        self._law_requests += 1
        number = self._law_requests
        self._newest |= dict.fromkeys(laws, number)
        return lambda: number in [self._newest[law] for law in laws]

    def act(self, request: Message, counts: Callable[[], bool] = lambda: True) -> str | None:
        """Do what a page requests; return what is wrong, or None. It may take seconds."""
        action = self._actions.get(str(request.get("do")))
        if action is None:
            return f"no such control: {request.get('do')!r}"
        if not counts():
            return None
        self._kernels.is_wanted = counts
        try:
            action(request)
        except KeyError as error:
            return f"{request.get('do')} needs {error}"
        except ForceboundError as error:
            return str(error) if counts() else None
        except Exception as error:  # a value that nobody thought of: the page's error, not ours
            return f"{request.get('do')}: {type(error).__name__}: {error}"
        return None

    def _set(self, settings: Any) -> None:
        if not isinstance(settings, Mapping):
            raise ConfigError("settings: expected names and values")
        chosen = read_settings([f"{name}:={value}" for name, value in settings.items()])
        set_parameters(self._run_dir, chosen, self._kernels)

    def _set_all(self, settings: Mapping[str, str]) -> None:
        """Change parameters of every hand."""
        hands = self._config.hands_here
        self._set({parameter_name(hand, name): v for hand in hands for name, v in settings.items()})

    def _mark(self, action: Any) -> None:
        if action not in ACTIONS:
            raise ConfigError(f"expected {', '.join(ACTIONS)}, got {action!r}")
        mark(self._run_dir, action)

    def count_episodes(self) -> Message:
        """Return how many episodes there are, for pages; ConfigError without a launcher."""
        found = ask_launcher(self._run_dir, GetStatus()).episodes
        self.episodes = {"type": "episodes", **msgspec.structs.asdict(found)}
        return self.episodes

    def _cut(self, time: str) -> None:
        cut_links(self._run_dir, time, ())

    def close(self) -> None:
        """End what is still under way."""
        self.recording.end()
        self._kernels.close()


class Pointer:
    """A client that sends pointer positions to the device of a hand, and never waits for an answer.

    ``taken`` is called with the stamp of a place when the device has taken it. When ``descriptor``
    is readable, call :meth:`send`.
    """

    def __init__(self, run_dir: Path, taken: Callable[[Any], None], hand: str = HAND) -> None:
        self._taken = taken
        self._network = Network()
        graph = graph_in(run_dir)
        self._client = self._network.control_client(
            endpoint(run_dir, graph.nodes[graph.of_role(DEVICE, hand)])
        )
        self.descriptor = self._client.descriptor
        self.place: Vector | None = None  # where the device has it, in m
        self._newest: tuple[Point, Any] | None = None
        self._asked: tuple[Any, float] | None = None  # stamp, and when

    def point(self, target: Any, stamp: Any = None) -> str | None:
        """Take where the pointer is now, in m, as a page sent it; return what is wrong, or None."""
        try:
            request = msgspec.convert({"request": "point", "target": target}, Point)
        except (msgspec.ValidationError, OverflowError) as error:
            return str(error)
        self._newest = request, stamp
        self.send()
        return None

    def send(self) -> None:
        """Send the latest place once the device has acknowledged the one before."""
        if self._asked is not None:
            stamp, asked = self._asked
            answer = self._client.answer()
            if answer is not None:
                self._asked = None
                if isinstance(answer, Pointed):
                    self.place = answer.target
                    if stamp is not None:
                        self._taken(stamp)
            elif time.monotonic() - asked > OVERDUE:
                self._asked = None
        if self._newest is not None and self._asked is None:
            request, stamp = self._newest
            if self._client.ask(request):
                self._newest, self._asked = None, (stamp, time.monotonic())

    def close(self) -> None:
        """Close the client."""
        self._network.close()


def _run(document: Document, status: DeviceStatus, columns: TelemetryColumns) -> Samples:
    run = Samples(columns, document)
    run.report = status.bounder
    return run


def _joints(axes: Sequence[Axis]) -> list[Message]:
    """The axes that are no places in space; none: they are, or there is one, which is drawn so."""
    if len(axes) == 1 or common_kind(axes) == "length":
        return []
    return [{"name": axis.name, "isAngle": axis.kind == "angle"} for axis in axes]


def _wall(config: GraphConfig) -> float | None:
    """Where the surface of a wall is, in m; None: the environment itself says what there is."""
    model = config.environment.model
    if isinstance(model, WithFixtures):
        model = model.model
    place = getattr(model, "position", None) if isinstance(model, StatelessEnvironment) else None
    return place if isinstance(place, float) else None


def _described(config: GraphConfig, name: str) -> Message:
    """What a page needs to know of a hand."""
    hand = config.hands[name]
    speed = parameter_name(name, "device.hand_speed")
    return {
        "name": name,
        "hand_speed": as_written(config, {speed: getattr(hand.device, "hand_speed", None)})[speed],
        "workspace": hand.facts.workspace,
        "pointer": _pointer(hand.operator),
    }


def _pointer(operator: Operator | None) -> Message | None:
    """What a pointer may do; None: the hand follows none."""
    if not isinstance(operator, PointerHand):
        return None
    start = operator.start if isinstance(operator.start, tuple) else (operator.start,)
    return {"start": start, "reach": operator.reach, "speed": operator.speed}
