"""How Sphinx builds the site: ``make docs`` writes it to results/site.

The sources begin at the root of the repository, so that links from docs/ to README.md, launch files
and code lead somewhere. A link to a file that is no page is a download.
"""

from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
FOLDERS = [entry.name for entry in ROOT.iterdir() if entry.is_dir()]

project = "forcebound"
author = "The forcebound developers"
version = release = version_of("forcebound")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
root_doc = "docs/index"
include_patterns = ["*.md", "docs/**.md", "examples/README.md"]
exclude_patterns = [*({*FOLDERS} - {"docs", "examples"}), "examples/*/**"]  # not even searched

myst_heading_anchors = 4  # named as repository browsers do; links to them are checked
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"  # a type where its argument is explained
napoleon_use_ivar = True  # attributes as a list, beside those that the class documents itself
copybutton_prompt_text = "$ "

html_theme = "furo"
html_title = "forcebound"
html_extra_path = ["site"]  # index.html, which leads to docs/index.html
html_copy_source = False

DECISIONS = "\n```{toctree}\n:hidden:\n:glob:\n\n[0-9]*\n```\n"


def setup(app: Any) -> None:
    """Add the list of decisions to the navigation, which their page has as a table."""
    app.connect("source-read", add_decisions)


def add_decisions(app: Any, page: str, source: list[str]) -> None:
    """Append a table of contents to the page of the decisions, on the site alone."""
    if page == "docs/decisions/README":
        source[0] += DECISIONS
