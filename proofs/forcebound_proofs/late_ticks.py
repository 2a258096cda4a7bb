"""Displayed stiffness when ticks are late: laws, hold limits and watchdogs against each other.

Usage: python -m forcebound_proofs.late_ticks [--seeds 3] [--duration 6]

The hand of `stiff_wall` presses into its wall without delay, in virtual time. A writer that is late
now and then is drawn from a seed, the same for all contestants: 0.3 to 2 ms late so often a
second, and every other write within 20 us of its time. A cell is the mean over the seeds of the
displayed stiffness, in N/mm; where they differ by more than a tenth, the lowest and the highest.
The lowest energy of the hand in all runs stands below the table.
"""

import argparse
from dataclasses import replace
from typing import Any

from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import load
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
    config = load("stiff_wall", [f"law:={law}", f"hold_limit:={hold_limit}"])
    allowance = ALLOWANCE if watchdog == "none" else 0.0
    servo = replace(config.only.servo, allowance=allowance)
    model: Any = config.only.device
    model = replace(model, watchdog=watchdog, **WATCHDOGS[watchdog])
    return config.with_hand(device=model, servo=servo)


def cell(values: list[float]) -> str:
    """Return the mean, or the range if the values differ."""
    mean = sum(values) / len(values)
    low, high = min(values), max(values)
    return f"{mean:.2f}" if high - low <= 0.1 * mean else f"{low:.2f}-{high:.2f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Displayed stiffness when ticks are late.")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--duration", type=float, default=6.0, help="of a run, in s")
    options = parser.parse_args()
    heads = [f"{limit} T" if limit != "auto" else "auto" for limit in HOLD_LIMITS]
    print(f"| law | watchdog | late ticks/s | {' | '.join(heads)} |")
    print(f"|---|---|---|{'---|' * len(heads)}")
    lowest, most = 0.0, 0.0
    for law in LAWS:
        for watchdog in WATCHDOGS:
            for rate in RATES:
                cells = []
                for hold_limit in HOLD_LIMITS:
                    values = []
                    for seed in range(1, options.seeds + 1):
                        config = case(law, watchdog, hold_limit)
                        late = LateTicks(rate=rate, jitter=JITTER, seed=seed)
                        summary = run_virtual(config, options.duration, late_ticks=late).summary
                        values.append((summary["displayed_stiffness_n_per_m"] or 0.0) * 1e-3)
                        lowest = min(lowest, summary["true_energy_min_j"])
                        most = max(most, summary["largest_allowance_j"] or 0.0)
                    cells.append(cell(values))
                print(f"| `{law}` | {watchdog} | {rate:g} | {' | '.join(cells)} |", flush=True)
    print(
        f"\nlowest energy of the hand {lowest * 1e3:.3f} mJ, largest allowance {most * 1e3:.2f} mJ"
    )


if __name__ == "__main__":
    main()
