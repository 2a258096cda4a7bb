"""An emulated device in place of a real one: its program, its port, its ground truth."""

import json
import os
import select
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from forcebound.ending import end
from forcebound.errors import DeviceError
from forcebound.folders import runtime_folder
from forcebound.haptics.devices.truth_file import SUFFIX, TruthFile, truth_beside
from forcebound.haptics.hands import OPERATORS, Operator
from forcebound.haptics.parts.plain import plain

__all__ = ["Emulated", "TruthFile", "start", "truth_beside"]

START_TIMEOUT_S = 60.0  # a cold start on a busy machine compiles the mechanism
GRACE = 5.0  # s, to end by itself


class Emulated:
    """A running emulator: the paths of its port and of its ground truth (:class:`TruthFile`)."""

    def __init__(self, process: "subprocess.Popen[bytes]", link: Path) -> None:
        self._process = process
        self.link = str(link)
        self.truth = Path(f"{link}{SUFFIX}")

    def close(self) -> None:
        """End it."""
        end(self._process, GRACE)
        for stream in (self._process.stdout, self._process.stderr):
            assert stream is not None
            stream.close()


def start(kind: str, mechanism: Mapping[str, Any], operator: Operator | None) -> Emulated:
    """Start an emulator of a kind in a process of its own; it ends when its port is closed.

    ``mechanism`` has parameters of the simulated device behind the board, plain JSON in SI units.
    DeviceError says why if it does not start.
    """
    folder = runtime_folder()
    if folder is None:
        raise DeviceError("there is no private folder for an emulator: set XDG_RUNTIME_DIR")
    link = folder / f"{kind}-{os.getpid()}-{os.urandom(4).hex()}"
    command = [sys.executable, "-m", "forcebound", "emulate", kind]
    process = subprocess.Popen(
        [*command, "--link", str(link), "--until-unused", "--values", "-"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=os.getsid(0) != os.getpid(),  # as for a guardian
    )
    hand = None if operator is None else {"kind": _kind(operator), **plain(operator)}
    assert process.stdin is not None
    with suppress(BrokenPipeError), process.stdin as given:  # it may have ended already
        given.write(json.dumps({"mechanism": dict(mechanism), "operator": hand}).encode())
    emulated = Emulated(process, link)
    try:
        _wait_for(process)
    except BaseException:
        emulated.close()
        raise
    return emulated


def _kind(operator: Operator) -> str:
    kind = OPERATORS.kind_of(type(operator))
    if kind is None:
        name = type(operator).__name__
        raise DeviceError(f"no kind of operator is a {name}: keep its class in a file")
    return kind


def _wait_for(process: "subprocess.Popen[bytes]") -> None:
    """Wait for the emulator's first line, which it says when its link is there."""
    assert process.stdout is not None
    assert process.stderr is not None
    if not select.select((process.stdout,), (), (), START_TIMEOUT_S)[0]:
        raise DeviceError(f"the emulator has not started within {START_TIMEOUT_S:.0f} s")
    if not process.stdout.readline():  # it has ended
        said = process.stderr.read().decode(errors="replace").strip()
        raise DeviceError(f"the emulator does not start: {said}")
