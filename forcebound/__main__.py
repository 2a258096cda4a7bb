"""``python -m forcebound`` is the command ``forcebound``."""

import sys


def main() -> None:
    """Run the command; Ctrl-C while it is still being imported ends it quietly, too."""
    try:
        from forcebound.cli import main as command

        command()
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
