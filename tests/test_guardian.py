"""The guardian writes zero force when the process of the device no longer can."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import pytest
from waiting import until

from benchmarks.guardian import FATES, FORCE, ZERO, watch
from forcebound.ending import end_group
from forcebound.errors import DeviceError, GuardianError
from forcebound.hardware.guardian import Guardian

pytestmark = pytest.mark.live


@pytest.fixture
def board() -> Iterator[tuple[int, int]]:
    """Both ends of a pipe: where the board reads, and the port."""
    reader, port = os.pipe()
    os.set_blocking(reader, False)
    yield reader, port
    os.close(reader)
    os.close(port)


@pytest.mark.parametrize("fate", FATES)
def test_a_force_ends_once_whatever_becomes_of_its_process(fate: str) -> None:
    messages, _ = watch(fate)  # how soon, `python -m benchmarks guardian` prints
    assert messages.count(ZERO) == 1
    assert messages[-1] == ZERO
    assert set(messages) <= {FORCE, ZERO}


def test_it_waits_neither_for_a_time_out_nor_for_the_memory_of_what_ends(
    board: tuple[int, int],
) -> None:
    reader, port = board
    made: list[Guardian] = []

    def give_force() -> None:
        made.append(Guardian(port, ZERO, timeout=3600.0))
        made[0].beat(time.monotonic_ns())

    holder = threading.Thread(target=give_force)
    holder.start()
    os.set_blocking(reader, True)
    assert os.read(reader, 100) == ZERO  # this process goes on, and so does its memory
    holder.join()
    made[0].close()


def test_a_process_that_was_too_late_is_told(board: tuple[int, int]) -> None:
    reader, port = board
    guardian = Guardian(port, ZERO, timeout=0.002)
    guardian.check()
    guardian.beat(time.monotonic_ns())
    os.set_blocking(reader, True)
    assert os.read(reader, 100) == ZERO
    with pytest.raises(DeviceError, match="did not write for 2 ms with a force on"):
        guardian.check()
    guardian.close()


def test_without_a_force_nobody_is_late_and_an_orderly_end_writes_nothing(
    board: tuple[int, int],
) -> None:
    reader, port = board
    guardian = Guardian(port, ZERO, timeout=0.001)
    guardian.beat(time.monotonic_ns() + 3_600_000_000_000)
    guardian.beat(0)
    guardian.close()
    with pytest.raises(BlockingIOError):
        os.read(reader, 100)


@pytest.mark.parametrize(
    ("number", "said"), [(signal.SIGKILL, "is gone"), (signal.SIGSTOP, "is silent")]
)
def test_a_guardian_that_is_gone_or_stopped_is_noticed_and_ended(
    board: tuple[int, int], number: signal.Signals, said: str
) -> None:
    guardian = Guardian(board[1], ZERO)
    os.kill(guardian.process_id, signal.SIGTERM)  # which it outlives
    guardian.check()
    os.kill(guardian.process_id, number)

    def is_noticed() -> bool:
        try:
            guardian.check()
        except GuardianError as error:
            return said in str(error)
        return False

    until(is_noticed, "the loss of the guardian")
    guardian.close()
    with pytest.raises(ProcessLookupError):
        os.kill(guardian.process_id, 0)


def test_the_rest_of_a_group_is_killed_even_if_it_is_stopped() -> None:
    starts = "import subprocess; print(subprocess.Popen(('sleep', '1000'), stdout=2).pid)"
    leader = subprocess.Popen(
        (sys.executable, "-c", starts), stdout=subprocess.PIPE, start_new_session=True
    )
    said, _ = leader.communicate()
    os.kill(int(said), signal.SIGSTOP)
    end_group(leader.pid, 0.0)

    def is_gone() -> bool:
        try:
            os.killpg(leader.pid, 0)
        except ProcessLookupError:
            return True
        return False

    until(is_gone, "the end of the group")
