"""Recorded delays, to be replayed on a link, and their files.

The file that forcebound writes has the header ``time_s,delay_s`` and a row for each packet that was
watched: when it was sent, strictly increasing, and how long it took, both in s. A packet without a
delay was lost. Only differences of times count: the trace begins with its first row.

Tables of others have other columns beside these, in ms (``time_ms``, ``delay_ms``), or those of
tshark. There a row without a delay is a packet of which nothing was measured; of packets captured
at the same time the last one counts. Files of numbers have no header (:func:`read_numbers`).
"""

import csv
import io
import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final, TypeAlias

from forcebound.errors import ConfigError
from forcebound.files import (
    MAX_TABLE,
    check_writable,
    open_file,
    read_rows,
    read_text,
    reason,
)

TABLE: Final = "table"  # format of a file whose header names its columns
MAHIMAHI: Final = "mahimahi"
HEADER = ("time_s", "delay_s")
#: Columns of a table, and what their unit is in s; those of tshark have a dot.
TIMES = {"time_s": 1.0, "time_ms": 1e-3, "frame.time_relative": 1.0, "frame.time_epoch": 1.0}
DELAYS = {"delay_s": 1.0, "delay_ms": 1e-3, "tcp.analysis.ack_rtt": 1.0, "icmp.resptime": 1e-3}
LONGEST = 80  # characters of a line in an error
LARGEST = 4e9  # s; a clock that counts from 1970 has 2e9, and differences in ns have 64 bits

_Row: TypeAlias = tuple[str, float, float | None]  # place, time and delay, in s; None: lost


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


class Opportunities(DelayTrace):
    """Times at which a packet can go, in ms from the start, never falling; then again from there.

    A packet waits for the next one. All that wait go then, however many: the queue of the recorded
    link, 1500 bytes for each time, is not replayed, and the newest of them counts.

    Raises:
        ConfigError: If there is no time above 0.

    Source: R. Netravali et al., Mahimahi: accurate record-and-replay for HTTP, USENIX ATC 2015;
    mm-link(1).
    """

    def __init__(self, times: Sequence[int]) -> None:
        if not times or times[-1] <= 0:
            raise ConfigError("expected a time above 0 ms at which a packet can go, got none")
        self._at_ns = [time * 1_000_000 for time in times]
        self.times, self.delays = tuple(time * 1e-3 for time in times), ()
        self.shortest = 0.0

    def delay_ns(self, since_ns: int) -> int:
        """Return how long what is sent ``since_ns`` ns after the first waits."""
        length_ns = self._at_ns[-1]
        at_ns = since_ns % length_ns or min(since_ns, length_ns)
        return self._at_ns[bisect_left(self._at_ns, at_ns)] - at_ns


def read_csv(file: Path) -> DelayTrace:
    """Return the trace in a table with a header; see the head of this module.

    Raises:
        ConfigError: If the file cannot be read or is no such trace; names the line.
    """
    rows = read_rows(file, "the trace", "\t;,")
    place, head = next(rows, (f"{file}:1", []))
    names = [cell.strip() for cell in head]
    found = [[name for name in names if name in known] for known in (TIMES, DELAYS)]
    if [len(one) for one in found] != [1, 1]:
        known = f"one of {', '.join(TIMES)}, and one of {', '.join(DELAYS)}"
        words = f"expected a header with {known}, got {','.join(head)[:LONGEST]!r}"
        hint = "a file of numbers without a header needs trace_format: s, ms or mahimahi"
        raise ConfigError(f"{place}: {words}", hint)
    (sent,), (took,) = found
    units, is_capture = (TIMES[sent], DELAYS[took]), "." in took

    def numbers() -> Iterator[_Row]:
        for place, row in rows:
            cells = [
                row[names.index(name)].strip() for name in (sent, took) if len(row) == len(names)
            ]
            if not is_capture or cells[1:] != [""]:
                yield place, *_numbers(place, cells, units, ",".join(row))

    return _trace(file, numbers(), is_capture)


def read_numbers(file: Path, form: str, interval: float) -> DelayTrace:
    """Return the trace in a file without a header: of numbers between spaces, ``,`` or ``;``.

    Args:
        file: Its empty lines, and those that begin with ``#``, are passed over.
        form: ``s`` or ``ms``: a delay in a line, or a time and a delay, in this unit; a delay that
            is ``nan``, ``-`` or empty is that of a lost packet. ``mahimahi``: a whole number of ms,
            see :class:`Opportunities`.
        interval: Between two delays without times, in s.

    Raises:
        ConfigError: If the file cannot be read or is no such trace; names the line.
    """
    if form == MAHIMAHI:
        return Opportunities(list(_opportunities(file)))
    return _trace(file, _rows(file, 1.0 if form == "s" else 1e-3, interval))


def _lines(file: Path) -> Iterator[tuple[str, str]]:
    """Yield the lines that say something, each with its place."""
    for number, line in enumerate(io.StringIO(read_text(file, "the trace", MAX_TABLE)), 1):
        if line.strip() and not line.startswith("#"):
            yield f"{file}:{number}", line.strip()


def _opportunities(file: Path) -> Iterator[int]:
    before = 0
    for place, line in _lines(file):
        if not (line.isascii() and line.isdigit() and int(line[:13]) * 1e-3 <= LARGEST):
            words = f"expected a whole number of ms, at most {LARGEST:g} s"
            raise ConfigError(f"{place}: {words}, got {line[:LONGEST]!r}")
        if int(line) < before:
            raise ConfigError(f"{place}: times must not fall: {line} ms after {before} ms")
        yield (before := int(line))


def _rows(file: Path, unit: float, interval: float) -> Iterator[_Row]:
    columns = 0
    for count, (place, line) in enumerate(_lines(file)):
        cells = [one.strip() for one in line.replace(";", ",").split(",")]
        if len(cells) == 1:
            cells = line.split()
        columns = columns or len(cells)
        if len(cells) != columns or columns > 2:
            words = f"expected {min(columns, 2)} numbers in a line, got {line[:LONGEST]!r}"
            raise ConfigError(f"{place}: {words}")
        lost = "" if cells[-1].lower() in ("nan", "-") else cells[-1]
        cells = [str(count) if columns == 1 else cells[0], lost]
        yield place, *_numbers(place, cells, (interval if columns == 1 else unit, unit), line)


def _numbers(
    place: str, cells: Sequence[str], units: tuple[float, float], row: str
) -> tuple[float, float | None]:
    """Return time and delay of a row, in s; ConfigError if they are none."""
    try:
        time, delay = (float(cell) if cell else None for cell in cells)
    except ValueError:
        time = delay = None
    if time is None:
        words = "expected a number for the time and for the delay (empty: lost)"
        raise ConfigError(f"{place}: {words}, got {row[:LONGEST]!r}")
    return time * units[0], None if delay is None else delay * units[1]


def _trace(file: Path, rows: Iterable[_Row], is_capture: bool = False) -> DelayTrace:
    """Return the trace of the rows; of a capture, the last one at each time counts."""
    times: list[float] = []
    delays: list[float | None] = []
    for place, time, delay in rows:
        if is_capture and times and time == times[-1]:
            delays[-1] = delay
            continue
        if fault := _fault(time, times[-1] if times else -math.inf, delay):
            raise ConfigError(f"{place}: {fault}")
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
