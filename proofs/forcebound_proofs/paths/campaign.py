"""Audit of certificates: devices that are as stated, or not, attacked along any path.

A *restart* draws a device and attacks it, at random or by a search. The name of a run is enough to
repeat it: ``CERTIFICATE:r3.17`` is run 17 of restart 3 of the random attack, ``s3.17`` of the
search; ``without_CERTIFICATE:...`` if the certificate's number was left out of what the law is
given.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import NamedTuple

import numpy as np

from forcebound.errors import ConfigError
from forcebound.haptics.laws import ENERGY_TOLERANCE, LAWS
from forcebound.lab.engine import Row
from forcebound.lab.views import groups, least, table, verdict
from forcebound.units import energy_in_words as energy
from forcebound_proofs.paths.certificates import CERTIFICATES, draw
from forcebound_proofs.paths.draft import Random
from forcebound_proofs.paths.run import Vector
from forcebound_proofs.paths.search import Restart
from forcebound_proofs.paths.transfer import TRANSFER, two_hands

OF_RESTART = {"r": 100, "s": 500}  # runs
RESTARTS_LEFT_OUT = 4  # searches with the number left out
WITHOUT = "without_"
LOWEST = "margin_min_j"


class PathCase(NamedTuple):
    """One restart; its fields but the law and the number of runs seed it."""

    certificate: str
    law: str
    left_out: bool
    kind: str  # "r": at random, "s": a search
    seed: int
    runs: int

    def restart(self) -> Restart:
        """Run it."""
        words = [ord(letter) for letter in self.kind + self.certificate]
        random = np.random.default_rng([self.seed, int(self.left_out), *words])
        found = drawn(self.certificate, self.law, random, self.left_out)
        (found.at_random if self.kind == "r" else found.search)(random, self.runs)
        return found

    def rows(self) -> list[Row]:
        """Run it; return one row for all its runs."""
        found = self.restart()
        assert found.worst is not None
        prefix = WITHOUT if self.left_out else ""
        name = f"{prefix}{self.certificate}:{self.kind}{self.seed}.{found.worst.number}"
        return [
            {
                **self._asdict(),
                "samples": found.samples,
                LOWEST: found.worst.result.worst,
                "case": name,
                "is_tight": found.is_tight,
            }
        ]


def drawn(certificate: str, law: str, random: Random, left_out: bool = False) -> Restart:
    """Return a restart on a random device, or on two, that has not begun."""
    if certificate == TRANSFER:
        return two_hands(law, random, left_out)
    return Restart(draw(certificate, law, random, left_out))


def cases(
    laws: Sequence[str], certificates: Sequence[str], runs: int, searched: int, seed: int = 1
) -> list[PathCase]:
    """Return the restarts of an audit.

    Args:
        laws: Certified laws, keys of :data:`forcebound.haptics.laws.LAWS`.
        certificates: Keys of :data:`.CERTIFICATES`.
        runs: Random runs of each law with each certificate.
        searched: Runs of each in searches; where a number can be left out, at most as many without.
        seed: Of the first restart of each kind.

    Raises:
        ConfigError: If a law is not certified or a certificate is not known.
    """
    for law in laws:
        if law not in LAWS or not LAWS[law].is_certified:
            raise ConfigError(f"only a certified law has certificates, got {law!r}")
    found = []
    for name in certificates:
        _check(name)
        for law in laws:
            for kind, number in (("r", runs), ("s", searched)):
                size = OF_RESTART[kind]
                for first in range(0, number, size):
                    case = (name, law, False, kind, seed + first // size, min(size, number - first))
                    found.append(PathCase(*case))
            if CERTIFICATES[name].left_out:
                share = min(searched, OF_RESTART["s"] * RESTARTS_LEFT_OUT) // RESTARTS_LEFT_OUT
                restarts = RESTARTS_LEFT_OUT if share else 0
                found += [PathCase(name, law, True, "s", seed + n, share) for n in range(restarts)]
    return found


def _check(name: str) -> None:
    if name not in CERTIFICATES:
        raise ConfigError(f"no certificate {name!r}; known are {', '.join(CERTIFICATES)}")


def replay(law: str, name: str) -> tuple[Row, list[Vector]]:
    """Repeat a run by its name; return it ready for JSON, and its trace.

    Raises:
        ConfigError: If it is not the name of a run.
    """
    title, _, rest = name.partition(":")
    left_out = title.startswith(WITHOUT)
    title = title.removeprefix(WITHOUT)
    _check(title)
    numbers = re.fullmatch(r"([rs])(\d{1,9})\.(\d{1,6})", rest)
    if numbers is None:
        raise ConfigError(f"expected a run such as {title}:s3.17, got {name!r}")
    kind, seed, number = numbers[1], int(numbers[2]), int(numbers[3])
    found = PathCase(title, law, left_out, kind, seed, number + 1).restart()
    assert found.last is not None
    trace: list[Vector] = []
    result = found.run(found.last.program, found.last.vector, trace)
    stated = {key: one for key, one in asdict(found.case.stated).items() if one}
    case = {"name": name, "summary": CERTIFICATES[title].summary, **stated}
    return {"law": law, "case": case, LOWEST: result.worst, **result._asdict()}, trace


def summary(rows: Sequence[Row]) -> list[Row]:
    """Return the worst of each certificate and law, ready for JSON.

    Each has ``certificate``, ``summary``, ``law``, ``holds``, ``runs``, ``samples``,
    ``margin_min_j`` (the lowest energy, of late holds that above the allowance, or the least truth
    above the estimate of the law) and its ``case``, ``searches`` and ``tight``: how many of them
    came back to zero; and ``without``: the same with the number left out, or None.
    """
    found = []
    for (certificate, law), own in groups(rows, "certificate", "law").items():
        stated = [row for row in own if not row["left_out"]]
        without = [row for row in own if row["left_out"]]
        numbers = _numbers(stated)
        found.append(
            {
                "certificate": certificate,
                "summary": CERTIFICATES[certificate].summary,
                "law": law,
                "holds": numbers[LOWEST] >= -ENERGY_TOLERANCE,
                **numbers,
                "without": _numbers(without) if without else None,
            }
        )
    return found


def _numbers(rows: Sequence[Row]) -> Row:
    lowest = least(rows, LOWEST)
    searches = [row for row in rows if row["kind"] == "s"]
    return {
        "runs": sum(row["runs"] for row in rows),
        "samples": sum(row["samples"] for row in rows),
        LOWEST: lowest[LOWEST],
        "case": lowest["case"],
        "searches": len(searches),
        "tight": sum(row["is_tight"] for row in searches),
    }


INTRODUCTION = """\
## The certificates along any path

What [a device may do](assumptions.md) besides dissipating, and what the law must be informed of.
The tip, or the joints, go along a path that is chosen freely, without inertia, so whatever a hand
could do, some path does; the energy is known in closed form, from a ground truth that shares
nothing with the simulated devices. The law is the live bounder.
[audit-method.md](audit-method.md) describes the attack, and what it rests on.

*Lowest energy*: the worst end of every hold included; of late holds, above the allowance. *Tight*:
searches that come back to within 1e-6 J of zero after at least 0.1 mJ. *Left out*: the lowest
energy if the certificate's own number is stated as if the device did not have the effect.
"""


def section(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the section of a page; ``rows`` as of :func:`summary`."""
    yield INTRODUCTION
    yield from worst(rows)
    yield ""


def worst(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a table of the worst run of each certificate and law."""
    heads = ("certificate", "law", "runs", "lowest energy", "case", "tight", "verdict")
    yield from table((*heads, "left out", "case"), map(_shown, rows))


def _shown(row: Row) -> tuple[str, ...]:
    without = row["without"] or {LOWEST: None, "case": ""}
    names = row["summary"], f"`{row['law']}`", f"{row['runs']:,}"
    tight = f"{row['tight']} of {row['searches']}", verdict(row[LOWEST])
    left_out = energy(without[LOWEST]), without["case"]
    return (*names, energy(row[LOWEST]), row["case"], *tight, *left_out)
