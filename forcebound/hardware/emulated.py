"""An emulator in place of a real device, in another process."""

import json
import os
import select
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from forcebound.ending import end
from forcebound.errors import DeviceError
from forcebound.folders import runtime_folder
from forcebound.graph.resolved import part_document
from forcebound.haptics.devices import DeviceModel
from forcebound.haptics.hands import Operator

START_TIMEOUT_S = 60.0  # a cold start on a busy machine compiles the mechanism
END_TIMEOUT_S = 5.0


class Emulator:
    """A running emulator; ``link`` is the path of its port."""

    def __init__(self, process: "subprocess.Popen[bytes]", link: Path) -> None:
        self._process = process
        self.link = str(link)

    def close(self) -> None:
        """End it."""
        end(self._process, END_TIMEOUT_S)
        for stream in (self._process.stdout, self._process.stderr):
            assert stream is not None
            stream.close()


def start(kind: str, model: DeviceModel, operator: Operator | None) -> Emulator:
    """Start an emulator of a kind of device; it ends when its port is closed.

    It has the numbers of ``model``. DeviceError gives the reason if it does not start; ConfigError
    if the operator's class is in no file.
    """
    folder = runtime_folder()
    if folder is None:
        raise DeviceError("there is no private folder for an emulator: set XDG_RUNTIME_DIR")
    link = folder / f"{kind}-{os.getpid()}-{os.urandom(4).hex()}"
    parts = {
        "device": part_document("device", model),
        "operator": None if operator is None else part_document("operator", operator),
    }
    command = [sys.executable, "-m", "forcebound", "emulate", kind]
    process = subprocess.Popen(
        [*command, "--link", str(link), "--until-unused", "--parts", "-"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=os.getsid(0) != os.getpid(),  # as for a guardian
    )
    emulator = Emulator(process, link)
    try:
        assert process.stdin is not None
        with suppress(BrokenPipeError), process.stdin as given:  # it may have ended already
            given.write(json.dumps(parts).encode())
        _wait_for(process)
    except BaseException:
        emulator.close()
        raise
    return emulator


def _wait_for(process: "subprocess.Popen[bytes]") -> None:
    """Wait for the emulator's first line, which it writes when its link is there."""
    assert process.stdout is not None
    assert process.stderr is not None
    if not select.select((process.stdout,), (), (), START_TIMEOUT_S)[0]:
        raise DeviceError(f"the emulator has not started within {START_TIMEOUT_S:.0f} s")
    if not process.stdout.readline():  # it has ended
        reason = process.stderr.read().decode(errors="replace").strip()
        raise DeviceError(f"the emulator does not start: {reason}")
