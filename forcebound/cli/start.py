"""Commands for the first hour: completion in the shell, and a folder to begin with."""

import shlex
from pathlib import Path
from shutil import copyfile

import click
from click.shell_completion import BashComplete, FishComplete, ShellComplete, ZshComplete

from forcebound.cli.common import reports_errors, show
from forcebound.errors import ConfigError

EXAMPLES = Path(__file__).parent.parent / "examples"
STARTER = ("my_environment.yaml", "my_environment.py")
VARIABLE = "_FORCEBOUND_COMPLETE"

# Where each shell looks for completions by itself, under the home folder.
PLACES = {
    "bash": ".local/share/bash-completion/completions/forcebound",
    "zsh": ".zfunc/_forcebound",
    "fish": ".config/fish/completions/forcebound.fish",
}
AFTER = {
    "bash": "it works in every new shell where the package bash-completion is",
    "zsh": "~/.zshrc needs: fpath+=~/.zfunc; autoload -Uz compinit; compinit",
    "fish": "it works in every new shell",
}


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


# How each shell is told what may follow.
SCRIPTS: dict[str, type[ShellComplete]] = {"bash": Bash, "zsh": Zsh, "fish": FishComplete}


@click.command(short_help="Let the Tab key complete commands and arguments.")
@click.argument("shell", type=click.Choice(list(PLACES)))
@click.option("--print", "only_prints", is_flag=True, help="Print the script; install nothing.")
@reports_errors
def completion(shell: str, only_prints: bool) -> None:
    r"""Install completion for SHELL: commands, files, arguments, laws, parameters, topics.

    \b
    forcebound completion bash
    """
    from forcebound.cli import main

    script = SCRIPTS[shell](main, {}, "forcebound", VARIABLE).source()
    if only_prints:
        click.echo(script)
        return
    place = Path.home() / PLACES[shell]
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(script)
    except OSError as error:
        raise ConfigError(f"cannot write {place}: {error.strerror}") from None
    show(f"{place}: {AFTER[shell]}")


@click.command("new", short_help="Make a folder to begin with.")
@click.argument("folder", type=click.Path(path_type=Path))
@reports_errors
def new(folder: Path) -> None:
    r"""Make FOLDER with a launch file and an environment of one's own, to be changed.

    \b
    forcebound new my_wall
    """
    files = [EXAMPLES / name for name in STARTER]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        there = [file.name for file in files if (folder / file.name).exists()]
        if there:
            raise ConfigError(f"{folder} has {', '.join(there)} already: choose another folder")
        for file in files:
            copyfile(file, folder / file.name)
    except OSError as error:
        raise ConfigError(f"cannot write {folder}: {error.strerror}") from None
    show(f"{folder}: {', '.join(STARTER)}")
    run, check = (shlex.quote(str(folder / name)) for name in STARTER)
    show(f"run it:   `forcebound simulate {run}`")
    show(f"check it: `forcebound check environment {check}`")
