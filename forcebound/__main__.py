"""``python -m forcebound`` is the command ``forcebound``."""

import gc
import os
import signal
import sys

# Imports make many objects and no garbage: with the default of 700 new objects between two
# collections, a device process would spend a tenth of its start on looking for some.
GARBAGE_THRESHOLD = 100_000


def main() -> None:
    """Run the command; Ctrl-C ends it quietly also while it is still being imported.

    Ctrl-C after the command has ended changes neither its result nor its exit status.
    """
    _open_standard_streams()
    gc.set_threshold(GARBAGE_THRESHOLD)
    try:
        from forcebound.cli import main as command

        command()
    except KeyboardInterrupt:
        sys.exit(130)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _open_standard_streams() -> None:
    """Open those that the shell has closed (``2>&-``), on the device that drops everything.

    Else Python has no stream at all there, and the next file or socket gets its descriptor.
    """
    for descriptor, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest that is free is this one
        if getattr(sys, name) is None:
            setattr(sys, name, open(descriptor, mode, closefd=False))  # noqa: SIM115  # for good


if __name__ == "__main__":
    main()
