"""Texts of sweep files."""

from pathlib import Path

SMALL = """
forcebound: 1
description: a small one
launch: stiff_wall
duration: 50 ms
set: { approach_speed: 100 mm/s }
over:
  law: [certified, none]
  stiffness: { from: 1 N/mm, to: 4 N/mm, count: 3, scale: log }
map: { x: stiffness, value: peak_force_n, per: law }
"""

LONG = SMALL.replace("count: 3", "count: 320")


def written(folder: Path, text: str) -> Path:
    file = folder / "small.yaml"
    file.write_text(text)
    return file
