"""What the certificate costs: stiffness beside other laws, numbers of a device, power, drag.

The hand and the wall are those of ``stiff_wall``, the clock is steady. By default the hold limit is
that of punctual ticks as shipped, 1.02 periods; with ``--hold-limit 1`` all laws rely on the same
dissipation. Runs go through the compiled loop where it serves them, which gives the bits of the
virtual-time graph (``tests/test_one_axis.py``).

``--speeds`` prints instead what a stated speed of the hand gives.

``--prices`` prints instead what the numbers of a device cost the certified law, on a device that
has what it states; what a wrong number costs; and power and drag of each law. These runs go through
the virtual-time graph and take some minutes. ``--page`` writes all tables into the text of
``prices.md`` beside this file (``make proofs``).

Aims: ``certified`` at least as stiff as the paper's less conservative law, ``certified_fading``
at least 1.4 times as stiff as the paper's more conservative law, on average over the grid.
"""

import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import mean
from typing import Any

import click
import numpy as np

from forcebound.errors import ConfigError
from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import load
from forcebound.haptics.devices.true_values import TrueAxes
from forcebound.haptics.environments.walls import ActiveWall
from forcebound.haptics.hands.hands import PressingHand, SinusoidalHand
from forcebound.lab.cases import grid
from forcebound.lab.engine import Campaign, Row, run_here
from forcebound.lab.runs import run_all
from forcebound.lab.views import groups, table
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.units import energy_in_words as energy
from forcebound_proofs.views import check_page, origin, write_page

LAWS = (
    "less_conservative",
    "less_conservative_viscous",
    "aol",
    "certified",
    "more_conservative",
    "more_conservative_viscous",
    "certified_fading",
)
#: N/mm; ms, each way; mm/s
GRID = {"stiffness": (1, 3, 10, 30), "delay": (0, 1, 5), "speed": (200, 35)}

#: Law, another law that it is measured against, and how much stiffer it should be.
AIMS = (
    ("certified", "less_conservative", 1.0),
    ("certified", "aol", None),
    ("certified_fading", "more_conservative", 1.4),
)

IMPERFECTIONS = ("write_delay", "gain_error", "presliding", "lag", "weight_error")
TOGETHER = (
    "together, small: 20 us, 1 %, 15 um, 50 us, 0.01 N",
    "together, usual: 100 us, 5 %, 60 um, 100 us, 0.02 N",
)
#: Numbers of a device whose price is printed, SI units.
PRICES: Mapping[str, Mapping[str, Any]] = {
    "none": {},
    **{f"write delay {us} us": {"write_delay": us * 1e-6} for us in (20, 100, 400)},
    **{f"gain error {percent} %": {"gain_error": percent / 100} for percent in (1, 5, 10)},
    **{f"presliding {um} um": {"presliding": um * 1e-6} for um in (15, 60, 120)},
    **{f"lag {us} us": {"lag": us * 1e-6} for us in (100, 400, 1000)},
    "weight error 0.02 N": {"weight_error": 0.02},
    "motor attenuates, per write": {"attenuates": "per_write"},
    "motor attenuates, freely": {"attenuates": "freely"},
    **{
        f"the same, a share of {share} at least": {"attenuates": "freely", "least_share": share}
        for share in (0.9, 0.98)
    },
    TOGETHER[0]: dict(zip(IMPERFECTIONS, (20e-6, 0.01, 15e-6, 50e-6, 0.01), strict=True)),
    TOGETHER[1]: dict(zip(IMPERFECTIONS, (100e-6, 0.05, 60e-6, 100e-6, 0.02), strict=True)),
    "a board at its defaults: write delay 600 us, lag 1 ms": {"write_delay": 6e-4, "lag": 1e-3},
    "the same, and a hand of 3 m/s at most": {"write_delay": 6e-4, "lag": 1e-3, "hand_speed": 3.0},
    "write delay 400 us, and such a hand": {"write_delay": 4e-4, "hand_speed": 3.0},
    "lag 400 us, and such a hand": {"lag": 4e-4, "hand_speed": 3.0},
}
#: m/s, of the hand as the device states it, on walls that need the limit, N/mm.
HAND_SPEEDS = (None, 5.0, 3.0, 2.0, 1.5, 1.0, 0.7, 0.5)
STIFF = {**GRID, "stiffness": (3, 10)}
#: What a device has that states ``stiff_wall``'s numbers.
MISTAKES: Mapping[str, TrueAxes | None] = {
    "nothing": None,
    "damping: the device has 0.9 of it": TrueAxes(damping=0.9 * 0.27),
    "friction: the device has 0.9 of it": TrueAxes(friction=0.9 * 0.12),
    "gain: the motor gives 1.05 times the force": TrueAxes(gain=1.05),
}
#: A hand that taps the wall once a second, and one that a wall pulls in with all its force.
TAPS = SinusoidalHand(centre=-0.010, amplitude=0.024, frequency=1.0)
PULLED = PressingHand(start=-0.200, end=1.500, approach_speed=0.5)
PULLING = ActiveWall(stiffness=0.0, damping=-200.0, position=0.0)
MOTION_LAWS = ("none", "tdpa", *(law for law in LAWS if "viscous" not in law))

STIFFNESS, HARDNESS = "displayed_stiffness_n_per_mm", "rate_hardness_n_per_mm"
ENERGY, FALL = "true_energy_min_j", "largest_energy_fall_j"
#: Columns of the tables: keys of a row, heads and formats.
HEADS: dict[str, tuple[str, Callable[[Any], str]]] = {
    "law": ("law", "`{}`".format),
    "against": ("against", "`{}`".format),
    "number": ("number", str),
    "speed": ("mm/s", str),
    "hand_speed": ("hand speed, m/s", lambda speed: "none" if speed is None else f"{speed:g}"),
    STIFFNESS: ("stiffness, N/mm", "{:.3f}".format),
    **{f"{STIFFNESS}_{v}": (f"at {v} mm/s", "{:.3f}".format) for v in GRID["speed"]},
    "price": ("price", lambda share: f"{100 * share:.1f} %"),
    "ratio_of_mean_stiffness": ("stiffness", "{:.3f} times".format),
    "least_stiffness_ratio": ("lowest of a cell", "{:.2f}".format),
    "most_stiffness_ratio": ("highest", "{:.2f}".format),
    HARDNESS: ("rate-hardness, N/mm", "{:.3f}".format),
    "contact_bounces": ("contact bounces", "{:.1f}".format),
    "overshoot": ("overshoot", "{:.2f}".format),
    "power_w": ("largest power, W", "{:.2f}".format),
    "power_bound_w": ("bound at that speed, W", "{:.2f}".format),
    FALL: ("largest fall of energy", energy),
    ENERGY: ("lowest energy", lambda joules: energy(min(joules, 0.0))),
    **{f"drag_{ms}_ms": (f"drag, {ms} ms, N", "{:.3f}".format) for ms in GRID["delay"]},
}
#: Arguments of ``stiff_wall``, by the key of a case.
ARGUMENTS = {
    "law": "law:={}",
    "stiffness": "stiffness:={} N/mm",
    "delay": "delay:={} ms",
    "speed": "approach_speed:={} mm/s",
}
PAGE = Path(__file__).with_name("prices.md")  # all but the tables


def config_of(case: Row) -> GraphConfig:
    """Return the graph of a case; with ``number`` its device states and has them."""
    config = load("stiff_wall", [one.format(case[k]) for k, one in ARGUMENTS.items() if k in case])
    device, servo = config.only.device, replace(config.only.servo, hold_limit=case["hold_limit"])
    numbers: Any = {"hand_speed": case.get("hand_speed")}
    if "number" in case:
        numbers |= {"watchdog": "silent", **PRICES.get(case["number"], {})}
        numbers["truth"] = MISTAKES.get(case["number"])
    device = replace(device, **numbers)
    if case.get("hand") == "taken":
        environment = replace(config.environment, model=PULLING)
        config = replace(config.with_hand(operator=PULLED), environment=environment, duration=3.8)
    elif case.get("hand") == "taps":
        config = config.with_hand(operator=TAPS)
    return config.with_hand(device=device, servo=servo)


def motion_of(columns: TelemetryColumns, model: Any) -> Row:
    """Return the largest power of the motor less losses, its bound, and the drag where it is free.

    The power in W, the drag in N: work of the applied force over the way without a command.
    """
    step, dt = np.diff(columns.true_position[:, 0]), np.diff(columns.elapsed)
    force, speed = columns.applied_force[:-1, 0], np.abs(step / dt)
    losses = model.friction * speed + model.damping * speed**2
    power = -force * step / dt - losses
    top, free = int(np.argmax(power)), columns.commanded_force[:-1, 0] == 0.0
    return {
        "power_w": float(power[top]),
        "power_bound_w": float(model.saturation * speed[top] - losses[top]),
        "drag_n": float((force * step)[free].sum() / np.abs(step[free]).sum()),
    }


def n_per_mm(stiffness: float | None) -> float:
    """Return a stiffness in N/m in N/mm; without a contact NaN, which JSON refuses."""
    return math.nan if stiffness is None else stiffness / 1e3


def measure(cases: Sequence[Row]) -> list[Row]:
    """Run some cells and return a row for each."""
    rows, configs = [], list(map(config_of, cases))
    for case, config, outcome in zip(cases, configs, run_all(configs), strict=True):
        if outcome.result is None:
            raise SystemExit(f"{case}: {outcome.error}")
        summary = outcome.result.summary
        rows.append(
            {
                **case,
                STIFFNESS: n_per_mm(summary["displayed_stiffness_n_per_m"]),
                HARDNESS: n_per_mm(summary["rate_hardness_n_per_m"]),
                "contact_bounces": summary["contact_bounces"],
                "overshoot": summary["overshoot_share"],
                ENERGY: summary[ENERGY],
                FALL: summary[FALL],
                **motion_of(outcome.result.columns, config.only.device),
            }
        )
    return rows


def prices_of(rows: Sequence[Row]) -> list[Row]:
    """Return the mean displayed stiffness with each of ``PRICES``, and the loss of it."""
    found: list[Row] = []
    for (number,), own in groups(rows, "number").items():
        stiffness = mean(row[STIFFNESS] for row in own)
        first = found[0][STIFFNESS] if found else stiffness
        row = {"number": number, STIFFNESS: stiffness, "price": 1.0 - stiffness / first}
        found.append({**row, ENERGY: min(one[ENERGY] for one in own)})
    return found


def average(rows: Sequence[Row]) -> list[Row]:
    """Return the mean of each law over the grid, and of its stiffness at each speed."""
    return [
        {
            "law": law,
            **{name: mean(row[name] for row in own) for name in (STIFFNESS, HARDNESS)},
            **{
                f"{STIFFNESS}_{speed}": mean(row[STIFFNESS] for row in those)
                for (speed,), those in groups(own, "speed").items()
            },
            "contact_bounces": mean(row["contact_bounces"] for row in own),
            ENERGY: min(row[ENERGY] for row in own),
        }
        for (law,), own in groups(rows, "law").items()
    ]


def judge(rows: Sequence[Row]) -> list[Row]:
    """Return how much stiffer our laws are than others: at both speeds together, and at each."""
    verdicts = []
    for law, other, aim in AIMS:
        for speeds in (GRID["speed"], *((speed,) for speed in GRID["speed"])):
            by_law = groups((row for row in rows if row["speed"] in speeds), "law")
            pairs = list(zip(by_law[law,], by_law[other,], strict=True))
            ratios = {
                name: mean(ours[name] for ours, _ in pairs) / mean(one[name] for _, one in pairs)
                for name in (STIFFNESS, HARDNESS)
            }
            each = [ours[STIFFNESS] / one[STIFFNESS] for ours, one in pairs]
            aimed = aim if speeds == GRID["speed"] else None
            verdicts.append(
                {
                    "law": law,
                    "against": other,
                    "speed": ", ".join(map(str, speeds)),
                    "ratio_of_mean_stiffness": ratios[STIFFNESS],
                    "least_stiffness_ratio": min(each),
                    "most_stiffness_ratio": max(each),
                    "ratio_of_mean_rate_hardness": ratios[HARDNESS],
                    "aim": aimed,
                    "reached": aimed is None or ratios[STIFFNESS] >= aimed,
                }
            )
    return verdicts


def pressed(hold_limit: float) -> dict[str, list[Row]]:
    """Return the tables of the laws, and all rows of the grid."""
    cases = grid(law=LAWS, **GRID, hold_limit=(hold_limit,))
    rows = run_here(Campaign("grid", cases, measure, part=24), workers=None).rows
    return {"averages": average(rows), "aims": judge(rows), "rows": rows}


def by_hand_speed(hold_limit: float) -> list[Row]:
    """Return the means of both certified laws over walls that need the limit, for each speed."""
    laws = ("certified", "certified_fading")
    cases = grid(law=laws, hand_speed=HAND_SPEEDS, **STIFF, hold_limit=(hold_limit,))
    rows = run_here(Campaign("speeds", cases, measure, part=12), workers=None).rows
    return [
        {
            "law": law,
            "hand_speed": speed,
            **{
                name: mean(row[name] for row in own if row[name] is not None)
                for name in (STIFFNESS, HARDNESS, "contact_bounces", "overshoot")
            },
            ENERGY: min(row[ENERGY] for row in own),
        }
        for (law, speed), own in groups(rows, "law", "hand_speed").items()
    ]


def priced(hold_limit: float) -> dict[str, list[Row]]:
    """Return the tables of ``--prices``."""
    cells = grid(**GRID)
    cases: list[Row] = [
        *({"law": "certified", **cell, "number": number} for number in PRICES for cell in cells),
        *({"law": "certified", "hand": "taken", "number": number} for number in MISTAKES),
        *({"law": law, "hand": "taken"} for law in MOTION_LAWS),
        *grid(law=MOTION_LAWS, hand=("taps",), delay=GRID["delay"]),
    ]
    cases = [case | {"hold_limit": hold_limit} for case in cases]
    rows = run_here(Campaign("prices", cases, measure, part=4), workers=None).rows
    by_hand = groups(rows, "hand")
    taken, taps = by_hand["taken",], groups(by_hand["taps",], "law")
    keys = ("law", "power_w", "power_bound_w", FALL)
    return {
        "prices": prices_of(by_hand[None,]),
        "mistakes": [
            {key: row[key] for key in ("number", ENERGY)} for row in taken[: len(MISTAKES)]
        ],
        "power": [{key: row[key] for key in keys} for row in taken[len(MISTAKES) :]],
        "drag": [
            {"law": law, **{f"drag_{row['delay']}_ms": row["drag_n"] for row in own}}
            for (law,), own in taps.items()
        ],
    }


def shown(rows: Sequence[Row]) -> str:
    """Return rows as a table."""
    keys = [key for key in HEADS if key in rows[0]]
    cells = ([HEADS[key][1](row[key]) for key in keys] for row in rows)
    return "\n".join(table([HEADS[key][0] for key in keys], cells))


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
@click.option("--hold-limit", default=1.02, show_default=True, help="In periods.")
@click.option("--prices", is_flag=True, help="Print prices, power and drag.")
@click.option("--speeds", is_flag=True, help="Print what a stated speed of the hand gives.")
@click.option("--page", type=click.Path(path_type=Path), help="Write all tables to this page.")
def main(as_json: bool, hold_limit: float, prices: bool, speeds: bool, page: Path | None) -> None:
    """What the certificate costs; status 1 if an aim is not reached."""
    try:
        check_page(page)
    except ConfigError as error:
        raise click.BadParameter(str(error), param_hint="--page") from None
    found: dict[str, list[Row]] = {} if prices or speeds else pressed(hold_limit)
    if speeds or page:
        found["speeds"] = by_hand_speed(hold_limit)
    if prices or page:
        found |= priced(hold_limit)
    tables = {name: shown(rows) for name, rows in found.items() if name != "rows"}
    if page:
        made = origin("python -m forcebound_proofs certificate_grid --page proofs/docs/prices.md")
        write_page(page, [PAGE.read_text().rstrip().format(origin=made, **tables)])
    document = json.dumps(found, indent=2, allow_nan=False)
    click.echo(document if as_json else "\n\n".join(tables.values()))
    sys.exit(0 if all(verdict["reached"] for verdict in found.get("aims", ())) else 1)
