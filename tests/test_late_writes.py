"""Forces that do not act yet when the next reading comes, or when another ledger begins.

The hand moves back only while a force acts, as fast as pays best: it takes what a ledger forgets.
"""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from builders import MS

import forcebound as fb
from forcebound.errors import ConfigError
from forcebound.haptics.devices import Device
from forcebound.haptics.laws import ENERGY_TOLERANCE, Dissipation, ForceBounder
from forcebound.haptics.laws.ledger import PLACES, Axis, Ledger
from forcebound.messages.packets import Vector
from forcebound.nodes.bounded_device import BoundedDevice

CERTIFIED = ["certified", "certified_fading"]
DAMPING, FRICTION, FASTEST = 0.27, 0.12, 4.0  # N s/m, N, m/s


def described(**fields: object) -> Dissipation:
    fixed = {"damping": DAMPING, "friction": FRICTION, "resolution": 0.0, "saturation": 8.5}
    return Dissipation(**{"period": 1e-3, "hold_limit": 2e-3, **fixed, **fields})  # type: ignore[arg-type]


class Hand:
    """The motor with a lag, without mass, and a hand on it; the energy that the hand has put in."""

    def __init__(self, lag: float = 0.0) -> None:
        self.lag, self.force, self.target = lag, 0.0, 0.0
        self.position = self.energy = self.lowest = 0.0

    def move(self, seconds: float, speed: float | None = None) -> None:
        """Move at a speed, in m/s; None: back, as pays best while the force acts."""
        pieces = 40 if self.lag > 0.0 else 1
        for _ in range(pieces if seconds > 0.0 else 0):
            step = seconds / pieces
            left = math.exp(-step / self.lag) if self.lag > 0.0 else 0.0
            away = self.force - self.target
            mean = self.target + away * (1.0 - left) * self.lag / step
            best = -math.copysign(max(abs(mean) - FRICTION, 0.0) / (2.0 * DAMPING), mean)
            v = min(max(best, -FASTEST), FASTEST) if speed is None else speed
            self.energy += (DAMPING * v * v + FRICTION * abs(v) + mean * v) * step
            self.position += v * step
            self.force = self.target + away * left
            self.lowest = min(self.lowest, self.energy)


def attacked(
    law: str, delays: "np.ndarray", stated: float, intervals: "np.ndarray", **fields: object
) -> tuple[float, float]:
    """Return the lowest energy of a hand that moves in at 4 m/s, then takes what it can.

    And the most that late writes can have given.

    ``delays``: from each reading to the effect of its force, ``intervals`` between readings, in s.
    """
    asks = intervals < delays  # where the next reading comes before the force acts
    asks |= not asks.any()
    limit = float(intervals.max() + stated + 1e-4)  # no force is cut
    bounder = ForceBounder(law, described(hold_limit=limit, write_delay=stated, **fields))
    hand = Hand()
    readings = np.concatenate([[0.0], np.cumsum(intervals)])
    effects: list[tuple[float, float]] = []
    bounder.start(0, (0.0,))
    for k, (now, after) in enumerate(pairwise(readings)):
        now_ns = round(now * 1e9)
        if k > 0:
            (force,) = bounder.bound(
                now_ns, (hand.position,), (8.5 if k > 20 and asks[k] else 0.0,)
            )
            effect_ns = now_ns + round(delays[k] * 1e9)
            bounder.settle((force,), effect_ns)
            effects = [one for one in effects if one[0] < effect_ns * 1e-9]
            effects.append((effect_ns * 1e-9, force))
        time = now
        while time < after:
            end = min(after, effects[0][0]) if effects else after
            hand.move(end - time, FASTEST if k <= 20 else None)
            time = end
            if effects and effects[0][0] <= time:
                hand.target = hand.force = effects.pop(0)[1]
    assert (bounder.late_writes == 0) == (stated >= delays.max())
    assert (bounder.largest_allowance == 0.0) or bounder.late_writes > 0
    return hand.lowest, bounder.largest_allowance


@pytest.mark.parametrize("law", CERTIFIED)
@pytest.mark.parametrize(
    ("delay", "varies", "jitter"),
    [(share, 0.0, 0.0) for share in (0.4, 0.9, 1.0, 1.2, 1.5, 1.9, 2.5)]
    + [(share, 0.5, 0.2) for share in (0.9, 1.5, 2.5)]
    + [(0.4, 0.0, 0.2), (0.4, 0.0, 0.35), (0.6, 0.0, 0.3), (0.9, 0.0, 0.2)],
)
def test_a_force_on_its_way_is_paid_for(
    law: str, delay: float, varies: float, jitter: float
) -> None:
    random = np.random.default_rng(3)
    delays = 1e-3 * delay * (1.0 - varies * random.random(200))
    shifts = jitter * random.choice([-1.0, 1.0], 201)  # of the ticks, early or late
    intervals = 1e-3 * (1.0 + np.diff(shifts))
    lowest, _ = attacked(law, delays, 1e-3 * delay, intervals)
    assert lowest >= -ENERGY_TOLERANCE


@pytest.mark.parametrize("law", CERTIFIED)
@pytest.mark.parametrize("stated", [0.0, 4e-4, 1e-3])
def test_what_a_write_that_is_later_than_stated_can_have_given_is_known(
    law: str, stated: float
) -> None:
    delays, intervals = np.full(200, 1.9e-3), np.full(200, 1e-3)
    lowest, owed = attacked(law, delays, stated, intervals)
    assert lowest >= -owed
    assert lowest < -1e-6 or stated > 0.0


def test_a_late_write_is_paid_where_a_force_was_planned_for_longer() -> None:
    delays, intervals = np.full(200, 1.9e-3), np.full(200, 1e-3)
    watchdog = {"watchdog": "none", "watchdog_limit": 0.1}
    lowest, owed = attacked("certified", delays, 4e-4, intervals, **watchdog)
    assert owed == 0.0
    assert lowest >= -ENERGY_TOLERANCE


@pytest.mark.parametrize("delay", ["1.2 ms", "1.5 ms", "2.5 ms"])
def test_a_wall_behind_late_writes_gives_nothing_and_less_force_the_later(
    tmp_path: Path, delay: str
) -> None:
    run = fb.simulate(wall_behind(tmp_path, "1 kHz", delay))
    assert run.figures.true_energy_min >= -ENERGY_TOLERANCE
    punctual = fb.simulate(wall_behind(tmp_path, "1 kHz", "1 ms"))
    assert 0.3 < run.figures.displayed_stiffness / punctual.figures.displayed_stiffness < 1.0


def test_two_kilohertz_with_the_write_delay_of_an_odrive_gives_nothing(tmp_path: Path) -> None:
    run = fb.simulate(wall_behind(tmp_path, "2 kHz", "600 us"))
    assert run.figures.true_energy_min >= -ENERGY_TOLERANCE
    lagging = fb.simulate(wall_behind(tmp_path, "2 kHz", "600 us", "500 us"))
    assert lagging.figures.true_energy_min >= -ENERGY_TOLERANCE


def wall_behind(folder: Path, rate: str, delay: str, lag: str = "0 s") -> Path:
    """Return a launch file of a stiff wall whose answers are late, too."""
    file = folder / "late.yaml"
    file.write_text(
        f"""forcebound: 1
seed: 1
duration: 2 s
device:
  {{ kind: phantom_premium_1_5, rate: {rate}, write_delay: {delay}, lag: {lag}, watchdog: silent }}
operator: {{ kind: pressing, start: -10 mm, end: 14 mm, approach_speed: 200 mm/s }}
controller: {{ kind: direct }}
environment: {{ kind: wall, stiffness: 10 N/mm, position: 10 mm }}
links: {{ environment_query: {{ delay: 5 ms }}, environment_reply: {{ delay: 5 ms }} }}
"""
    )
    return file


def test_a_device_slower_than_the_ledger_has_places_for_is_refused() -> None:
    with pytest.raises(ConfigError) as refused:
        described(write_delay=6.1e-3)
    assert refused.value.field == "write_delay"


def test_without_a_place_for_a_force_it_is_zero_and_counted() -> None:
    """Readings far oftener than stated: so many forces are on their way at once."""
    bounder = ForceBounder("certified", described(write_delay=4e-3))
    bounder.start(0, (0.0,))
    forces = []
    for k in range(1, 40):
        force = bounder.bound(k * 100_000, (k * 1e-3,), (8.5,))
        forces.append(force[0])
        bounder.settle(force, k * 100_000 + 4 * MS)
    assert bounder.crowded_writes == 39 - (PLACES - 1)
    assert all(forces[2 : PLACES - 1])
    assert not any(forces[PLACES - 1 :])
    # They act in turn; then there are places again.
    assert bounder.bound(9 * MS, (0.04,), (8.5,))[0] > 0.0


class Lagging(Device):
    """A motor whose writes act late, and then with a lag; 1 kHz."""

    axes = 1

    def __init__(self, hand: Hand, delay_ns: int) -> None:
        self.hand, self.delay_ns, self.now_ns = hand, delay_ns, 0
        self.effects: list[tuple[int, float]] = []

    def read(self, time_ns: int) -> Vector:
        return (self.hand.position,)

    def write(self, time_ns: int, force: Vector) -> Vector:
        self.now_ns = time_ns
        self.effects.append((time_ns + self.delay_ns, force[0]))
        return force

    def stamps(self) -> tuple[int, int]:
        return self.now_ns, self.now_ns + self.delay_ns

    def go(self, until_ns: int, speed: float | None) -> None:
        while self.now_ns < until_ns:
            end = min([until_ns, *(ns for ns, _ in self.effects[:1])])
            self.hand.move((end - self.now_ns) * 1e-9, speed)
            self.now_ns = end
            if self.effects and self.effects[0][0] <= end:
                self.hand.target = self.effects.pop(0)[1]
                if self.hand.lag == 0.0:
                    self.hand.force = self.hand.target


@pytest.mark.parametrize(
    ("lag", "delay_ns"), [(2e-3, 0), (1e-3, 0), (0.0, 2_500_000), (2e-3, 600_000)]
)
def test_a_new_ledger_waits_until_the_motor_has_no_force(lag: float, delay_ns: int) -> None:
    hand = Hand(lag)
    device = Lagging(hand, delay_ns)
    stated = described(
        hold_limit=5e-3, lag=lag, write_delay=delay_ns * 1e-9, watchdog="none", watchdog_limit=5e-3
    )
    node = BoundedDevice(device, "certified", stated, learns=False)
    node.begin()
    begun, pushed = None, 0.0
    for k in range(200):
        force = (8.5,) if 30 < k < 35 else (0.0,)
        pushed = max(pushed, abs(node.write(k * MS, force, 1.0).applied[0]))
        if begun is None and k >= 35 and not node.holds_force:
            begun = k
            assert abs(hand.force) < 1e-6
            assert not any(force for _, force in device.effects)
            node.change_law("certified")
            device.go((k + 1) * MS, 0.0)
            before = hand.energy
            hand.lowest = math.inf
            continue
        device.go((k + 1) * MS, FASTEST if k < 30 else None)
    assert pushed > 1.0
    assert begun is not None
    assert hand.lowest - before >= -ENERGY_TOLERANCE


class Jittering(Lagging):
    """One whose readings may be later than their stamps; they are not."""

    def latch_jitter(self) -> int:
        return 100_000


@pytest.mark.parametrize("delay_ns", [1_100_000, 1_500_000, 2_200_000])
def test_a_force_on_its_way_acts_no_earlier_because_a_reading_may_be_late(delay_ns: int) -> None:
    """The hand resists only until the ledger takes the next force for the acting one."""
    hand = Hand()
    device = Jittering(hand, delay_ns)
    stated = described(hold_limit=20e-3, write_delay=delay_ns * 1e-9)
    node = BoundedDevice(device, "certified", stated, learns=False)
    node.begin()
    speed, applied, ago = 4.0, [0.0] * 3, delay_ns // MS + 1
    for k in range(72):
        is_on = 4 <= k < 64 and k % 4 < 2
        before = hand.energy
        force = (8.5 if k == 71 else 2.0 if is_on else 0.0,)
        applied.append(node.write(k * MS, force, 1.0).applied[0])
        assert node.bounder.estimated_energy <= before + ENERGY_TOLERANCE or k == 0
        step = applied[-ago] - applied[-ago - 1]
        device.go((k + 1) * MS, speed if k < 3 else math.copysign(speed, step) if step else 0.0)
    device.go(device.now_ns + delay_ns + 20 * MS, None)
    assert applied[-1] > 0.5
    assert hand.lowest >= -ENERGY_TOLERANCE


@pytest.mark.parametrize("lag", [1e-3, 3e-3])
def test_a_lagging_motor_settles_no_more_because_a_reading_may_be_late(lag: float) -> None:
    """The hand goes with the force while it rises, against it while it falls."""
    hand = Hand(lag)
    device = Jittering(hand, 0)
    stated = described(hold_limit=20e-3, lag=lag, watchdog="none", watchdog_limit=20e-3)
    node = BoundedDevice(device, "certified", stated, learns=False)
    node.begin()
    pushed = 0.0
    for k in range(300):
        is_on = k >= 4 and k // 10 % 2 == 0
        before = hand.energy
        written = node.write(k * MS, (3.0 if is_on else 0.0,), 1.0)
        pushed = max(pushed, written.applied[0])
        assert node.bounder.estimated_energy <= before + ENERGY_TOLERANCE or k == 0
        device.go((k + 1) * MS, 0.6 if k < 4 else 1.0 if is_on else -1.0)
    assert pushed > 1.0


@pytest.mark.parametrize("law", CERTIFIED)
@pytest.mark.parametrize("watchdog", ["silent", "reporting"])  # whose reports are lost
def test_after_a_cut_at_an_unknown_time_a_lagging_motor_is_not_taken_as_known(
    law: str, watchdog: str
) -> None:
    bounder = ForceBounder(
        law, described(hold_limit=1e-3, lag=1e-3, watchdog=watchdog, watchdog_tolerance=0.3)
    )
    hand, now_ns, forces = Hand(1e-3), 0, []
    bounder.start(0, (0.0,))
    bounder.settle((0.0,), 0)

    def tick(ns: int, speed: float | None, commanded: float) -> None:
        nonlocal now_ns
        hand.move(min(ns, 700_000) * 1e-9, speed)
        if ns > 700_000:
            hand.target = 0.0  # cut, early
            hand.move((ns - 700_000) * 1e-9, speed)
        now_ns += ns
        (force,) = bounder.bound(now_ns, (hand.position,), (commanded,))
        bounder.settle((force,), now_ns)
        hand.target = force
        forces.append(force)
        assert bounder.estimated_energy <= hand.energy + ENERGY_TOLERANCE

    for _ in range(26):  # a force that is held too long by a hand at rest, which then moves on
        tick(690_000, FASTEST, 0.5)
        tick(1_250_000, 0.0, 0.0)
    for _ in range(8):
        tick(690_000, None, 8.5)
    assert forces[0] > 0.0
    assert hand.lowest >= -ENERGY_TOLERANCE
    for _ in range(60):  # 20 time constants later there is force again
        tick(690_000, FASTEST, 8.5)
    assert forces[-1] > 1.0


def test_a_report_at_the_time_of_the_last_reading_is_not_one_of_the_force_that_began_then() -> None:
    stated = described(write_delay=2e-3, watchdog="reporting")
    bounder, energy, forces = ForceBounder("certified", stated), 0.0, [0.0, 0.0]
    bounder.start(0, (0.0,))
    for k in range(1, 40):
        force = forces[k - 2] if k > 2 else 0.0  # each acts exactly at a reading
        energy += (DAMPING * 16.0 + FRICTION * 4.0 + force * 4.0) * 1e-3
        if k == 31:
            bounder.report_cut(30 * MS, (0.12,))
        bounded = bounder.bound(k * MS, (k * 4e-3,), (-3.0 if k > 27 else 0.0,))
        bounder.settle(bounded, (k + 2) * MS)
        forces.append(bounded[0])
        assert bounder.estimated_energy <= energy + ENERGY_TOLERANCE
    assert forces[-1] == -3.0


def test_what_a_late_force_leaves_in_a_lagging_motor_is_in_the_largest_allowance() -> None:
    stated = described(lag=1e-3, watchdog="none", watchdog_limit=50e-3, allowance=0.5)
    bounder, hand = ForceBounder("certified", stated), Hand(1e-3)
    bounder.start(0, (0.0,))
    bounder.settle((0.0,))
    now_ns = 0
    for k in range(70):
        ns = 2_500_000 if k == 40 else MS
        hand.move(ns * 1e-9, 0.05 if k < 40 else None)
        now_ns += ns
        force = bounder.bound(now_ns, (hand.position,), (8.5 if k < 40 else 0.0,))
        bounder.settle(force)
        hand.target = force[0]
    assert hand.lowest < -1e-4
    assert -hand.lowest <= bounder.largest_allowance < -2.0 * hand.lowest


def test_the_table_of_what_the_ledger_remembers_has_every_state() -> None:
    page = (Path(__file__).parents[1] / "docs" / "theory.md").read_text()
    section = page.split("### 3.8")[1].split("## 4.")[0]
    states = set(Ledger.__annotations__) - {"axis", "constants"}
    first = list(Ledger.__annotations__).index("axes")
    last = list(Ledger.__annotations__).index("state")
    states -= set(list(Ledger.__annotations__)[first:last]) - {"planned_limit"}
    states |= set(Axis.__annotations__) - {"constants"}
    assert {name for name in states if f"`{name}`" not in section} == set()
