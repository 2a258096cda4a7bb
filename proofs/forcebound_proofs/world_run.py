"""One run through a world: live nodes in virtual time, a hand in space, a bad link.

Law, safety chain, controller and environment are those of every run. The device is the simulated
one; it dissipates exactly what the law is informed of, so no law has a hidden reserve. Its energies
are looked at four times a period.
"""

import math
from dataclasses import dataclass

from forcebound.graph.servo import ServoSettings, dissipation_of
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.devices.simulated import SimulatedDevice
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws import check_law
from forcebound.messages.packets import TOPIC_OF, EnvironmentQuery, EnvironmentReply, Packet, Vector
from forcebound.network.impairment import Impairment
from forcebound.network.link import Link, link_seed
from forcebound.nodes.controller import ControllerNode
from forcebound.nodes.device import DeviceNode
from forcebound.nodes.environment import EnvironmentNode
from forcebound.run.simulation import LateTicks, Simulation
from forcebound_proofs.cases import LEAST_PEAK
from forcebound_proofs.world_cases import SURFACE, WATCHDOGS, WorldScenario

SECONDS = 0.25  # of a run
ENGAGE = 0.01  # s: soon at full force
START, ARRIVAL = SURFACE - 0.002, 0.03  # m, before the surface; s, until the hand presses
SHORTEST_LATE = 0.3e-3  # s
TRACE_COLUMNS = ("time", "position", "energy", "loss_and_work")  # SI units, of the first axis
_SIDES = 2  # energies are looked at in the middle and at the end of each stretch of a hold


@dataclass(frozen=True)
class SpaceHand(Operator):
    """A hand that goes from before the surface to ``pressing``, with a sine along each axis."""

    mass: float
    stiffness: float
    damping: float
    pressing: float  # m
    amplitudes: Vector  # m
    frequencies: Vector  # Hz

    def target(self, elapsed: float) -> Vector:
        """Return the target after ``elapsed`` s; see :class:`forcebound.haptics.hands.Operator`."""
        turn = 2.0 * math.pi * elapsed
        places = zip(self.amplitudes, self.frequencies, strict=True)
        first, *others = [a * math.cos(turn * f) for a, f in places]
        arrived = min(elapsed / ARRIVAL, 1.0)
        return (START + arrived * (self.pressing - START) - first, *others)


class WatchedDevice(SimulatedDevice):
    """A simulated device that keeps the lowest energies of its hand."""

    def __init__(self, model: PhantomPremium15, hand: SpaceHand, hold_limit: float) -> None:
        super().__init__(model, hand, hold_limit)
        self._half_mass = 0.5 * model.mass
        self.energy_min = 0.0  # J, of the hand
        self.lost_min = 0.0  # J, loss plus work: less the kinetic energy of the device
        self._earned = 0.0  # J, largest loss plus work
        self.share_left = 1.0  # lowest share left of the loss plus work so far
        self.peak_force = 0.0  # N
        self.looks: list[tuple[float, ...]] = []  # rows of TRACE_COLUMNS

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Hold ``force`` from now on; see :class:`forcebound.haptics.devices.Device`."""
        held = super().write(time_ns, force)
        self.peak_force = max(self.peak_force, math.hypot(*held))
        return held

    def _hold_until(self, time_ns: int) -> None:
        assert self._time_ns is not None
        begin_ns, step_ns = self._time_ns, (time_ns - self._time_ns) / _SIDES
        for side in range(1, _SIDES + 1):
            look_ns = time_ns if side == _SIDES else begin_ns + round(side * step_ns)
            super()._hold_until(look_ns)
            truth = self._body.truth()
            lost = truth.energy - self._half_mass * math.hypot(*truth.velocity) ** 2
            self.energy_min = min(self.energy_min, truth.energy)
            self.lost_min = min(self.lost_min, lost)
            self._earned = max(self._earned, lost)
            self.looks.append((look_ns * 1e-9, truth.position[0], truth.energy, lost))
            if self._earned > LEAST_PEAK:
                self.share_left = min(self.share_left, lost / self._earned)


def run_world(law: str, case: WorldScenario) -> WatchedDevice:
    """Run a case, and return its device with the energies that it has kept.

    Raises:
        ConfigError: If the law is not known.
    """
    check_law(law)
    numbers = case.numbers
    model, servo = device_of(case), servo_of(law, case)
    device = WatchedDevice(model, hand_of(case), servo.opening_hold)
    lateness = LateTicks(
        rate=numbers["late_rate"],
        shortest=SHORTEST_LATE,
        longest=numbers["lateness"],
        jitter=numbers["write_jitter"],
        seed=case.seed,
    ).of(servo)
    device_node = DeviceNode(device, dissipation_of(model, servo), servo, lateness=lateness)
    nodes = [
        EnvironmentNode(case.environment(), axes=case.axes),
        ControllerNode(case.open_controller()),
        device_node,
    ]
    simulation = Simulation(nodes, _links_of(case), lambda packet: None, ())
    for node in nodes:
        node.events.is_logged = False
    device_node.engage()
    end_ns = round(SECONDS * 1e9)
    try:
        simulation.run(end_ns)
    finally:
        for node in nodes:
            node.stop(end_ns)
            node.close()
    return device


def device_of(case: WorldScenario) -> PhantomPremium15:
    """Return the device of a case, which has just what it states."""
    numbers, axes = case.numbers, case.axes
    damping, friction = (
        tuple([numbers[name] * numbers[f"{name}_ratio"] ** axis for axis in range(axes)])
        for name in ("damping", "friction")
    )
    return PhantomPremium15(
        axes=axes,
        mass=numbers["mass"],
        damping=damping,
        friction=friction,
        resolution=numbers["resolution"],
        saturation=numbers["saturation"],
        watchdog=WATCHDOGS[int(numbers["watchdog"])],
    )


def hand_of(case: WorldScenario) -> SpaceHand:
    """Return the hand of a case."""
    numbers, others = case.numbers, range(1, case.axes)
    frequency, detuning = numbers["frequency"], numbers["detuning"]
    return SpaceHand(
        numbers["hand_mass"],
        numbers["hand_stiffness"],
        numbers["hand_damping"],
        SURFACE + numbers["pressing"],
        (numbers["amplitude"], *(numbers["sideways"] for _ in others)),
        (frequency, *(frequency * detuning**axis for axis in others)),
    )


def servo_of(law: str, case: WorldScenario) -> ServoSettings:
    """Return the servo of a case."""
    numbers = case.numbers
    return ServoSettings(
        law=law,
        reply_wait=numbers["reply_wait"],
        hold_limit=1.0 + numbers["excess_hold"] if numbers["excess_hold"] else "auto",
        engage_time=ENGAGE,
    )


def _links_of(case: WorldScenario) -> dict[str, Link[Packet]]:
    numbers = case.numbers
    impairment = Impairment(
        delay=numbers["link_delay"], jitter=numbers["delay_jitter"], loss=numbers["loss"]
    )
    if impairment == Impairment():
        return {}
    topics = [TOPIC_OF[kind] for kind in (EnvironmentQuery, EnvironmentReply)]
    return {topic: Link(impairment, link_seed(case.seed, topic)) for topic in topics}
