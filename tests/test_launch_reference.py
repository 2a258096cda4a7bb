import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).parent.parent / "docs"


def test_the_page_of_keys_is_current() -> None:
    program = [sys.executable, str(DOCS / "launch_files.py")]
    page = subprocess.run(program, capture_output=True, text=True, check=True).stdout
    assert (DOCS / "launch-files.md").read_text(encoding="utf-8") == page, "run: make reference"
