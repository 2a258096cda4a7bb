"""``python -m forcebound`` is the command ``forcebound``."""

import gc
import sys

# Imports make many objects and no garbage: with the default of 700 new objects between two
# collections, a device process would spend a tenth of its start on looking for some.
GARBAGE_THRESHOLD = 100_000


def main() -> None:
    """Run the command; Ctrl-C while it is still being imported ends it quietly, too."""
    gc.set_threshold(GARBAGE_THRESHOLD)
    try:
        from forcebound.cli import main as command

        command()
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
