"""``python -m forcebound`` is the command ``forcebound``."""

from forcebound.cli import main

main()
