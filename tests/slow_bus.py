"""A device of a user's own on a slow bus, without stamps, whose motor's true energy is known.

Reading and writing take milliseconds of the clock, within which the reading is latched and the
force begins to act. Its clock is the test's, so that no machine decides what is late.
"""

import math
from dataclasses import dataclass, fields, replace
from random import Random
from typing import Any, Literal

from forcebound.graph.loader import load
from forcebound.graph.resolved import to_document
from forcebound.graph.servo import dissipation_of
from forcebound.haptics.devices import AxesModel, Device
from forcebound.haptics.hands import Operator
from forcebound.messages.packets import DeviceState, Event, ForceCommand, Packet, Telemetry, Vector
from forcebound.messages.topology import flat
from forcebound.nodes.device import DeviceNode
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.run.results import RunResult

RATE = 150.0  # Hz
WALL = 0.003  # m
STEP_NS = 20_000  # of the motion


@dataclass(frozen=True)
class SlowRail(AxesModel):
    """A mass on a damped rail that a springy hand presses forward, behind a slow bus."""

    axes: int = 1
    damping: float = 1.0  # N s/m
    friction: float = 0.1  # N
    resolution: float = 1e-5  # m
    saturation: float = 8.0  # N
    watchdog: Literal["none"] = "none"
    watchdog_limit: float = 0.1  # s
    write_delay: float = 3e-3  # s, as its user believes
    mass: float = 0.2  # kg
    read_time: float = 2e-3  # s
    write_time: float = 2.5e-3  # s
    latch: float = 0.5  # share of a read after which the reading is latched; below 0: anywhere
    has_stamps: bool = False  # true ones
    jitter: float = -1.0  # s, that it reports beside them; below 0: nothing

    def open(self, operator: Operator | None, hold_limit: float) -> "OpenRail":
        """Return the rail, on a clock of its own."""
        return OpenRail(self)


class OpenRail(Device):
    """The rail; ``now_ns`` is its clock, ``taken`` what its motor has taken of its motion, in J."""

    axes = 1

    def __init__(self, model: SlowRail) -> None:
        self.model = model
        self.now_ns = 1_000_000_000
        self.taken = self.least = 0.0
        self._x, self._v, self._force = 0.0, 0.0, 0.0
        self._moved_ns = self.now_ns
        self._engaged_ns: int | None = None
        self._random = Random(1)
        self._read_ns = self._acts_ns = self.now_ns

    def engage(self, time_ns: int) -> None:
        self._engaged_ns = time_ns

    def read(self, time_ns: int) -> Vector:
        model = self.model
        share = model.latch if model.latch >= 0.0 else self._random.random()
        self._read_ns = self.now_ns + round(1e9 * share * model.read_time)
        self._move(self._read_ns)
        reading = round(self._x / model.resolution) * model.resolution
        self.pass_until(self.now_ns + round(1e9 * model.read_time))
        return (reading,)

    def write(self, time_ns: int, force: Vector) -> Vector:
        took_ns = round(1e9 * self.model.write_time * self._random.uniform(0.8, 1.0))
        self._acts_ns = self.now_ns + took_ns
        self.pass_until(self._acts_ns)
        self._force = force[0]
        return force

    def stamps(self) -> tuple[int, int] | None:
        return (self._read_ns, self._acts_ns) if self.model.has_stamps else None

    def latch_jitter(self) -> int | None:
        return None if self.model.jitter < 0.0 else round(1e9 * self.model.jitter)

    def pass_until(self, time_ns: int) -> None:
        """Let the clock go on."""
        self._move(time_ns)
        self.now_ns = max(self.now_ns, time_ns)

    def _move(self, until_ns: int) -> None:
        model = self.model
        while self._moved_ns < until_ns:
            dt = min(STEP_NS, until_ns - self._moved_ns) * 1e-9
            elapsed = (
                0.0 if self._engaged_ns is None else (self._moved_ns - self._engaged_ns) * 1e-9
            )
            hand = 400.0 * (min(0.05 * elapsed, 0.010) - self._x) - 2.0 * self._v
            pushed = hand - self._force - model.damping * self._v
            stop = model.friction * dt / model.mass
            free = self._v + pushed * dt / model.mass
            moving = math.copysign(max(abs(free) - stop, 0.0), free)
            way = 0.5 * (self._v + moving) * dt
            self._v, self._x = moving, self._x + way
            self.taken += self._force * way
            self.least = min(self.least, self.taken)
            self._moved_ns += round(dt * 1e9)


def run_slow(
    law: str, stiffness: float, seconds: float, **numbers: Any
) -> tuple[OpenRail, RunResult]:
    """Press a rail into a wall behind its bus; return it, and the result as of a real device.

    ``numbers`` are those of the :class:`SlowRail` that differ, ``stiffness`` is in N/m.
    """
    config = load("stiff_wall", [f"law:={law}", f"stiffness:={stiffness} N/m"])
    model = SlowRail(**numbers)
    servo = replace(config.only.servo, rate=RATE)
    rail, packets = OpenRail(model), list[Packet]()
    node = DeviceNode(rail, dissipation_of(model, servo), servo, clock=lambda: rail.now_ns)
    node.engage()
    received: list[Packet] = []
    end_ns = rail.now_ns + round(seconds * 1e9)
    while rail.now_ns < end_ns:
        rail.pass_until(node.wake_ns)
        answered, received = received, []
        for packet in node.step(rail.now_ns, answered):
            packets.append(packet)
            if isinstance(packet, DeviceState):
                received.append(_answer(packet, rail.now_ns, stiffness))
    packets += node.last_events(rail.now_ns)
    columns = TelemetryColumns.from_packets([p for p in packets if isinstance(p, Telemetry)])
    document = flat(to_document(config))
    stated = {field.name: getattr(model, field.name) for field in fields(model)}
    document["device"] |= stated | {"rate": RATE}
    return rail, RunResult(columns, document, [p for p in packets if isinstance(p, Event)])


def _answer(state: DeviceState, now_ns: int, stiffness: float) -> ForceCommand:
    force = (stiffness * max(state.position[0] - WALL, 0.0),)
    return ForceCommand(state.seq, now_ns, state.seq, state.time_ns, force, state.time_ns)
