"""A bar of progress on standard error, or in a notebook."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from threading import RLock
from typing import Any


@contextmanager
def progress_bar(
    name: str, after: float = 0.0, shown: bool = True
) -> Iterator[Callable[[int, int], None]]:
    """Yield a function that shows progress; it takes what is done, and the total.

    The bar appears with the first call ``after`` some seconds, so that errors in arguments are
    reported without it; only in a terminal or a notebook, and never, if it is not ``shown``.
    """
    is_notebook = {"ipykernel", "ipywidgets"} <= sys.modules.keys()  # which draw it
    if not shown or not (is_notebook or sys.stderr.isatty()):
        yield lambda done, total: None
        return
    began = time.monotonic()
    bars: list[Any] = []
    with ExitStack() as stack:

        def show(done: int, total: int) -> None:
            if time.monotonic() - began < after:
                return
            if not bars:
                bars.append(stack.enter_context(_bar(name, total, is_notebook)))
            bars[0].update(done - bars[0].n)

        yield show


def _bar(name: str, total: int, is_notebook: bool) -> Any:
    """Return a bar of tqdm."""
    if is_notebook:
        from tqdm.notebook import tqdm
    else:
        from tqdm import tqdm

    class Bar(tqdm):  # type: ignore[misc]
        monitor_interval = 0  # no thread that redraws it

    Bar.set_lock(RLock())  # of this process alone
    return Bar(desc=name, total=total)
