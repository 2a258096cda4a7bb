"""Displayed stiffness of each law over a grid of walls, delays and speeds.

    python experiments/certificate_grid.py [--hold-limit PERIODS] [--prices] [--json]

The hand and the wall are those of ``stiff_wall``, the clock is steady. By default the hold limit is
that of punctual ticks as shipped, 1.02 periods; with ``--hold-limit 1`` all laws rely on the same
dissipation. The runs go through the compiled loop, which gives the bits of the virtual-time graph
(``tests/test_one_axis.py``).

``--prices`` prints what each number of a device costs the certified law: the loss of displayed
stiffness, on a device that has what it states. These runs go through the virtual-time graph and
take some minutes; ``--quick`` runs 4 of the 24 cells.

Aims: ``certified`` at least as stiff as the paper's less conservative law, ``certified_fading``
at least 1.4 times as stiff as the paper's more conservative law, on average over the grid.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from statistics import mean
from typing import Any

from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import load
from forcebound.lab.cases import grid
from forcebound.lab.engine import Campaign, Row, run_here
from forcebound.lab.runs import run_all
from forcebound.lab.views import groups, table

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
QUICK = ((10, 0, 200), (10, 0, 35), (30, 1, 200), (3, 1, 35))

#: Law, the law of the paper that it is measured against, and how much stiffer it should be.
AIMS = (
    ("certified", "less_conservative", 1.0),
    ("certified_fading", "more_conservative", 1.4),
)

#: Numbers of a device and the values whose price is printed, SI units.
PRICES: tuple[dict[str, float], ...] = (
    {},
    *({"write_delay": value} for value in (20e-6, 100e-6, 400e-6)),
    *({"gain_error": value} for value in (0.01, 0.05, 0.10)),
    *({"presliding": value} for value in (15e-6, 60e-6, 120e-6)),
    *({"lag": value} for value in (100e-6, 400e-6)),
    {"weight_error": 0.02},
)
STIFFNESS, HARDNESS = "displayed_stiffness_n_per_mm", "rate_hardness_n_per_mm"
ENERGY = "true_energy_min_j"


def config_of(case: Row) -> GraphConfig:
    """Return the graph of a case; with ``numbers`` its device states and has them."""
    arguments = {
        "law": case["law"],
        "stiffness": f"{case['stiffness']} N/mm",
        "delay": f"{case['delay']} ms",
        "approach_speed": f"{case['speed']} mm/s",
    }
    config = load("stiff_wall", [f"{name}:={value}" for name, value in arguments.items()])
    device = config.device
    device = replace(device, servo=replace(device.servo, hold_limit=case["hold_limit"]))
    if "numbers" in case:
        model: Any = device.model
        device = replace(device, model=replace(model, watchdog="silent", **case["numbers"]))
    return replace(config, device=device)


def measure(cases: Sequence[Row]) -> list[Row]:
    """Run some cells and return a row for each."""
    rows = []
    for case, outcome in zip(cases, run_all(list(map(config_of, cases))), strict=True):
        if outcome.result is None:
            raise SystemExit(f"{case}: {outcome.error}")
        summary = outcome.result.summary
        rows.append(
            {
                **case,
                STIFFNESS: summary["displayed_stiffness_n_per_m"] / 1e3,
                HARDNESS: summary["rate_hardness_n_per_m"] / 1e3,
                "contact_bounces": summary["contact_bounces"],
                ENERGY: summary[ENERGY],
            }
        )
    return rows


def prices_of(rows: Sequence[Row]) -> list[Row]:
    """Return the mean displayed stiffness with each of ``PRICES``, and the loss of it."""
    found: list[Row] = []
    for own in groups([row | {"key": str(row["numbers"])} for row in rows], "key").values():
        stiffness = mean(row[STIFFNESS] for row in own)
        first = found[0][STIFFNESS] if found else stiffness
        row = {"numbers": own[0]["numbers"], STIFFNESS: stiffness, "price": 1.0 - stiffness / first}
        found.append({**row, ENERGY: min(0.0, *(one[ENERGY] for one in own))})
    return found


def average(rows: Sequence[Row]) -> list[Row]:
    """Return the mean of each law over the grid."""
    return [
        {
            "law": law,
            **{name: mean(row[name] for row in own) for name in (STIFFNESS, HARDNESS)},
            "contact_bounces": mean(row["contact_bounces"] for row in own),
            "most_contact_bounces": max(row["contact_bounces"] for row in own),
            ENERGY: min(row[ENERGY] for row in own),
        }
        for (law,), own in groups(rows, "law").items()
    ]


def judge(rows: Sequence[Row]) -> list[Row]:
    """Return how much stiffer our laws are than the paper's, as means over the grid."""
    by_law, verdicts = groups(rows, "law"), []
    for law, other, aim in AIMS:
        pairs = list(zip(by_law[law,], by_law[other,], strict=True))
        ratios = {
            name: mean(ours[name] for ours, _ in pairs) / mean(paper[name] for _, paper in pairs)
            for name in (STIFFNESS, HARDNESS)
        }
        each = [ours[STIFFNESS] / paper[STIFFNESS] for ours, paper in pairs]
        verdicts.append(
            {
                "law": law,
                "against": other,
                "ratio_of_mean_stiffness": ratios[STIFFNESS],
                "mean_of_stiffness_ratios": mean(each),
                "least_stiffness_ratio": min(each),
                "ratio_of_mean_rate_hardness": ratios[HARDNESS],
                "aim": aim,
                "reached": ratios[STIFFNESS] >= aim,
            }
        )
    return verdicts


def shown(rows: Sequence[Row]) -> str:
    """Return rows as a table, numbers with four digits."""
    cells = (
        [f"{one:.4g}" if isinstance(one, float) else one for one in row.values()] for row in rows
    )
    return "\n".join(table(list(rows[0]), cells)) + "\n"


def main() -> int:
    """Print the grid; return 1 if an aim is not reached, else 0."""
    parser = argparse.ArgumentParser(description="Stiffness of the laws over a grid.")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--hold-limit", type=float, default=1.02, help="in periods")
    parser.add_argument("--prices", action="store_true", help="print the price of each number")
    parser.add_argument("--quick", action="store_true", help="prices on 4 of the 24 cells")
    options = parser.parse_args()
    fixed = {"hold_limit": (options.hold_limit,)}
    if options.prices:
        cells = (
            [dict(zip(GRID, one, strict=True)) for one in QUICK] if options.quick else grid(**GRID)
        )
        cases = [
            case | cell for case in grid(law=LAWS[3:4], **fixed, numbers=PRICES) for cell in cells
        ]
    else:
        cases = grid(law=LAWS, **GRID, **fixed)
    rows = run_here(Campaign("grid", cases, measure, part=24), workers=None).rows
    verdicts = [] if options.prices else judge(rows)
    document: Any = {"averages": average(rows), "aims": verdicts, "rows": rows}
    if options.prices:
        document = prices_of(rows)
    if options.json:
        sys.stdout.write(json.dumps(document, indent=2, allow_nan=False) + "\n")
    elif options.prices:
        sys.stdout.write(shown(document))
    else:
        sys.stdout.write(shown(document["averages"]) + "\n" + shown(verdicts))
    return 0 if all(verdict["reached"] for verdict in verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())
