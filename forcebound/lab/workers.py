"""Executors for divisible work (cores or a dask cluster).

Take the results from :func:`completed` and do not cancel futures: a future that is cancelled while
its process ends makes the pool's own thread fail in Python 3.11. An interruption ends the
processes instead.
"""

import copyreg
import dataclasses
import logging
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    ProcessPoolExecutor,
    as_completed,
)
from contextlib import contextmanager
from functools import lru_cache, partial
from multiprocessing import active_children
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any, TypeVar

from forcebound.errors import ConfigError, RunError
from forcebound.extras import needed
from forcebound.graph.graph import KINDS
from forcebound.haptics.laws import LAWS
from forcebound.haptics.parts import Table
from forcebound.realtime import die_with_parent

Task = TypeVar("Task")
Result = TypeVar("Result")

_TABLES: Mapping[str, Table[Any]] = {**KINDS, "law": LAWS}


@contextmanager
def local_executor(
    workers: int | None = None,
) -> Iterator[Executor | None]:
    """Give ``workers`` processes, by default one per core; they end with this one in any case.

    With 0 workers there is no executor, and the work is done in this process.

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
            _WithoutMain(),
            _begin_worker,
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
    What is defined in it is sent by value.
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


def _begin_worker() -> None:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # each has a core; before numpy is loaded
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends it
    die_with_parent(signal.SIGKILL)


@contextmanager
def cluster_executor(address: str) -> Iterator[Executor]:
    """Give the workers of a dask cluster; each needs this version of forcebound.

    Anyone who reaches a scheduler runs code on it and its workers: start it on loopback.

    Args:
        address: Of the scheduler, such as ``tcp://127.0.0.1:8786``.

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

    Without an executor they run in this process. Else functions and classes of the main module, of
    a script or notebook, are sent by value, and with them the parts that were added to tables.

    Raises:
        ConfigError: If the work or a task cannot be sent.
        RunError: If the executor's processes are gone: a worker was killed, a cluster has ended; or
            if a module cannot be imported there.
    """
    if executor is None:
        yield from ((index, work(task)) for index, task in enumerate(tasks))
        return
    added = {section: table.added for section, table in _TABLES.items() if table.added}
    call = partial(_call, _pickled((added, work)))
    try:
        futures = {executor.submit(call, _pickled(task)): i for i, task in enumerate(tasks)}
        for future in as_completed(futures):
            yield futures.pop(future), future.result()
    except BrokenExecutor as error:
        raise RunError("a worker process ended before its work was done") from error
    except CancelledError as error:
        raise RunError("the cluster has ended, or has dropped the work") from error


def _pickled(content: object) -> bytes:
    cloudpickle = needed("a campaign on several cores", "cloudpickle")

    # Fields of a class know by identity that they have no default.
    copyreg.pickle(type(dataclasses.MISSING), lambda one: (getattr, (dataclasses, "MISSING")))
    try:
        pickled: bytes = cloudpickle.dumps(content)
    except (TypeError, pickle.PicklingError) as error:
        message = f"a function, case or part cannot be sent to other processes: {error}"
        raise ConfigError(f"{message}; use workers=0") from None
    return pickled


def _call(work: bytes, task: bytes) -> Any:
    try:
        return _received(work)(pickle.loads(task))
    except ModuleNotFoundError as error:
        advice = "define what you send in the program itself, or install its module there"
        raise RunError(f"in a process that runs cases: {error}; {advice}") from error


@lru_cache(maxsize=1)
def _received(pickled: bytes) -> Callable[[Any], Any]:
    """Return the work; once in a process, since its parts are added to tables."""
    added, work = pickle.loads(pickled)
    for section, parts in added.items():
        _TABLES[section].update(parts)
    called: Callable[[Any], Any] = work
    return called
