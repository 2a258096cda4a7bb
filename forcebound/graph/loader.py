"""Launch files read into configurations, with every problem reported at once.

1. :mod:`forcebound.graph.document` reads the file, and those that it includes, into a tree.
2. :mod:`forcebound.graph.arguments` finds the value of each argument and puts it where it is used.
3. :mod:`forcebound.graph.model` makes the dataclasses of :mod:`forcebound.graph.graph` of it, and
   :mod:`forcebound.graph.checks` checks what concerns several sections.

Each step notes its problems and passes on what is sound, so that all of them are seen at once.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TypeAlias

from forcebound.bounded_child import tried
from forcebound.errors import ConfigError, ForceboundError
from forcebound.graph import checks
from forcebound.graph.arguments import OVERRIDE, Argument, Arguments, Substitution, override_place
from forcebound.graph.document import (
    find,
    missing,
    read,
    with_device_file,
    with_hands,
    with_named_hands,
)
from forcebound.graph.graph import KINDS, GraphConfig, HandConfig
from forcebound.graph.model import read_graph
from forcebound.graph.names import OF_GRAPH, ParameterName, parameter_name, split_setting
from forcebound.graph.phases import read_phases
from forcebound.graph.problems import Problems, Related, unknown
from forcebound.graph.tree import Value, from_plain, scalar
from forcebound.haptics.parts.user_module import file_of, names_file
from forcebound.messages.topology import HAND, HAND_SECTIONS, HANDS, Document, flat

_LAUNCH_FILE = re.compile(r"(?P<file>.+\.ya?ml)(?::(?P<hand>\w+))?", re.DOTALL)


def load(path: str | Path, overrides: Sequence[str] = ()) -> GraphConfig:
    """Return the configuration that a launch file describes.

    Args:
        path: A file; or the name of one that comes with forcebound: ``stiff_wall``.
        overrides: Values for the file's arguments, each ``name:=value``.

    Raises:
        ConfigError: With every problem of the file and its place.
    """
    problems = Problems()
    with _sane(path):
        return build(_read(path, problems), overrides, problems)


Trial: TypeAlias = Callable[[GraphConfig], None]  # raises ConfigError if it fails
TRIAL_S = 60.0  # for loading users' files (imports, a mesh, compilation) and the trial


def load_tried(
    path: str | Path, overrides: Sequence[str] = (), trial: Trial | None = None
) -> GraphConfig:
    """Return the same as :func:`load`, for a command in the foreground, after a further ``trial``.

    A user's files are loaded, and the graph is tried, in a separate process first, where
    they may hang or exit; their parts are asked there alone. The log says what is not certified.
    ConfigError also if the user's code was too slow or ended its process.
    """
    problems = Problems()
    with _sane(path):
        filled = _filled(_read(path, problems), overrides, problems)
    files = user_files(filled)
    if files:
        tried(partial(_try, path, overrides, trial), files, TRIAL_S)
    with _sane(path):
        config = _build(filled, problems)
    if trial is not None and not files:
        trial(config)
    checks.warn(config)
    return config


def _try(path: str | Path, overrides: Sequence[str], trial: Trial | None) -> bytes:
    """Load a launch file for its problems alone, and ask the user's parts once."""
    problems = Problems()
    with _sane(path):
        config = _build(_filled(_read(path, problems), overrides, problems), problems, asks=True)
    if trial is not None:
        trial(config)
    return b""


def read_template(path: str | Path) -> Value:
    """Return a launch file with its arguments still open, to :func:`build` it many times."""
    problems = Problems()
    root = _read(path, problems)
    problems.raise_if_any()
    return root


def build(
    template: Value,
    overrides: Sequence[str] = (),
    problems: Problems | None = None,
    asks: bool = False,
) -> GraphConfig:
    """Return the configuration of a launch file that :func:`read_template` has read.

    ``asks``: whether to call a user's parts once.
    """
    problems = Problems() if problems is None else problems
    return _build(_filled(template, overrides, problems), problems, asks)


def _filled(template: Value, overrides: Sequence[str], problems: Problems) -> Value:
    """The template with its arguments' values, and values by their paths, in their places."""
    arguments = Arguments(template, problems)
    paths = [text for text in overrides if "." in text.partition(":=")[0]]
    of_arguments = [text for text in overrides if text not in paths]
    substitution = Substitution(arguments.values(of_arguments), problems)
    filled = _substituted(template, substitution, problems)
    arguments.note_unused(of_arguments, substitution.used)
    for text in sorted(paths, key=_comes_later):
        name, word = split_setting(text)
        place, at = override_place(text), ParameterName.parse(name)
        before, problem = filled.at(at.path), _whose(at, filled)
        if before is not None and before.place.name.startswith(OVERRIDE):
            problems.add(f"{name} is given twice", place, Related("first", before.place))
        elif problem is not None:
            problems.add(problem, place)
        else:
            if at.is_preset:
                filled = filled.with_entry(at.path[:-1], Value({}, place, place))
            content = scalar(word) if word else ""  # as an argument's
            filled = filled.with_entry(at.path, Value(content, place, place, word))
    return filled


def _comes_later(text: str) -> bool:
    """Order of paths: first a link's named network, which takes the place of all the file says."""
    return not ParameterName.parse(split_setting(text)[0]).is_preset


def _substituted(template: Value, arguments: Substitution, problems: Problems) -> Value:
    """The template with its hands by name, and the arguments in it and in files of devices."""
    named = with_named_hands(arguments.apply(template.without("arguments")))
    return with_hands(named, partial(with_device_file, problems=problems, arguments=arguments))


def _whose(at: ParameterName, root: Value) -> str | None:
    """The problem with a path that leads to no section of a launch file; None: it does."""
    hands = root.entries[HANDS].entries
    if at.path[0] != HANDS or at.hand in hands:
        is_section = at.path[0] in (HANDS, *OF_GRAPH)
        return None if is_section else unknown("section", at.section, (*HAND_SECTIONS, *OF_GRAPH))
    if at.hand == HAND:
        names = " or ".join(parameter_name(hand, ".".join(at.keys)) for hand in hands)
        return f"whose {at}? It belongs to a hand: {names}"
    named = [hand for hand in hands if hand != HAND]
    return unknown("section or hand", at.hand, (*HAND_SECTIONS, *OF_GRAPH, *named))


def arguments_of(path: str | Path) -> list[Argument]:
    """Return the arguments that a launch file declares and uses, in its order."""
    problems = Problems()
    root = _read(path, problems)
    arguments = Arguments(root, problems)
    problems.raise_if_any()
    substitution = Substitution(arguments.values(()), Problems())
    _substituted(root, substitution, Problems())
    return [each for name, each in arguments.declared.items() if name in substitution.used]


def from_document(document: Document) -> GraphConfig:
    """Return the configuration of a resolved document that may have been changed."""
    return _build(with_named_hands(from_plain(flat(document), "document")), Problems())


@contextmanager
def _sane(path: str | Path) -> Iterator[None]:
    """Turn what a value raises that no launch file has, such as a name with a zero byte."""
    try:
        yield
    except ForceboundError:
        raise
    except (ValueError, OverflowError, RecursionError, OSError) as error:
        raise ConfigError(f"{path}: it holds what no launch file has: {error}") from error


def _read(path: str | Path, problems: Problems) -> Value:
    found = find(Path(path))
    if found is None:
        raise ConfigError(missing(path))
    root = read(found, problems)
    if root is None:
        raise problems.error()
    return root


def launch_file_of(kind: str) -> tuple[str, str]:
    """Return launch file and hand of a kind ``FILE.yaml`` or ``FILE.yaml:HAND``; else "", ""."""
    match = _LAUNCH_FILE.fullmatch(kind)
    return ("", "") if match is None else (match["file"], match["hand"] or "")


def hand_of(kind: str, overrides: Sequence[str] = ()) -> HandConfig:
    """Return a hand of a launch file; ConfigError if it is wrong, or has no such hand."""
    path, name = launch_file_of(kind)
    config = load(path, overrides)
    if not name:
        return config.only
    if name not in config.hands:
        raise ConfigError(f"{path}: {unknown('hand', name, config.hands)}")
    return config.hands[name]


def user_files(root: Value) -> list[Path]:
    """Return the users' files that a launch file names."""
    kinds = []
    for part in (*root.entries[HANDS].entries.values(), root):
        sections = part.entries
        kinds += [sections[name].entries.get("kind") for name in KINDS if name in sections]
        if "device" in sections:
            kinds += [sections["device"].entries.get(key) for key in ("law", "class")]
    named = [kind for kind in kinds if kind is not None and names_file(kind.text)]
    return list(dict.fromkeys(file_of(kind.text, kind.folder) for kind in named))


def _build(root: Value, problems: Problems, asks: bool = False) -> GraphConfig:
    """Return what the tree says; ``asks``: whether to call a user's parts once."""
    config = read_graph(root, problems, check=partial(checks.check_together, asks=asks))
    if config.phases:
        config = read_phases(root, config, problems)
        problems.raise_if_any()
    return config
