"""What a shell may offer in place of a word that is begun: files, arguments, laws, names.

Nothing here may raise or write: the user presses a key and waits.
"""

import functools
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import click
from click.shell_completion import BashComplete, CompletionItem, ZshComplete

from forcebound.cli.lazy import when_used
from forcebound.files import RECORDING_SUFFIX

with when_used():
    from forcebound.graph import document, loader
    from forcebound.haptics import controllers
    from forcebound.haptics import laws as bounding
    from forcebound.messages import topology
    from forcebound.observe import runs as running
    from forcebound.recordings import recording
    from forcebound.run import run_directory


class Bash(BashComplete):
    """Completion in bash, which also cuts a word at ``:`` and ``=``: ``law``, ``:=``, ``cert``."""

    source_template = BashComplete.source_template.replace(
        "COMPREPLY+=($value)",
        "COMPREPLY+=($value)\n            [[ $value == *[=/] ]] && compopt -o nospace",
    )
    _before = ""  # the part of the word that bash keeps

    def get_completion_args(self) -> tuple[list[str], str]:
        """Return the words before the one that is begun, and this one, none of them cut."""
        before, begun = super().get_completion_args()
        joined = re.sub(r"\n([:=]+)(\n(?!$))?", r"\1", "\n".join([*before, begun]))
        *words, word = joined.split("\n")
        self._before = word.removesuffix(begun.lstrip(":="))
        return words, word

    def format_completion(self, item: "CompletionItem[Any]") -> str:
        """Return an offer without what bash keeps."""
        return f"{item.type},{item.value.removeprefix(self._before)}"


class Zsh(ZshComplete):
    """Completion in zsh, which goes on without a blank after ``law:=`` and ``folder/``."""

    source_template = ZshComplete.source_template.replace(
        "compadd -U -V unsorted -a completions",
        "compadd -U -V unsorted -S '' -- ${(M)completions:#*[=/]}\n"
        "        compadd -U -V unsorted -- ${completions:#*[=/]}",
    )


Offer = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def offering(words: Callable[[click.Context, str], Iterable[str]]) -> Offer:
    """Return a ``shell_complete`` that offers those of ``words`` that begin like the word."""

    @functools.wraps(words)
    def offer(context: click.Context, _: click.Parameter, begun: str) -> list[CompletionItem]:
        try:
            found = [word for word in words(context, begun) if word.startswith(begun)]
        except Exception:  # of any file or graph that is not as it should be
            return []
        return [CompletionItem(word) for word in found]

    return offer


def files(*endings: str, shipped: Callable[[], Iterable[str]] = tuple[str]) -> Offer:
    """Return an :func:`offering` of files with these endings, of folders, and of shipped files.

    Those can be named without ending.
    """

    @offering
    def found(_: click.Context, begun: str) -> Iterable[str]:
        yield from (Path(name).stem for name in shipped())
        folder, sign, _name = begun.rpartition("/")
        for path in sorted(Path(folder + sign).iterdir()):
            if path.is_dir() and not path.name.startswith("."):
                yield f"{folder}{sign}{path.name}/"
            elif path.suffix in endings:
                yield f"{folder}{sign}{path.name}"

    return found


@offering
def graphs(_: click.Context, begun: str) -> Iterable[str]:
    """Graphs that run, by the names of their launch files."""
    return (run.file.partition(" ")[0] for run in running.running().values())


_own_launch_files = files(".yaml", ".yml")


def launch_files(
    context: click.Context, parameter: click.Parameter, begun: str
) -> list[CompletionItem]:
    """Launch files: those that come with the package, without ending and by group; one's own."""
    shipped = [
        CompletionItem(name, help=group)
        for group, names in document.GROUPS.items()
        for name in names
        if name.startswith(begun)
    ]
    return shipped + _own_launch_files(context, parameter, begun)


parts = files(".py")
recordings = files(RECORDING_SUFFIX)
laws = offering(lambda *_: bounding.LAWS)


def graph_of(context: click.Context) -> "topology.Graph":
    """The running graph that is meant; one of one hand if it is not known."""
    run = context.params.get("run")
    return topology.ONE_HAND if run is None else run_directory.graph_in(run)


@offering
def hands(context: click.Context, begun: str) -> Iterable[str]:
    """Hands of the recording that is already there, or of the running graph."""
    run = context.params.get("run") or next(iter(context.params.get("runs", context.args)), None)
    if run is not None and Path(run).is_file():
        return recording.read(run).hands
    return run_directory.graph_in(running.find(run)).hands


def runs(context: click.Context, parameter: click.Parameter, begun: str) -> list[CompletionItem]:
    """Graphs that run, and recordings of the folder."""
    return graphs(context, parameter, begun) + recordings(context, parameter, begun)


@offering
def settings(context: click.Context, begun: str) -> Iterable[str]:
    """Arguments of the launch file, each ``name:=``, and the values that one may choose."""
    name, sign, _ = begun.partition(":=")
    known = {one.name: one for one in loader.arguments_of(context.params["file"])}
    if not sign:
        return [f"{one}:=" for one in known]
    tables = {"law": [*bounding.LAWS], "controller": [*controllers.CONTROLLERS]}
    values: Iterable[object] = tables.get(name) or known[name].choices or [known[name].default]
    return [f"{name}:={one_word(value)}" for value in values]


def one_word(value: object) -> str:
    """Return a value as a shell takes it without quotes: 2ms."""
    return str(value).replace(" ", "")
