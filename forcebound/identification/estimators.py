"""Estimators: numbers and their bounds from what experiments have seen. Pure functions of arrays.

Bounds hold with a probability of 99.9 % for each number, by Student's distribution: a device has
several numbers, and all of them should hold in 99 of 100 identifications.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

Floats: TypeAlias = "np.ndarray[Any, np.dtype[np.float64]]"

#: Quantile 0.999 of Student's distribution by degrees of freedom.
_STUDENT = (
    (1, 318.3), (2, 22.33), (3, 10.21), (4, 7.173), (5, 5.893), (6, 5.208), (7, 4.785), (8, 4.501),
    (10, 4.144), (12, 3.930), (15, 3.733), (20, 3.552), (30, 3.385), (60, 3.232), (math.inf, 3.090),
)  # fmt: skip
#: Share by which a loss may be less than its statistics say: what the model leaves out, such as the
#: ripple of the speed and the phase of the encoder.
UNMODELLED = 0.03
HUBER = 1.5  # standard deviations; beyond, a point counts less
ROUNDS = 20


@dataclass(frozen=True)
class Bounded:
    """A number: its estimate, and what holds with a probability of 99.9 %.

    Attributes:
        estimate: Most likely value.
        lower: It is not below.
        upper: It is not above.
    """

    estimate: float
    lower: float
    upper: float


def student(freedom: float) -> float:
    """Return the quantile 0.999 of Student's distribution."""
    inverse = [1.0 / known for known, _ in _STUDENT][::-1]
    values = [value for _, value in _STUDENT][::-1]
    return float(np.interp(1.0 / max(freedom, 1.0), inverse, values))


@dataclass(frozen=True)
class Point:
    """The loss of a pair of passes, there and back, in a part of the range.

    What a force that depends on the place does there, it takes back on the way back; so half the
    difference of both is the loss, and half the sum that force.

    Attributes:
        cell: Where: pose of the other axes and part of the range.
        speed: In m/s (rad/s), > 0.
        loss: Force that motion costs, in N (N m): b v + f_c.
        load: Force that depends on the place: weight, cogging.
        gained: Acceleration that ``loss`` still contains, times the inertia, in m/s^2 (rad/s^2).
        load_gained: And ``load``.
    """

    cell: tuple[int, int]
    speed: float
    loss: float
    load: float
    gained: float = 0.0
    load_gained: float = 0.0

    def at_rest(self, inertia: float) -> "Point":
        """Return the point without what accelerates an axis of this inertia."""
        loss, load = self.loss - inertia * self.gained, self.load - inertia * self.load_gained
        return Point(self.cell, self.speed, loss, load)


def slope(points: Sequence[Point]) -> Bounded:
    """Return the viscous damping: by how much the loss grows with the speed, over all cells.

    Huber's regression with a level for each cell, and standard errors that allow for points of
    unequal accuracy (MacKinnon and White's HC3).
    """
    cells = sorted({one.cell for one in points})
    design = np.zeros((len(points), 1 + len(cells)))
    for row, point in enumerate(points):
        design[row, 0] = point.speed
        design[row, 1 + cells.index(point.cell)] = 1.0
    loss = np.array([point.loss for point in points])
    weights = _huber_weights(design, loss)
    bread = np.linalg.pinv(design.T @ (weights[:, None] * design))
    found = bread @ (design.T @ (weights * loss))
    leverage = np.einsum("ij,jk,ik->i", design, bread, design) * weights
    miss = weights * (loss - design @ found) / np.maximum(1.0 - leverage, 0.1)
    spread = bread @ (design.T @ (miss[:, None] ** 2 * design)) @ bread
    error = student(len(points) - design.shape[1]) * math.sqrt(max(spread[0, 0], 0.0))
    b = float(found[0])
    error += UNMODELLED * abs(b)
    return Bounded(b, b - error, b + error)


def _huber_weights(design: Floats, loss: Floats) -> Floats:
    weights = np.ones(loss.size)
    for _ in range(ROUNDS):
        root = np.sqrt(weights)
        found = np.linalg.lstsq(root[:, None] * design, root * loss, rcond=None)[0]
        miss = np.abs(loss - design @ found)
        scale = 1.4826 * float(np.median(miss))
        if scale == 0.0:
            break
        weights = np.minimum(1.0, HUBER * scale / np.maximum(miss, 1e-300))
    return weights


def friction(
    points: Sequence[Point], damping: Bounded
) -> tuple[Bounded, dict[tuple[int, int], float]]:
    """Return Coulomb friction: lowest bound over all cells, and the estimate of each cell.

    Args:
        points: Slow ones, several in each cell.
        damping: Of :func:`slope`.
    """
    cells = sorted({one.cell for one in points})
    own = {cell: [one for one in points if one.cell == cell] for cell in cells}
    levels = {
        cell: np.array([one.loss - damping.estimate * one.speed for one in members])
        for cell, members in own.items()
    }
    means = {cell: float(values.mean()) for cell, values in levels.items()}
    misses = np.concatenate([values - values.mean() for values in levels.values()])
    freedom = max(misses.size - len(cells), 1)
    deviation = math.sqrt(float((misses**2).sum()) / freedom)
    error, most = student(freedom) * deviation, -math.inf
    least = math.inf
    for cell, members in own.items():
        speed = sum(one.speed for one in members) / len(members)
        wide = error / math.sqrt(len(members))
        wide += UNMODELLED * abs(means[cell])
        least = min(least, means[cell] - wide - (damping.upper - damping.estimate) * speed)
        most = max(most, means[cell] + wide + (damping.estimate - damping.lower) * speed)
    return Bounded(float(np.median(list(means.values()))), max(least, 0.0), most), means


def below_all(points: Sequence[Point], damping: float, level: float) -> float:
    """Return the friction, lowered until the line with this damping is below all measurements.

    Points of one cell and one speed are averaged; speeds within a tenth count as one.
    """
    groups: dict[tuple[tuple[int, int], int], list[float]] = {}
    for one in points:
        key = (one.cell, round(math.log(one.speed) / math.log(1.3)))
        groups.setdefault(key, []).append(one.loss - damping * one.speed)
    misses = [value - sum(g) / len(g) for g in groups.values() for value in g]
    freedom = max(len(misses) - len(groups), 1)
    deviation = math.sqrt(sum(m * m for m in misses) / freedom)
    lowest = min(
        sum(g) / len(g) - student(freedom) * deviation / math.sqrt(len(g)) for g in groups.values()
    )
    return max(0.0, min(level, lowest))


def load(points: Sequence[Point]) -> Bounded:
    """Return the largest force that depends on the place, without sign, and the mean, with sign."""
    cells: dict[tuple[int, int], list[float]] = {}
    for one in points:
        cells.setdefault(one.cell, []).append(one.load)
    misses = [value - sum(g) / len(g) for g in cells.values() for value in g]
    freedom = max(len(misses) - len(cells), 1)
    deviation = math.sqrt(sum(m * m for m in misses) / freedom)
    means = [sum(g) / len(g) for g in cells.values()]
    few = min(len(g) for g in cells.values())
    error = student(freedom) * deviation / math.sqrt(few)
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


def presliding(
    yielded: Floats, force: float, friction_estimate: float, friction_upper: float, step: float
) -> Bounded:
    """Return the way over which friction yields before it slides.

    It yields evenly: by z_m at f_c, so by z_m F / f_c under F. The mean of many places tells parts
    of a step of the encoder; a change that no push has shown may still be there in a few of them.

    Args:
        yielded: How far the axis came back, of each push.
        force: Of the pushes, in N (N m).
        friction_estimate: In N (N m).
        friction_upper: In N (N m).
        step: Of the encoder.
    """
    count = yielded.size
    mean = max(0.0, float(yielded.mean()))
    error = student(count - 1) * float(yielded.std(ddof=1)) / math.sqrt(count)
    unseen = step * (1.0 - 0.001 ** (1.0 / count))  # of `count` pushes, none crossed an edge
    upper = mean + max(error, unseen)
    return Bounded(
        mean * friction_estimate / force,
        max(0.0, mean - error) * friction_estimate / force,
        upper * friction_upper / force,
    )
