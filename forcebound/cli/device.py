"""Commands about devices on serial ports."""

from dataclasses import asdict
from pathlib import Path

import click

from forcebound.cli.common import (
    Group,
    json_option,
    print_json,
    print_rows,
    reports_errors,
    run_option,
    show,
)


@click.group("device", cls=Group, short_help="List serial ports; go on with a lost device.")
def device_group() -> None:
    """Look for devices on serial ports; let a graph go on with one that was lost."""


@device_group.command("list")
@json_option
@reports_errors
def list_devices(as_json: bool) -> None:
    r"""List the serial ports of this machine, and what seems to be there.

    \b
    forcebound device list --json
    """
    from forcebound.hardware.ports import listed

    ports = listed()
    if as_json:
        print_json([asdict(port) for port in ports])
        return
    rows = [
        (
            port.path,
            port.seems or "–",
            port.serial_number or "–",
            port.description or "–",
            "yes" if port.is_permitted else "no: `forcebound doctor`",
        )
        for port in ports
    ]
    if rows:
        print_rows(("port", "seems to be", "serial number", "description", "may be opened"), rows)
    else:
        show("no serial port has a device; plug it in, or try `forcebound emulate haply_2diy`")


@device_group.command("resume", short_help="Let a graph go on with a device that was lost.")
@run_option
@reports_errors
def resume(run_dir: Path | None) -> None:
    r"""Let a running graph open its lost device again (on_loss: wait).

    First plug it in, switch it on, and hold it in its home pose.

    \b
    forcebound device resume --run haply_2diy
    """
    from forcebound.monitor.control import resume_device
    from forcebound.monitor.runs import find

    resume_device(find(run_dir, require_graph=True))
    show("the device is back; its force engages")
