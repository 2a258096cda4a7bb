"""``python -m forcebound`` is the command ``forcebound``."""

import gc
import io
import signal
import sys
from types import FrameType

from forcebound.stop import INTERRUPTED, ending_signals

# Imports make many objects and no garbage: with the default of 700 new objects between two
# collections, a device process would spend a tenth of its start on looking for some.
GARBAGE_THRESHOLD = 100_000


def main() -> None:
    """Run the command; Ctrl-C ends it quietly also while it is still being imported.

    The other signals that end a command act as Ctrl-C, so that it keeps what it has, and leaves
    nothing behind. After its end they change neither its result nor its exit status.
    """
    gc.set_threshold(GARBAGE_THRESHOLD)
    is_over = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        if not is_over:
            raise KeyboardInterrupt

    ending = ending_signals()
    for number in ending:
        signal.signal(number, interrupt)
    if isinstance(sys.stdout, io.TextIOWrapper):  # a terminal or a pipe that is not UTF-8
        sys.stdout.reconfigure(errors="replace")
    try:
        try:
            from forcebound.cli import main as command

            command()
        finally:
            is_over = True
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    finally:  # the end of Python gives a handler of ours up, and a signal its usual effect
        for number in ending:
            signal.signal(number, signal.SIG_IGN)


if __name__ == "__main__":
    main()
