"""Audit of certificates: devices that are as stated, or not, attacked along any path.

Runs are named ``paths:CERTIFICATE:s3.17`` (:mod:`forcebound_proofs.paths.restarts`), or
``paths:without_CERTIFICATE:s3.17`` if the certificate's number was left out of what the law is
given.
"""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from forcebound.errors import ConfigError
from forcebound.haptics.laws import LAWS
from forcebound.lab.engine import Row
from forcebound.units import energy_in_words as energy
from forcebound_proofs.attack import (
    MARGIN,
    RANDOM,
    SEARCH,
    Budget,
    Names,
    Series,
    certified_laws,
    cut,
    is_stated,
    lowest,
)
from forcebound_proofs.paths.certificates import CERTIFICATES, draw
from forcebound_proofs.paths.draft import Random
from forcebound_proofs.paths.restarts import LETTERS, RestartAttack
from forcebound_proofs.paths.search import Restart
from forcebound_proofs.paths.transfer import TRANSFER, two_hands

LEFT_OUT_RESTARTS = 4  # searches with the number left out
WITHOUT = "without_"


def drawn(certificate: str, law: str, random: Random, left_out: bool = False) -> Restart:
    """Return a restart on a random device, or on two, that has not begun."""
    if certificate == TRANSFER:
        return two_hands(law, random, left_out)
    return Restart(draw(certificate, law, random, left_out))


class PathAttack(RestartAttack):
    """Certified laws along any path, with every certificate that a device may have."""

    name = "paths"
    sizes: ClassVar = {RANDOM: 100, SEARCH: 500}
    columns: ClassVar = {
        "certificate": lambda row: CERTIFICATES[row["target"]].summary,
        "law": None,
        "runs": None,
        "lowest energy": None,
        "case": None,
        "tight": lambda row: f"{row['tight']} of {row['searches']}",
        "verdict": None,
        "left out": lambda row: energy(row["without"] and row["without"][MARGIN]),
        "case left out": lambda row: row["without"]["case"] if row["without"] else "",
    }
    introduction = """\
## The certificates along any path

What [a device may do](../../docs/assumptions.md) besides dissipating, and what the law must be
informed of. The tip, or the joints, go along a path that is chosen freely, without inertia, so
whatever a hand could do, some path does; the energy is known in closed form, from a ground truth
that shares nothing with the simulated devices. The law is the live bounder.
[evidence.md](evidence.md#how-the-attacks-work) describes the attack, and what it rests on.

*Lowest energy*: the worst end of every hold included; of late holds, above the allowance. *Tight*:
searches that come back to within 1e-6 J of zero after at least 0.1 mJ. *Left out*: the lowest
energy if the certificate's own number is stated as if the device did not have the effect.
"""

    def series(self, laws: Names, targets: Names, budget: Budget) -> list[Series]:
        """Return what is to be run; where a number can be left out, some searches without it."""
        found, (runs, searched, seed) = [], budget
        laws = laws or certified_laws()
        for law in laws:
            if law not in LAWS or not LAWS[law].is_certified:
                raise ConfigError(f"only a certified law has certificates, got {law!r}")
        without = min(searched, self.sizes[SEARCH] * LEFT_OUT_RESTARTS)
        for name in targets or CERTIFICATES:
            self.check(name)
            for law in laws:
                found += self.restarts(law, name, RANDOM, runs, seed)
                found += self.restarts(law, name, SEARCH, searched, seed)
                if CERTIFICATES[name].left_out and without >= LEFT_OUT_RESTARTS:
                    share = without // LEFT_OUT_RESTARTS
                    every = (WITHOUT + name, SEARCH, seed, share * LEFT_OUT_RESTARTS)
                    found += cut(Series(self.name, law, *every), share)
        return found

    def check(self, target: str) -> None:
        """Check that there is such a certificate."""
        if target.removeprefix(WITHOUT) not in CERTIFICATES:
            known = ", ".join(CERTIFICATES)
            raise ConfigError(f"no certificate {target!r}; known are {known}")

    def begin(self, law: str, target: str, kind: str, seed: int) -> tuple[Restart, Random]:
        """Return a restart that has not begun, and its chance."""
        certificate, left_out = target.removeprefix(WITHOUT), target.startswith(WITHOUT)
        words = [ord(letter) for letter in LETTERS[kind] + certificate]
        random = np.random.default_rng([seed, int(left_out), *words])
        return drawn(certificate, law, random, left_out), random

    def labels(self, target: str) -> Row:
        """Return the certificate, and whether its number was left out."""
        return {"target": target.removeprefix(WITHOUT), "left_out": target.startswith(WITHOUT)}

    def further(self, rows: Sequence[Row]) -> Row:
        """Return how many searches came back to zero, and the lowest without the number."""
        searches = [row for row in rows if is_stated(row) and row["kind"] == SEARCH]
        without = [row for row in rows if not is_stated(row)]
        return {
            "searches": len(searches),
            "tight": sum(row["is_tight"] for row in searches),
            "without": lowest(without) if without else None,
        }
