"""Estimators: numbers and their bounds from what experiments have seen. Pure functions of arrays.

Bounds hold with a probability of 99.9 % for each number, by Student's distribution: a device has
several numbers, and all of them should hold in 99 of 100 identifications.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

Floats: TypeAlias = NDArray[np.float64]
Cell: TypeAlias = tuple[int, int]  # pose of the other axes, and part of the range

#: Share by which a loss may be less than statistics allow: what the model leaves out, such as the
#: ripple of the speed and the phase of the encoder.
UNMODELLED = 0.03
HUBER = 1.5  # standard deviations; beyond, a point counts less
ROUNDS = 5  # for scale and fit, each of which needs the other
ALIKE = math.log(1.3)  # of the logarithms of two speeds that count as one


class Bounded(NamedTuple):
    """A number: its estimate, and what holds with a probability of 99.9 %."""

    estimate: float
    lower: float
    upper: float

    def times(self, other: "Bounded") -> "Bounded":
        """Return the product with a positive number."""
        return Bounded(
            self.estimate * other.estimate, self.lower * other.lower, self.upper * other.upper
        )


def student(freedom: float) -> float:
    """Return the quantile 0.999 of Student's distribution."""
    return float(stats.t.ppf(0.999, max(freedom, 1.0)))


def mean_of(values: Floats) -> tuple[float, float]:
    """Return the mean of two or more values, and by how much it may err."""
    return float(values.mean()), student(values.size - 1) * float(stats.sem(values, axis=None))


def _groups(values: Iterable[tuple[Any, float]]) -> tuple[dict[Any, Floats], float]:
    """Return the values by key, and by how much one of them may miss the mean of its key."""
    groups: dict[Any, list[float]] = {}
    for key, value in values:
        groups.setdefault(key, []).append(value)
    arrays = {key: np.array(group) for key, group in groups.items()}
    squares = sum(float(((each - each.mean()) ** 2).sum()) for each in arrays.values())
    freedom = max(sum(each.size for each in arrays.values()) - len(arrays), 1)
    return arrays, student(freedom) * math.sqrt(squares / freedom)


class Point(NamedTuple):
    """The loss of a pair of passes, there and back, in a part of the range.

    What a force that depends on the place does there, it takes back on the way back; so half the
    difference of both is the loss, and half the sum that force.
    """

    cell: Cell
    speed: float  # m/s (rad/s), > 0
    loss: float  # N (N m), force that motion costs: b v + f_c
    load: float  # N (N m), force that depends on the place: weight, cogging
    gained: float = 0.0  # m/s^2 (rad/s^2), whose force ``loss`` still contains
    load_gained: float = 0.0  # and ``load``

    def at_rest(self, inertia: float) -> "Point":
        """Return the point without what accelerates an axis of this inertia."""
        loss, load = self.loss - inertia * self.gained, self.load - inertia * self.load_gained
        return Point(self.cell, self.speed, loss, load)


def slope(points: Sequence[Point]) -> Bounded:
    """Return the viscous damping: by how much the loss grows with the speed, over all cells.

    Huber's regression with a level for each cell; its error allows for points of unequal accuracy
    (MacKinnon and White's HC3: each point's influence if it were left out).
    """
    cells = sorted({one.cell for one in points})
    design = np.array([[one.speed, *(one.cell == cell for cell in cells)] for one in points])
    loss = np.array([point.loss for point in points])
    found, scale = np.linalg.lstsq(design, loss, rcond=None)[0], 0.0
    for _ in range(ROUNDS):
        scale = HUBER * 1.4826 * float(np.median(np.abs(loss - design @ found)))
        if scale > 0.0:
            found = optimize.least_squares(
                lambda x: design @ x - loss, found, lambda x: design, loss="huber", f_scale=scale
            ).x
    miss = np.abs(loss - design @ found)
    root = np.sqrt(scale / np.maximum(miss, max(scale, 1e-300)))
    weighted = root[:, None] * design
    inverse = np.linalg.pinv(weighted)
    left = np.maximum(1.0 - (weighted * inverse.T).sum(axis=1), 0.1)
    influence = np.linalg.norm(inverse[0] * root * miss / left)
    b = float(found[0])
    error = student(len(points) - design.shape[1]) * float(influence) + UNMODELLED * abs(b)
    return Bounded(b, b - error, b + error)


def friction(points: Sequence[Point], damping: Bounded) -> tuple[Bounded, dict[Cell, float]]:
    """Return Coulomb friction: lowest bound over all cells, and the estimate of each cell.

    Args:
        points: Slow ones, several in each cell.
        damping: Of :func:`slope`.
    """
    levels, error = _groups((one.cell, one.loss - damping.estimate * one.speed) for one in points)
    speeds, _ = _groups((one.cell, one.speed) for one in points)
    means = {cell: float(values.mean()) for cell, values in levels.items()}
    least, most = math.inf, -math.inf
    for cell, mean in means.items():
        speed = float(speeds[cell].mean())
        wide = error / math.sqrt(speeds[cell].size) + UNMODELLED * abs(mean)
        least = min(least, mean - wide - (damping.upper - damping.estimate) * speed)
        most = max(most, mean + wide + (damping.estimate - damping.lower) * speed)
    return Bounded(float(np.median(list(means.values()))), max(least, 0.0), most), means


def below_all(points: Sequence[Point], damping: float, level: float) -> float:
    """Return the friction, lowered until the line with this damping is below all measurements.

    Points of one cell and nearly one speed are averaged.
    """
    groups, error = _groups(
        ((one.cell, round(math.log(one.speed) / ALIKE)), one.loss - damping * one.speed)
        for one in points
    )
    lowest = min(float(each.mean()) - error / math.sqrt(each.size) for each in groups.values())
    return max(0.0, min(level, lowest))


def load(points: Sequence[Point]) -> Bounded:
    """Return the largest force that depends on the place, without sign, and the mean, with sign."""
    groups, error = _groups((one.cell, one.load) for one in points)
    means = [float(each.mean()) for each in groups.values()]
    error /= math.sqrt(min(each.size for each in groups.values()))
    largest = max(map(abs, means))
    return Bounded(sum(means) / len(means), max(0.0, largest - error), largest + error)


def resolution(moving: Floats, resting: Floats) -> Bounded:
    """Return the step of an encoder, from readings in motion and at rest.

    At rest a reading may change by one step, where the axis stands on an edge; if it changes by
    more, the encoder is noisy, and as much is added, half as much again for what was not seen.
    """
    steps = np.abs(np.diff(moving))
    tiny = 1e-9 * float(np.abs(moving).max() + steps.max(initial=0.0))
    steps = steps[steps > tiny]
    step = float(steps.min()) if steps.size else 0.0
    noise = float(np.ptp(resting)) if resting.size else 0.0
    excess = max(0.0, noise - step * (1.0 + 1e-6))
    return Bounded(step, step, step * (1.0 + 1e-9) + 1.5 * excess)


def presliding(yielded: Floats, force: float, friction: Bounded, step: float) -> Bounded:
    """Return the way over which friction yields before it slides.

    It yields evenly: by z_m at f_c, so by z_m F / f_c under F. The mean of many places resolves
    parts of a step of the encoder; a change that no push has shown may still be there in a few.

    Args:
        yielded: How far the axis came back, of each push.
        force: Of the pushes, in N (N m).
        friction: f_c, in N (N m).
        step: Of the encoder.
    """
    mean, error = mean_of(yielded)
    mean = max(0.0, mean)
    unseen = step * (1.0 - 0.001 ** (1.0 / yielded.size))  # no push has crossed an edge
    upper = (mean + max(error, unseen)) * friction.upper
    lower = max(0.0, mean - error) * friction.estimate
    return Bounded(mean * friction.estimate / force, lower / force, upper / force)
