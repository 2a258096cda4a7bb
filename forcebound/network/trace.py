"""Recorded delays, to be replayed on a link, and their CSV file.

The file has the header ``time_s,delay_s`` and a row for each packet that was watched: when it was
sent, strictly increasing, and how long it took, both in s. A packet without a delay was lost. Only
differences of times count: the trace begins with its first row.
"""

import csv
import math
from bisect import bisect_right
from collections.abc import Sequence
from pathlib import Path

from forcebound.errors import ConfigError
from forcebound.files import check_writable, open_file, read_rows, reason

HEADER = ("time_s", "delay_s")
LONGEST = 80  # characters of a header in an error
LARGEST = 4e9  # s; a clock that counts from 1970 has 2e9, and differences in ns have 64 bits


class DelayTrace:
    """Delays (s, at least 0; None: lost) over time (s, increasing), again and again from the start.

    Each row holds from its time until the next row; the last one for as long as the row before it.
    A single row holds for ever.

    Raises:
        ConfigError: If that is not what they are, or two times are less than 1 ns apart.
    """

    def __init__(self, times: Sequence[float], delays: Sequence[float | None]) -> None:
        if not times or len(times) != len(delays):
            raise ConfigError(
                f"a trace needs as many delays as times, got {len(delays)} and {len(times)}"
            )
        for time, before, delay in zip(times, (-math.inf, *times), delays, strict=False):
            if fault := _fault(time, before, delay):
                raise ConfigError(fault)
        self.times = tuple(times)
        self.delays = tuple(delays)
        # s; 0 if all is lost
        self.shortest = min((delay for delay in delays if delay is not None), default=0.0)
        self._times_ns = [round((time - times[0]) * 1e9) for time in times]
        self._delays_ns = [None if delay is None else round(delay * 1e9) for delay in delays]
        last_ns = self._times_ns[-2:]
        self._length_ns = 2 * last_ns[-1] - last_ns[0] or 1

    def delay_ns(self, since_ns: int) -> int | None:
        """Return the delay of what is sent ``since_ns`` ns after the first; None if it is lost."""
        row = bisect_right(self._times_ns, since_ns % self._length_ns) - 1
        return self._delays_ns[row]

    def write(self, file: Path) -> None:
        """Write the file of the trace; ConfigError if it cannot be written."""
        try:
            with file.open("w", newline="", encoding="utf-8") as lines:
                writer = csv.writer(lines, lineterminator="\n")
                writer.writerow(HEADER)
                for time, delay in zip(self.times, self.delays, strict=True):
                    writer.writerow((f"{time:.9f}", "" if delay is None else f"{delay:.9f}"))
        except OSError as error:
            raise ConfigError(f"cannot write the trace {file}: {error.strerror}") from error


def check_output(file: Path) -> None:
    """Check before the work begins that a trace can be written to a file.

    ConfigError if it cannot, or if the file holds something else, which would be lost.
    """
    check_writable(file, "the trace")
    if not file.is_file() or not file.stat().st_size:
        return
    head = ",".join(HEADER).encode()
    try:
        with open_file(file) as before:
            is_trace = before.read(len(head)) == head
    except OSError as error:
        raise ConfigError(f"cannot read {file}: {reason(error)}") from error
    if not is_trace:
        raise ConfigError(f"{file} exists and is not a trace: choose another name")


def read_csv(file: Path) -> DelayTrace:
    """Return the trace in a CSV file; see the head of this module.

    Raises:
        ConfigError: If the file cannot be read or is no such trace; names the line.
    """
    rows = read_rows(file, "the trace")
    place, head = next(rows, (f"{file}:1", []))
    if tuple(cell.strip() for cell in head) != HEADER:
        words = f"expected the header {','.join(HEADER)}, got {','.join(head)[:LONGEST]!r}"
        raise ConfigError(f"{place}: {words}", "both are in s: divide ms by 1000")
    times: list[float] = []
    delays: list[float | None] = []
    for place, row in rows:
        try:
            time, delay = (float(cell) if cell.strip() else None for cell in row)
        except ValueError:
            time = delay = None
        before = times[-1] if times else -math.inf
        if time is None or (fault := _fault(time, before, delay)):
            words = f"expected a time in s and a delay in s (empty: lost), got {','.join(row)!r}"
            raise ConfigError(f"{place}: {words if time is None else fault}")
        times.append(time)
        delays.append(delay)
    if not times:
        raise ConfigError(f"{file}: expected a row for each packet, got none")
    return DelayTrace(times, delays)


def _fault(time: float, before: float, delay: float | None) -> str | None:
    """Return what is wrong with a row, all in s; None if nothing."""
    if delay is not None and math.isnan(delay):
        return f"expected a delay >= 0 s, or an empty cell for a lost packet; got {delay}"
    if not abs(time) <= LARGEST or not 0.0 <= (delay or 0.0) <= LARGEST:
        return f"expected a time and a delay >= 0 s, within {LARGEST:g} s; got {time}, {delay}"
    if (time - before) * 1e9 < 0.5:
        return f"times must increase, by 1 ns and more: {time} s after {before} s"
    return None
