"""The wall clock of a live recording, to join it with cameras and other machines.

Packets have the monotonic clock of their machine. The recorder reads both clocks at the beginning
and at the end of a recording: ten readings of UTC, each between two of the monotonic clock, of
which that with the shortest time between counts; so the offset is right within that time, a
microsecond as a rule. In between it goes evenly from one to the other.
"""

from contextlib import suppress
from typing import TYPE_CHECKING, TypeVar, cast

import numpy as np
from mcap.records import Metadata
from numpy.typing import NDArray

from forcebound import mcap_file
from forcebound.errors import ConfigError

if TYPE_CHECKING:
    from forcebound.recordings.recording import Recording

#: Keys of the metadata of a live recording: UTC less the monotonic clock, in ns, and when that was.
UTC_OFFSET, UTC_OFFSET_AT = "utc_offset_ns", "utc_offset_at_ns"
CLOCK_END = "forcebound.clock_end"  # metadata record with the same at the end of the recording

Times = TypeVar("Times", int, NDArray[np.int64])


def utc_ns(recording: "Recording", time_ns: Times) -> Times:
    """Return the wall clock, in ns since 1970 (UTC), at a ``time_ns`` of packets, or at many.

    Of a recording without an end, the offset of its beginning holds.

    Raises:
        ConfigError: If it has none, as one in virtual time.
    """
    if UTC_OFFSET not in recording.metadata:
        raise ConfigError(f"{recording.path} has no wall clock: it was not recorded live")
    begin = end = recording.metadata
    with suppress(mcap_file.DamagedError):
        for content in mcap_file.contents(recording.path, ()):
            if isinstance(content, Metadata) and content.name == CLOCK_END:
                end = content.metadata
    (first, offset), (last, offset_end) = (
        (int(of[UTC_OFFSET_AT]), int(of[UTC_OFFSET])) for of in (begin, end)
    )
    drift = (offset_end - offset) / max(last - first, 1)  # ns per ns
    more = np.rint((time_ns - first) * drift).astype(np.int64)  # a float has no room for the sum
    return cast(Times, time_ns + offset + more)
