"""Fixtures of tests with sockets."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from forcebound.network.sockets import Network


@pytest.fixture
def run_dir() -> Iterator[Path]:
    """A folder whose path is short enough for ipc endpoints."""
    with tempfile.TemporaryDirectory(prefix="fb-") as path:
        yield Path(path)


@pytest.fixture
def network() -> Iterator[Network]:
    """The sockets of this process; closed afterwards."""
    with Network() as network:
        yield network
