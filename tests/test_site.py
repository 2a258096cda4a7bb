"""The site, built without a warning; the gallery; the texts beside the code."""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

import forcebound
from experiments.films import FILMS, PICTURES
from experiments.gallery import (
    APART,
    ENDS,
    WITHOUT_FILM,
    entries,
    films,
    launch_line,
    plots,
)
from experiments.page import Take, end_of
from forcebound.graph.document import GROUPS

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
MOST_LINES = 20  # of an entry of the gallery
LARGEST, ALL, ALL_FILMS = 200_000, 1_500_000, 6_000_000  # B, of its pictures
SAME = 1e-4  # m, or rad, by which the end of a film may differ from that of the world


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    options = ["-q", "-W", "--keep-going", "-c", str(ROOT / "docs"), str(ROOT), str(folder)]
    command = [sys.executable, "-m", "sphinx", *options]
    run = subprocess.run(command, capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")
    return folder


def test_every_page_is_built(site: Path) -> None:
    pages = {file.with_suffix("").relative_to(ROOT) for file in (ROOT / "docs").rglob("*.md")}
    built = {file.with_suffix("").relative_to(site) for file in (site / "docs").rglob("*.html")}
    assert built == pages
    assert (site / "README.html").exists()
    assert "docs/README.html" in (site / "index.html").read_text()


def test_the_reference_has_every_public_name(site: Path) -> None:
    page = (site / "docs/api.html").read_text(encoding="utf-8")
    places = set(re.findall(r'id="(forcebound[\w.]*)"', page))
    made = {name for name in forcebound.__all__ if callable(getattr(forcebound, name))}
    assert {f"forcebound.{name}" for name in made} - places == set()
    assert "forcebound.haptics.environments.Environment.force" in places
    assert "forcebound.haptics.laws.law.BoundingLaw" in places


def test_an_entry_of_the_gallery_is_small() -> None:
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    parts = re.split("\n###? ", text)[1:]
    assert len(entries()) >= 12
    assert [part for part in parts if len(part.strip().splitlines()) > MOST_LINES] == []
    sizes = [picture.stat().st_size for picture, _ in entries().values()]
    assert max(sizes) < LARGEST
    assert sum(sizes) < ALL
    assert sum(file.stat().st_size for file, _ in films().values()) < ALL_FILMS


def test_every_launch_file_has_a_film_or_a_reason_for_none() -> None:
    known = {name for names in GROUPS.values() for name in names}
    assert known == FILMS.keys() | WITHOUT_FILM.keys()
    assert not FILMS.keys() & WITHOUT_FILM.keys()
    assert [name for name, take in FILMS.items() if take.launch != name] == []


def test_each_film_stands_above_the_command_that_shows_it() -> None:
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    for file, take in films().values():
        shown = f"]({file.relative_to(DOCS)})\n\n```sh\n{launch_line(take)}\n```\n"
        assert shown in text, shown


def test_every_picture_is_made_by_the_command_and_shown() -> None:
    made = {file for file, _ in (*films().values(), *plots().values())}
    made |= {DOCS / f"{name}.png" for name in (*PICTURES, *APART)}
    found = {file for kind in ("png", "webp") for file in DOCS.rglob(f"*.{kind}")}
    assert found == made
    pages = [ROOT / "README.md", *DOCS.rglob("*.md"), *(ROOT / "proofs").rglob("*.md")]
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    assert [file.name for file in found if file.name not in text] == []


@pytest.mark.parametrize(("name", "take"), FILMS.items(), ids=FILMS)
def test_a_film_is_not_older_than_its_world(name: str, take: Take) -> None:
    ends = json.loads(ENDS.read_text(encoding="utf-8"))
    old = f"the world has changed: python -m experiments gallery {name}"
    tips = end_of(take)
    assert tips.keys() == ends[name].keys()
    for hand, tip in tips.items():
        assert tip == pytest.approx(ends[name][hand], abs=SAME), old


def read(name: str) -> Any:
    """Return the content of a YAML file of the repository."""
    return YAML(typ="safe").load((ROOT / name).read_text(encoding="utf-8"))


def test_the_citation_is_that_of_this_version() -> None:
    citation = read("CITATION.cff")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert citation["version"] == project["version"]
    assert citation["license"] == project["license"]


@pytest.mark.parametrize("name", ["bug", "device"])
def test_a_form_asks_for_the_diagnosis(name: str) -> None:
    form = read(f".github/ISSUE_TEMPLATE/{name}.yml")
    assert {"name", "description", "body"} <= set(form)
    asked = {part["id"]: part for part in form["body"] if part["type"] != "markdown"}
    assert "forcebound doctor --json" in asked["doctor"]["attributes"]["label"]
    assert all(part["attributes"]["label"] for part in asked.values())


def test_the_paper_cites_each_of_its_sources() -> None:
    text = (ROOT / "paper/paper.md").read_text(encoding="utf-8")
    sources = (ROOT / "paper/paper.bib").read_text(encoding="utf-8")
    listed = set(re.findall(r"^@\w+\{(\w+),", sources, re.MULTILINE))
    assert set(re.findall(r"@(\w+)", text)) == listed != set()
