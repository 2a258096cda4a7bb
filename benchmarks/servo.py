"""Punctuality of the servo's wake-ups against a C loop, and the cost of its ticks.

Wake-ups: :func:`forcebound.realtime.wait_until` on an absolute schedule against `pacing.c`, in each
scheduling class that is permitted, on the same core with the same priority. Ticks: the real device
node on real sockets, answered by a peer on the same core; their cost is the time from the two
wake-ups of a tick to the return to sleep, at the rate and at 4 kHz.
"""

import subprocess
import tempfile
import time
from array import array
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import ClassVar

from msgspec.structs import replace

from benchmarks.harness import Figure, Result, alternate, at, chain, compare, compiled, missed
from forcebound.errors import RunError
from forcebound.graph.servo import ServoSettings, dissipation_of
from forcebound.haptics.devices import DeviceModel
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.environments.walls import Wall
from forcebound.haptics.hands import Operator
from forcebound.haptics.hands.hands import SinusoidalHand
from forcebound.messages.events import EventLog
from forcebound.messages.packets import DeviceState, ForceCommand, Packet
from forcebound.messages.topology import ONE_HAND, Graph
from forcebound.network.sockets import Network
from forcebound.nodes import Node
from forcebound.nodes.device import DeviceNode
from forcebound.observe.measure import READY, WARMUP, Round, Timing, apart, serving, wake_ups
from forcebound.realtime import Settings, enter, freeze_garbage, wait_until
from forcebound.roles import CONTROLLER, DEVICE, ROLES
from forcebound.run.process.runner import Runner
from forcebound.run.process.runner import run as run_node
from forcebound.stop import Stop

DURATION = 24.0
ASKED = "tick of the device node, one axis at 1 kHz"
FAST_RATE = 4000.0  # Hz, to be held without a miss


def run(duration: float, rate: float) -> Result:
    """Run the benchmark."""
    best = chain()
    policies = dict.fromkeys(("other", best.policy))
    with tempfile.TemporaryDirectory(prefix="forcebound-") as folder:
        program = compiled("pacing.c", folder)
        contestants = {}
        for policy in policies:
            contestants[f"wake-up, {policy}"] = partial(apart, wake_ups, chain(policy))
            contestants[f"C loop, {policy}"] = partial(_c_loop, program, chain(policy))
        woken = alternate(0.6 * duration, rate, contestants)
    figures: list[Figure] = []
    for ours, limit in zip(woken[::2], woken[1::2], strict=True):
        figures += [compare(ours, limit, share, 1.0) for share in ("p50", "p99")]
    (tick,) = alternate(0.2 * duration, rate, {f"tick at {rate:g} Hz": partial(_ticks, best)})
    fast_label = f"tick at {FAST_RATE:g} Hz"
    (fast,) = alternate(0.2 * duration, FAST_RATE, {fast_label: partial(_ticks, best)})
    share = tick.processor_share or 0.0
    figures += [at(tick, "p50", is_shown=True), at(tick, "p99", 60.0, is_shown=True)]
    figures.append(Figure(f"{tick.label}, processor", share, "%", 0.12, shown="of a core"))
    return [*woken, tick, fast], [*figures, missed(tick), missed(fast)]


def _c_loop(program: Path, settings: Settings, timing: Timing) -> Round:
    priority = ROLES[DEVICE].priority
    words = (program, settings.core, settings.policy, priority, timing[0], WARMUP, timing[1])
    done = subprocess.run(list(map(str, words)), capture_output=True, timeout=READY + timing[1])
    if done.returncode:
        raise RunError(f"pacing.c ended with status {done.returncode}: {done.stderr.decode()}")
    *times_ns, skipped, processor_ns, elapsed_ns = array("q", done.stdout)
    return Round(times_ns, skipped, processor_ns, elapsed_ns)


def _ticks(settings: Settings, timing: Timing) -> Round:
    with tempfile.TemporaryDirectory(prefix="forcebound-") as name, ExitStack() as stack:
        folder, hand = Path(name), SinusoidalHand()
        stack.enter_context(serving(answer_states, folder, settings))
        return apart(ticks, PhantomPremium15(), hand, folder, settings, 0.4, timing)


class AnswerNode(Node):
    """Controller and environment in one: answers each state with the force of a wall."""

    wakes_on_arrival: ClassVar[bool] = True
    wake_ns: int | None = None

    def __init__(self) -> None:
        self.events = EventLog("controller")
        self._wall = Wall()

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        """Answer the states; see :class:`forcebound.nodes.Node`."""
        return [
            ForceCommand(
                state.seq,
                time_ns,
                state.seq,
                state.time_ns,
                self._wall.force("", state.position, state.velocity, state.elapsed),
            )
            for state in received
            if type(state) is DeviceState
        ]


def answer_states(folder: Path, settings: Settings) -> None:
    """Take the telemetry of a device, too, and answer its states until killed."""
    streams = [
        replace(stream, receiver=CONTROLLER) if stream.topic == "telemetry" else stream
        for stream in ONE_HAND.streams
    ]
    graph = Graph(ONE_HAND.nodes, tuple(streams))
    run_node(AnswerNode(), CONTROLLER, folder, {}, settings, Stop(), graph=graph)


def ticks(
    model: DeviceModel,
    operator: Operator | None,
    folder: Path,
    settings: Settings,
    reply_wait: float,
    timing: Timing,
) -> Round:
    """Measure ticks of the node of a device, engaged."""
    servo = ServoSettings(rate=1e9 / timing[0], reply_wait=reply_wait)
    node = DeviceNode(model.open(operator, servo.opening_hold), dissipation_of(model, servo), servo)
    enter(settings, "device")
    runner = Runner(node, "device", folder, {}, Network(), settings.spin_ns)
    node.engage()
    freeze_garbage()
    ready_ns = time.monotonic_ns() + round(READY * 1e9)

    def tick() -> int:
        spent_ns = 0
        for _ in range(2):  # read and publish the state; receive, bound and write
            begun_ns = wait_until(node.wake_ns, settings.spin_ns)
            runner.turn(begun_ns)
            spent_ns += time.monotonic_ns() - begun_ns
        return spent_ns

    while runner.status().waiting_for:
        tick()
        if time.monotonic_ns() > ready_ns:
            raise RunError("the servo got no answer: the answering process is missing")
    for _ in range(WARMUP):
        tick()
    before, processor_ns, began_ns = (
        node.deadline_misses,
        time.process_time_ns(),
        time.monotonic_ns(),
    )
    times_ns = [tick() for _ in range(timing[1])]
    used_ns, elapsed_ns = time.process_time_ns() - processor_ns, time.monotonic_ns() - began_ns
    found = Round(times_ns, node.deadline_misses - before, used_ns, elapsed_ns)
    node.close()
    return found
