"""Command ``forcebound feel``: a forecast of the stiffness that a hand will feel."""

from pathlib import Path

from forcebound.cli import complete
from forcebound.cli import options as opt
from forcebound.cli.common import print_document, say, show
from forcebound.cli.lazy import when_used

with when_used():
    from forcebound.lab import feel as forecasts
    from forcebound.results import plots


def feel(
    device: str = opt.argument(complete.launch_files),
    arguments: tuple[str, ...] = opt.settings,
    output: Path | None = opt.output("Picture to write, .png or .svg. Needs the extra plot."),
    as_json: bool = opt.as_json,
) -> None:
    r"""Forecast the stiffness that a hand will feel on DEVICE, a launch file or a kind of device.

    In virtual time, with the numbers as stated and with others in their place. Without a watchdog
    that ends late forces, these are watchdog_limit and allowance; for every device the rate.
    FILE.yaml:HAND is one hand of several. The launch file says in operator: who holds it.

    \b
    forcebound feel haply_2diy
    forcebound feel odrive_knob watchdog_limit:="20 ms" -o feel.png
    """
    if output is not None:
        plots.check_picture(output)
    found = forecasts.forecast(device, arguments, (lambda _: None) if as_json else show)
    print_document(found.document, as_json, lambda _: found.details)
    if output is not None:
        plots.save(forecasts.draw(found), output)
        say(f"picture: {output}")
