"""The notebooks run as they stand; their pictures are drawn."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).parent.parent / "notebooks").glob("*.ipynb"))
# In a process of its own: its event loop and sockets are no matter of these tests.
EXECUTE = """
import sys, nbformat
from nbclient import NotebookClient

notebook = nbformat.read(sys.argv[1], 4)
NotebookClient(notebook, timeout=600, kernel_name="python3").execute()
nbformat.write(notebook, sys.argv[2])
"""


@pytest.mark.live
@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_notebook(file: Path, tmp_path: Path) -> None:
    made = tmp_path / file.name
    command = [sys.executable, "-c", EXECUTE, str(file), str(made)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    outputs = [
        output
        for cell in json.loads(made.read_text())["cells"]
        for output in cell.get("outputs", ())
    ]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    errors = [output for output in outputs if output.get("name") == "stderr"]
    assert not errors


def test_there_are_three_notebooks() -> None:
    assert len(NOTEBOOKS) == 3
