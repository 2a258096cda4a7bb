"""An environment on another machine, for tests: its process, its keys, its launch file."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from textwrap import indent

from waiting import TIMEOUT

from forcebound.network.keys import new_key


class RemoteEnvironment:
    """``forcebound node environment FILE`` as a process of its own; see :func:`serving`."""

    def __init__(
        self,
        file: Path,
        folder: Path,
        prefix: Sequence[str] = (),
        keys: Path | None = None,
        runtime: Path | None = None,
    ) -> None:
        self.log_path = folder / "log"
        self._said = ""
        with self.log_path.open("wb") as log:
            self.process = subprocess.Popen(
                [*prefix, sys.executable, "-m", "forcebound", "node", "environment", str(file)],
                env={
                    **os.environ,
                    "XDG_RUNTIME_DIR": str(runtime or folder),
                    **({} if keys is None else {"FORCEBOUND_KEYS": str(keys)}),
                },
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
            )

    @property
    def log(self) -> str:
        """What it has said."""
        if self.log_path.exists():
            self._said = self.log_path.read_text(errors="replace")
        return self._said

    def end(self) -> None:
        """Stop it as systemd or Ctrl-C would."""
        self.process.terminate()
        assert self.process.wait(TIMEOUT) == 0, self.log


@contextmanager
def serving(
    file: Path,
    prefix: Sequence[str] = (),
    keys: Path | None = None,
    runtime: Path | None = None,
) -> Iterator[RemoteEnvironment]:
    """Start an environment that serves a graph elsewhere; afterwards nothing of it is left.

    Args:
        file: Launch file.
        prefix: In front of its command line.
        keys: Its key folder.
        runtime: Its runtime folder, shared with other processes; None: one of its own.
    """
    with tempfile.TemporaryDirectory(prefix="fe-") as folder:
        environment = RemoteEnvironment(file, Path(folder), prefix, keys, runtime)
        try:
            yield environment
        finally:
            environment.process.kill()
            environment.process.wait()
            assert "Traceback" not in environment.log, environment.log


def key_folders(folder: Path, *names: str) -> dict[str, Path]:
    """Make a key pair for each machine; each machine has its own secret and all public keys."""
    folders = {name: folder / f"keys-of-{name}" for name in names}
    for name, own in folders.items():
        own.mkdir(mode=0o700)
        new_key(name, own)
    for name, own in folders.items():
        for other, theirs in folders.items():
            if other != name:
                (theirs / f"{name}.key").write_text((own / f"{name}.key").read_text())
    return folders


# Each time that it comes into the wall it brings energy, so hard contact returns however often it
# is lost; a hand that leans on the wall has spent what it brought, and the law has none to give.
HAND = """
operator:
  kind: sinusoidal
  mass: 0.275 kg
  stiffness: 2 N/mm
  damping: 5 N s/m
  centre: 11 mm # the surface is at 10 mm
  amplitude: 8 mm
  frequency: 2 Hz
"""

# What a test of connections, commands or changes needs not more often, the machine has for others.
RATE = "500 Hz"


def write_launch_file(
    folder: Path,
    name: str,
    remote: str = "",
    more: str = "",
    base: str = "stiff_wall.yaml",
    rate: str = RATE,
) -> Path:
    """Write a launch file of a hand that hits a stiff wall again and again.

    Args:
        folder: Where.
        name: Of the file.
        remote: Entries of its section ``remote``; empty: none.
        more: Further sections.
        base: What it includes.
        rate: Of the servo.
    """
    file = folder / name
    section = f"remote: {{ {remote} }}\n" if remote else ""
    file.write_text(
        f"forcebound: 1\ndescription: A hand and a wall.\ninclude: {base}\n"
        f"realtime: {{ policy: other }}\ndevice: {{ rate: {rate} }}\n{section}{HAND}{more}"
    )
    return file


def write_hands(folder: Path, **remotes: str) -> Path:
    """Write a launch file of several such hands in one wall.

    Args:
        folder: Where.
        remotes: Entries of the section ``remote`` of each hand, by its name; empty: none.
    """
    hands = []
    for hand, remote in remotes.items():
        section = f"remote: {{ {remote} }}\n" if remote else ""
        text = f"include: stiff_wall.yaml\ndevice: {{ rate: {RATE} }}{HAND}{section}"
        hands.append(f"{hand}:\n{indent(text, '  ')}")
    file = folder / "hands.yaml"
    file.write_text(
        "forcebound: 1\nseed: 1\nduration: 10\nrealtime: { policy: other }\n"
        "environment: { kind: wall, stiffness: 10 N/mm, position: 10 mm }\n"
        f"hands:\n{indent(''.join(hands), '  ')}"
    )
    return file
