"""A device in a program of its user's, in C++ for example, over a socket.

The program has two hooks, ``read`` and ``write``; ``examples/cpp/forcebound_device.hpp`` is its end
of the socket, and says what its watchdog promises. The bounder stays in our device process.
"""

import os
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path

from forcebound.errors import ConfigError, DeviceError
from forcebound.files import reason
from forcebound.haptics.devices import Source
from forcebound.haptics.hands import Operator
from forcebound.hardware.driven import GRACE, Caller, DrivenModel, OpenDriven, Units
from forcebound.messages.packets import Vector
from forcebound.network.program import ProgramLink

OPENING = 30.0  # s, for a program to start and to find its device
LOOK = 1.0  # s, between two looks whether it still runs then
ENDING = 0.3  # s, for it to end


@dataclass(frozen=True, kw_only=True)
class Program(DrivenModel):
    """Parameters of a device in a program.

    Its positions are in rad, and its commands in N m, positive where they accelerate towards larger
    positions; of the joints in ``prismatic`` in m and N, such as x, y and z of a haptic device.

    Attributes:
        program: It is started with the endpoint as its first argument, and ended with the run;
            null: it runs already, at ``address``.
        address: Endpoint of a program that runs already, ``tcp://127.0.0.1:7601``; empty: there is
            one for the program that is started.
    """

    program: Path | None = None
    address: str = ""
    sources: Mapping[str, Source] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.program is None) == (not self.address):
            raise ConfigError(
                "a device of this kind needs either program, to start it, or address, of one that"
                " runs",
                field="address",
            )

    def check_files(self) -> None:
        if self.program is not None and not os.access(self.program, os.X_OK):
            raise ConfigError(f"program: nothing to start at {self.program}", field="program")

    @property
    def own_code(self) -> str:
        return str(self.program or self.address)

    def open(self, operator: Operator | None, hold_limit: float) -> OpenDriven:
        with ExitStack() as stack:
            address, process = self.address, None
            if self.program is not None:
                folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="forcebound-"))
                address = f"ipc://{folder}/device"
                process = _started(self.program, address)
                stack.callback(_end, process)
            link = ProgramLink(address)
            stack.callback(link.close)
            for _ in range(round(OPENING / LOOK)):
                if link.waits_for(LOOK) or process is None:
                    break
                if (status := process.poll()) is not None:
                    raise DeviceError(f"{self.program} ended at its start, with status {status}")
            link.ask("hello", (float(self.axes), self.longest_force), max(self.timeout, LOOK))
            robot = _Served(link, self.timeout)
            ones = (1.0,) * self.axes
            device = OpenDriven(self, Caller(2.0 * self.timeout + GRACE), robot, Units(ones, ones))
            robot.owned = stack.pop_all()
        return device


class _Served:
    """The program, with the methods of a user's class."""

    def __init__(self, link: ProgramLink, timeout: float) -> None:
        self._link, self._timeout = link, timeout
        self.owned = ExitStack()

    def get_positions(self) -> Vector:
        return self._link.ask("read", (), self._timeout)

    def set_torques(self, torques: Sequence[float]) -> None:
        self._link.ask("write", torques, self._timeout)

    def stop(self) -> None:
        with self.owned:
            self._link.ask("stop", (), self._timeout)


def _started(program: Path, address: str) -> "subprocess.Popen[bytes]":
    try:
        # What it prints goes to the log.
        return subprocess.Popen(
            [str(program), address, "--once"], stdin=subprocess.DEVNULL, stdout=2
        )
    except OSError as error:
        raise DeviceError(f"cannot start {program}: {reason(error)}") from None


def _end(process: "subprocess.Popen[bytes]") -> None:
    """Wait for a program that was asked to stop; end it if it does not."""
    for end in (process.terminate, process.kill):
        with suppress(subprocess.TimeoutExpired):
            process.wait(ENDING)
            return
        end()
    process.wait()
