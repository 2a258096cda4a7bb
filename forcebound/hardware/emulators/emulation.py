"""A board, its mechanism and its faults, over time; without a clock or a port."""

from typing import Protocol

from forcebound.haptics.devices.truth_file import NOT_YET, TruthFile
from forcebound.hardware.emulators.faults import Faults
from forcebound.hardware.emulators.mechanism import Mechanism
from forcebound.messages.packets import Vector


class Board(Protocol):
    """The firmware of a board: bytes and angles in, bytes and torques out.

    It has no clock: times are given to it, and never run backwards.

    Attributes:
        angles: Of the motors' shafts now, in rad; set before each :meth:`receive`.
        torque: What the motors give now, in N m, positive towards larger angles.
        wake_ns: When it has something to do by itself, in ns, such as to end a wait; None: never.
    """

    angles: Vector
    torque: Vector
    wake_ns: int | None

    def receive(self, data: bytes, time_ns: int) -> bytes:
        """Take bytes that have come together; return what the board sends now.

        It is called without bytes when ``wake_ns`` has come, and every millisecond or so.
        """
        ...

    def reset(self) -> None:
        """Forget what was set up: a fault on demand."""
        ...

    def with_nan(self, reply: bytes) -> bytes:
        """Return a reply in which every reading is not a number: a fault on demand."""
        ...


class Emulation:
    """The far end of a serial line.

    Attributes:
        replies: Number of replies so far.
        lowest_energy: Least ground-truth energy so far, in J.
        longest_hold: Longest time so far that a torque was on and no bytes came, in s.
    """

    def __init__(
        self,
        board: Board,
        mechanism: Mechanism,
        faults: Faults,
        truth: TruthFile,
    ) -> None:
        self._board, self._mechanism = board, mechanism
        self._faults, self._truth = faults, truth
        self._unread = b""
        self._is_used = False
        self.replies = 0
        self.lowest_energy = self.longest_hold = 0.0
        self._heard_ns = 0

    @property
    def wake_ns(self) -> int | None:
        """When the board has something to do by itself, in ns."""
        return self._board.wake_ns

    def start(self, time_ns: int) -> None:
        """Begin at this time: the mechanism at rest in the pose of the set-up."""
        self._mechanism.start(time_ns)
        self.settle(time_ns)

    def is_unplugged(self, time_ns: int) -> bool:
        """Return whether the port is to go away."""
        return self._faults.is_on("unplug", time_ns)

    def step(self, data: bytes, time_ns: int) -> bytes:
        """Move on, take bytes that have come together, return what comes from the board."""
        board, mechanism, faults = self._board, self._mechanism, self._faults
        mechanism.advance(time_ns)
        if any(mechanism.torque):
            self.longest_hold = max(self.longest_hold, (time_ns - self._heard_ns) * 1e-9)
        if data:
            self._heard_ns = time_ns
            data = faults.lose(data, time_ns)
        self._unread += data
        if faults.is_on("stall", time_ns):
            return b""
        board.angles = mechanism.angles
        if faults.is_on("reset", time_ns):
            board.reset()
        reply = board.receive(self._unread, time_ns)
        self._unread = b""
        sign = -1.0 if faults.is_on("reversed", time_ns) else 1.0
        mechanism.hold(time_ns, tuple([sign * torque for torque in board.torque]))
        if reply:
            self.replies += 1
            self._is_used = True
            faults.begin(time_ns)
            if faults.is_on("nan", time_ns):
                reply = board.with_nan(reply)
            reply = faults.spoil(reply, time_ns)
        return reply

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
