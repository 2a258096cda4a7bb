"""The live page of a running graph."""

import os
from importlib.util import find_spec
from pathlib import Path

import click

from forcebound.cli.common import reports_errors, run_option, show
from forcebound.errors import ConfigError


def check_tornado() -> None:
    """Refuse to go on where the page's server is not installed.

    Raises:
        ConfigError: With what to install.
    """
    if find_spec("tornado") is None:
        raise ConfigError("the page needs tornado: pip install 'forcebound[view]'")


def has_screen() -> bool:
    """Return whether a browser would have a window; one of text would take the terminal."""
    return "DISPLAY" in os.environ or "WAYLAND_DISPLAY" in os.environ


@click.command(short_help="Open a live page of the running graph.")
@run_option
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Default: any free one.")
@click.option(
    "--listen",
    default="127.0.0.1",
    metavar="ADDRESS",
    help="Address of this machine that others may call, too. Default: this machine only.",
)
@click.option("--open/--no-open", "opens", default=True, help="Whether to open a browser.")
@click.option("--launcher", type=int, hidden=True, help="Wait for the graph of this process.")
@reports_errors
def view(run_dir: Path | None, port: int, listen: str, opens: bool, launcher: int | None) -> None:
    r"""Show a running graph in a browser, and change it from there, until Ctrl-C.

    Who has the first address may change the graph; the second is for an audience. Nobody else gets
    in. With --listen both go over the network as they are, without encryption: use it among
    people you trust.

    \b
    forcebound view
    forcebound view --run pointer_wall --port 8000 --no-open
    """
    import asyncio
    import webbrowser

    from forcebound.monitor.runs import find, find_launched
    from forcebound.view.access import LOOPBACK

    check_tornado()
    from forcebound.view.server import Server

    run = find(run_dir, of_graph=True) if launcher is None else find_launched(launcher)

    async def serve() -> None:
        server = Server(run, listen, port)
        access = server.access
        show(f"page:          {access.address(access.token)}")
        show(f"to look only:  {access.address(access.watching)}")
        if access.hosts != LOOPBACK:
            show("others on this network can open them, and read what is sent", err=True)
        if opens and has_screen():
            webbrowser.open(access.address(access.token))
        await server.run()
        show("the graph has ended")

    asyncio.run(serve())
