"""Films and pictures of docs/gallery.md, the live page, README.md and other pages of docs/.

All but those of ``APART`` come from this one command, in some five minutes: a film of each world,
the page's pictures, the plots by the commands that stand below them in the gallery, and the other
experiments. All are in virtual time, so on every machine and at any load they show the same.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import click
from PIL import Image

from experiments.films import FILMS, PICTURES, README
from experiments.page import Take, browser, end_of, film, pictures

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
ENTRY = re.compile(r"\]\((?P<picture>[\w/-]+\.png)\)\s+```sh\n(?P<commands>.*?)```", re.DOTALL)
STILL = 0.2  # s between two looks of the browser before a picture
LARGEST = 1400  # pixels, width
COLOURS = 256
MOST, MOST_README = 400_000, 2_000_000  # B of a film
#: Where the tips are at the end of the film of each world, in m: once that changes, it is old.
ENDS = DOCS / "gallery" / "ends.json"
LIVE = DOCS / "live-page.webp"
#: Pictures of other pages, by the command that makes them.
OTHERS = {
    "networks": "python -m experiments networks --out networks.png",
    "scaled": "python -m experiments scaled --out scaled.png",
    "transparency_two_hands": "python -m experiments two_hands transparency"
    " --out transparency_two_hands.png",
    "coupling": "forcebound sweep coupling --plot",
    "coupling_transfer": "forcebound sweep coupling_transfer --plot",
    "hand_speed": "forcebound sweep hand_speed --plot",
}
#: Pictures that this command does not make, and why.
APART = {
    "demo": "live: `make demo`",
    "first_device": "live, with the emulated board: docs/first-device.md",
    "far_wall": "a campaign of `make proofs`",
    "study": "a campaign of docs/reproduce.md of the proofs",
    "league_stiffness": "of `forcebound league`",
    "league_energy": "of `forcebound league`",
    "league_transparency": "of `forcebound league`",
    "study-page": "a person's touch, live: docs/study.md",
}
#: Launch files without a film of their own, and why.
WITHOUT_FILM = {
    name: reason
    for reason, names in {
        "the wall of the first film, live-page.webp": "pointer_wall stiff_wall damped_wall"
        " delayed_wall time_varying_wall released_hand impedance stress paper_wall"
        " paper_time_varying_wall knob_wall five_bar_wall serial_arm_wall remote_wall",
        "live only, before the same wall": "haply_2diy haply_inverse3 odrive_knob dynamixel_arm"
        " feetech_arm",
        "a wall in space, as that of desktop_arm": "three_axes",
        "the sphere of pointer_touch": "touch_sphere",
        "the rabbit of pointer_rabbit": "touch_mesh touch_field",
        "the skin of pointer_membrane": "membrane",
        "the box of pointer_two_hands": "two_hands",
        "the devices of leader_follower_transfer": "leader_follower leader_follower_remote",
        "dials, as those of joint_arms": "servo_wall servo_arms",
        "a wall in one axis, of a comparison": "two_port_wall",
        "a cup that nobody sees: one axis, no scene": "cart_pendulum",
    }.items()
    for name in names.split()
}


def entries() -> dict[str, tuple[Path, str]]:
    """Return picture and commands of each plot of the page, by the picture's name."""
    found = ENTRY.finditer((DOCS / "gallery.md").read_text(encoding="utf-8"))
    pairs = [(DOCS / each["picture"], each["commands"]) for each in found]
    return {picture.stem: (picture, commands) for picture, commands in pairs}


def films() -> dict[str, tuple[Path, Take]]:
    """Return file and content of each film, by its name."""
    worlds = {name: (DOCS / "gallery" / f"{name}.webp", take) for name, take in FILMS.items()}
    return {**worlds, LIVE.name: (LIVE, README)}


def plots() -> dict[str, tuple[Path, str]]:
    """Return picture and commands of each plot that this makes, by the picture's name."""
    return entries() | {name: (DOCS / f"{name}.png", line) for name, line in OTHERS.items()}


def launch_line(take: Take) -> str:
    """Return the command that shows live what a film shows."""
    words = (re.sub(r":=(.*)", r':="\1"', word) for word in take.words)
    return " ".join(["forcebound launch", take.launch, "--view", *words])


@click.command()
@click.argument(
    "names", nargs=-1, type=click.Choice([*films(), *PICTURES, *plots()]), metavar="[NAME]..."
)
def main(names: tuple[str, ...]) -> None:
    """Make the named films and pictures, or all: one world is ``gallery push_boxes``."""
    chosen = [name for name in (*films(), *PICTURES) if name in names or not names]
    if chosen:
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as own, browser(own) as driver:
            for name in chosen:
                show(driver, name)
    for name, (picture, commands) in plots().items():
        if name in names or not names:
            run(picture, commands)


def show(driver: Any, name: str) -> None:
    """Make a film, or a picture of the page."""
    if name in PICTURES:
        file, take = DOCS / f"{name}.png", PICTURES[name]
        *_, last = pictures(driver, take, STILL)
        quantized(last).save(file, optimize=True)
    else:
        file, take = films()[name]
        film(driver, take, file, MOST_README if file == LIVE else MOST)
        if name in FILMS:
            ends = json.loads(ENDS.read_text()) if ENDS.exists() else {}
            ends[name] = end_of(take)
            ENDS.write_text(json.dumps(ends, sort_keys=True) + "\n")
    click.echo(f"wrote {file}, {file.stat().st_size} B")


def run(picture: Path, commands: str) -> None:
    """Run commands in an empty folder, and store their picture with fewer colours, not too wide."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "experiments").symlink_to(ROOT / "experiments")
        variables = {**os.environ, "PATH": path}
        subprocess.run(["sh", "-ec", commands], cwd=folder, env=variables, check=True)
        image = Image.open(Path(folder) / picture.name).convert("RGB")
    image.thumbnail((LARGEST, 10 * LARGEST))
    quantized(image).save(picture, optimize=True)
    click.echo(f"wrote {picture}")


def quantized(image: Image.Image) -> Image.Image:
    """Return an image with fewer colours."""
    return image.quantize(COLOURS, dither=Image.Dither.NONE)
