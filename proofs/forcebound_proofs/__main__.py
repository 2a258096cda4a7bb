"""Studies of the proofs: ``python -m forcebound_proofs NAME``."""

from importlib import import_module

import click

NAMES = (
    "certificate_grid",
    "far_wall",
    "fit_table1",
    "identification_bounds",
    "late_ticks",
    "lemmas",
)


class Studies(click.Group):
    """Commands by the names of their modules, each imported when it is meant."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names."""
        return list(NAMES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command ``main`` of a module."""
        if cmd_name not in NAMES:
            return None
        command: click.Command = import_module(f"forcebound_proofs.{cmd_name}").main
        return command


@click.command(cls=Studies)
def main() -> None:
    """Repeat a study of the proofs; NAME --help has its options."""


if __name__ == "__main__":
    main(prog_name="python -m forcebound_proofs")
