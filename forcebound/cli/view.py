"""The live page of a running graph."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from threading import Thread

import click

from forcebound.cli import options as opt
from forcebound.cli.common import run_to_signal, show
from forcebound.cli.lazy import when_used
from forcebound.errors import ConfigError, ForceboundError
from forcebound.extras import check_installed
from forcebound.folders import runtime_folder
from forcebound.realtime import on_cores

with when_used():
    import asyncio
    import webbrowser

    from forcebound.observe import runs
    from forcebound.observe.page import access as pages
    from forcebound.observe.page import server as page_server
    from forcebound.run import run_directory

POLL_S = 0.5  # between two looks for the next graph

REDIRECT = """<!doctype html><meta name="referrer" content="no-referrer">
<meta http-equiv="refresh" content="0;url={}"><title>forcebound</title>
"""


@contextmanager
def opened_in_browser(address: str, run: Path | None) -> Iterator[None]:
    """Open a page in a browser, which stays off the core of the nodes of a run, if there is one.

    Every user of the machine can read command lines, so the browser gets the name of a private file
    that leads to the address; it is deleted after the body. A browser may stay in the foreground,
    so a thread waits for it.
    """
    core = None if run is None else run_directory.RunDocument.read(run).core
    with tempfile.NamedTemporaryFile("w", suffix=".html", dir=runtime_folder()) as file:  # 0600
        file.write(REDIRECT.format(address))
        file.flush()

        def open_page() -> None:
            with on_cores(os.sched_getaffinity(0) - {core}):  # of this thread and what it starts
                webbrowser.open(Path(file.name).as_uri())

        Thread(target=open_page, daemon=True).start()
        yield


@contextmanager
def shown(access: "pages.Access", run: Path | None, opens: bool) -> Iterator[None]:
    """Print the addresses of a server, and open its page in a browser if there is a screen."""
    show(f"page:          {access.address(access.token)}")
    show(f"to look only:  {access.address(access.watching)}")
    if not access.is_local:
        show("others on this network can open them, and read what is sent", err=True)
    is_opened = opens and ("DISPLAY" in os.environ or "WAYLAND_DISPLAY" in os.environ)
    # Without a screen a browser of text would take the terminal.
    page = opened_in_browser(access.address(access.token), run) if is_opened else nullcontext()
    with page:
        yield


def view(
    run: Path | None = opt.given_run,
    waits: bool = opt.flag("Also wait for the first graph.", "--wait"),
    port: int = opt.port("Port. Default: any free one."),
    listen: str = opt.option(
        "Address of this machine that others may call, too. Default: this machine only.",
        default="127.0.0.1",
        metavar="ADDRESS",
    ),
    recordings: Path = opt.option(
        "Folder for recordings that the page makes. Default: this one.",
        type=click.Path(exists=True, file_okay=False, path_type=Path),
        default=".",
        metavar="DIR",
    ),
    opens: bool = opt.opens,
    embed: bool = opt.flag("Let other pages, such as a notebook, show it in a frame.", "--embed"),
    launcher: int | None = opt.option(
        "Show only the graph of this process.", type=int, hidden=True
    ),
) -> None:
    r"""Show a running graph in a browser, and change it from there, until Ctrl-C.

    When the graph has ended, the page waits for the next one, and shows it at the same address.

    Who has the first address may change the graph; the second is for an audience. Nobody else gets
    in. With --listen both go over the network as they are, without encryption: use it among
    people you trust.

    \b
    forcebound view
    forcebound view --wait --run pointer_wall --port 8000
    """
    check_installed("the page", "tornado")
    # Its imports take a while, in which the graph starts.
    served = partial(page_server.Server, listen, port, recordings, embed=embed)
    first: Path | None = None
    if launcher is not None:
        first = runs.find_launched(launcher)
    elif not waits:
        first = runs.find(run, require_graph=True)

    async def serve() -> None:
        server = served()  # in the loop in which it serves
        try:
            with shown(server.access, first, opens):
                await _show_graphs(server, first, run, stays=launcher is None)
        finally:
            await server.close()

    run_to_signal(serve())


async def _show_graphs(
    server: "page_server.Server", run: Path | None, name: Path | None, *, stays: bool
) -> None:
    """Show a graph, and if the server ``stays``, those of this name that come after it."""
    while not server.is_stopped:
        if run is None:
            show("waiting for a graph; Ctrl-C ends the page")
            run = await _next(server, name)
        if run is not None:
            try:
                await server.show(run)
            except ForceboundError as error:  # it ended before there was anything to show
                show(str(error), err=True)
            run = None
            if not server.is_stopped:
                show("the graph has ended")
        if not stays:
            return


async def _next(server: "page_server.Server", name: Path | None) -> Path | None:
    """Return the next graph; None: the server is to stop. It is reported once if several run."""
    reported = ""
    while not server.is_stopped:
        await asyncio.sleep(POLL_S)
        try:
            run = runs.find(name, require_graph=True)
        except ConfigError as error:
            if name is None and runs.running() and str(error) != reported:
                reported = str(error)
                show(reported, err=True)
        else:
            if run != server.last:
                return run
    return None
