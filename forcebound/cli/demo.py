"""``forcebound demo``: the same late, stiff wall without and with a law."""

import os
import shutil
import sys
from pathlib import Path

import click

from forcebound.cli import options as opt
from forcebound.cli.common import show
from forcebound.cli.lazy import when_used
from forcebound.cli.outcome import status_line
from forcebound.errors import ConfigError, RunError
from forcebound.results.printing import print_rows

with when_used():
    from forcebound.graph import loader
    from forcebound.haptics import laws
    from forcebound.results import plots, tables
    from forcebound.run import live
    from forcebound.run import results as run_results

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
picture:      {picture}
all figures:  {command} plot --all {folder}/none.mcap {folder}/certified.mcap
do it by hand, in a browser (extra view):  {command} launch pointer_wall --view
"""


def demo(
    folder: Path = opt.folder("Folder for two recordings and a picture.", Path("results/demo")),
) -> None:
    r"""Press a simulated hand into a late, stiff wall, without a law and with the certified one.

    \b
    forcebound demo
    """
    folder.mkdir(parents=True, exist_ok=True)
    results: list[run_results.RunResult] = []
    for law in ("none", "certified"):
        show(
            f"live run, law {law}: device, controller and environment as processes; a simulated "
            "hand presses into a late, stiff wall"
        )
        config = loader.load("delayed_wall.yaml", [f"law:={law}"])
        with status_line(as_json=False) as screen:
            results += live.run_live(config, record=folder / f"{law}.mcap", screen=screen).values()
        if results[-1].interrupted:
            raise KeyboardInterrupt
    try:
        plots.check_picture(folder / "demo.png")
    except ConfigError as error:  # without the extra plot
        picture = str(error)
    else:
        drawn = plots.figure([(r.label, r.columns, r.document) for r in results])
        plots.save(drawn, folder / "demo.png")
        picture = str(folder / "demo.png")
    head, rows = tables.summary_table([(result.label, result.summary) for result in results])
    show("")
    print_rows(head, [row for row in rows if row[0] in TELLING])
    without, certified = (result.summary for result in results)
    if certified["true_energy_min_j"] < -laws.ENERGY_TOLERANCE:
        raise RunError("the certified law leaked energy: please report this with the recording")
    words = MESSAGE.format(
        delay=certified["loop_delay_ms"]["p50"],
        given=-1e3 * without["true_energy_min_j"],
        depth=1e3 * certified["peak_penetration_m"],
        least=1e3 * certified["true_energy_min_j"],
    )
    show("\n" + click.wrap_text(words, 100))
    command = "forcebound" if shutil.which("forcebound") else os.path.relpath(sys.argv[0])
    show(AFTERWARDS.format(picture=picture, folder=folder, command=command).rstrip())
