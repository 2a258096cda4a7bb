"""Kernels of the laws, compiled before a running device needs them.

A device that takes another law loads its kernels between two ticks, without force. From the cache
on disk that takes some 20 ms, compiling them 0.6 s or more. So another process compiles them
beforehand: ``python -m forcebound.observe.kernels RUN_DIR LAW...``.
"""

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from forcebound import realtime
from forcebound.errors import ConfigError
from forcebound.haptics.laws import ForceBounder
from forcebound.run.run_directory import RunDocument, read_configuration

POLL_S = 0.05  # between two looks at what compiles
COMPILE_TIMEOUT_S = 60.0  # s, for a busy machine; then the device compiles itself what is missing


class Kernels:
    """The kernels for the devices of a graph that have ``loaded`` those of a law; to be closed."""

    def __init__(self, run_dir: Path, loaded: str = "") -> None:
        self._run_dir = run_dir
        self._processes: list[subprocess.Popen[bytes]] = []
        self._under_way = {loaded: 0.0}  # s that a law is to be waited for
        self.is_wanted: Callable[[], bool] = lambda: True  # asked while :meth:`wait` waits

    def begin(self, laws: Iterable[str]) -> None:
        """Start to compile the kernels of some laws."""
        new = [law for law in laws if law not in self._under_way]
        if new:
            command = [sys.executable, "-m", __name__, str(self._run_dir), *new]
            none = subprocess.DEVNULL
            process = subprocess.Popen(command, stdin=none, stdout=none, stderr=none)
            self._processes.append(process)
            self._under_way |= dict.fromkeys(new, COMPILE_TIMEOUT_S)

    def wait(self, law: str) -> None:
        """Wait until the kernels of a law are in the cache, but not for ever.

        Raises:
            ConfigError: If another law is asked for now; see :attr:`is_wanted`.
        """
        self.begin([law])
        end = time.monotonic() + self._under_way[law]
        while time.monotonic() < end and any(one.poll() is None for one in self._processes):
            if not self.is_wanted():
                raise ConfigError(f"the law {law} is no longer asked for: a newer change came")
            time.sleep(POLL_S)
        self._under_way[law] = 0.0

    def close(self) -> None:
        """End what is still under way."""
        for process in self._processes:
            process.kill()
            process.wait()


def compile_kernels(run_dir: Path, laws: Iterable[str]) -> None:
    """Compile the kernels of laws for the devices of a graph, into the cache on disk."""
    hands = read_configuration(run_dir).hands.values()
    for law in laws:
        for facts in (hand.facts for hand in hands):
            ForceBounder(law, facts.dissipation, facts.axes)


if __name__ == "__main__":
    realtime.die_with_parent(signal.SIGKILL)
    realtime.leave_core(RunDocument.read(Path(sys.argv[1])).core)
    compile_kernels(Path(sys.argv[1]), sys.argv[2:])
