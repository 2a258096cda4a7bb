"""Fixtures of tests with sockets and processes; profiles of hypothesis; time limits."""

import signal
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from leaks import no_leaks, no_processes
from measured import measure_begins_of_runs, measure_no_compilation

from forcebound.network.sockets import Network

# The daily tests draw the same examples each day, so that a change fails for what it changes; make
# test-slow draws others: --hypothesis-profile=random.
settings.register_profile("daily", derandomize=True, deadline=None)  # no timing decides a test
settings.register_profile("random", print_blob=True, deadline=None)
settings.load_profile("daily")

# Of a script (nohup, &) it is inherited that Ctrl-C is ignored, which children would inherit, too.
signal.signal(signal.SIGINT, signal.default_int_handler)

LIMITS = {"slow": 3600.0, "endurance": 86_400.0}  # s, of a test; of others as in pyproject.toml


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep the tests of a file on one worker, where kernels and fixtures are made once.

    Campaigns have more time.
    """
    for item in items:
        limits = [limit for mark, limit in LIMITS.items() if item.get_closest_marker(mark)]
        if limits and item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(max(limits)))
        if item.get_closest_marker("xdist_group") is None:
            item.add_marker(pytest.mark.xdist_group(item.path.stem))


@pytest.fixture(autouse=True, scope="session")
def runtime_folder() -> Iterator[None]:
    """A runtime folder of the tests, so that they touch nothing of the user's."""
    with tempfile.TemporaryDirectory(prefix="fb-") as path, pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", path)
        yield


@pytest.fixture(autouse=True, scope="session")
def measured_parts(request: pytest.FixtureRequest) -> Iterator[None]:
    """Coverage measures the beginning of each run in virtual time, and no compilation."""
    if not request.config.getoption("cov_source"):
        yield
        return
    with pytest.MonkeyPatch.context() as patch:
        measure_begins_of_runs(patch)
        measure_no_compilation(patch)
        yield


@pytest.fixture(autouse=True)
def leak_check(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[None]:
    """No process is left after a test; after one marked ``live`` no socket, file, thread either."""
    tmp_path_factory.getbasetemp()  # made once, and not in the folder of this test
    is_live = request.node.get_closest_marker("live") is not None
    with no_leaks() if is_live else no_processes():
        yield


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
