import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parent.parent / "docs"


@pytest.mark.parametrize("page", ["launch-files", "results"])
def test_a_page_that_is_made_from_a_table_is_current(page: str) -> None:
    program = [sys.executable, str(DOCS / f"{page.replace('-', '_')}.py")]
    made = subprocess.run(program, capture_output=True, text=True, check=True).stdout
    assert (DOCS / f"{page}.md").read_text(encoding="utf-8") == made, "run: make reference"


def test_every_key_of_a_launch_file_has_a_meaning() -> None:
    page = (DOCS / "launch-files.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| (`\w+`) .*\|\s*\|$", page, re.MULTILINE) == []
