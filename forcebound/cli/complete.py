"""What a shell may offer in place of a word that is begun: files, arguments, laws, names.

Nothing here may raise or write: the user presses a key and waits.
"""

import functools
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

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
    folder = Path(begun).parent if "/" in begun else Path()
    start = f"{folder}/" if "/" in begun else ""
    for path in sorted(folder.iterdir()):
        if path.is_dir() and not path.name.startswith("."):
            yield f"{start}{path.name}/"
        elif path.suffix in (".yaml", ".yml"):
            yield f"{start}{path.name}"


@offering
def settings(context: click.Context, begun: str) -> Iterable[str]:
    """Arguments of the launch file, each ``name:=``, and the values that one may choose."""
    from forcebound.config.loader import arguments_of

    name, sign, _ = begun.partition(":=")
    known = {one.name: one for one in arguments_of(context.params["file"])}
    if not sign:
        return [f"{one}:=" for one in known]
    return [f"{name}:={value}" for value in _values(name, known)]


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
    from forcebound.messages.packets import LINKS

    return LINKS


@offering
def nodes(_: click.Context, begun: str) -> Iterable[str]:
    """Nodes that can be stopped."""
    return "environment", "controller"


@offering
def graphs(_: click.Context, begun: str) -> Iterable[str]:
    """Graphs that run, by the names of their launch files."""
    from forcebound.monitor.runs import running

    return (run.file.partition(" ")[0] for run in running().values())


@offering
def parameters(context: click.Context, begun: str) -> Iterable[str]:
    """Parameters of the running graph."""
    return _parameters(context)


@offering
def changes(context: click.Context, begun: str) -> Iterable[str]:
    """Parameters of the running graph, each ``name:=``."""
    return (f"{name}:=" for name in _parameters(context))


def _parameters(context: click.Context) -> Iterable[str]:
    from forcebound.monitor.runs import find
    from forcebound.monitor.tuning import configuration, find_parameters

    run = find(context.params.get("run_dir"))
    return find_parameters(configuration(run, serves=False), ())
