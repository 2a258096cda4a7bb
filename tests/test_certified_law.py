"""The certified laws: by hand, and against the truth on paths that a model of the hand never takes.

The audit (``test_audit.py``) drives them with simulated hands. Here the path itself is chosen, and
with it everything that a hand could ever do.
"""

import math
from dataclasses import dataclass, replace

import pytest
from bounding_traces import EXACT, PHANTOM, forces, run, steady
from builders import MS
from hypothesis import given, settings
from hypothesis import strategies as st

from forcebound.haptics.laws import LAWS, Dissipation, ForceBounder, play
from forcebound.haptics.laws.certified import FORGETTING
from forcebound.haptics.laws.hold_cost import hold_cost
from forcebound.messages.packets import Vector

CERTIFIED_LAWS = sorted(name for name, law in LAWS.items() if law.is_certified)
R = 1.5e-5  # m, half the resolution of the PHANToM
CAPABILITY = 216.0  # N/m, b / T_max of the PHANToM


@dataclass(frozen=True)
class Step:
    """One sample period of a chosen path."""

    elapsed_ns: int
    moves: tuple[Vector, ...]  # m, walked one after the other, in equal times
    error: Vector  # of the reading, in half resolutions
    asked: Vector  # N


class Truth:
    """Least that a device dissipates on a path, plus the work against its motor; no inertia."""

    def __init__(self, device: Dissipation, axes: int) -> None:
        self.device = device
        self.position = (0.0,) * axes
        self.loss_and_work = 0.0
        self.turnover = 0.0  # J, sum of magnitudes: what rounding is relative to
        self.lowest = 0.0

    def walk(self, move: Vector, duration: float, force: Vector) -> None:
        length = math.hypot(*move)
        lost = (
            self.device.least_damping * length**2 / duration + self.device.least_friction * length
        )
        work = sum(f * d for f, d in zip(force, move, strict=True))
        self.position = tuple(x + d for x, d in zip(self.position, move, strict=True))
        self.loss_and_work += lost + work
        self.turnover += lost + abs(work)
        self.lowest = min(self.lowest, self.loss_and_work)

    def hold(self, step: Step, force: Vector) -> None:
        """Walk the moves of ``step``; the force is dropped after the hold limit."""
        elapsed = step.elapsed_ns / 1e9
        part = elapsed / len(step.moves)
        for number, move in enumerate(step.moves):
            before = min(max(self.device.hold_limit - number * part, 0.0), part)
            share = before / part
            if share > 0.0:
                self.walk(tuple(share * d for d in move), before, force)
            if share < 1.0:
                self.walk(
                    tuple((1.0 - share) * d for d in move), part - before, (0.0,) * len(force)
                )


def walk(law: str, device: Dissipation, steps: list[Step], axes: int) -> tuple[Truth, list[float]]:
    """Return the truth after the path, and by how much it exceeded the law's belief each time.

    Rounding is in the law's favour: 1 cm in 1 ns loses more than 10 kJ, of which 1e-15 is much.
    """
    truth = Truth(device, axes)
    bounder = ForceBounder(law, device, axes)
    bounder.start(0, tuple(device.coarsest_resolution / 2.0 * e for e in steps[0].error))
    time_ns = 0
    force: Vector = (0.0,) * axes
    reserves: list[float] = []
    for step in steps[1:]:
        truth.hold(step, force)
        time_ns += step.elapsed_ns
        reading = tuple(
            x + device.coarsest_resolution / 2.0 * e
            for x, e in zip(truth.position, step.error, strict=True)
        )
        force = bounder.bound(time_ns, reading, step.asked)
        bounder.settle(force)
        rounding = 1e-15 * truth.turnover
        reserves.append(truth.loss_and_work - bounder.estimated_energy + rounding)
    return truth, reserves


@st.composite
def paths(draw: st.DrawFn) -> tuple[Dissipation, list[Step], int]:
    """Return a device, a path with jumps, creeping and overruns, and the number of axes."""
    axes = draw(st.integers(1, 3))
    device = Dissipation(
        damping=draw(st.sampled_from((0.01, 0.27, 3.0))),
        friction=draw(st.sampled_from((0.0, 0.003, 0.12, 1.0))),
        resolution=draw(st.sampled_from((0.0, 1e-6, 3e-5, 2e-4))),
        period=1e-3,
        hold_limit=draw(st.sampled_from((1e-3, 1.25e-3, 2e-3))),
        saturation=20.0,
    )
    length = draw(st.sampled_from((device.coarsest_resolution, 1e-4, 1e-2)))
    coordinate = st.sampled_from((-1.0, -0.5, -1e-6, 0.0, 1e-6, 0.5, 1.0)).map(length.__mul__)
    vector = st.tuples(*[coordinate] * axes)
    step = st.builds(
        Step,
        elapsed_ns=st.sampled_from((1, MS // 2, MS, 1_250_000, 2 * MS, 6 * MS)),
        moves=st.lists(vector, min_size=1, max_size=3).map(tuple),
        error=st.tuples(*[st.sampled_from((-1.0, -0.3, 0.0, 1.0))] * axes),
        asked=st.tuples(*[st.sampled_from((-20.0, -0.5, 0.0, 0.2, 20.0))] * axes),
    )
    return device, draw(st.lists(step, min_size=2, max_size=25)), axes


@pytest.mark.parametrize("law", CERTIFIED_LAWS)
@settings(max_examples=150)
@given(paths())
def test_on_any_path_the_true_energy_is_not_negative_nor_below_the_estimate(
    law: str, path: tuple[Dissipation, list[Step], int]
) -> None:
    truth, reserves = walk(law, *path)
    rounding = 1e-12 + 1e-14 * abs(truth.loss_and_work)  # a centimetre in a nanosecond: 27 kJ
    assert truth.lowest >= -rounding
    assert min(reserves) >= -rounding


# The path on which an overrun without a new start of the play operator would leak


class LedgerWithoutRestart:
    """The certified law for one axis, but after an overrun the play operator just follows."""

    def __init__(self, device: Dissipation) -> None:
        self.device = device
        self.r = device.coarsest_resolution / 2.0

    def start(self, reading: float) -> None:
        self.ledger = -self.device.least_friction * self.r
        self.reading = self.playing = reading
        self.force = 0.0

    def bound(self, elapsed: float, reading: float, asked: float) -> float:
        d, r = self.device, self.r
        capability = d.least_damping / d.hold_limit
        moved = reading - self.reading
        playing = play(reading, self.playing, r)
        if elapsed > d.hold_limit:
            excess = max(abs(self.force) - d.least_friction, 0.0)
            self.ledger -= excess**2 / (4 * capability) + r * abs(self.force)
            self.force = 0.0
        else:
            self.ledger += d.least_damping * max(abs(moved) - 2 * r, 0.0) ** 2 / elapsed
            self.ledger += d.least_friction * abs(playing - self.playing) + self.force * moved
        surplus = max(self.ledger - r * abs(self.force), 0.0)
        limit = min(d.least_friction + 2 * math.sqrt(capability * surplus), d.saturation)
        force = max(-limit, min(limit, asked))
        self.ledger -= r * abs(force - self.force)
        self.reading, self.playing, self.force = reading, playing, force
        return force


class Ours:
    """The certified law behind the same calls as :class:`LedgerWithoutRestart`."""

    def __init__(self, device: Dissipation) -> None:
        self.bounder = ForceBounder("certified", device)

    def start(self, reading: float) -> None:
        self.time_ns = 0
        self.bounder.start(0, (reading,))

    def bound(self, elapsed: float, reading: float, asked: float) -> float:
        self.time_ns += round(elapsed * 1e9)
        force = self.bounder.bound(self.time_ns, (reading,), (asked,))
        self.bounder.settle(force)
        return force[0]


def overrun_attack(law: LedgerWithoutRestart | Ours, cycles: int) -> float:
    """Return the true energy after overruns that cross one encoder cell each, and a last push.

    In each cut hold the hand crosses a cell and the friction of that way keeps the energy up. The
    play operator, still on the other side, follows with the next reading and credits it again.
    """
    device = PHANTOM
    r, tiny = device.coarsest_resolution / 2.0, 1e-12
    cell = 2.0 * r
    push = (
        device.least_friction + 4.0 * CAPABILITY * r
    )  # its worst displacement in a hold is one cell
    truth = Truth(device, 1)
    force = 0.0

    def go(move: float, elapsed: float, asked: float) -> None:
        """Walk evenly within the hold limit, then rest; the reading is the middle of the cell."""
        nonlocal force
        moving = min(elapsed, device.hold_limit)
        truth.walk((move,), moving, (force,))
        reading = cell * math.floor(truth.position[0] / cell + 0.5)
        force = law.bound(elapsed, reading, asked)

    law.start(0.0)
    for _ in range(400):  # creep down, and so earn by friction what the first push needs
        go(-cell, 1e-3, 0.0)
    go(-(r - tiny), 1e-3, 0.0)  # the lower edge of the cell
    direction = 1.0
    for _ in range(cycles):
        go(0.0, 1e-3, -direction * push)  # a force that pushes along ``direction``
        go(-direction * 2 * tiny, 1e-3, -direction * push)  # over the edge, against it
        go(direction * (cell - tiny), 6e-3, 0.0)  # the overrun: across the cell
        go(direction * 3 * tiny, 1e-3, 0.0)  # over the far edge: the play operator follows
        go(direction * (cell - 2 * tiny), 1e-3, 0.0)  # on to the edge after it
        direction = -direction
    go(0.0, 1e-3, -direction * device.saturation)
    largest = abs(force)
    worst = max(largest - device.least_friction, 0.0) / (2.0 * CAPABILITY)
    go(direction * worst, device.hold_limit, 0.0)
    return truth.loss_and_work


def test_without_a_new_start_of_the_play_operator_overruns_leak() -> None:
    assert overrun_attack(LedgerWithoutRestart(PHANTOM), 2000) < -1e-3


def test_overruns_that_cross_an_encoder_cell_leak_nothing() -> None:
    assert overrun_attack(Ours(PHANTOM), 2000) >= 0.0


@pytest.mark.parametrize("law", CERTIFIED_LAWS)
def test_the_anchors_do_not_earn_the_way_of_a_cut_hold_again(law: str) -> None:
    """Each overrun goes just so far that the motor has given all that it can.

    The ledger has paid for that, assuming the damping's loss on the way. Anchors from before the
    overrun would credit this loss a second time: 30 uJ in each of these cycles.
    """
    held, rest = 0.5, (0.0,)
    furthest = (held - PHANTOM.least_friction) / (2.0 * CAPABILITY)
    earn = Step(MS, ((1e-3,),), rest, rest)
    push = Step(MS, (rest,), rest, (-held,))
    overrun = Step(5 * MS, ((furthest,), rest, rest, rest), rest, rest)  # 1.25 ms, then rest
    settle = [Step(MS, (rest,), rest, rest)] * 2
    cycle = [push, overrun, *settle]
    truth, reserves = walk(law, PHANTOM, [earn] * 10 + cycle * 200, 1)
    assert truth.lowest >= 0.0
    assert min(reserves) >= -1e-12


# By hand


def test_a_regular_sample_by_hand() -> None:
    # 1 mm in 1 ms, at rest before: viscous loss of (1 mm - 2r), friction of (1 mm - r).
    ledger = -0.12 * R + 0.27 * (1e-3 - 2 * R) ** 2 / 1e-3 + 0.12 * (1e-3 - R)
    largest = 0.12 + 2 * math.sqrt(CAPABILITY * ledger)
    (row,) = run("certified", PHANTOM, steady([1e-3], [9.0]))
    assert row.limit == row.force[0] == pytest.approx(largest)
    assert row.energy == pytest.approx(ledger)  # what the change of force costs is paid next


def test_a_steady_press_by_hand_through_the_second_sample() -> None:
    first = 0.1
    # Over both samples the cell of the encoder is lost once: 2 mm - 2r in 2 ms.
    ledger = -0.12 * R + 0.27 * (2e-3 - 2 * R) ** 2 / 2e-3 + 0.12 * (2e-3 - R) - R * first
    ledger += first * 1e-3
    rows = run("certified", PHANTOM, steady([1e-3, 2e-3], [first, 9.0]))
    assert rows[1].limit == pytest.approx(0.12 + 2 * math.sqrt(CAPABILITY * (ledger - R * first)))


def test_an_overrun_is_a_force_that_steps_to_zero_at_the_hold_limit() -> None:
    start = 0.27 * (1e-3 - 2 * R) ** 2 / 1e-3 + 0.12 * (1e-3 - R) - 0.12 * R
    held, dt = 0.5, 2.5e-3
    mean = held * 1.25e-3 / dt
    # A rest of 2.5 ms: no loss; a detour beyond 2r slides twice.
    share = 1.25e-3 / 2.5e-3 * (dt - 1.25e-3)
    penalty = hold_cost(held, 2 * 0.12, 2 * R, 0.27, share)
    ledger = start - penalty - R * mean
    trace = [(MS, (1e-3,), (held,)), (2_500_000, (1e-3,), (9.0,))]
    row = run("certified", PHANTOM, trace)[1]
    assert row.limit == pytest.approx(0.12 + 2 * math.sqrt(CAPABILITY * (ledger - R * mean)))
    assert row.energy == pytest.approx(ledger - R * mean)


@pytest.mark.parametrize("law", CERTIFIED_LAWS)
def test_an_encoder_that_chatters_on_one_edge_earns_nothing(law: str) -> None:
    readings = [3e-5 * (i % 2) for i in range(1000)]
    rows = run(law, PHANTOM, steady(readings, [0.0] * 1000))
    assert rows[-1].energy <= 0.0  # one move of the play operator pays the start, at most


def test_the_fading_law_forgets_what_its_force_does_not_need() -> None:
    earned = 0.27 * 1e-3 + 0.12 * 1e-3  # J, by 1 mm in 1 ms
    kept = FORGETTING / (FORGETTING + 1e-3)
    needed = (0.5 - 0.12) ** 2 / (4 * 270.0)
    (row,) = run("certified_fading", EXACT, steady([1e-3], [0.5]))
    assert row.energy == pytest.approx(needed + kept * (earned - needed))
    rest = run("certified_fading", EXACT, steady([1e-3] * 1001, [0.5] * 1001))
    assert rest[-1].energy == pytest.approx(needed)
    assert run("certified", EXACT, steady([1e-3] * 1001, [0.5] * 1001))[-1].energy == earned


def test_a_slow_hand_earns_by_its_damping_what_single_samples_cannot_prove() -> None:
    step = 2 * R  # of the encoder, in each sample: from sample to sample it proves nothing
    exact = replace(PHANTOM, friction=0.0)
    readings = [step * i for i in range(1, 401)]
    energy = run("certified", exact, steady(readings, [0.0] * 400))[-1].energy
    lost = 0.27 * (step / 1e-3) ** 2 * 0.4
    assert 0.8 * lost < energy < lost


def test_without_quantisation_and_with_a_steady_clock_certified_is_the_exact_causal_bound() -> None:
    positions = [2e-3 * math.sin(i / 30) for i in range(1, 500)]
    asked = [5.0 * math.cos(i / 7) for i in range(1, 500)]
    certified = forces(run("certified", EXACT, steady(positions, asked)))
    assert certified == pytest.approx(forces(run("aol", EXACT, steady(positions, asked))))


def test_the_price_of_a_start_grows_with_the_axes() -> None:
    for axes in (1, 2, 3):
        bounder = ForceBounder("certified", PHANTOM, axes)
        assert bounder.estimated_energy == pytest.approx(-0.12 * R * math.sqrt(axes))
