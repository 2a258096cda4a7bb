"""Commands for this machine: completion in the shell, a folder to begin with, keys, schema."""

import shlex
from pathlib import Path
from shutil import copyfile

import click
from click.shell_completion import get_completion_class

from forcebound.cli import options as opt
from forcebound.cli.common import Group, command, print_json, say, show
from forcebound.cli.lazy import when_used
from forcebound.errors import ConfigError
from forcebound.folders import home_folder

with when_used():
    from forcebound.graph import schema as launch_schema
    from forcebound.network import keys as known_keys

EXAMPLES = Path(__file__).parent.parent / "examples"
STARTER = ("my_environment.yaml", "my_environment.py", "test_my_environment.py")

#: Where each shell looks for its script under the home folder, and what else it needs.
SHELLS = {
    "bash": (
        ".local/share/bash-completion/completions/forcebound",
        "it works in every new shell where the package bash-completion is",
    ),
    "zsh": (
        ".zfunc/_forcebound",
        "~/.zshrc needs: fpath+=~/.zfunc; autoload -Uz compinit; compinit",
    ),
    "fish": (".config/fish/completions/forcebound.fish", "it works in every new shell"),
}


def completion(
    shell: str = opt.argument(type=click.Choice(SHELLS)),
    only_prints: bool = opt.flag("Print the script; install nothing.", "--print"),
) -> None:
    r"""Install completion for SHELL: commands, files, arguments, laws, parameters, topics.

    \b
    forcebound completion bash
    """
    complete = get_completion_class(shell)
    assert complete is not None  # click has one for each of SHELLS
    script = complete(click.Command(None), {}, "forcebound", "_FORCEBOUND_COMPLETE").source()
    if only_prints:
        click.echo(script)
        return
    place, words = SHELLS[shell]
    file = home_folder() / place
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(script)
    show(f"{file}: {words}")


def new(folder: Path = opt.argument(type=opt.PATH)) -> None:
    r"""Create FOLDER with a launch file, a sample environment to edit, and its tests.

    \b
    forcebound new my_wall
    """
    folder.mkdir(parents=True, exist_ok=True)
    there = [name for name in STARTER if (folder / name).exists()]
    if there:
        raise ConfigError(f"{folder} has {', '.join(there)} already: choose another folder")
    for name in STARTER:
        copyfile(EXAMPLES / name, folder / name)
    show(f"{folder}: {', '.join(STARTER)}")
    run, check, test = (shlex.quote(str(folder / name)) for name in STARTER)
    show(f"run it:   `forcebound simulate {run}`")
    show(f"check it: `forcebound check environment {check}`")
    show(f"test it:  `pytest {test}`")


keys = Group("keys", help="Create and show the keys for a link to another machine.")


@command("new", keys)
def new_keys(name: str = opt.argument(), as_json: bool = opt.as_json) -> None:
    r"""Create the key pair NAME; the secret stays on this machine.

    \b
    forcebound keys new lab_pc
    """
    made, folder = known_keys.new_key(name), known_keys.key_folder()
    if as_json:
        print_json({"name": made.name, "public": made.public, "folder": str(folder)})
        return
    show(f"public key: {made.public}")
    show(f"copy {folder / name}.key to the other machine's key folder; the secret stays here")


@command("list", keys)
def list_all_keys(as_json: bool = opt.as_json) -> None:
    r"""List the keys on this machine.

    \b
    forcebound keys list --json
    """
    entries = known_keys.list_keys()
    if as_json:
        print_json(entries)
        return
    for entry in entries:
        kind = "pair" if entry.has_secret else "public"
        problem = f"{entry.problem}: {entry.action}" if entry.action else entry.problem
        show(f"{entry.name:<20}{kind:<8}{problem or entry.public}")
    if not entries:
        say(f"no keys in {known_keys.key_folder()}; create one with `forcebound keys new NAME`")


@command("show", keys)
def show_key(name: str = opt.argument(), as_json: bool = opt.as_json) -> None:
    r"""Print the public key NAME, for the other machine.

    \b
    forcebound keys show lab_pc
    """
    public = known_keys.public_key(name)
    print_json({"name": name, "public": public}) if as_json else show(public)


def schema() -> None:
    r"""Print the JSON schema of launch files, for completion in an editor.

    \b
    forcebound schema > forcebound.schema.json
    """
    print_json(launch_schema.json_schema())
