"""Whether the bounds of an identification hold: seeded identifications of devices with known truth.

    python experiments/identification_bounds.py [--runs 1000] [--seed 1] [--workers N] [--json]

Each run draws a simulated device: every fourth a five-bar, the others a knob of one axis. Its
damping, friction, presliding, inertia, encoders, motors' gains and write delay are random; it is
then identified in virtual time as ``forcebound identify`` does it. Aims: each bound holds in at
least 99 % of the runs, and is not worse than 0.7 of the truth (a lower bound is at least 0.7 times
the truth, an upper one at most the truth over 0.7).

A presliding below 1.5 steps of the encoder is not drawn: no reading shows it that narrowly.
"""

import argparse
import json
import math
import os
import random
import sys
from concurrent.futures import ProcessPoolExecutor
from typing import Any

from forcebound.devices.five_bar import FiveBar
from forcebound.devices.phantom import PhantomPremium15
from forcebound.devices.stated_joints import TrueJoints
from forcebound.devices.true_values import TrueAxes
from forcebound.errors import DeviceError
from forcebound.identification.clock import VirtualClock
from forcebound.identification.procedure import Found, Plan, identify

WORST = 0.7  # share of the truth
AIM = 0.99  # share of the runs
SEEN = 1.5  # steps of the encoder; less presliding cannot be told narrowly
HEAD = f"{'bound of':<14}{'runs':>6}{'holds':>9}{'narrow':>9}{'over truth':>18}\n"
NUMBERS = ("damping", "friction", "presliding", "resolution", "write_delay")


def draw(seed: int) -> tuple[Any, Plan]:
    """Return the device of a seed, and how it is identified."""
    rng = random.Random(seed)

    def spread(middle: float, factor: float) -> float:
        return middle * math.exp(math.log(factor) * rng.uniform(-1.0, 1.0))

    axes = 2 if seed % 4 == 1 else 1
    step = spread(1.2e-3, 2.0) if axes == 2 else spread(3e-5, 2.0)
    yields = rng.random() < 0.5
    presliding = tuple(rng.uniform(SEEN, 5.0) * step if yields else 0.0 for _ in range(axes))
    gain = tuple(rng.uniform(0.8, 1.2) for _ in range(axes))
    delay = rng.choice((0.0, rng.uniform(2e-5, 2e-4)))
    if axes == 2:
        truth = TrueJoints(
            damping=tuple(spread(1e-3, 2.5) for _ in range(2)),
            friction=tuple(spread(4e-3, 2.5) for _ in range(2)),
            presliding=presliding,
            resolution=(step, step),
            gain=gain,
            write_delay=delay,
            random=True,
            seed=seed,
        )
        inertia = spread(1e-4, 1.5)
        arm = FiveBar(inertia=inertia, truth=truth, substep=2.5e-4, write_delay=delay)
        return arm, Plan(reach=0.35, force=0.06)
    knob = TrueAxes(
        damping=spread(0.27, 2.5),
        friction=spread(0.12, 2.5),
        presliding=presliding,
        resolution=step,
        gain=gain,
        write_delay=delay,
        random=True,
        seed=seed,
    )
    mass = spread(0.075, 1.5)
    one = PhantomPremium15(mass=mass, truth=knob, substep=2.5e-4, write_delay=delay)
    return one, Plan(reach=0.03, force=4.25)


def judge(seed: int) -> dict[str, Any]:
    """Identify the device of a seed; return bound over truth of each number."""
    model, plan = draw(seed)
    device = model.open(None, 1.25e-3)
    try:
        found = identify(device, model, VirtualClock(), plan)
    except DeviceError as error:
        return {"seed": seed, "error": str(error), "ratios": {}}
    finally:
        device.close()
    return {"seed": seed, "error": None, "ratios": _ratios(model.truth, found)}


def _ratios(truth: Any, found: Found) -> dict[str, list[float]]:
    """Bound over truth: at most 1 for a lower bound, at least 1 for an upper one."""
    ratios: dict[str, list[float]] = {name: [] for name in NUMBERS}
    for axis, one in enumerate(found.axes):
        gain = truth.gain[axis]  # what dissipates is found in the units of the motor
        ratios["damping"].append(one.damping.lower / (_of(truth.damping, axis) / gain))
        ratios["friction"].append(one.friction.lower / (_of(truth.friction, axis) / gain))
        ratios["resolution"].append(one.resolution.upper / _of(truth.resolution, axis))
        if _of(truth.presliding, axis) > 0.0:
            ratios["presliding"].append(one.presliding.upper / _of(truth.presliding, axis))
    if truth.write_delay > 0.0:
        ratios["write_delay"].append(found.write_delay.upper / truth.write_delay)
    return ratios


def _of(value: Any, axis: int) -> float:
    return float(value[axis] if isinstance(value, tuple) else value)


def evaluate(outcomes: list[dict[str, Any]]) -> dict[str, Any]:
    """Return, of each number, how often its bound holds and is narrow, and the extremes."""
    document: dict[str, Any] = {"runs": len(outcomes), "numbers": {}}
    document["failed"] = [one for one in outcomes if one["error"]]
    for name in NUMBERS:
        is_lower = name in ("damping", "friction")
        runs = [one["ratios"][name] for one in outcomes if one["ratios"].get(name)]
        values = [value for run in runs for value in run]
        holds = [all(v <= 1.0 if is_lower else v >= 1.0 for v in run) for run in runs]
        narrow = [all(v >= WORST if is_lower else v <= 1.0 / WORST for v in run) for run in runs]
        document["numbers"][name] = {
            "runs": len(runs),
            "holds": sum(holds) / len(runs) if runs else math.nan,
            "narrow": sum(narrow) / len(runs) if runs else math.nan,
            "least": min(values, default=math.nan),
            "largest": max(values, default=math.nan),
        }
    return document


def is_reached(document: dict[str, Any]) -> bool:
    """Return whether every number reaches the aims."""
    numbers = document["numbers"].values()
    return all(one["holds"] >= AIM and one["narrow"] >= AIM for one in numbers)


def main() -> int:
    """Print how often each bound holds; return 1 if an aim is not reached, else 0."""
    parser = argparse.ArgumentParser(description="Whether identified bounds hold.")
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1, help="of the first run")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    options = parser.parse_args()
    seeds = range(options.seed, options.seed + options.runs)
    with ProcessPoolExecutor(options.workers) as pool:
        document = evaluate(list(pool.map(judge, seeds, chunksize=4)))
    if options.json:
        sys.stdout.write(json.dumps(document, indent=2) + "\n")
    else:
        sys.stdout.write(HEAD)
        for name, one in document["numbers"].items():
            sys.stdout.write(
                f"{name:<14}{one['runs']:>6}{100 * one['holds']:>8.1f}%{100 * one['narrow']:>8.1f}%"
                f"{one['least']:>10.3f} to {one['largest']:.3f}\n"
            )
        for one in document["failed"]:
            sys.stdout.write(f"seed {one['seed']}: {one['error']}\n")
    return 0 if is_reached(document) and not document["failed"] else 1


if __name__ == "__main__":
    sys.exit(main())
