"""A device behind its bounder: stamps, cuts, hold limits and joints, by a device that notes all."""

import math
from dataclasses import replace

import pytest
from builders import MS
from msgspec.structs import replace as changed

from forcebound.haptics.devices import Device
from forcebound.haptics.laws import Dissipation
from forcebound.messages.packets import Vector
from forcebound.nodes.bounded_device import BoundedDevice

DISSIPATION = Dissipation(
    damping=0.27, friction=0.12, resolution=0.0, period=1e-3, hold_limit=1.02e-3, saturation=8.5
)


class Silent(Device):
    """A device without any optional member."""

    def __init__(self, axes: int = 1) -> None:
        self.axes = axes
        self.position: Vector = (0.0,) * axes
        self.written: list[Vector] = []

    def read(self, time_ns: int) -> Vector:
        return self.position

    def write(self, time_ns: int, force: Vector) -> Vector:
        self.written.append(force)
        return force


class Told(Silent):
    """A device that can be given a hold limit, and notes it with the writes."""

    def __init__(self) -> None:
        super().__init__()
        self.limits: list[float] = []

    def set_hold_limit(self, seconds: float) -> float:
        self.limits.append(seconds)
        return seconds


class Clamping(Told):
    """A device that holds no force for less than 2 ms."""

    def set_hold_limit(self, seconds: float) -> float:
        return max(super().set_hold_limit(seconds), 2e-3)


class Stamping(Told):
    """A device whose writes take effect late."""

    time_ns = delay_ns = 0

    def stamps(self) -> tuple[int, int]:
        return self.time_ns, self.time_ns + self.delay_ns


class Uncertain(Stamping):
    """A device whose readings may be later than their stamps."""

    def latch_jitter(self) -> int:
        return 100_000


class Cutting(Uncertain):
    """A device that drops each force 1.02 ms after its write, and reports it."""

    def cut(self) -> tuple[int, Vector]:
        return self.time_ns - 2 * MS + 1_020_000, self.position


class Fresh(Silent):
    """A device whose writes bring a reading, and whose reads are noted."""

    fresh: Vector | None = None

    def __init__(self) -> None:
        super().__init__()
        self.reads = 0

    def read(self, time_ns: int) -> Vector:
        self.reads += 1
        return self.position

    def fresh_reading(self) -> Vector | None:
        return self.fresh


class Lever:
    """Two levers of 0.5 m and 0.25 m, at right angles to their forces."""

    def position(self, angles: Vector) -> Vector:
        return (0.5 * angles[0], 0.25 * angles[1])

    def torque(self, angles: Vector, force: Vector) -> Vector:
        return (0.5 * force[0], 0.25 * force[1])


class Arm(Silent):
    """An arm of two levers."""

    kinematics = Lever()


def bounded(device: Silent, law: str = "none", learns: bool = True) -> BoundedDevice:
    made = BoundedDevice(device, law, DISSIPATION, learns)
    made.begin()
    return made


@pytest.mark.parametrize("learns", [False, True])
def test_a_force_is_planned_for_the_hold_limit_that_the_device_has_set(learns: bool) -> None:
    def limit_of(device: Silent, dissipation: Dissipation, learns: bool) -> tuple[float, float]:
        node = BoundedDevice(device, "certified", dissipation, learns)
        node.begin()
        for tick in range(20):
            device.position = (tick * 1e-3,)
            node.write(tick * MS, (8.5,), 1.0)
        return node.bounder.limit, node.report().hold_limit

    clamped = limit_of(Clamping(), DISSIPATION, learns)
    as_stated = limit_of(Silent(), replace(DISSIPATION, hold_limit=2e-3), learns=False)
    assert clamped == pytest.approx(as_stated)
    assert clamped < limit_of(Told(), DISSIPATION, learns)


def test_no_force_before_it_engages_whatever_is_commanded() -> None:
    device = Silent()
    node = BoundedDevice(device, "none", DISSIPATION, learns=False)
    for tick in range(3):
        assert node.write(tick * MS, (2.0,), 1.0).applied == (0.0,)
    node.begin()
    forces = [node.write(tick * MS, (2.0,), 1.0).applied for tick in range(3, 6)]
    assert forces == [(0.0,), (2.0,), (2.0,)]  # the ledger begins with the first


def test_another_law_begins_a_new_ledger_and_keeps_what_the_last_one_has_met() -> None:
    device = Silent()
    node = bounded(device, "certified")
    for tick in range(20):
        device.position = (math.nan,) if tick % 5 == 4 else (1e-4 * tick,)
        node.write((2 * tick if tick > 10 else tick) * MS, (0.0,), 1.0)
    before = node.report()
    assert (before.overruns, before.refused_readings) == (9, 4)
    assert node.bounder.estimated_energy > 0.0
    node.change_law("certified_fading")
    device.position = (2e-3,)
    node.write(60 * MS, (0.0,), 1.0)
    assert node.bounder.estimated_energy == 0.0
    after = node.report()
    assert after.hold_limit == pytest.approx(before.hold_limit)
    assert changed(after, hold_limit=before.hold_limit) == before
    device.position = (math.nan,)
    node.write(61 * MS, (0.0,), 1.0)
    assert node.report().refused_readings == node.refused_readings == 5


@pytest.mark.parametrize(
    ("device", "learns", "learned", "limit"),
    [
        (Told(), True, True, 1.02e-3),
        (Told(), False, False, 1.02e-3),
        (Silent(), True, False, 1.25e-3),
    ],
    ids=["learned", "of the launch file", "fixed"],
)
def test_the_first_hold_limit(device: Silent, learns: bool, learned: bool, limit: float) -> None:
    node = bounded(device, learns=learns)
    assert node.learns == learned
    assert node.report().hold_limit == pytest.approx(limit)
    if isinstance(device, Told):
        assert device.limits[-1] == pytest.approx(limit)


def test_a_watchdog_that_may_be_early_is_given_a_longer_limit() -> None:
    device = Told()
    BoundedDevice(device, "none", replace(DISSIPATION, watchdog_tolerance=0.2), learns=True)
    assert 0.8 * device.limits[-1] == pytest.approx(1.02e-3)


def write_late(node: BoundedDevice, device: Stamping, ticks: int) -> None:
    """Write each millisecond; every other force acts 0.2 ms after its reading."""
    for tick in range(ticks):
        device.time_ns = tick * MS
        device.delay_ns = 200_000 * (tick % 2)
        node.write(device.time_ns, (0.0,), 1.0)


def test_the_limit_follows_the_time_between_writes_not_between_readings() -> None:
    device = Stamping()
    write_late(bounded(device), device, 2000)
    assert device.limits[-1] >= 1.2e-3


def test_writes_later_than_the_device_states_are_counted() -> None:
    device = Stamping()
    node = bounded(device)
    write_late(node, device, 10)
    assert node.report().late_writes == 5
    assert node.report().longest_write_delay == pytest.approx(2e-4)


def test_a_way_of_uncertain_duration_is_taken_for_the_slowest() -> None:
    losses = []
    for device in (Stamping(), Uncertain()):
        node = bounded(device, "certified")
        for tick in range(2):
            device.time_ns, device.position = tick * MS, (0.01 * tick,)
            node.write(device.time_ns, (0.0,), 1.0)
        losses.append(node.bounder.estimated_energy - 0.12 * 0.01)
    certain, uncertain = losses
    assert certain == pytest.approx(0.27 * 0.01**2 / 1.0e-3)
    assert uncertain == pytest.approx(0.27 * 0.01**2 / 1.1e-3)


def test_a_reported_cut_is_on_the_clock_of_the_bounder() -> None:
    """The hand moves with the force until it is cut, and rests there."""
    device = Cutting()
    node = BoundedDevice(device, "certified", replace(DISSIPATION, watchdog="reporting"), False)
    node.begin()
    for tick in range(20):  # the bounder's clock runs 2 ms ahead
        device.time_ns, device.position = 2 * tick * MS, (0.005 * tick,)
        node.write(device.time_ns, (1.0 if tick == 19 else 0.0,), 1.0)
    before, (force,) = node.bounder.estimated_energy, device.written[-1]
    assert force == 1.0
    device.time_ns, device.position = 40 * MS, (0.095 - 1e-3,)
    node.write(device.time_ns, (0.0,), 1.0)
    loss = 0.27 * 1e-3**2 / 1.02e-3 + 0.12 * 1e-3
    assert node.bounder.estimated_energy == pytest.approx(before + loss - force * 1e-3)


def test_forces_of_a_new_law_depend_on_nothing_before_it() -> None:
    changed, fresh = Stamping(), Stamping()
    node = bounded(changed, "none")
    write_late(node, changed, 2000)
    assert changed.limits[-1] >= 1.2e-3
    node.change_law("certified")
    results = []
    for device, one in ((changed, node), (fresh, bounded(fresh, "certified"))):
        written = []
        for tick in range(2000, 2300):
            device.time_ns, device.delay_ns = tick * MS, 200_000 * (tick % 2)
            device.position = (1e-3 * math.sin(0.1 * tick),)
            written.append((one.write(device.time_ns, (5.0,), 1.0), one.bounder.estimated_energy))
        results.append(written)
    assert results[0] == results[1]
    assert changed.limits[-1] == fresh.limits[-1] > 1.2e-3


def test_uncertain_readings_leave_the_time_from_reading_to_writing_as_it_is() -> None:
    device = Uncertain()
    node = bounded(device)
    for tick in range(10):
        device.time_ns, device.delay_ns = tick * MS, 200_000
        written = node.write(device.time_ns, (0.0,), 1.0)
        assert (written.read_ns, written.write_ns) == device.stamps()  # of the device's clock
        assert written.ahead_ns == (tick + 1) * 100_000
    assert node.report().longest_write_delay == pytest.approx(2e-4)


def test_a_fresh_reading_serves_a_state_and_never_the_ledger() -> None:
    device = Fresh()
    node = bounded(device)
    device.position, device.fresh = (0.002,), (0.001,)
    assert node.read(0) == (0.001,)
    assert device.reads == 0
    assert node.write(0, (0.0,), 1.0).position == (0.002,)
    assert device.reads == 1
    device.fresh = None
    assert node.read(0) == (0.002,)
    assert device.reads == 2


def test_an_arm_takes_torques_and_shows_the_force_at_its_tip() -> None:
    arm = Arm(axes=2)
    node = bounded(arm)
    arm.position = (0.1, 0.2)
    assert node.read(0) == (0.05, 0.05)
    node.write(0, (0.0, 0.0), 1.0)
    written = node.write(MS, (2.0, 4.0), 1.0)
    assert arm.written[-1] == (1.0, 1.0)
    assert written.position == (0.05, 0.05)
    assert written.applied == pytest.approx((2.0, 4.0))


def test_the_torques_of_an_arm_saturate_in_their_direction_and_the_ramp_comes_after() -> None:
    arm = Arm(axes=2)
    node = bounded(arm)
    node.write(0, (0.0, 0.0), 1.0)
    written = node.write(MS, (300.0, 800.0), 1.0)
    assert math.hypot(*arm.written[-1]) == pytest.approx(8.5)
    assert arm.written[-1][0] / arm.written[-1][1] == pytest.approx(0.75)
    assert written.applied[0] / written.applied[1] == pytest.approx(0.375)
    node.write(2 * MS, (300.0, 800.0), 0.1)
    assert math.hypot(*arm.written[-1]) == pytest.approx(0.85)


def test_a_torque_that_is_no_number_becomes_none() -> None:
    arm = Arm(axes=2)
    node = bounded(arm)
    node.write(0, (0.0, 0.0), 1.0)
    node.write(MS, (math.inf, 1.0), 1.0)
    assert arm.written[-1] == (0.0, 0.0)


def test_the_bounder_limits_the_torques_of_an_arm() -> None:
    arm = Arm(axes=2)
    node = bounded(arm, law="certified")
    node.write(0, (0.0, 0.0), 1.0)
    written = node.write(MS, (2.0, 4.0), 1.0)
    assert 0.0 < math.hypot(*arm.written[-1]) <= 0.12
    assert math.hypot(*written.applied) == pytest.approx(written.limit)
