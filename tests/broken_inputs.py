"""Broken inputs and what is said of them, to hold one reader of launch files against another.

``golden/broken_inputs/cases.yaml`` is the table of inputs, ``said.txt`` what is said of each, with
file, line, column and caret. Beside the table every shipped launch file is broken in each of its
entries (:func:`mutations`); ``mutations.txt.xz`` has what is said of those.

::

    python tests/broken_inputs.py --write           # in place of what is stored
    python tests/broken_inputs.py > /tmp/here.txt   # all of it, to compare two checkouts with diff

The functions of :data:`ROUTES` are all that knows the package.
"""

import contextlib
import io
import json
import lzma
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

from click.testing import CliRunner
from ruamel.yaml import YAML
from ruamel.yaml.nodes import MappingNode, ScalarNode, SequenceNode

import forcebound
from forcebound.cli import main
from forcebound.errors import ForceboundError
from forcebound.graph import loader, parameters

GOLDEN = Path(__file__).parent / "golden" / "broken_inputs"
CASES, SAID, MUTATIONS = GOLDEN / "cases.yaml", GOLDEN / "said.txt", GOLDEN / "mutations.txt.xz"
SHIPPED = Path(forcebound.__file__).parent / "launch_files"
FILE = "graph.yaml"
SOUND = "sound"  # what is said of an input that is not refused


# --- The table ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """One broken input: a name, the files of its folder, and how they come in."""

    name: str
    files: Mapping[str, str]
    route: str = "arguments"  # a key of ROUTES
    given: Any = ()  # of the route


def table() -> list[Case]:
    """Return the cases of the table."""
    written = YAML(typ="safe", pure=True).load(CASES.read_text(encoding="utf-8"))
    return [_case(row, written["texts"], written["files"]) for row in written["cases"]]


def _case(row: Any, texts: Mapping[str, str], files: Mapping[str, str]) -> Case:
    if isinstance(row, list):
        row = {"in": row[0], "changes": [row[1:]]}
    text = row["text"] if "text" in row else texts[row["in"]]
    words = [row.get("in") or repr(text)]
    for old, new in row.get("changes", ()):
        assert old in text, f"{old!r} is not in the text {row['in']}"
        text = text.replace(old, new, 1)
        words.append(f"{old!r} -> {new!r}")
    words += [row["what"]] if "what" in row else map(str, filter(None, [row.get("files")]))
    route = next((route for route in ROUTES if route in row), "arguments")
    given = row.get(route, ())
    words += [f"{route} {json.dumps(given)}"] if given else []
    return Case(" ".join(words), {**files, FILE: text, **row.get("files", {})}, route, given)


# --- How an input comes in ----------------------------------------------------------------------


def _load(given: Any) -> None:
    """A launch file, with arguments, as a command reads it: it asks parts of the user's own.

    In this process: no code of the table hangs or ends it.
    """
    with mock.patch.object(loader, "tried", lambda function, *_: function()):
        loader.load_tried(Path.cwd() / FILE, tuple(given))


def _phase(given: Mapping[str, Any]) -> None:
    """Parameters that a phase sets, where the file has the line ``duration``."""
    phases = json.dumps([{"name": "a", "duration": 1.0, "set": given}])
    text = re.sub(r"(?m)^duration:.*$", lambda _: f"phases: {phases}", Path(FILE).read_text())
    Path(FILE).write_text(text)
    loader.load(Path.cwd() / FILE)


def _set(given: dict[str, Any]) -> None:
    """Parameters that ``forcebound param set`` changes, of the graph of the launch file."""
    parameters.change(loader.load(Path.cwd() / FILE), given)


def _document(given: Mapping[str, Any]) -> None:
    """A resolved document, of one hand or of the ``file``, with other values; REMOVED: without."""
    given = dict(given)
    document = json.loads((GOLDEN / given.pop("file", "document.json")).read_text())
    for path, value in given.items():
        *before, last = path.split("/")
        inner = document
        for step in before:
            inner = inner[step]
        inner[last] = value
        if value == "REMOVED":
            del inner[last]
    loader.from_document(document)


def _python(given: Mapping[str, Any]) -> None:
    """A mapping from Python, and arguments of ``fb.simulate``."""
    content = given.get("content", FILE)
    forcebound.simulate(content, **{"duration": 0.01, **given.get("arguments", {})})


def _command(given: list[str]) -> str:
    """A command of the shell, and its exit status."""
    result = CliRunner().invoke(main, given)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return f"exit status {result.exit_code}\n{result.stderr.strip()}"


ROUTES: Mapping[str, Callable[[Any], str | None]] = {
    "arguments": _load,
    "phase": _phase,
    "set": _set,
    "document": _document,
    "python": _python,
    "command": _command,
}


def said_of(case: Case, folder: Path) -> str:
    """Return what is said of a case, whose files are written in a folder; it names no machine."""
    for name, text in case.files.items():
        path = folder / name
        if not path.is_file() or path.read_text(encoding="utf-8", errors="surrogateescape") != text:
            path.write_text(text, encoding="utf-8", errors="surrogateescape")
    try:
        with contextlib.chdir(folder), contextlib.redirect_stderr(io.StringIO()):
            said = ROUTES[case.route](case.given)
    except ForceboundError as error:
        said = str(error)
    except (Exception, SystemExit) as error:  # what no input may raise
        said = f"RAISED {type(error).__name__}: {error}"
    said = (said or SOUND).replace(f"{folder}{os.sep}", "").replace(str(folder), "FOLDER")
    said = said.replace(str(SHIPPED), "SHIPPED").replace(str(SHIPPED.parents[1]), "CHECKOUT")
    return "\n".join(line.rstrip() for line in said.splitlines())


def brief(said: str) -> list[str]:
    """Return place and first words of each problem, without the lines that show it."""
    found = []
    for line in said.splitlines():
        if re.match(r" *\d* \| ", f"{line} ") is None:  # no excerpt
            head = re.match(r"(?P<place>[^ ]*:\d+:\d+: )?(?P<words>.*)", line.strip())
            assert head is not None
            words = head["words"].split()[:6]
            found.append((head["place"] or "") + " ".join(words))
    return sorted(found)


# --- Each entry of each shipped file broken ------------------------------------------------------


def mutations(file: Path) -> Iterator[tuple[str, str]]:
    """Yield a name and the text for each fault that is put into a launch file."""
    text = file.read_text(encoding="utf-8")
    root = YAML(typ="safe", pure=True).compose(text)
    yield from _of_mapping(text, root, file.stem)


def _of_mapping(text: str, node: MappingNode, path: str) -> Iterator[tuple[str, str]]:
    is_flow = bool(node.flow_style)
    for key, value in node.value:
        full = f"{path}/{key.value}"
        start, end = key.start_mark.index, _end(text, value)
        whole = text[start:end]

        def put(new: str, start: int, end: int) -> str:
            return text[:start] + new + text[end:]

        yield f"{full} misspelt", put(_misspelt(key.value), start, key.end_mark.index)
        yield f"{full} missing", _without(text, start, end, is_flow)
        between = ", " if is_flow else "\n" + " " * key.start_mark.column
        yield f"{full} twice", put(whole + between + whole, start, end)
        begin = value.start_mark.index
        if isinstance(value, MappingNode):
            if value.flow_style:
                yield f"{full} as a list", put("[1]", begin, end)
            else:
                yield f"{full} as a number", put(" 7", key.end_mark.index + 1, end)
            yield from _of_mapping(text, value, full)
        elif isinstance(value, SequenceNode):
            if value.flow_style:
                yield f"{full} as a number", put("7", begin, end)
            for number, entry in enumerate(value.value):
                if isinstance(entry, MappingNode):
                    yield from _of_mapping(text, entry, f"{full}/{number}")
        else:
            yield f"{full} as a mapping", put("{ a: 1 }", begin, end)
            if key.value == "kind":
                yield f"{full} unknown", put(_misspelt(value.value), begin, end)
            elif re.match(r"[-+.\d]", value.value):
                unit = "3 s" if value.value.endswith("g") else "3 kg"
                yield f"{full} of another unit", put(unit, begin, end)
                yield f"{full} as text", put("abc", begin, end)
            else:
                yield f"{full} as a list", put("[1]", begin, end)


def _end(text: str, value: Any) -> int:
    """Where a value ends: the parser counts the lines after a block to it."""
    if isinstance(value, ScalarNode) or value.flow_style:
        return int(value.end_mark.index)
    inner = value.value[-1]
    return _end(text, inner[1] if isinstance(inner, tuple) else inner)


def _misspelt(word: str) -> str:
    middle = len(word) // 2
    return word[:middle] + word[middle + 1 :] if len(word) > 3 else f"{word}x"


def _without(text: str, start: int, end: int, is_flow: bool) -> str:
    after = text[end:]
    if is_flow:
        after = after.lstrip()
        return text[:start] + (after[1:].lstrip() if after.startswith(",") else after)
    line = text.rfind("\n", 0, start) + 1
    after = after.partition("\n")[2]
    if text[line:start].strip():  # it begins an entry of a list
        return text[:start] + after.lstrip(" ")
    return text[:line] + after


def said_of_mutations(file: Path, folder: Path, part: int = 1) -> Iterator[tuple[str, str]]:
    """Yield the name of each fault of a shipped file, or of each ``part``-th, and what is said."""
    for number, (name, text) in enumerate(mutations(file)):
        if number % part == 0:
            said = said_of(Case(name, {FILE: text}), folder)
            yield name, "\n".join(line for line in said.splitlines() if " | " not in line[:9])


def prepare(folder: Path) -> None:
    """Write what the shipped launch files find in their folder."""
    for file in SHIPPED.iterdir():
        if file.suffix in (".xml", ".ply"):
            shutil.copy(file, folder)


# --- What is stored -----------------------------------------------------------------------------


def as_text(said: Mapping[str, str]) -> str:
    """Return what is said of some cases as one text."""
    return "".join(f"## {name}\n{words}\n\n" for name, words in said.items())


def from_text(text: str) -> dict[str, str]:
    """Return what is said of some cases, by their names."""
    blocks = (block.partition("\n") for block in text.split("## ")[1:] if block)
    return {name: words.strip("\n") for name, _, words in blocks}


def stored(file: Path) -> dict[str, str]:
    """Return what a file of this folder says of cases, by their names."""
    data = file.read_bytes()
    return from_text((lzma.decompress(data) if file.suffix == ".xz" else data).decode())


def said_now() -> tuple[dict[str, str], dict[str, str]]:
    """Return what is said of the table and of all mutations, by name."""
    of_table: dict[str, str] = {}
    for case in table():
        with tempfile.TemporaryDirectory(prefix="fb-") as name:
            assert case.name not in of_table, case.name
            of_table[case.name] = said_of(case, Path(name).resolve())
    with tempfile.TemporaryDirectory(prefix="fb-") as name:
        folder = Path(name).resolve()
        prepare(folder)
        files = sorted(SHIPPED.glob("*.yaml"))
        return of_table, dict(one for file in files for one in said_of_mutations(file, folder))


if __name__ == "__main__":
    of_table, of_mutations = said_now()
    if sys.argv[1:] == ["--write"]:
        SAID.write_text(as_text(of_table), encoding="utf-8")
        MUTATIONS.write_bytes(lzma.compress(as_text(of_mutations).encode(), preset=9))
    else:
        sys.stdout.write(as_text(of_table | of_mutations))
