"""Experiments: ``python -m experiments NAME [options]``, in a clone.

To add one, write a module with a command ``main`` and add its name.
"""

from importlib import import_module

import click

NAMES = {
    "gallery": "Make the films and pictures of docs: gallery, live page, README.",
    "networks": "Draw the delay of each named network over a minute.",
    "rabbit": "Make the mesh of touch_mesh.",
    "rough_cloud": "Press on clouds of points.",
    "scaled": "Draw what the scaled controller is good for.",
    "surfaces": "Draw what the worlds with a surface do.",
    "two_hands": "Draw a box between two hands; the transparency of two.",
}


class _Experiments(click.Group):
    """Each is imported when it is called: what it needs beside forcebound differs."""

    def get_command(self, _: click.Context, name: str) -> click.Command | None:
        """Return a command by its name; None: there is none."""
        if name not in NAMES:
            return None
        found: click.Command = import_module(f"experiments.{name}").main
        return found

    def format_commands(self, _: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the names with a line each."""
        with formatter.section("Experiments"):
            formatter.write_dl(list(NAMES.items()))


@click.group(cls=_Experiments)
def main() -> None:
    """Run an experiment; each makes pictures or a file, or prints a table."""


if __name__ == "__main__":
    main(prog_name="python -m experiments")
