"""What a shell may offer in place of a word that is begun: files, arguments, laws, names.

Nothing here may raise or write: the user presses a key and waits.
"""

import functools
import re
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import BashComplete, CompletionItem, ZshComplete

from forcebound.files import RECORDING_SUFFIX

if TYPE_CHECKING:
    from forcebound.messages.topology import Graph


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
        *words, word = re.sub(r"\n([:=]+)(\n(?!$))?", r"\1", "\n".join([*before, begun])).split(
            "\n"
        )
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


def _of(module: str, names: str) -> Offer:
    """Return an :func:`offering` of the names of a collection in a module of forcebound."""
    return offering(lambda *_: getattr(import_module(f"forcebound.{module}"), names))


def _files(shipped: str, *endings: str) -> Offer:
    """Return an :func:`offering` of files with these endings, and of folders.

    A module's function ``shipped`` gives files that can be named without ending.
    """

    @offering
    def files(_: click.Context, begun: str) -> Iterable[str]:
        if shipped:
            module = import_module(f"forcebound.{shipped}")
            yield from (Path(name).stem for name in module.shipped())
        folder, sign, _name = begun.rpartition("/")
        for path in sorted(Path(folder + sign).iterdir()):
            if path.is_dir() and not path.name.startswith("."):
                yield f"{folder}{sign}{path.name}/"
            elif path.suffix in endings:
                yield f"{folder}{sign}{path.name}"

    return files


@offering
def graphs(_: click.Context, begun: str) -> Iterable[str]:
    """Graphs that run, by the names of their launch files."""
    from forcebound.observe.runs import running

    return (run.file.partition(" ")[0] for run in running().values())


launch_files = _files("graph.document", ".yaml", ".yml")
sweeps = _files("lab.sweep.plan", ".yaml", ".yml")
studies = _files("lab.study.plan", ".yaml", ".yml")
parts = _files("", ".py")
recordings = _files("", RECORDING_SUFFIX)
laws = _of("haptics.laws", "LAWS")


def graph_of(context: click.Context) -> "Graph":
    """The running graph that is meant; one of one hand if it is not known."""
    from forcebound.messages.topology import ONE_HAND
    from forcebound.run.run_directory import graph_in

    run = context.params.get("run")
    return ONE_HAND if run is None else graph_in(run)


@offering
def hands(context: click.Context, begun: str) -> Iterable[str]:
    """Hands of the recording that is already there, or of the running graph."""
    from forcebound.observe.runs import find
    from forcebound.recordings.recording import read
    from forcebound.run.run_directory import graph_in

    run = context.params.get("run") or next(iter(context.params.get("runs", context.args)), None)
    if run is not None and Path(run).is_file():
        return read(run).hands
    return graph_in(find(run)).hands


def runs(context: click.Context, parameter: click.Parameter, begun: str) -> list[CompletionItem]:
    """Graphs that run, and recordings of the folder."""
    return graphs(context, parameter, begun) + recordings(context, parameter, begun)


@offering
def settings(context: click.Context, begun: str) -> Iterable[str]:
    """Arguments of the launch file, each ``name:=``, and the values that one may choose."""
    from forcebound.graph.loader import arguments_of
    from forcebound.haptics.controllers import CONTROLLERS
    from forcebound.haptics.laws import LAWS

    name, sign, _ = begun.partition(":=")
    known = {one.name: one for one in arguments_of(context.params["file"])}
    if not sign:
        return [f"{one}:=" for one in known]
    tables: dict[str, Iterable[object]] = {"law": LAWS, "controller": CONTROLLERS}
    values = tables.get(name) or known[name].choices or [known[name].default]
    return [f"{name}:={one_word(value)}" for value in values]


def one_word(value: object) -> str:
    """Return a value as a shell takes it without quotes: 2ms."""
    return str(value).replace(" ", "")
