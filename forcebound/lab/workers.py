"""Executors for divisible work (cores or a dask cluster).

Take the results from :func:`completed` and do not cancel futures: a future that is cancelled while
its process ends makes the pool's own thread fail in Python 3.11. An interruption ends the
processes instead.
"""

import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    ProcessPoolExecutor,
    as_completed,
)
from contextlib import contextmanager
from multiprocessing import active_children, get_context
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any, TypeVar

from forcebound.errors import ConfigError, RunError
from forcebound.extras import needed
from forcebound.realtime import die_with_parent

Task = TypeVar("Task")
Result = TypeVar("Result")


@contextmanager
def local_executor(
    workers: int | None = None,
    begin: Callable[[], None] | None = None,
    imports_main: bool = True,
) -> Iterator[Executor | None]:
    """Give ``workers`` processes, by default one per core; they end with this one in any case.

    With 0 workers there is no executor, and the work is done in this process. Each process first
    calls ``begin``; ``imports_main``: and imports the program's main module, as multiprocessing
    does, whose tasks may be defined there.

    An exception, Ctrl-C included, ends them at once. SIGTERM acts as Ctrl-C: the default action
    would leave the pool's semaphores behind.
    """
    if workers == 0:
        yield None
        return
    count = workers or len(os.sched_getaffinity(0))
    # Spawned, not forked: the parent may have threads (progress bar, numba).
    with (
        _termination_interrupts(),
        ProcessPoolExecutor(
            count,
            get_context("spawn") if imports_main else _WithoutMain(),
            _begin_worker,
            (begin,),
        ) as executor,
    ):
        try:
            yield executor
        except BaseException:
            for child in active_children():
                child.terminate()
            raise


@contextmanager
def _termination_interrupts() -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():  # which alone may set a handler
        yield
        return
    previous = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


class _Process(SpawnProcess):
    """A spawned process that does not import the program's main module.

    That may be a script without ``if __name__ == "__main__"``, which would start all over there.
    """

    @staticmethod
    def _Popen(process: Any) -> Any:  # noqa: N802  # the hook of multiprocessing
        main = sys.modules["__main__"]
        kept: dict[str, object] = {
            name: vars(main).pop(name) for name in ("__file__", "__spec__") if name in vars(main)
        }
        main.__spec__ = None
        try:
            return SpawnProcess._Popen(process)
        finally:
            vars(main).update(kept)


class _WithoutMain(SpawnContext):
    Process = _Process


def _begin_worker(begin: Callable[[], None] | None) -> None:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # each has a core; before numpy is loaded
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends it
    die_with_parent(signal.SIGKILL)
    if begin is not None:
        begin()


@contextmanager
def cluster_executor(address: str) -> Iterator[Executor]:
    """Give the workers of a dask cluster; each needs this version of forcebound.

    Args:
        address: Of the scheduler, such as ``tcp://host:8786``.

    Raises:
        ConfigError: If dask is not installed or there is no scheduler.
    """
    distributed = needed("a cluster", "distributed")
    logging.getLogger("distributed.client").setLevel(
        logging.CRITICAL
    )  # completed reports a lost one
    try:
        client: Any = distributed.Client(address, timeout="10s", set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConfigError(f"no dask scheduler at {address}: {error}") from error
    with client:
        yield client.get_executor(pure=False)


def completed(
    executor: Executor | None, work: Callable[[Task], Result], tasks: Iterable[Task]
) -> Iterator[tuple[int, Result]]:
    """Run ``work`` on each task; yield the task's index and its result, in the order of their end.

    Without an executor they run in this process.

    Raises:
        RunError: If the executor's processes are gone: a worker was killed, a cluster has ended.
    """
    if executor is None:
        yield from ((index, work(task)) for index, task in enumerate(tasks))
        return
    try:
        futures = {executor.submit(work, task): index for index, task in enumerate(tasks)}
        for future in as_completed(futures):
            yield futures.pop(future), future.result()
    except BrokenExecutor as error:
        raise RunError("a worker process ended before its work was done") from error
    except CancelledError as error:
        raise RunError("the cluster has ended, or has dropped the work") from error
