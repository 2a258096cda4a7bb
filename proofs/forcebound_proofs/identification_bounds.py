"""Whether the bounds of an identification hold: seeded identifications of devices with known truth.

Each run draws a simulated device: every fourth a five-bar, the others a knob of one axis. Its
damping, friction, presliding, inertia, encoders, motors' gains, lag and write delay are random; it
is then identified in virtual time as ``forcebound identify`` does it, with a weight that a
simulated user hangs on each axis and takes off again.

Aims: each bound holds in at least 99 % of the runs, and is not worse than 0.7 of the truth (a lower
bound is at least 0.7 times the truth, an upper one at most the truth over 0.7).
"""

import dataclasses
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from forcebound.errors import DeviceError
from forcebound.lab.engine import Campaign, Row, run_here
from forcebound.lab.identification.procedure import Found, identify
from forcebound.lab.identification.rig import VirtualClock
from forcebound_proofs.identified_devices import WEIGHTS, Weighted, draw

WORST = 0.7  # share of the truth
AIM = 0.99  # share of the runs
HEAD = f"{'bound of':<15}{'runs':>6}{'holds':>9}{'narrow':>9}{'over truth':>18}\n"
#: Numbers with their bounds, and whether it is a lower one.
NUMBERS = {
    "damping": True,
    "friction": True,
    "presliding": False,
    "resolution": False,
    "write_delay": False,
    "lag": False,
    "least_gain": True,
    "largest_gain": False,
}


def judge(seed: int) -> dict[str, Any]:
    """Identify the device of a seed; return bound over truth of each number."""
    case = draw(seed)
    truth, axes = case.model.truth, case.model.axes
    device = Weighted(case.model.open(None, 1.25e-3), truth.gain, WEIGHTS[axes])
    plan = dataclasses.replace(case.plan, weight=WEIGHTS[axes])
    try:
        found = identify(device, case.model, VirtualClock(), plan, device.listen)
    except DeviceError as error:
        return {"seed": seed, "error": str(error), "ratios": {}}
    finally:
        device.close()
    ratios = ratios_of(truth, found)
    return {"seed": seed, "error": None, "ratios": ratios, "lags": _lags_of_none(truth, found)}


def ratios_of(truth: Any, found: Found) -> dict[str, list[float]]:
    """Return bound over truth: at most 1 for a lower bound, at least 1 for an upper one."""
    ratios: dict[str, list[float]] = {name: [] for name in NUMBERS}

    def add(name: str, bound: float, true: float) -> None:
        if true > 0.0:
            ratios[name].append(float(bound / true))

    for axis, one in enumerate(found.axes):
        gain = truth.gain[axis]  # what dissipates is found in the units of the motor
        add("damping", one.damping.lower, truth.damping[axis] / gain)
        add("friction", one.friction.lower, truth.friction[axis] / gain)
        add("resolution", one.resolution.upper, truth.resolution[axis])
        add("presliding", one.presliding.upper, truth.presliding[axis])
        add("lag", math.inf if one.lag is None else one.lag.upper, truth.lag)
    for gain, bound in zip(truth.gain, found.gain, strict=bool(found.gain)):
        if bound is not None:
            add("least_gain", bound.lower, gain)
            add("largest_gain", bound.upper, gain)
    add("write_delay", found.write_delay.upper, truth.write_delay)
    return ratios


def _lags_of_none(truth: Any, found: Found) -> list[float]:
    """Upper bounds of the lag, in s, of motors without any."""
    return [] if truth.lag else [one.lag.upper for one in found.axes if one.lag is not None]


def evaluate(outcomes: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return, of each number, how often its bound holds and is narrow, and the extremes."""
    document: dict[str, Any] = {"runs": len(outcomes), "numbers": {}}
    document["failed"] = [one for one in outcomes if one["error"]]
    for name, is_lower in NUMBERS.items():
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
    lags = [lag for one in outcomes for lag in one.get("lags", [])]
    document["lag_of_none"] = {
        "motors": len(lags),
        "holds": sum(lag >= 0.0 for lag in lags) / max(len(lags), 1),
        "largest": max(lags, default=math.nan),
    }
    return document


def is_reached(document: dict[str, Any]) -> bool:
    """Return whether every number reaches the aims."""
    numbers = document["numbers"].values()
    seen = [one for one in numbers if one["runs"]]
    return bool(seen) and all(one["holds"] >= AIM and one["narrow"] >= AIM for one in seen)


def outcomes_of(seeds: Sequence[int]) -> list[Row]:
    """Return a row for each seed: its outcome as one text, since it has lists by name."""
    return [{"seed": seed, "outcome": json.dumps(judge(seed))} for seed in seeds]


def lines_of(document: dict[str, Any]) -> list[str]:
    """Return what is printed."""
    lines = [HEAD]
    for name, one in document["numbers"].items():
        lines.append(
            f"{name:<15}{one['runs']:>6}{100 * one['holds']:>8.1f}%{100 * one['narrow']:>8.1f}%"
            f"{one['least']:>10.3f} to {one['largest']:.3f}\n"
        )
    none = document["lag_of_none"]
    lines.append(
        f"of {none['motors']} motors without a lag at most {1e6 * none['largest']:.0f} us are"
        f" stated, {100 * none['holds']:.1f}% not below 0\n"
    )
    lines += [f"seed {one['seed']}: {one['error']}\n" for one in document["failed"]]
    return lines


@click.command()
@click.option("--runs", default=1000, show_default=True, help="Devices.")
@click.option("--seed", default=1, show_default=True, help="Of the first run.")
@click.option("--workers", type=int, help="Processes; 0: only this one. Default: one per core.")
@click.option("--results", type=click.Path(path_type=Path), help="Parquet file of the runs.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def main(runs: int, seed: int, workers: int | None, results: Path | None, as_json: bool) -> None:
    """How often each identified bound holds; status 1 if an aim is not reached.

    With --results the runs are kept in that file, and a study that was interrupted goes on.
    """
    campaign = Campaign("identification", list(range(seed, seed + runs)), outcomes_of, part=1)
    rows = run_here(campaign, workers, results).rows
    document = evaluate([json.loads(row["outcome"]) for row in rows])
    click.echo(json.dumps(document, indent=2) if as_json else "".join(lines_of(document)))
    sys.exit(0 if is_reached(document) and not document["failed"] else 1)
