"""Commands for sweeps and their maps."""

from pathlib import Path

import click

from forcebound.cli import complete
from forcebound.cli import options as opt
from forcebound.cli.common import continued, print_document, show
from forcebound.cli.lazy import when_used
from forcebound.errors import RunError
from forcebound.extras import check_installed

with when_used():
    from forcebound.lab.sweep import maps, plan, runner

_sweeps = complete.files(".yaml", ".yml", shipped=lambda: plan.shipped())


def sweep(
    file: str = opt.argument(_sweeps),
    arguments: tuple[str, ...] = opt.settings,
    output: Path | None = opt.output("Parquet file to write. Default: name of the sweep file."),
    workers: int | None = opt.option("Number of processes. Default: one per core.", type=opt.COUNT),
    cluster: str | None = opt.option(
        "Run on a dask cluster; address of its scheduler, tcp://127.0.0.1:8786. Anyone who reaches "
        "a scheduler runs code on it.",
        metavar="ADDRESS",
    ),
    restart: bool = opt.flag("Discard earlier parts."),
    overwrite: bool = opt.flag("Replace the result of another sweep."),
    plot: bool = opt.flag("Also draw the map of the sweep."),
    as_json: bool = opt.as_json,
) -> None:
    r"""Run a sweep file, e.g. z_width or stability_map; continue an interrupted sweep.

    Needs the extra lab: pip install 'forcebound[lab]'.

    \b
    forcebound sweep stability_map --plot
    forcebound sweep my_sweep.yaml -o my_sweep.parquet --workers 2
    """
    with continued("the same command without --restart" if restart else "the same command"):
        done = runner.run_file(file, arguments, output, workers, cluster, restart, overwrite, plot)
    known = [
        f"{name.replace('_', ' ')}: {value}" for name, value in done.items() if value is not None
    ]
    print_document(done, as_json, lambda _: known)
    if done["failed"] == done["cases"]:
        raise RunError(f"every case failed; the first: {done['first_error']}")


def draw_map(
    result: Path = opt.argument(type=opt.FILE),
    value: str | None = opt.option("Figure or measure to draw. Default: that of the sweep file."),
    x: str | None = opt.option("Varied argument of the axis across; without --y: curves."),
    y: str | None = opt.option("Varied argument of the axis upwards."),
    per: str | None = opt.option("Varied argument with a panel, or a curve, for each value."),
    scale: str | None = opt.option(
        "Of the value: linear or log.", type=click.Choice(["linear", "log"])
    ),
    output: Path | None = opt.output(
        "Picture file, .png or .svg. Default: name of the result, .png."
    ),
) -> None:
    r"""Draw the map of a sweep's RESULT.parquet, with theoretical limits, or any column of it.

    Needs the extra lab: pip install 'forcebound[lab]'.

    \b
    forcebound map stability_map.parquet -o map.svg
    forcebound map runs.parquet --value contacts --x delay --y stiffness --per law
    """
    check_installed("a map", "matplotlib", "pyarrow")
    output = output or result.with_suffix(".png")
    maps.draw(result, output, value=value, x=x, y=y, per=per, scale=scale)
    show(f"map: {output}")
