"""Commands for this machine: completion in the shell, a folder to begin with, keys, schema."""

import shlex
from pathlib import Path
from shutil import copyfile

import click
from click.shell_completion import BashComplete, FishComplete, ShellComplete, ZshComplete

from forcebound.cli.common import Group, json_option, print_json, show
from forcebound.errors import ConfigError
from forcebound.folders import home_folder

EXAMPLES = Path(__file__).parent.parent / "examples"
STARTER = ("my_environment.yaml", "my_environment.py")


class Bash(BashComplete):
    """Completion in bash, where ``:`` and ``=`` end a word, but not in ``law:=certified``."""

    source_template = r"""\
%(complete_func)s() {
    local IFS=$'\n' line="${COMP_LINE:0:$COMP_POINT}" type value
    local whole="${line##* }" begun="${COMP_WORDS[COMP_CWORD]}"
    [[ "$begun" =~ ^[:=]*$ ]] && begun=""
    local before="${whole%%"$begun"}" count found
    count=$(IFS=' '; set -f; set -- $line; echo $#)
    [[ "$line" == *' ' ]] || count=$((count - 1))
    found=$(env COMP_WORDS="$line" COMP_CWORD=$count %(complete_var)s=bash_complete $1 2>/dev/null)
    for completion in $found; do
        IFS=',' read type value <<< "$completion"
        [[ "$type" == plain ]] || continue  # files and folders are the shell's own matter
        COMPREPLY+=("${value#"$before"}")
        [[ "$value" == *[=/] ]] && compopt -o nospace
    done
}
complete -o nosort -o bashdefault -o default -F %(complete_func)s %(prog_name)s
"""


class Zsh(ZshComplete):
    """Completion in zsh, which goes on without a blank after ``law:=`` and ``folder/``."""

    source_template = ZshComplete.source_template.replace(
        "compadd -U -V unsorted -a completions",
        "compadd -U -V unsorted -S '' -- ${(M)completions:#*[=/]}\n"
        "        compadd -U -V unsorted -- ${completions:#*[=/]}",
    )


#: Each shell's script, where it looks for it under the home folder, and what else it needs.
SHELLS: dict[str, tuple[type[ShellComplete], str, str]] = {
    "bash": (
        Bash,
        ".local/share/bash-completion/completions/forcebound",
        "it works in every new shell where the package bash-completion is",
    ),
    "zsh": (
        Zsh,
        ".zfunc/_forcebound",
        "~/.zshrc needs: fpath+=~/.zfunc; autoload -Uz compinit; compinit",
    ),
    "fish": (
        FishComplete,
        ".config/fish/completions/forcebound.fish",
        "it works in every new shell",
    ),
}


@click.command(short_help="Let the Tab key complete commands and arguments.")
@click.argument("shell", type=click.Choice(SHELLS))
@click.option("--print", "only_prints", is_flag=True, help="Print the script; install nothing.")
def completion(shell: str, only_prints: bool) -> None:
    r"""Install completion for SHELL: commands, files, arguments, laws, parameters, topics.

    \b
    forcebound completion bash
    """
    from forcebound.cli import main

    complete, place, words = SHELLS[shell]
    script = complete(main, {}, "forcebound", "_FORCEBOUND_COMPLETE").source()
    if only_prints:
        click.echo(script)
        return
    file = home_folder() / place
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(script)
    show(f"{file}: {words}")


@click.command("new", short_help="Make a folder to begin with.")
@click.argument("folder", type=click.Path(path_type=Path))
def new(folder: Path) -> None:
    r"""Create FOLDER with a launch file and a sample environment to edit.

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
    run, check = (shlex.quote(str(folder / name)) for name in STARTER)
    show(f"run it:   `forcebound simulate {run}`")
    show(f"check it: `forcebound check environment {check}`")


@click.group(cls=Group)
def keys() -> None:
    """Create and show the keys for a link to another machine."""


@keys.command("new")
@click.argument("name")
@json_option
def new_keys(name: str, as_json: bool) -> None:
    r"""Create the key pair NAME; the secret stays on this machine.

    \b
    forcebound keys new lab_pc
    """
    from forcebound.network.keys import key_folder, new_key

    made, folder = new_key(name), key_folder()
    if as_json:
        print_json({"name": made.name, "public": made.public, "folder": str(folder)})
        return
    show(f"public key: {made.public}")
    show(f"copy {folder / name}.key to the other machine's key folder; the secret stays here")


@keys.command("list")
@json_option
def list_all_keys(as_json: bool) -> None:
    r"""List the keys on this machine.

    \b
    forcebound keys list --json
    """
    from forcebound.network.keys import key_folder, list_keys

    entries = list_keys()
    if as_json:
        print_json(entries)
        return
    for entry in entries:
        kind = "pair" if entry.has_secret else "public"
        problem = f"{entry.problem}: {entry.action}" if entry.action else entry.problem
        show(f"{entry.name:<20}{kind:<8}{problem or entry.public}")
    if not entries:
        show(f"no keys in {key_folder()}; create one with `forcebound keys new NAME`", err=True)


@keys.command("show")
@click.argument("name")
@json_option
def show_key(name: str, as_json: bool) -> None:
    r"""Print the public key NAME, for the other machine.

    \b
    forcebound keys show lab_pc
    """
    from forcebound.network.keys import public_key

    public = public_key(name)
    print_json({"name": name, "public": public}) if as_json else show(public)


@click.command(short_help="Print the JSON schema of launch files.")
def schema() -> None:
    r"""Print the JSON schema of launch files, for completion in an editor.

    \b
    forcebound schema > forcebound.schema.json
    """
    from forcebound.graph.schema import json_schema

    print_json(json_schema())
