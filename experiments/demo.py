"""Live demo of ``make demo``: the same late, stiff wall without and with a law."""

import os
import sys
from pathlib import Path

from rich.console import Console

from forcebound.cli.common import INTERRUPTED, print_rows, status_line, table_of
from forcebound.errors import ForceboundError, RunError
from forcebound.graph.loader import load
from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound.results.plots import figure, save
from forcebound.run.live import run_live

RESULTS = Path(__file__).parent.parent / "results" / "demo"

#: Rows of the table that tell the two runs apart.
TELLING = (
    "contact bounces",
    "speed at the end",
    "displayed stiffness",
    "minimum energy (ground truth)",
)

MESSAGE = (
    "Without a law, a wall of 10 N/mm with a loop delay of {delay:.0f} ms makes the hand oscillate "
    "and gives it {given:.0f} mJ that it did not put in. With the certified law, the hand sinks no "
    "deeper than {depth:.1f} mm into the same wall, and the energy never falls below zero "
    "(minimum {least:.2g} mJ)."
)

AFTERWARDS = """
picture:      {folder}/demo.png
all figures:  .venv/bin/forcebound plot {folder}/none.mcap {folder}/certified.mcap
do it by hand, in a browser:  .venv/bin/forcebound launch pointer_wall --view
"""


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
        with status_line(as_json=False) as screen:
            results.append(run_live(config, record=RESULTS / f"{law}.mcap", screen=screen))
        if results[-1].interrupted:
            raise KeyboardInterrupt
    save(figure([(r.label, r.columns, r.document) for r in results]), RESULTS / "demo.png")
    head, rows = table_of(results)
    console.print()
    print_rows(head, [row for row in rows if row[0] in TELLING])
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
    folder = os.path.relpath(RESULTS)
    console.print(AFTERWARDS.format(folder=folder), soft_wrap=True, highlight=False)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except ForceboundError as error:
        sys.exit(f"demo: {error}")
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
