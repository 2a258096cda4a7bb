"""The live page of a graph, served as a user would, for tests with a browser."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from live_graph import LiveGraph, live_graph

TWO_HANDS = """
forcebound: 1
description: Two hands that follow pointers, in front of one wall.
duration: 3600 s
seed: 1
hands:
  left: { include: pointer_wall.yaml }
  right: { include: pointer_wall.yaml }
environment: { kind: wall, stiffness: 10 N/mm, position: 10 mm }
realtime: { policy: other } # two cores are full with two browsers and the nodes of two hands
"""


@contextmanager
def pages_of(runtime: str) -> Iterator[tuple[str, str]]:
    """The addresses of the graph that runs: to change it, and to look only."""
    command = [sys.executable, "-u", "-m", "forcebound", "view", "--no-open"]
    variables = {**os.environ, "XDG_RUNTIME_DIR": runtime}
    with subprocess.Popen(command, env=variables, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            yield server.stdout.readline().split()[-1], server.stdout.readline().split()[-1]
        finally:
            server.terminate()


@contextmanager
def pointed(launch: str = "pointer_wall") -> Iterator[tuple[LiveGraph, tuple[str, str]]]:
    """A graph whose hand follows a pointer, engaged, and its addresses."""
    with live_graph(launch, is_alone=False) as graph:
        graph.wait_until_engaged()
        with pages_of(str(graph.runtime)) as addresses:
            yield graph, addresses
