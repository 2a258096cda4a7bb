"""What the runs of a method in a place amount to, and where the certified law loses."""

from collections.abc import Callable, Iterator, Sequence
from statistics import mean
from typing import NamedTuple, TypeAlias

from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound.lab.engine import Row
from forcebound.lab.views import groups
from forcebound.units import DB, HZ, N_MM, NUMBER, WHOLE, Everyday, N
from forcebound_proofs.attack import RANDOM, SEARCH
from forcebound_proofs.league.contest import CELL, ENERGY, MASS, TUNING
from forcebound_proofs.league.methods import CERTIFIED, OURS
from forcebound_proofs.league.places import CARRIER, FREE, PERSONS, SHAKER, TOUCHED, Place

#: kg, what a carrier feels of both; tests/test_cart_pendulum.py has the formula.
CUP_AND_BALL = 3.22
LITTLE = 1e-3  # J; a method that gave no more is compared with the certified law apart
LOST_BY = 0.05  # of the certified law's figure; less is not called a loss
Figure: TypeAlias = Callable[[Sequence[Row]], float | None]


class Score(NamedTuple):
    """A figure of a method in a place."""

    label: str
    unit: Everyday
    of: Figure  # of the runs in cells
    is_higher_better: bool
    least: float = 0.0  # difference, in SI units, that is called a loss

    def counted(self, value: float, place: Place) -> float:
        """Return a value as it is compared: a wall that feels stiffer than it is, is no better."""
        return min(value, place.stiffness) if self.unit is N_MM else value

    def show(self, value: float | None) -> str:
        """Return a value without its unit."""
        return "–" if value is None else self.unit.show(value).removesuffix(self.unit.unit).strip()

    def is_better(self, one: float, other: float) -> bool:
        """Return whether a value is better than another one by more than what counts."""
        gain = one - other if self.is_higher_better else other - one
        share = 0.0 if self.unit is DB else LOST_BY * abs(other)
        return gain > max(self.least, share)


class Loss(NamedTuple):
    """A place where another method has a better figure than the certified law."""

    score: Score
    place: Place
    ours: float
    method: str
    theirs: float


def _persons(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row["hand"] in PERSONS and row["world"] in TOUCHED]


def _felt(key: str, join: Callable[[list[float]], float]) -> Figure:
    """Return what persons felt, by a key of their runs."""

    def of(rows: Sequence[Row]) -> float | None:
        known = [row[key] for row in _persons(rows) if row.get(key) is not None]
        return join(known) if known else None

    return of


def _stiffness(rows: Sequence[Row], key: str = "displayed_stiffness_n_per_m") -> float | None:
    """Return the stiffness that persons felt; one that moves felt 0."""
    values = [(row.get(key) or 0.0) * bool(row.get("at_rest")) for row in _persons(rows)]
    return mean(values) if values else None


def _hardness(rows: Sequence[Row]) -> float | None:
    """Return the hardness at contact; without one where a person's hand does not come to rest."""
    is_at_rest = all(row.get("at_rest") for row in _persons(rows))
    return _felt("extended_rate_hardness_n_per_m", mean)(rows) if is_at_rest else None


def _strongest(decibels: Sequence[float]) -> float:
    """Return the strongest vibration; one 20 dB below the threshold is felt by nobody."""
    return max(-20.0, *decibels)


def _bandwidth(rows: Sequence[Row]) -> float | None:
    shaken = [row for row in rows if row["hand"] == SHAKER and not row["error"]]
    return shaken[0]["transparency_bandwidth_hz"] or 0.0 if shaken else None


def _mass_error(rows: Sequence[Row]) -> float | None:
    """Return how far the felt mass is from that of cup and ball, as a share of it."""
    carried = [row[MASS] for row in rows if row["hand"] == CARRIER and not row["error"]]
    return abs(complex(*carried[0]) / CUP_AND_BALL - 1.0) if carried else None


def _in_the_air(rows: Sequence[Row]) -> float | None:
    if rows[0]["world"] != FREE:
        return None
    return max((row["peak_force_n"] for row in rows if row["error"] is None), default=None)


SCORES = (
    Score("stiffness felt", N_MM, _stiffness, True, 10.0),
    Score("extended rate-hardness", N_MM, _hardness, True, 10.0),
    Score("error to the wall", N, _felt("wall_error_rms_n", mean), False, 0.02),
    Score("contact bounces", NUMBER, _felt("contact_bounces", mean), False, 0.5),
    Score(
        "vibration above threshold",
        DB,
        _felt("vibration_above_threshold_db", _strongest),
        False,
        3.0,
    ),
    Score("transparency bandwidth", HZ, _bandwidth, True, 0.5),
    Score("error of the felt mass", WHOLE, _mass_error, False, 0.01),
    Score("largest force in free motion", N, _in_the_air, False, 0.01),
)


def cells(rows: Sequence[Row]) -> dict[Place, dict[str, list[Row]]]:
    """Return the runs in cells by place and method."""
    found: dict[Place, dict[str, list[Row]]] = {}
    own = [row for row in rows if row["kind"] == CELL]
    for key, some in groups(own, *Place._fields, "method").items():
        found.setdefault(Place(*key[:3]), {})[key[3]] = some
    return found


def lowest(rows: Sequence[Row]) -> float | None:
    """Return the lowest energy of some runs, in J; None if none could be run."""
    return min((row[ENERGY] for row in rows if row[ENERGY] is not None), default=None)


def leaks(energy: float | None) -> bool:
    """Return whether a lowest energy means that a hand was given some."""
    return energy is not None and energy < -ENERGY_TOLERANCE


class Worst(NamedTuple):
    """The lowest energies of a method on a device, in J."""

    method: str
    device: str
    row: Row  # the run with the lowest one
    by_kind: dict[str, float | None]  # in cells, under random attacks, under learned ones
    share_left: float  # lowest one
    failed: int  # runs that ended in an error

    @property
    def energy(self) -> float:
        """The lowest one, in J."""
        return float(self.row[ENERGY])

    @property
    def leaks(self) -> bool:
        """Whether it gave energy."""
        return leaks(self.energy)


def worst(rows: Sequence[Row]) -> list[Worst]:
    """Return the worst of each method and device, of cells and attacks."""
    found = []
    played = [row for row in rows if row["kind"] != TUNING]
    for (method, device), own in groups(played, "method", "device").items():
        known = [row for row in own if row[ENERGY] is not None]
        if not known:
            continue
        kinds = {
            k: lowest([row for row in own if row["kind"] == k]) for k in (CELL, RANDOM, SEARCH)
        }
        row = min(known, key=lambda row: (row[ENERGY], row["share_left"]))
        left = min(row["share_left"] for row in known)
        found.append(Worst(method, device, row, kinds, left, len(own) - len(known)))
    return found


def giving(rows: Sequence[Row], most: float) -> set[tuple[str, str]]:
    """Return method and device where a hand got more energy than ``most``, in J."""
    return {(one.method, one.device) for one in worst(rows) if -one.energy > most}


def losses(rows: Sequence[Row], most: float) -> Iterator[Loss]:
    """Yield where the best of the other methods is better than the certified law, by figure.

    Others are those that gave a hand of the device at most so much, in J, in cells or attacks.
    """
    unsafe = giving(rows, most)
    for score in SCORES:
        for place, by_method in cells(rows).items():
            ours = score.of(by_method[CERTIFIED]) if CERTIFIED in by_method else None
            if ours is None:
                continue
            others = {
                name: value
                for name, runs in by_method.items()
                if name not in OURS
                and (name, place.device) not in unsafe
                and (value := score.of(runs)) is not None
            }
            sign = 1.0 if score.is_higher_better else -1.0
            best = max(others, key=lambda name: sign * others[name], default=None)
            if best is not None and score.is_better(
                score.counted(others[best], place), score.counted(ours, place)
            ):
                yield Loss(score, place, ours, best, others[best])


def compared(rows: Sequence[Row], score: Score) -> int:
    """Return in how many places the certified law has a figure."""
    return sum(
        CERTIFIED in own and score.of(own[CERTIFIED]) is not None for own in cells(rows).values()
    )
