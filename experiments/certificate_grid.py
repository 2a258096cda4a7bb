"""Displayed stiffness of each law over a grid of walls, delays and speeds.

    python experiments/certificate_grid.py [--hold-limit PERIODS] [--prices] [--json]

The hand and the wall are those of ``stiff_wall``, the clock is steady. By default the hold limit is
that of punctual ticks as shipped, 1.02 periods; with ``--hold-limit 1`` all laws rely on the same
dissipation. The runs go through the compiled loop, which gives the bits of the virtual-time graph
(``tests/test_one_axis.py``).

``--prices`` prints what each number of a device costs the certified law: the loss of displayed
stiffness, on a device that has what it states. These runs go through the virtual-time graph and
take some minutes; ``--quick`` runs 4 of the 24 cells.

Aims: ``certified`` at least as stiff as the paper's less conservative law, ``certified_memoryless``
at least 1.4 times as stiff as the paper's more conservative law, on average over the grid.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from statistics import mean
from typing import Any

from forcebound.config.graph import GraphConfig
from forcebound.config.loader import load
from forcebound.lab.runs import run_all

LAWS = (
    "less_conservative",
    "less_conservative_viscous",
    "aol",
    "certified",
    "more_conservative",
    "more_conservative_viscous",
    "certified_memoryless",
)
STIFFNESSES = (1, 3, 10, 30)  # N/mm
DELAYS = (0, 1, 5)  # ms, each way
SPEEDS = (200, 35)  # mm/s

#: Law, the law of the paper that it is measured against, and how much stiffer it should be.
AIMS = (
    ("certified", "less_conservative", 1.0),
    ("certified_memoryless", "more_conservative", 1.4),
)

#: Numbers of a device and the values whose price is printed, SI units.
PRICES: tuple[dict[str, float], ...] = (
    {},
    {"write_delay": 20e-6},
    {"write_delay": 100e-6},
    {"write_delay": 400e-6},
    {"gain_error": 0.01},
    {"gain_error": 0.05},
    {"gain_error": 0.10},
    {"presliding": 15e-6},
    {"presliding": 60e-6},
    {"presliding": 120e-6},
    {"lag": 100e-6},
    {"lag": 400e-6},
    {"weight_error": 0.02},
)
QUICK = ((10, 0, 200), (10, 0, 35), (30, 1, 200), (3, 1, 35))  # N/mm, ms, mm/s


def case(
    law: str, stiffness: float, delay: float, speed: float, hold_limit: float = 1.0
) -> GraphConfig:
    """Return one cell of the grid; units as above, the hold limit in periods."""
    config = load(
        "stiff_wall",
        [
            f"law:={law}",
            f"stiffness:={stiffness} N/mm",
            f"delay:={delay} ms",
            f"approach_speed:={speed} mm/s",
        ],
    )
    servo = replace(config.device.servo, hold_limit=hold_limit)
    return replace(config, device=replace(config.device, servo=servo))


def measure_prices(hold_limit: float, quick: bool) -> list[dict[str, Any]]:
    """Return the mean displayed stiffness of the certified law with each of ``PRICES``."""
    cells = list(QUICK) if quick else list(product(STIFFNESSES, DELAYS, SPEEDS))
    rows: list[dict[str, Any]] = []
    for numbers in PRICES:
        configs = []
        for cell in cells:
            config = case("certified", *cell, hold_limit)
            model: Any = config.device.model
            model = replace(model, watchdog="silent", **numbers)
            configs.append(replace(config, device=replace(config.device, model=model)))
        stiffnesses, lowest = [], 0.0
        for outcome in run_all(configs):
            if outcome.result is None:
                raise SystemExit(f"{numbers}: {outcome.error}")
            summary = outcome.result.summary
            stiffnesses.append(summary["displayed_stiffness_n_per_m"] / 1e3)
            lowest = min(lowest, summary["true_energy_min_j"])
        stiffness = mean(stiffnesses)
        first = rows[0]["displayed_stiffness_n_per_mm"] if rows else stiffness
        rows.append(
            {
                "numbers": numbers,
                "displayed_stiffness_n_per_mm": stiffness,
                "price": 1.0 - stiffness / first,
                "true_energy_min_j": lowest,
            }
        )
    return rows


def print_prices(rows: list[dict[str, Any]]) -> None:
    """Print the prices as a table."""
    sys.stdout.write(
        f"{'number of the device':<28}{'N/mm':>8}{'price':>9}{'least energy, J':>18}\n"
    )
    for row in rows:
        numbers = ", ".join(f"{name} {value:g}" for name, value in row["numbers"].items())
        sys.stdout.write(
            f"{numbers or 'as the paper has it':<28}{row['displayed_stiffness_n_per_mm']:>8.3f}"
            f"{100 * row['price']:>8.1f}%{row['true_energy_min_j']:>18.2g}\n"
        )


def measure(laws: Sequence[str], hold_limit: float) -> list[dict[str, Any]]:
    """Run the grid and return one row for each cell."""
    cells = list(product(laws, STIFFNESSES, DELAYS, SPEEDS))
    outcomes = run_all([case(*cell, hold_limit) for cell in cells])
    rows = []
    for (law, stiffness, delay, speed), outcome in zip(cells, outcomes, strict=True):
        if outcome.result is None:
            raise SystemExit(f"{law}, {stiffness} N/mm, {delay} ms, {speed} mm/s: {outcome.error}")
        summary = outcome.result.summary
        rows.append(
            {
                "law": law,
                "stiffness_n_per_mm": stiffness,
                "delay_ms": delay,
                "approach_speed_mm_per_s": speed,
                "displayed_stiffness_n_per_mm": summary["displayed_stiffness_n_per_m"] / 1e3,
                "rate_hardness_n_per_mm": summary["rate_hardness_n_per_m"] / 1e3,
                "contact_bounces": summary["contact_bounces"],
                "true_energy_min_j": summary["true_energy_min_j"],
            }
        )
    return rows


def average(rows: list[dict[str, Any]], laws: Sequence[str]) -> list[dict[str, Any]]:
    """Return the mean of each law over the grid."""
    averages = []
    for law in laws:
        own = [row for row in rows if row["law"] == law]
        averages.append(
            {
                "law": law,
                "displayed_stiffness_n_per_mm": mean(
                    row["displayed_stiffness_n_per_mm"] for row in own
                ),
                "rate_hardness_n_per_mm": mean(row["rate_hardness_n_per_mm"] for row in own),
                "contact_bounces": mean(row["contact_bounces"] for row in own),
                "most_contact_bounces": max(row["contact_bounces"] for row in own),
                "true_energy_min_j": min(row["true_energy_min_j"] for row in own),
            }
        )
    return averages


def judge(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return how much stiffer our laws are than the paper's, as means over the grid."""
    verdicts = []
    for law, other, aim in AIMS:
        pairs = {
            key: [
                (ours[key], paper[key])
                for ours, paper in zip(
                    [row for row in rows if row["law"] == law],
                    [row for row in rows if row["law"] == other],
                    strict=True,
                )
            ]
            for key in ("displayed_stiffness_n_per_mm", "rate_hardness_n_per_mm")
        }
        stiffness = pairs["displayed_stiffness_n_per_mm"]
        hardness = pairs["rate_hardness_n_per_mm"]
        ratio = mean(a for a, _ in stiffness) / mean(b for _, b in stiffness)
        verdicts.append(
            {
                "law": law,
                "against": other,
                "ratio_of_mean_stiffness": ratio,
                "mean_of_stiffness_ratios": mean(a / b for a, b in stiffness),
                "least_stiffness_ratio": min(a / b for a, b in stiffness),
                "ratio_of_mean_rate_hardness": mean(a for a, _ in hardness)
                / mean(b for _, b in hardness),
                "aim": aim,
                "reached": ratio >= aim,
            }
        )
    return verdicts


def main() -> int:
    """Print the grid; return 1 if an aim is not reached, else 0."""
    parser = argparse.ArgumentParser(description="Stiffness of the laws over a grid.")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument("--hold-limit", type=float, default=1.02, help="in periods")
    parser.add_argument("--prices", action="store_true", help="print the price of each number")
    parser.add_argument("--quick", action="store_true", help="prices on 4 of the 24 cells")
    options = parser.parse_args()
    as_json = options.json
    if options.prices:
        prices = measure_prices(options.hold_limit, options.quick)
        if as_json:
            sys.stdout.write(json.dumps(prices, indent=2, allow_nan=False) + "\n")
        else:
            print_prices(prices)
        return 0
    rows = measure(LAWS, options.hold_limit)
    averages, verdicts = average(rows, LAWS), judge(rows)
    if as_json:
        document = {"averages": averages, "aims": verdicts, "rows": rows}
        sys.stdout.write(json.dumps(document, indent=2, allow_nan=False) + "\n")
    else:
        sys.stdout.write(f"{'N/mm':<27}{'S_D':>8}{'H_R':>8}{'turns':>8}{'least energy, J':>18}\n")
        for row in averages:
            sys.stdout.write(
                f"{row['law']:<27}{row['displayed_stiffness_n_per_mm']:>8.3f}"
                f"{row['rate_hardness_n_per_mm']:>8.3f}{row['contact_bounces']:>8.1f}"
                f"{row['true_energy_min_j']:>18.2g}\n"
            )
        for verdict in verdicts:
            sys.stdout.write(
                f"{verdict['law']} / {verdict['against']}: S_D "
                f"{verdict['ratio_of_mean_stiffness']:.3f} (cell by cell "
                f"{verdict['mean_of_stiffness_ratios']:.3f}, least "
                f"{verdict['least_stiffness_ratio']:.3f}), H_R "
                f"{verdict['ratio_of_mean_rate_hardness']:.3f}; aim {verdict['aim']:.1f} "
                f"{'reached' if verdict['reached'] else 'NOT reached'}\n"
            )
    return 0 if all(verdict["reached"] for verdict in verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())
