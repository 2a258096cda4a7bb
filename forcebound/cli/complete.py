"""What a shell may offer in place of a word that is begun: files, arguments, laws, names.

Nothing here may raise or write: the user presses a key and waits.
"""

import functools
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from forcebound.files import RECORDING_SUFFIX

if TYPE_CHECKING:
    from forcebound.config.graph import GraphConfig

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


@offering
def launch_files(_: click.Context, begun: str) -> Iterable[str]:
    """Launch files that come with forcebound, without ending, and those of the folder."""
    from forcebound.config.document import shipped

    yield from (Path(name).stem for name in shipped())
    yield from _files(begun, ".yaml", ".yml")


@offering
def sweeps(_: click.Context, begun: str) -> Iterable[str]:
    """Sweep files that come with forcebound, without ending, and YAML files of the folder."""
    from forcebound.sweep.plan import shipped

    yield from (Path(name).stem for name in shipped())
    yield from _files(begun, ".yaml", ".yml")


@offering
def parts(_: click.Context, begun: str) -> Iterable[str]:
    """Python files of the folder."""
    return _files(begun, ".py")


@offering
def recordings(_: click.Context, begun: str) -> Iterable[str]:
    """Recordings of the folder."""
    return _files(begun, RECORDING_SUFFIX)


@offering
def runs(_: click.Context, begun: str) -> Iterable[str]:
    """Graphs that run, and recordings of the folder."""
    yield from _graphs()
    yield from _files(begun, RECORDING_SUFFIX)


def _files(begun: str, *endings: str) -> Iterable[str]:
    """Give files with one of these endings, and folders, where the user has begun a name."""
    folder, sign, _ = begun.rpartition("/")
    for path in sorted(Path(folder + sign).iterdir()):
        if path.is_dir() and not path.name.startswith("."):
            yield f"{folder}{sign}{path.name}/"
        elif path.suffix in endings:
            yield f"{folder}{sign}{path.name}"


@offering
def settings(context: click.Context, begun: str) -> Iterable[str]:
    """Arguments of the launch file, each ``name:=``, and the values that one may choose."""
    from forcebound.config.loader import arguments_of

    name, sign, _ = begun.partition(":=")
    known = {one.name: one for one in arguments_of(context.params["file"])}
    if not sign:
        return [f"{one}:=" for one in known]
    return [f"{name}:={_one_word(value)}" for value in _values(name, known)]


def _one_word(value: object) -> str:
    """Return a value as a shell takes it without quotes: 2ms."""
    return str(value).replace(" ", "")


def _values(name: str, known: dict[str, Any]) -> Iterable[object]:
    if name == "law":
        from forcebound.bounding import LAWS

        return sorted(LAWS)
    if name == "controller":
        from forcebound.controllers import CONTROLLERS

        return sorted(CONTROLLERS)
    one = known[name]
    return one.choices or [one.default]


@offering
def topics(_: click.Context, begun: str) -> Iterable[str]:
    """Topics of a graph."""
    from forcebound.messages.packets import TOPICS

    return TOPICS


@offering
def links(_: click.Context, begun: str) -> Iterable[str]:
    """Links that can be impaired."""
    from forcebound.topology import LINKS

    return LINKS


@offering
def nodes(_: click.Context, begun: str) -> Iterable[str]:
    """Nodes that can be stopped."""
    return "environment", "controller"


@offering
def graphs(_: click.Context, begun: str) -> Iterable[str]:
    """Graphs that run, by the names of their launch files."""
    return _graphs()


def _graphs() -> Iterable[str]:
    from forcebound.monitor.runs import running

    return (run.file.partition(" ")[0] for run in running().values())


@offering
def fields(context: click.Context, begun: str) -> Iterable[str]:
    """Fields of the topic that is already there."""
    from forcebound.messages.packets import TOPICS, field_types

    # An option without its value ends the parsing, before arguments have their names.
    topic = context.params.get("topic") or context.args[0]
    return field_types(TOPICS[topic])


@offering
def laws(_: click.Context, begun: str) -> Iterable[str]:
    """Laws that come with forcebound."""
    from forcebound.bounding import LAWS

    return sorted(LAWS)


@offering
def parameters(context: click.Context, begun: str) -> Iterable[str]:
    """Parameters of the running graph, also those that are fixed."""
    from forcebound.monitor.tuning import every_parameter

    return every_parameter(_configuration(context))


@offering
def changes(context: click.Context, begun: str) -> Iterable[str]:
    """Parameters of the running graph, each ``name:=``, and its value; for the law all choices."""
    from forcebound.config.names import LAW
    from forcebound.config.parameters import takeable_laws
    from forcebound.monitor.formatting import as_written
    from forcebound.monitor.tuning import find_parameters

    config = _configuration(context)
    known = find_parameters(config, ())
    name, sign, _ = begun.partition(":=")
    if not sign:
        return [f"{one}:=" for one in known]
    if name == LAW:
        return [f"{name}:={law}" for law in takeable_laws()]
    return [f"{name}:={_one_word(as_written(config, {name: known[name]})[name])}"]


def _configuration(context: click.Context) -> "GraphConfig":
    from forcebound.monitor.runs import find
    from forcebound.monitor.tuning import configuration

    return configuration(find(context.params.get("run_dir")), with_code=False)
