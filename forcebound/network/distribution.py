"""Distributions of the deviation of a delay, by name or from a file (``docs/impairments.md``).

The deviation is ``jitter * quantile(u)`` of a number ``u``, uniform in [0, 1). The quantiles are
those of the tables that tc loads (iproute2 ``netem/*.c``), without their 4096 steps and, as there,
within 4. A file is such a table, each of its entries as likely as the others.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import NormalDist

from forcebound.errors import ConfigError
from forcebound.files import read_text

SCALE = 8192  # of an entry is one jitter: NETEM_DIST_SCALE, <linux/pkt_sched.h>
LONGEST = 16_384  # entries: NETEM_DIST_MAX, <linux/pkt_sched.h>
MAX_BYTES = 1_000_000  # of a table; the longest of tc's has 100 kB with its comments
_NORMAL = NormalDist()
_LARGEST = 4.0  # jitters: an entry of a table has 16 bits, of which 8192 are one jitter


def _uniform(u: float) -> float:
    return 2.0 * u - 1.0


def _normal(u: float) -> float:
    return max(-_LARGEST, min(_NORMAL.inv_cdf(u), _LARGEST)) if 0.0 < u < 1.0 else -_LARGEST


def _pareto(u: float) -> float:
    return float(min(4.0 / 3.0 * ((1.0 - u) ** (-1.0 / 3.0) - 1.5), _LARGEST))


def _paretonormal(u: float) -> float:
    return (_normal(u) + 3.0 * _pareto(u)) / 4.0


QUANTILES: Mapping[str, Callable[[float], float]] = {
    "uniform": _uniform,
    "normal": _normal,
    "pareto": _pareto,
    "paretonormal": _paretonormal,
}


def read_distribution(file: Path) -> tuple[float, ...]:
    """Return the 1 to 16384 deviations that a table holds, in jitters, in ascending order.

    The file holds whole numbers between white space, of which 8192 are one jitter; what follows a
    ``#`` in a line is a comment. ConfigError, which names the line, for another file.

    Source: iproute2 tc/q_netem.c (get_distribution), Linux net/sched/sch_netem.c (tabledist).
    """
    text = read_text(file, "the table of a distribution", MAX_BYTES)
    entries: list[int] = []
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            entries += [int(word, 0) for word in line.partition("#")[0].split()]
        except ValueError:
            raise ConfigError(
                f"{file}:{number}: expected whole numbers, of which {SCALE} are one jitter (the"
                " format of tc's .dist files)"
            ) from None
    if not 1 <= len(entries) <= LONGEST:
        raise ConfigError(f"{file}: expected 1 to {LONGEST} whole numbers, got {len(entries)}")
    return tuple(entry / SCALE for entry in sorted(entries))
