"""Processes on this machine's cores for work that can be divided."""

import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context

from forcebound.realtime import die_with_parent


@contextmanager
def local_executor(workers: int | None = None) -> Iterator[Executor]:
    """Give ``workers`` processes, by default one a core; they end with this one, whatever ends it.

    Leaving with an exception, Ctrl-C among them, ends them in the middle of what they do.
    """
    count = workers or len(os.sched_getaffinity(0))
    # Spawned, not forked: the parent may have threads (progress bar, numba).
    with ProcessPoolExecutor(count, get_context("spawn"), _begin_worker) as executor:
        try:
            yield executor
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            for child in active_children():
                child.terminate()
            raise


def _begin_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends it
    die_with_parent(signal.SIGKILL)
