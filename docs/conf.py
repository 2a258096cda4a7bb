"""How Sphinx builds the site: ``make docs`` writes it to results/site.

The sources begin at the root of the repository, so that links from docs/ to README.md, launch files
and code lead somewhere. A link to a file that is no page is a download.
"""

import re
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

from docutils.nodes import SkipNode
from docutils.utils.math.latex2mathml import tex2mathml

ROOT = Path(__file__).parent.parent
FOLDERS = [entry.name for entry in ROOT.iterdir() if entry.is_dir()]

project = "forcebound"
author = "The forcebound developers"
project_copyright = f"2026 {author}, MIT licence"
version = release = version_of("forcebound")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
root_doc = "docs/README"  # the one list of all pages
include_patterns = ["*.md", "docs/**.md", "proofs/**.md", "examples/README.md"]
exclude_patterns = [
    *({*FOLDERS} - {"docs", "examples", "proofs"}),
    "examples/*/**",
    "proofs/forcebound_proofs",
]  # not even searched

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4  # named as repository browsers do; links to them are checked
add_module_names = False
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_type_aliases = {"ArrayLike": "ArrayLike"}  # numpy expands it to a long union
autodoc_typehints_description_target = "documented"  # a type where its argument is explained
napoleon_use_ivar = True  # attributes as a list, beside those that the class documents itself
copybutton_prompt_text = "$ "

html_theme = "furo"
html_title = "forcebound"
html_static_path = ["site/site.css"]
html_css_files = ["site.css"]
html_extra_path = ["site/index.html"]  # leads to docs/README.html
html_copy_source = False
html_math_renderer = "mathml"  # of the browser's own: the site asks no other server for anything

PART = "\n```{{toctree}}\n:hidden:\n:caption: {}\n\n{}\n```\n"
DECISIONS = "\n```{toctree}\n:hidden:\n:glob:\n\n[0-9]*\n```\n"


def setup(app: Any) -> None:
    """Add formulas, and the navigation: the pages that list others have tables."""
    app.connect("autodoc-process-docstring", keep_colon, priority=400)  # before napoleon
    app.connect("source-read", add_navigation)
    app.add_html_math_renderer("mathml", (show_formula, None), (show_formula, None))


def add_navigation(app: Any, page: str, source: list[str]) -> None:
    """Append a page's tables of contents, which repository browsers would show as code."""
    if page == "docs/decisions/README":
        source[0] += DECISIONS
    if page == root_doc:
        for part in source[0].split("\n## ")[1:]:
            pages = re.findall(r"^\| \[(.+?)\]\((.+?)\.md\) \|", part, re.MULTILINE)
            source[0] += PART.format(
                part.splitlines()[0], "\n".join("{} <{}>".format(*one) for one in pages)
            )


def show_formula(page: Any, node: Any) -> None:
    """Write a formula, in a line of text or by itself, as MathML."""
    is_block = node.tagname == "math_block"
    page.body.append(tex2mathml(node.astext(), as_block=is_block))
    raise SkipNode


def keep_colon(app: Any, what: str, name: str, part: Any, options: Any, lines: list[str]) -> None:
    """Keep napoleon from taking the words before a colon for the type of a property."""
    if what in ("attribute", "data", "property"):
        lines[:0] = ["..", ""]  # an empty comment, in whose line there is no colon
