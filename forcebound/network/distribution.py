"""Distributions of the deviation of a delay, by name or from a file.

The deviation is ``jitter * quantile(u)`` of a number ``u``, uniform in [0, 1). The quantiles are
those of the tables that tc loads (iproute2 ``netem/normal.c``, ``pareto.c``, ``paretonormal.c``),
without their 4096 steps and, as there, within 4:

``uniform``
    ``2 u - 1``: jitter is the largest deviation.
``normal``
    jitter is the standard deviation.
``pareto``
    ``4/3 (X - 3/2)``, ``X`` Pareto with shape 3 from 1: mean 0, from -2/3. tc scales by the
    variance 3/4, so the standard deviation is ``2 / sqrt(3)`` times the jitter before the cut.
``paretonormal``
    ``(normal + 3 pareto) / 4`` of the same ``u``.

A file is a table in the format of tc, as iproute2 has them (``netem/*.dist``): each of its entries
is as likely as the others. The kernel takes the entry ``number % size``; here it is
``floor(u * size)`` of the sorted ones, which is as likely and keeps the correlation.
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
    """Return the deviations that a table holds, each as likely as the others, in ascending order.

    The file holds whole numbers between white space, of which 8192 are one jitter; what follows a
    ``#`` in a line is a comment.

    Returns:
        Deviations, in jitters, within 4; 1 to 16384 of them.

    Raises:
        ConfigError: If the file cannot be read or is not such a table; names the line.

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
