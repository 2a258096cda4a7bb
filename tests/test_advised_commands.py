"""Commands that messages, README and docs advise: each can be parsed."""

import ast
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

import forcebound
from forcebound.cli import main

ROOT = Path(__file__).parent.parent
PACKAGE = Path(forcebound.__file__).parent

QUOTED = re.compile(r"`forcebound ([^`|>&]+)[^`]*`")
COMMAND = re.compile(rf"(?<!`)\bforcebound (?:{'|'.join(sorted(main.commands))})\b")

# Files whose texts hold commands that are whole lines, or titles, rather than advice in a sentence.
ADVISING = {
    "results/little_force.py",
    "observe/doctor.py",
    "observe/doctor_loop.py",
    "observe/machine.py",
}
NO_SENTENCES = ADVISING | {
    "network/notices.py",
    "lab/views.py",
    "cli/parts.py",
    "graph/schema.py",
}


def texts() -> Iterator[tuple[str, str]]:
    """Give file and text of each string of the package but docstrings; a field becomes 1."""
    for file in sorted(PACKAGE.rglob("*.py")):
        nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
        documents = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
        inner = {
            id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values
        }
        for node in nodes:
            if id(node) not in documents | inner and (text := text_of(node)):
                yield str(file.relative_to(PACKAGE)), text


def text_of(node: ast.AST) -> str:
    if isinstance(node, ast.JoinedStr):
        return "".join(map(text_of, node.values))
    if isinstance(node, ast.FormattedValue):
        return "1"
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def advised_in_pages() -> Iterator[tuple[str, str]]:
    """Give file and command of each line of a page's shell examples."""
    pages = [ROOT / "README.md", ROOT / "examples/README.md", *(ROOT / "docs").glob("*.md")]
    for page in sorted(pages):
        for block in re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            for line in block.replace("\\\n", " ").splitlines():
                found = re.match(r"(?:[\w-]+\$ |\$ )?forcebound ([^|>&]*)", line)
                if found is not None:
                    yield page.name, found[1]


TEXTS = list(texts())
MESSAGES = sorted({(file, command) for file, text in TEXTS for command in QUOTED.findall(text)})
PAGES = sorted(set(advised_in_pages()))
ADVICE = sorted(
    {text for file, text in TEXTS if file in ADVISING and re.match(r"(\w+=\w+ )?forcebound ", text)}
)


def commands(group: click.Group, path: str = "") -> Iterator[tuple[str, click.Command]]:
    """Give each command that is no group of others, or does something by itself, by its words."""
    for name, command in group.commands.items():
        inner = f"{path} {name}".strip()
        if isinstance(command, click.Group):
            yield from commands(command, inner)
        if not isinstance(command, click.Group) or command.invoke_without_command:
            yield inner, command


def parse(words: list[str], is_whole: bool) -> None:
    """Parse a command as it comes from the shell, without doing it."""
    command: click.Command = main
    context = click.Context(main)
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        _, inner, words = command.resolve_command(context, words)
        assert inner is not None
        command, context = inner, click.Context(inner, parent=context)
    values, rest, _ = command.make_parser(context).parse_args(list(words))
    assert not rest, f"{command.name} takes no {rest}"
    needed = [p.name for p in command.params if isinstance(p, click.Argument) and p.required]
    missing = [name for name in needed if not values.get(str(name))]
    assert not (is_whole and missing), f"{command.name} needs {missing}"


@pytest.mark.parametrize(("file", "command"), MESSAGES)
def test_a_command_in_a_message_is_one_that_there_is(file: str, command: str) -> None:
    parse(command.split(), is_whole=False)


def test_each_command_in_a_message_stands_between_backticks() -> None:
    unquoted = [
        (file, text) for file, text in TEXTS if file not in NO_SENTENCES and COMMAND.search(text)
    ]
    assert unquoted == []


@pytest.mark.parametrize("command", ADVICE)
def test_a_command_that_the_doctor_advises_is_one_that_there_is(command: str) -> None:
    parse(shlex.split(command.partition("forcebound ")[2]), is_whole=True)


@pytest.mark.parametrize(("page", "command"), PAGES)
def test_a_command_on_a_page_is_one_that_there_is(page: str, command: str) -> None:
    parse(shlex.split(command, comments=True), is_whole=True)


@pytest.mark.parametrize(("path", "command"), list(commands(main)))
def test_the_help_of_each_command_has_examples(path: str, command: click.Command) -> None:
    shown = command.get_help(click.Context(command))
    examples = re.findall(rf"^ *forcebound ({path}\b[^>\n]*)", shown, re.MULTILINE)
    assert examples
    for example in examples:
        parse(shlex.split(example), is_whole=True)


@pytest.mark.parametrize("wrong", ["param list links.x", "doctor --all", "parm list", "delay a b"])
def test_a_command_that_would_fail_is_found(wrong: str) -> None:
    with pytest.raises((AssertionError, click.UsageError)):
        parse(wrong.split(), is_whole=True)
