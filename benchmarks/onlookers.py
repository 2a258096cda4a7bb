"""Benchmark of the commands that look at a running graph: ``python -m benchmarks.onlookers``.

::

    python -m benchmarks.onlookers
    python -m benchmarks.onlookers "echo scene" "hz telemetry" --turns 10

A graph runs. Its servo's lateness and loop delay are compared in turns: nobody looks, then one
command after the other does, its start and end included. The servo must not notice: less than 5 %
difference.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import click

from benchmarks.turns import ALONE, Graph, Turn, graph, servo, told

COMMANDS = ("list --watch", "echo telemetry --json", "hz", "graph", "delay --links", "log")


@click.command()
@click.argument("commands", nargs=-1)
@click.option("--turns", default=5, help="Turns without and with each command.")
@click.option("--seconds", default=3.0, help="Of each turn.")
@click.option("--json", "as_json", is_flag=True)
def main(commands: tuple[str, ...], turns: int, seconds: float, as_json: bool) -> None:
    """Measure the servo without and with each COMMAND of forcebound, which takes --duration."""
    with tempfile.TemporaryDirectory(prefix="fb-") as folder:
        record = Path(folder) / "run.mcap"
        with graph(folder, record) as running:
            taken = [
                turn(viewer, seconds, running)
                for _ in range(turns)
                for command in commands or COMMANDS
                for viewer in (ALONE, command)
            ]
        figures, load = servo(record, taken), os.getloadavg()[0]
    if as_json:
        click.echo(json.dumps({"servo": figures, "load": load}, indent=2))
        return
    for line in told(figures):
        click.echo(line.replace("; ", "\n  "))
    click.echo(f"load of the machine at the end: {load:.1f}")


def turn(viewer: str, seconds: float, running: Graph) -> Turn:
    """Let a command look, or nobody; return when it began and ended."""
    look = [sys.executable, "-m", "forcebound", *viewer.split(), "--duration", f"{seconds} s"]
    begin_ns = time.monotonic_ns()
    if viewer == ALONE:
        running.run_for(seconds)
    else:
        subprocess.run(look, env=running.variables, stdout=subprocess.DEVNULL, check=True)
    return Turn(viewer, begin_ns, time.monotonic_ns())


if __name__ == "__main__":
    main()
