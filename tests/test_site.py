"""The site, built without a warning; the gallery; the texts beside the code."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

import forcebound
from experiments.gallery import entries

ROOT = Path(__file__).parent.parent
MOST_LINES = 20  # of an entry of the gallery
LARGEST, ALL = 200_000, 1_500_000  # B, of its pictures


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
    parts = (ROOT / "docs/gallery.md").read_text(encoding="utf-8").split("\n## ")[1:]
    assert len(parts) == len(entries()) >= 12
    assert [part for part in parts if len(part.strip().splitlines()) > MOST_LINES] == []
    sizes = [picture.stat().st_size for picture, _ in entries().values()]
    assert max(sizes) < LARGEST
    assert sum(sizes) < ALL


def test_no_picture_of_the_gallery_is_without_an_entry() -> None:
    shown = {picture for picture, _ in entries().values()}
    assert set((ROOT / "docs/gallery").iterdir()) - shown == set()


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
