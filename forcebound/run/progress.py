"""A bar of progress on standard error."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager


@contextmanager
def progress_bar(
    name: str, after: float = 0.0, shown: bool = True
) -> Iterator[Callable[[int, int], None]]:
    """Yield a function that shows progress on standard error; it takes what is done, and the total.

    The bar appears with the first call ``after`` some seconds, so that errors in arguments are
    reported without it; never, if it is not ``shown``.
    """
    if not shown:
        yield lambda done, total: None
        return
    began = time.monotonic()
    from rich import progress
    from rich.console import Console

    columns = (
        progress.TextColumn(name),
        progress.BarColumn(),
        progress.MofNCompleteColumn(),
        progress.TimeElapsedColumn(),
        progress.TextColumn("left:"),
        progress.TimeRemainingColumn(elapsed_when_finished=False),
    )
    bar = progress.Progress(*columns, console=Console(stderr=True))
    task = bar.add_task(name, total=None)
    with ExitStack() as stack:

        def show(done: int, total: int) -> None:
            if time.monotonic() - began < after:
                return
            if not bar.live.is_started:
                stack.enter_context(bar)
            bar.update(task, completed=done, total=total)

        yield show
