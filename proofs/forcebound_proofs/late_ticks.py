"""Displayed stiffness when ticks are late: laws, hold limits and watchdogs against each other.

The hand of `stiff_wall` presses into its wall without delay, in virtual time. A writer that is late
now and then is drawn from a seed, the same for all contestants: 0.3 to 2 ms late so often a
second, and every other write within 20 us of its time. A cell is the mean over the seeds of the
displayed stiffness, in N/mm; where they differ by more than a tenth, the lowest and the highest.
The lowest energy of the hand in all runs stands below the table.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import click

from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import load
from forcebound.lab.cases import grid
from forcebound.lab.engine import Campaign, Row, run_here
from forcebound.lab.views import groups, table
from forcebound.run.simulation import LateTicks
from forcebound.run.virtual import run_virtual

LAWS = ("certified", "certified_fading")
RATES = (0.0, 2.0, 20.0)  # late ticks per second
HOLD_LIMITS = (1.25, 2.0, 4.0, 10.0, "auto")
JITTER = 20e-6  # s
# Watchdog -> what the device states beside it. Without one, a hold may last 10 ms at most.
WATCHDOGS: dict[str, dict[str, float]] = {
    "guarding": {},
    "reporting": {},
    "silent": {},
    "none": {"watchdog_limit": 10e-3},
}
ALLOWANCE = 100e-3  # J, that late holds may leak where there is no watchdog


def case(law: str, watchdog: str, hold_limit: float | str) -> GraphConfig:
    """Return the press of one cell."""
    config = load(
        "stiff_wall", [f"law:={law}", f"hold_limit:={hold_limit}", "device.hand_speed:=null"]
    )
    allowance = ALLOWANCE if watchdog == "none" else 0.0
    servo = replace(config.only.servo, allowance=allowance)
    model: Any = config.only.device
    model = replace(model, watchdog=watchdog, **WATCHDOGS[watchdog])
    return config.with_hand(device=model, servo=servo)


def measure(cases: Sequence[Row]) -> list[Row]:
    """Run some presses and return a row for each."""
    rows = []
    for one in cases:
        config = case(one["law"], one["watchdog"], one["hold_limit"])
        late = LateTicks(rate=one["rate"], jitter=JITTER, seed=one["seed"])
        summary = run_virtual(config, one["duration"], late_ticks=late).summary
        found = {
            "stiffness": (summary["displayed_stiffness_n_per_m"] or 0.0) * 1e-3,  # N/mm
            "energy": summary["true_energy_min_j"],
            "allowance": summary["largest_allowance_j"] or 0.0,
        }
        rows.append({**one, "hold_limit": str(one["hold_limit"]), **found})
    return rows


def cell(values: list[float]) -> str:
    """Return the mean, or the range if the values differ."""
    mean = sum(values) / len(values)
    low, high = min(values), max(values)
    return f"{mean:.2f}" if high - low <= 0.1 * mean else f"{low:.2f}-{high:.2f}"


@click.command()
@click.option("--seeds", default=3, show_default=True, help="Runs of each cell.")
@click.option("--duration", default=6.0, show_default=True, help="Of a run, in s.")
def main(seeds: int, duration: float) -> None:
    """Displayed stiffness when ticks are late, by law, watchdog and hold limit."""
    contestants = grid(law=LAWS, watchdog=list(WATCHDOGS), rate=RATES, hold_limit=HOLD_LIMITS)
    cases = [
        {**one, "seed": seed, "duration": duration}
        for one in contestants
        for seed in range(1, seeds + 1)
    ]
    rows = run_here(Campaign("late ticks", cases, measure, part=seeds), workers=None).rows
    heads = [f"{limit} T" if limit != "auto" else "auto" for limit in HOLD_LIMITS]
    lines = []
    for (law, watchdog, rate), own in groups(rows, "law", "watchdog", "rate").items():
        each = groups(own, "hold_limit").values()
        cells = [cell([row["stiffness"] for row in some]) for some in each]
        lines.append((f"`{law}`", watchdog, f"{rate:g}", *cells))
    click.echo("\n".join(table(("law", "watchdog", "late ticks/s", *heads), lines)))
    lowest, most = min(row["energy"] for row in rows), max(row["allowance"] for row in rows)
    click.echo(
        f"\nlowest energy of the hand {min(lowest, 0.0) * 1e3:.3f} mJ, largest allowance"
        f" {most * 1e3:.2f} mJ"
    )
