"""Reads tables of delays in the format of tc, as iproute2 brings them (``netem/*.dist``)."""

from pathlib import Path

from forcebound.errors import ConfigError
from forcebound.files import reason

SCALE = 8192  # of an entry is one jitter: NETEM_DIST_SCALE, <linux/pkt_sched.h>
LONGEST = 16_384  # entries: NETEM_DIST_MAX, <linux/pkt_sched.h>
SMALLEST, LARGEST = -32_768, 32_767  # an entry has 16 bits


def read_distribution(file: Path) -> tuple[float, ...]:
    """Return the deviations that a table holds, each as likely as the others, in ascending order.

    The file holds whole numbers between white space, of which 8192 are one jitter; what follows a
    ``#`` in a line is a comment.

    Returns:
        Deviations, in jitters, within 4; 1 to 16384 of them.

    Raises:
        ConfigError: If the file cannot be read or is not such a table; names the line.

    Source: iproute2 tc/q_netem.c (get_distribution), Linux net/sched/sch_netem.c (tabledist).
    """
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"cannot read the table of a distribution {file}: {reason(error)}"
        ) from error
    entries: list[int] = []
    for number, line in enumerate(text.splitlines(), start=1):
        for word in line.partition("#")[0].split():
            entries.append(_entry(word, f"{file}:{number}"))
    if not 1 <= len(entries) <= LONGEST:
        raise ConfigError(f"{file}: expected 1 to {LONGEST} whole numbers, got {len(entries)}")
    return tuple(entry / SCALE for entry in sorted(entries))


def _entry(word: str, place: str) -> int:
    try:
        entry = int(word, 0)  # so 010, which is 8 for tc, is refused and not read as 10
    except ValueError:
        entry = None
    if entry is None or not SMALLEST <= entry <= LARGEST:
        raise ConfigError(
            f"{place}: expected whole numbers, {SMALLEST} to {LARGEST}, of which {SCALE} are one"
            f" jitter (the format of tc's .dist files), got {word!r}"
        )
    return entry
