"""The command that runs one node: an environment by itself, or any node for a launcher."""

import sys
from pathlib import Path

from forcebound.cli import complete
from forcebound.cli import options as opt
from forcebound.cli.lazy import when_used
from forcebound.errors import ConfigError
from forcebound.roles import ENVIRONMENT

with when_used():
    from forcebound.run import worker


def node(
    name: str = opt.argument(metavar="environment"),
    file: str = opt.argument(complete.launch_files),
    arguments: tuple[str, ...] = opt.file_settings,
    run_dir: Path | None = opt.option("Of a launcher.", type=opt.PATH, hidden=True),
) -> None:
    r"""Run the environment of FILE for hands on other machines, as set in their sections remote:.

    \b
    forcebound node environment remote_wall
    """
    if run_dir is not None:  # a launcher starts its processes so
        sys.exit(worker.run_node(name, run_dir))
    if name != ENVIRONMENT:
        raise ConfigError(f"only an environment runs by itself, got {name!r}: `forcebound launch`")
    worker.serve_environment(Path(file), arguments)
