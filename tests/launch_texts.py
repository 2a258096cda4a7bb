"""A small launch file that tests change, and how they write and read it."""

from pathlib import Path

import pytest

from forcebound.errors import ConfigError
from forcebound.graph.loader import load

GOOD = """\
forcebound: 1
arguments:
  law: {default: certified, help: bounding law}
  stiffness: 10 N/mm
  mode: {default: soft, choices: [soft, hard]}
seed: 1
duration: 6 s
device:
  kind: phantom_premium_1_5
  law: $(arg law)
operator: {kind: pressing}
environment:
  kind: wall
  stiffness: $(arg stiffness)
links:
  environment_query: {delay: 2 ms}
"""


def written(folder: Path, text: str | bytes, name: str = "graph.yaml") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def problems_of(path: str | Path, *overrides: str) -> str:
    with pytest.raises(ConfigError) as caught:
        load(path, overrides)
    return str(caught.value)
