"""Live demo of ``make demo``: the same late, stiff wall without and with a law."""

import sys
from pathlib import Path

from rich.console import Console

from forcebound.analysis.plots import figure, save
from forcebound.bounding import ENERGY_TOLERANCE
from forcebound.cli import print_table
from forcebound.config.loader import load
from forcebound.errors import ForceboundError, RunError
from forcebound.launch.live import run_live

RESULTS = Path(__file__).parent.parent / "results" / "demo"

MESSAGE = (
    "Without a law, a wall of 10 N/mm with a loop delay of {delay:.0f} ms makes the hand oscillate "
    "and gives it {given:.0f} mJ that it did not put in. With the certified law, the hand sinks no "
    "deeper than {depth:.1f} mm into the same wall, and the energy never falls below zero "
    "(minimum {least:.2g} mJ)."
)


def main() -> int:
    """Run the demo; return the exit status."""
    console = Console()
    RESULTS.mkdir(parents=True, exist_ok=True)
    results = []
    for law in ("none", "certified"):
        console.print(
            f"[bold]live run, law {law}[/bold]: device, controller and environment as processes; "
            "a simulated hand presses into a late, stiff wall"
        )
        config = load("delayed_wall.yaml", [f"law:={law}"])
        results.append(run_live(config, record=RESULTS / f"{law}.mcap"))
    picture = RESULTS / "demo.png"
    save(figure([(r.label, r.columns, r.document) for r in results]), picture)
    print_table(results)
    without, certified = (result.summary for result in results)
    if certified["true_energy_min_j"] < -ENERGY_TOLERANCE:
        raise RunError("the certified law leaked energy: please report this with the recording")
    console.print()
    console.print(
        MESSAGE.format(
            delay=certified["loop_delay_ms"]["p50"],
            given=-1e3 * without["true_energy_min_j"],
            depth=1e3 * certified["peak_penetration_m"],
            least=1e3 * certified["true_energy_min_j"],
        ),
        soft_wrap=True,
    )
    console.print(f"\npicture: {picture}\nrecordings: {RESULTS}/none.mcap, certified.mcap")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except ForceboundError as error:
        sys.exit(f"demo: {error}")
