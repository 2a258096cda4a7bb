"""The Python on pages of docs/ runs as a script, with fewer values where a list is long.

Without live graphs, which `test_interface.py` has, and on one core, where no processes start;
`test_measures.py` has scripts whose runs are in processes.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from forcebound.lab.table import read_table

DOCS = Path(__file__).parent.parent / "docs"


def run_page(name: str, folder: Path) -> list[str]:
    """Run the blocks of a page, in one script; return them."""
    text = (DOCS / name).read_text(encoding="utf-8")
    blocks: list[str] = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    blocks = [block for block in blocks if "fb.launch" not in block]
    script = re.sub(r"(space\([^()]*, )\d+\)", r"\g<1>2)", "\n".join(blocks))
    script = script.replace("law=list(fb.laws)", "law=list(fb.laws)[:2]")
    (folder / "page.py").write_text(script, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "page.py"],
        cwd=folder,
        preexec_fn=lambda: os.sched_setaffinity(0, [min(os.sched_getaffinity(0))]),
        env={**os.environ, "MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return blocks


def test_the_code_of_the_page_on_python_runs(tmp_path: Path) -> None:
    blocks = run_page("python.md", tmp_path)
    (own,) = (block for block in blocks if block.startswith("def contacts"))
    assert len(own.splitlines()) == 6
    columns = read_table(tmp_path / "contacts.parquet").columns
    assert len(columns["contacts"]) == 3 * 2 * 2
    assert (tmp_path / "contacts.png").read_bytes().startswith(b"\x89PNG")


def test_the_campaign_of_the_page_on_sweeps_runs(tmp_path: Path) -> None:
    run_page("sweeps.md", tmp_path)
    assert read_table(tmp_path / "areas.parquet").columns["area"][-1] == pytest.approx(0.24)
