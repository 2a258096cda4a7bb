"""A hand that follows a recorded path."""

from bisect import bisect_right
from dataclasses import dataclass, field
from pathlib import Path

from forcebound.errors import ConfigError
from forcebound.files import RECORDING_SUFFIX
from forcebound.messages.packets import MAX_AXES, Vector
from forcebound.operators.grip import SoftGrip
from forcebound.operators.path_file import read_numbers
from forcebound.operators.recorded_path import read_recording


@dataclass(frozen=True)
class TrajectoryHand(SoftGrip):
    """Mass, spring and damper whose target follows a CSV file, or the hand in a recording.

    A CSV file has a header line; its first column is the time in s, strictly increasing, the others
    (1 to 6) are the target's position in m, one per axis. Between two lines the target moves in a
    straight line; before the first and after the last it rests. Of a recording (``.mcap``), it is
    where the hand wanted to be, as far as that is known, else where the device was
    (docs/recordings.md).

    Raises:
        ConfigError: If the file cannot be read or is neither; of a table it names the line.
    """

    file: Path
    _times: tuple[float, ...] = field(init=False, repr=False, compare=False)
    _positions: tuple[Vector, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            is_recording = Path(self.file).suffix == RECORDING_SUFFIX
            read = read_recording if is_recording else _read_path
            times, positions = read(Path(self.file))
        except ConfigError as error:
            raise ConfigError(str(error), field="file") from None
        object.__setattr__(self, "_times", times)
        object.__setattr__(self, "_positions", positions)

    def target(self, elapsed: float) -> Vector:
        """Return the target after ``elapsed`` s; see :class:`forcebound.operators.Operator`."""
        after = bisect_right(self._times, elapsed)
        if after == 0:
            return self._positions[0]
        if after == len(self._times):
            return self._positions[-1]
        before = after - 1
        share = (elapsed - self._times[before]) / (self._times[after] - self._times[before])
        return tuple(
            a + share * (b - a)
            for a, b in zip(self._positions[before], self._positions[after], strict=True)
        )


def _read_path(file: Path) -> tuple[tuple[float, ...], tuple[Vector, ...]]:
    expected = "time in s, then 1 to 6 positions in m, after one header line"
    times: list[float] = []
    positions: list[Vector] = []
    for place, values in read_numbers(file, "the trajectory", expected, 2, 1 + MAX_AXES):
        if times and values[0] <= times[-1]:
            raise ConfigError(f"{place}: time must increase: {values[0]} after {times[-1]}")
        times.append(values[0])
        positions.append(tuple(values[1:]))
    return tuple(times), tuple(positions)
