"""Contestant of the servo benchmark: ticks of the real device node in the live runner.

``device`` runs the device node of a stiff wall; ``controller`` takes its states and telemetry and
answers each state with a force, so that the whole safety chain and the bounder work. The cost of a
tick is the time between its two wake-ups and the return to sleep: read and publish the state;
receive, decode, read, chain, bound, write and publish the telemetry. The waits do not count.

::

    python -m forcebound.benchmark.servo_tick ROLE FOLDER CORE POLICY PERIOD_NS COUNT
"""

import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from forcebound.benchmark.workers import READY, WARMUP, Stopwatch, enter_contestant
from forcebound.devices import DeviceModel
from forcebound.devices.phantom import PhantomPremium15
from forcebound.environments.wall import Wall
from forcebound.messages.packets import DeviceState, ForceCommand, Packet, Telemetry
from forcebound.network.sockets import Network
from forcebound.nodes import Node
from forcebound.nodes.device import DeviceNode
from forcebound.nodes.events import EventLog
from forcebound.nodes.servo import ServoSettings, dissipation_of
from forcebound.operators import Operator
from forcebound.operators.sinusoidal import SinusoidalHand
from forcebound.process import Runner, Stop, run
from forcebound.realtime import Settings, enter, freeze_garbage, wait_until


class AnswerNode(Node):
    """Controller and environment in one: answers each state with the force of a wall."""

    subscribes: ClassVar[tuple[type[Packet], ...]] = (DeviceState, Telemetry)
    publishes: ClassVar[tuple[type[Packet], ...]] = (ForceCommand,)
    wakes_on_arrival: ClassVar[bool] = True
    wake_ns: int | None = None

    def __init__(self) -> None:
        self.events = EventLog("controller")
        self._wall = Wall()
        self._seq = 0

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        """Answer the states; see :class:`forcebound.nodes.Node`."""
        commands: list[Packet] = []
        for state in received:
            if type(state) is DeviceState:
                force = self._wall.force("", state.position, state.velocity, state.elapsed)
                commands.append(ForceCommand(self._seq, time_ns, state.seq, state.time_ns, force))
                self._seq += 1
        return commands


def drive(runner: Runner, node: DeviceNode, spin_ns: int, count: int) -> None:
    """Run ``count`` ticks that count and write their durations to standard output.

    Args:
        runner: Of ``node``.
        node: The servo, engaged.
        spin_ns: Of its waits, in ns.
        count: Ticks.
    """
    durations_ns: list[int] = []
    index = -WARMUP
    missed, watch = 0, Stopwatch()
    deadline_ns = time.monotonic_ns() + round(READY * 1e9)
    while index < count:
        if index == 0:
            durations_ns.clear()
            missed, watch = node.deadline_misses, Stopwatch()
        begun_ns = wait_until(node.wake_ns, spin_ns)  # to read and publish the state
        runner.turn(begun_ns)
        spent_ns = time.monotonic_ns() - begun_ns
        begun_ns = wait_until(node.wake_ns, spin_ns)  # to receive, bound and write
        runner.turn(begun_ns)
        durations_ns.append(spent_ns + time.monotonic_ns() - begun_ns)
        if runner.status()["ready"] if index == -WARMUP else True:
            index += 1
        elif begun_ns > deadline_ns:
            sys.exit("the servo got no answer: the answering process is missing")
    watch.write_times(durations_ns, node.deadline_misses - missed)


def main(role: str, folder: Path, core: int, policy: str, period_ns: int, count: int) -> None:
    """Run one of the two processes; only the device ends by itself."""
    enter_contestant()
    settings = Settings(policy=policy, core=core)
    if role == "controller":
        run(AnswerNode(), role, folder, {}, settings, Stop())
        return
    measure(PhantomPremium15(), SinusoidalHand(), folder, settings, period_ns, count)
    os._exit(0)  # without waiting for the sockets


def measure(
    model: DeviceModel,
    operator: Operator | None,
    folder: Path,
    settings: Settings,
    period_ns: int,
    count: int,
    reply_wait: float = ServoSettings.reply_wait,
) -> None:
    """Open a device and run ticks of its node; see :func:`drive`."""
    servo = ServoSettings(rate=1e9 / period_ns, reply_wait=reply_wait)
    device = model.open(operator, servo.opening_hold)
    node = DeviceNode(device, dissipation_of(model, servo), servo)
    enter(settings, "device")
    runner = Runner(node, "device", folder, {}, Network(), settings.spin_ns)
    node.engage()
    freeze_garbage()
    drive(runner, node, settings.spin_ns, count)
    device.close()


if __name__ == "__main__":
    _role, _folder, _core, _policy, _period_ns, _count = sys.argv[1:]
    main(_role, Path(_folder), int(_core), _policy, int(_period_ns), int(_count))
