"""A board, its mechanism and its faults, over time; without a clock or a port."""

from collections import deque
from typing import NamedTuple

from forcebound.devices.truth_file import NOT_YET, TruthFile
from forcebound.emulators.board import Board
from forcebound.emulators.faults import Faults
from forcebound.emulators.mechanism import Mechanism


class Emulated(NamedTuple):
    """What a kind of emulator is made of."""

    board: Board
    mechanism: Mechanism


class Emulation:
    """What happens at the far end of a serial line.

    Args:
        emulated: Board and mechanism.
        faults: What goes wrong.
        truth: Where the ground truth goes.
        latency: From the bytes to the reply, beyond that of the pseudo-terminal, in s.

    Attributes:
        replies: Number of replies so far.
        lowest_energy: Least ground-truth energy so far, in J.
        longest_hold: Longest time so far that a torque was on and no bytes came, in s.
    """

    def __init__(
        self, emulated: Emulated, faults: Faults, truth: TruthFile, latency: float = 0.0
    ) -> None:
        self._board, self._mechanism = emulated
        self._faults = faults
        self._truth = truth
        self._latency_ns = round(1e9 * latency)
        self._unread = b""
        self._waiting: deque[tuple[int, bytes]] = deque()  # replies, and when they are due
        self._is_used = False
        self.replies = 0
        self.lowest_energy = 0.0
        self.longest_hold = 0.0
        self._heard_ns = 0

    @property
    def wake_ns(self) -> int | None:
        """When the board has something to do by itself, in ns."""
        if self._waiting and self._board.wake_ns is None:
            return self._waiting[0][0]
        return self._board.wake_ns

    def start(self, time_ns: int) -> None:
        """Begin at this time: the mechanism at rest in the pose of the set-up."""
        self._mechanism.start(time_ns)
        self.settle(time_ns)

    def is_unplugged(self, time_ns: int) -> bool:
        """Return whether the port is to go away."""
        return self._faults.is_on("unplug", time_ns)

    def step(self, data: bytes, time_ns: int) -> bytes:
        """Move on, take bytes that have come together, return what comes from the board.

        Raises:
            DeviceError: If the hand has moved the tip to where the arm cannot be held.
        """
        self._mechanism.advance(time_ns)
        if any(self._mechanism.torque):
            self.longest_hold = max(self.longest_hold, (time_ns - self._heard_ns) * 1e-9)
        if data:
            self._heard_ns = time_ns
            data = self._faults.lose(data, time_ns)
        self._unread += data
        if self._faults.is_on("stall", time_ns):
            return b""
        board = self._board
        board.angles = self._mechanism.angles
        if self._faults.is_on("reset", time_ns):
            board.reset()
        reply = board.receive(self._unread, time_ns)
        self._unread = b""
        sign = -1.0 if self._faults.is_on("reversed", time_ns) else 1.0
        self._mechanism.hold(time_ns, tuple([sign * torque for torque in board.torque]))
        if reply:
            self.replies += 1
            self._is_used = True
            self._faults.begin(time_ns)
            spoiled = self._faults.spoil(reply, board, time_ns)
            self._waiting.append((time_ns + self._latency_ns, spoiled))
        due = b""
        while self._waiting and self._waiting[0][0] <= time_ns:
            due += self._waiting.popleft()[1]
        return due

    def settle(self, time_ns: int) -> None:
        """Move the hand as its time has come, and publish the ground truth."""
        if self._is_used:
            self._mechanism.use(time_ns, may_move=self._truth.engaged_ns != NOT_YET)
        truth = self._mechanism.truth()
        self.lowest_energy = min(self.lowest_energy, truth.energy)
        self._truth.write(time_ns, truth, self._mechanism.torque, self._mechanism.torque_ns)

    def release(self, time_ns: int) -> None:
        """Nobody has the port any more: the hand brings the tip back to the set-up's pose."""
        if self._is_used:
            self._is_used = False
            self._truth.forget()
            self._mechanism.hold_home(time_ns)
