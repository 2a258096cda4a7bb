"""Pictures of docs/gallery.md, by the commands that stand below them.

Without a name all of them, in ten minutes. The picture of the live page is one of
``live_pictures``.
"""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import click
from PIL import Image

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
ENTRY = re.compile(r"\]\((?P<picture>[\w/-]+\.png)\)\s+```sh\n(?P<commands>.*?)```", re.DOTALL)
LARGEST = 1400  # pixels, width
COLOURS = 256


def entries() -> dict[str, tuple[Path, str]]:
    """Return picture and commands of each entry of the page, by the picture's name."""
    found = ENTRY.finditer((DOCS / "gallery.md").read_text(encoding="utf-8"))
    pairs = [(DOCS / each["picture"], each["commands"]) for each in found]
    return {picture.stem: (picture, commands) for picture, commands in pairs}


@click.command()
@click.argument("names", nargs=-1, type=click.Choice(sorted(entries())))
def main(names: tuple[str, ...]) -> None:
    """Run the commands of the named entries, or of all, and store their pictures."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for name, (picture, commands) in entries().items():
        if name not in names and (names or "--view" in commands):
            continue
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "experiments").symlink_to(ROOT / "experiments")
            variables = {**os.environ, "PATH": path}
            subprocess.run(["sh", "-ec", commands], cwd=folder, env=variables, check=True)
            store(Path(folder) / picture.name, picture)


def store(made: Path, picture: Path) -> None:
    """Store a picture with fewer colours, and not too wide."""
    image = Image.open(made).convert("RGB")
    image.thumbnail((LARGEST, 10 * LARGEST))
    image.quantize(COLOURS, dither=Image.Dither.NONE).save(picture, optimize=True)
