"""Fit of the hand of ``forcebound reproduce table1``: python experiments/fit_table1.py --half odd.

Nine numbers are sought: mass, stiffness and damping of the one hand; approach speed, way to the
wall and target depth for each of the two speeds. The cost is the root-mean-square logarithm of ours
over the paper's cell, over the chosen half of Table 1 only, plus a penalty where the handle meets
the wall outside the paper's speed bands. CMA-ES, started again from the best of random draws until
the time is up, because the cost is rugged: where a sample falls behind the surface is luck.

The runs go through a compiled loop of the very functions of the plant and the laws, a hundred times
faster than the graph; the last line of each result is what belongs into
``forcebound/experiments/setup.py``, whose numbers ``forcebound reproduce`` then takes through the
nodes. Needs the extra ``fit``: pip install -e '.[fit]'.
"""

import argparse
import math
import sys
import time
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forcebound.analysis.contact import displayed_stiffness, initial_rate_hardness
from forcebound.bounding import LAWS, DeviceConstants, Dissipation
from forcebound.bounding.one_axis import one_axis
from forcebound.bounding.sample import NO_MEMORY, start_axis
from forcebound.compiled import allow_in_kernels, jit
from forcebound.devices.phantom import PhantomPremium15
from forcebound.devices.plant import advance, quantise
from forcebound.devices.stated import per_axis
from forcebound.experiments.setup import PAPER_LAWS, SURFACE
from forcebound.experiments.table1 import COLUMNS, PAPER, is_fitted

Floats = NDArray[np.float64]

DEVICE = PhantomPremium15()
PERIOD = 1e-3  # s
STIFFNESS = 10_000.0  # N/m, of the wall
SAMPLES = 5001  # 2 to 5 s count for the displayed stiffness
QUICK_SAMPLES = 2251  # the hand rests by then: what it shows at 2 s it shows at 5 s
FAILED = 3.0  # logarithmic error of a cell that has no value

#               kg    N/m   N s/m  m/s   m     m     m/s   m     m
NAMES = ("mass", "stiffness", "damping", "speed", "way", "target", "speed", "way", "target")
LOWEST = np.array([0.1, 20.0, 0.05, 0.150, 0.010, 3e-4, 0.020, 0.010, 3e-4])
HIGHEST = np.array([1.5, 3000.0, 4.0, 0.250, 0.200, 0.040, 0.050, 0.200, 0.040])
LINEAR = np.array([name == "speed" for name in NAMES])  # the others are searched by logarithm
BANDS = {"high": (0.150, 0.250), "low": (0.020, 0.050)}  # m/s; paper, section 5.2


def decode(unit: Floats) -> Floats:
    """Return the nine numbers (total mass first) of a point in the unit cube."""
    unit = np.clip(unit, 0.0, 1.0)
    straight = LOWEST + (HIGHEST - LOWEST) * unit
    numbers: Floats = np.where(LINEAR, straight, LOWEST * (HIGHEST / LOWEST) ** unit)
    return numbers


@cache
def kernel(law: str) -> Callable[..., float]:
    """Return the compiled contact of one law; it returns the true speed at contact."""
    start, bound = LAWS[law].start, one_axis(LAWS[law])
    allow_in_kernels([start, bound, advance, quantise])
    damping, friction, resolution = (
        per_axis(value, 1)[0] for value in (DEVICE.damping, DEVICE.friction, DEVICE.resolution)
    )
    saturation, substep = DEVICE.saturation, DEVICE.substep

    def run(
        device: DeviceConstants,
        mass: float,
        hand_stiffness: float,
        hand_damping: float,
        begin: float,
        end: float,
        speed: float,
        readings: Floats,
        forces: Floats,
    ) -> float:
        x = target = begin
        v = work = 0.0
        axis, memory, state = start_axis(quantise(x, resolution)), NO_MEMORY, start(device)
        readings[0], forces[0] = axis.reading, 0.0
        contact_speed = 0.0
        for n in range(1, readings.size):
            target_end = min(begin + speed * n * PERIOD, end)
            x_before = x
            x, v, work, _ = advance(
                x, v, work, target, target_end, PERIOD, substep, axis.force, mass, damping,
                friction, hand_stiffness, hand_damping,
            )  # fmt: skip
            target = target_end
            if contact_speed == 0.0 and x > SURFACE:
                contact_speed = (x - x_before) / PERIOD
            reading = quantise(x, resolution)
            commanded = min(STIFFNESS * max(reading - SURFACE, 0.0), saturation)
            axis, memory, state, _ = bound(
                axis, memory, state, reading, commanded, saturation, PERIOD, device
            )
            readings[n], forces[n] = reading, axis.force
        return contact_speed

    return jit(run)


def contact(law: str, hand: Floats, approach: Floats, samples: int) -> tuple[float, float, float]:
    """Return rate-hardness and displayed stiffness, in N/mm, and contact speed, in m/s."""
    speed, way, target = approach.tolist()
    readings, forces = np.empty(samples), np.empty(samples)
    relied_on = Dissipation(
        DEVICE.damping, DEVICE.friction, DEVICE.resolution, PERIOD, PERIOD, DEVICE.saturation
    )
    contact_speed = kernel(law)(
        LAWS[law].device(relied_on), *hand.tolist(), SURFACE - way, SURFACE + target, speed,
        readings, forces,
    )  # fmt: skip
    depth = readings - SURFACE
    hardness = initial_rate_hardness(forces, depth)
    if samples == SAMPLES:
        times = PERIOD * np.arange(samples, dtype=np.float64)
        stiffness = displayed_stiffness(times, forces, depth)
    else:
        steady = slice(2000, None)
        inside = depth[steady] > 0.0
        ratios = forces[steady][inside] / depth[steady][inside]
        stiffness = float(ratios.mean()) if inside.any() else None
    return (
        math.nan if hardness is None else hardness * 1e-3,
        math.nan if stiffness is None else stiffness * 1e-3,
        contact_speed,
    )


def evaluate(numbers: Floats, samples: int) -> tuple[Floats, Floats, float]:
    """Return the table in N/mm, its logarithmic errors, and how far contact is off the bands."""
    table = np.full((len(PAPER_LAWS), len(COLUMNS)), math.nan)
    off = 0.0
    for column, (speed, approach) in enumerate((("high", numbers[3:6]), ("low", numbers[6:9]))):
        low, high = BANDS[speed]
        for row, law in enumerate(PAPER_LAWS):
            *cells, contact_speed = contact(law, numbers[:3], approach, samples)
            table[row, 2 * column : 2 * column + 2] = cells
        off += max(0.0, low - contact_speed) / low + max(0.0, contact_speed - high) / high
    paper = np.array([PAPER[law] for law in PAPER_LAWS])
    with np.errstate(all="ignore"):
        errors = np.log(table / paper)
    return table, np.where(np.isfinite(errors), errors, FAILED), off


def fit(half: NDArray[np.bool_], seconds: float, seed: int) -> None:
    """Search and print every result."""
    import cma

    random = np.random.default_rng(seed)
    end = time.monotonic() + seconds

    def cost(unit: Any) -> float:
        point = np.asarray(unit)
        outside = float(np.sum(np.maximum(0.0, -point) + np.maximum(0.0, point - 1.0)))
        _, errors, off = evaluate(decode(point), QUICK_SAMPLES)
        return math.sqrt(float(np.mean(errors[half] ** 2))) + off + outside

    while time.monotonic() < end:
        start = min((random.random(9) for _ in range(300)), key=cost)
        options = {
            "popsize": 18,
            "maxiter": 160,
            "verbose": -9,
            "seed": int(random.integers(1, 2**31)),
        }
        strategy = cma.CMAEvolutionStrategy(start, 0.12, options)
        while not strategy.stop():
            points = strategy.ask()
            strategy.tell(points, [cost(point) for point in points])
            if time.monotonic() >= end:
                break
        print_hand(decode(np.asarray(strategy.result.xbest)), half)


def print_hand(numbers: Floats, half: NDArray[np.bool_]) -> None:
    """Print one result."""

    def rms(errors: Floats) -> float:
        return math.sqrt(float(np.mean(errors**2))) if errors.size else math.nan

    table, errors, off = evaluate(numbers, SAMPLES)
    print(
        f"all {rms(errors):.3f}  fitted {rms(errors[half]):.3f}  "
        f"predicted {rms(errors[~half]):.3f}  off the bands {off:.3f}"
    )
    print("  " + "; ".join(" ".join(f"{cell:.2f}" for cell in row) for row in table))
    device, hand = DEVICE.mass, numbers[:3]
    print(f"  hand {hand[0] - device:.4g} kg, {hand[1]:.4g} N/m, {hand[2]:.4g} N s/m;", end=" ")
    for name, (speed, way, target) in (("high", numbers[3:6]), ("low", numbers[6:9])):
        print(
            f"{name} {speed * 1e3:.4g} mm/s, way {way * 1e3:.4g} mm, target {target * 1e3:.4g} mm;",
            end=" ",
        )
    print(flush=True)


def main() -> int:
    """Fit; return the exit status."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("--half", choices=("odd", "even", "all"), default="odd")
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    odd = np.array([[is_fitted(law, cell) for cell in range(4)] for law in range(len(PAPER_LAWS))])
    halves = {"odd": odd, "even": ~odd, "all": odd | ~odd}
    fit(halves[arguments.half], arguments.seconds, arguments.seed)
    return 0


if __name__ == "__main__":
    sys.exit(main())
