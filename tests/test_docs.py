"""Pages of docs/: links that resolve, rows and keys that exist."""

import re
from itertools import pairwise
from pathlib import Path

import pytest

from forcebound.cli import main
from forcebound.graph.loader import load
from forcebound.messages.packets import TOPIC_OF, field_types
from forcebound.results.figures import FIGURES
from forcebound.results.tables import summary_rows
from forcebound.run.virtual import run_virtual

ROOT = Path(__file__).parent.parent
PAGES = sorted(
    [
        *(
            ROOT / name
            for name in ("README.md", "SECURITY.md", "CONTRIBUTING.md", "examples/README.md")
        ),
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "proofs/docs").rglob("*.md"),
    ],
    key=str,
)
ROWS = {figure.label for figure in FIGURES}
WIRE_KEYS = {name for packet in TOPIC_OF for name in field_types(packet)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_between_pages_leads_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8"))
    local = [link for link in links if "://" not in link]
    assert [link for link in local if not (page.parent / link).exists()] == []


WRITTEN = [
    page for folder in ("docs", "proofs/docs") for page in sorted((ROOT / folder).glob("*.md"))
]
LIST = ROOT / "docs/README.md"


def linked(page: Path, text: str) -> list[Path]:
    """The pages to which a part of a page's text links, in order."""
    links = re.findall(r"\]\(([^)#:]+\.md)", text)
    return [(page.parent / link).resolve() for link in links]


def test_the_one_list_of_pages_has_every_page_once() -> None:
    rows = re.findall(
        r"^\| (\[[^]]+\]\([^)]+\)) \|", LIST.read_text(encoding="utf-8"), re.MULTILINE
    )
    listed = linked(LIST, " ".join(rows))
    assert len(set(listed)) == len(listed)
    assert set(WRITTEN) - {LIST} - set(listed) == set()


@pytest.mark.parametrize(
    "page", [page for page in WRITTEN if page != LIST], ids=lambda page: page.name
)
def test_every_page_says_at_its_end_what_comes_next(page: Path) -> None:
    *_, last = page.read_text(encoding="utf-8").strip().split("\n\n")
    assert last.startswith("**Next**")
    assert linked(page, last)


def paths() -> list[list[Path]]:
    """The pages of each path, in order."""
    part = LIST.read_text(encoding="utf-8").partition("\n## Four paths\n")[2].partition("\n## ")[0]
    rows = [row.split("|")[-2] for row in part.splitlines() if "](" in row and row[0] == "|"]
    return [linked(LIST, row) for row in rows]


def test_each_of_the_four_paths_is_short_and_each_page_leads_to_the_next_one() -> None:
    assert len(paths()) == 4
    for pages in paths():
        assert 1 < len(pages) <= 6
        for page, following in pairwise(pages):
            *_, last = page.read_text(encoding="utf-8").strip().split("\n\n")
            assert following in linked(page, last), f"{page.name} does not lead to {following.name}"


def test_the_glossary_names_rows_and_keys_that_exist() -> None:
    page = (ROOT / "docs/glossary.md").read_text(encoding="utf-8")
    cells = [line.split("|")[-2] for line in page.splitlines() if line.startswith("| ")]
    rows = {row for cell in cells for row in re.findall(r"\*([^*]+)\*", cell)}
    keys = {key for cell in cells for key in re.findall(r"`([a-z]{2,}_[a-z_]+)`", cell)}
    assert rows - ROWS == set()
    assert keys - WIRE_KEYS - set(TOPIC_OF.values()) == set()
    assert rows
    assert keys


def test_the_page_of_commands_lists_every_command() -> None:
    page = (ROOT / "docs/commands.md").read_text(encoding="utf-8")
    assert [name for name in main.commands if not re.search(rf"`{name}\b", page)] == []


def tutorial_rows() -> list[tuple[str, ...]]:
    page = (ROOT / "docs/tutorial.md").read_text(encoding="utf-8")
    return re.findall(r"^\| (\d+ ms) \| `(\w+)` \| (.+?) \| (.+?) \| (.+?) \|", page, re.MULTILINE)


@pytest.mark.parametrize(
    ("delay", "law", "stiffness", "bounces", "energy"), tutorial_rows(), ids=str
)
def test_the_figures_of_the_tutorial_are_those_of_virtual_time(
    delay: str, law: str, stiffness: str, bounces: str, energy: str
) -> None:
    config = load("stiff_wall", [f"law:={law}", f"delay:={delay}"])
    rows = dict(summary_rows(run_virtual(config).summary))
    assert rows["displayed stiffness"] == stiffness
    assert rows["contact bounces"] == bounces
    assert rows["minimum energy (ground truth)"] == energy
