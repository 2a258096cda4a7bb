"""Attack on two hands whose ledgers exchange energy over a bad link.

Each hand goes along a path of its own, as in every attack here, on a device of its own. The link
loses, delays, doubles and reorders packets; ledgers and processes begin again at any time. A ledger
gives what the device node would let it give, or all it has, or any part of that.
"""

import math
import zlib
from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import ClassVar

import numpy as np

from forcebound.haptics.laws import ForceBounder
from forcebound.messages.packets import EnergyTransfer
from forcebound.nodes.energy_exchange import EnergyExchange
from forcebound_proofs.cases import LEAST_PEAK
from forcebound_proofs.paths.certificates import draw
from forcebound_proofs.paths.draft import Random, log_between
from forcebound_proofs.paths.run import AttackedDevice, PathResult, Vector, Walk
from forcebound_proofs.paths.search import Program, Restart
from forcebound_proofs.paths.truth import Floats

TRANSFER = "energy_transfer"  # the certificate


class Forgetful(EnergyExchange):
    """Left out: credits the whole of a total, not what it has grown by."""

    def take(self, packet: EnergyTransfer) -> None:
        """Take in a packet."""
        self._seen = 0.0
        super().take(packet)


class Side:
    """One hand's side of an exchange, and its end of the link."""

    def __init__(
        self, case: AttackedDevice, samples: int, random: Random, kind: type[EnergyExchange]
    ) -> None:
        self._random, self._kind = random, kind
        self._exchange = kind("")
        self._exchange.begin()
        self._loss, self._doubles = random.choice([0.0, 0.0, 0.3, 0.8], 2)
        self._delay = 1e9 * random.choice([0.0, log_between(random, 1e-5, 1e-2)])  # ns, on average
        self._manner = int(random.integers(3))  # of giving: as in the node, any part, everything
        # A ledger begins without force; with a lag or a late write there would be some left.
        is_quiet = case.stated.lag == case.stated.write_delay == 0.0
        often = random.choice([0.0, 0.1]) if is_quiet else 0.0
        self._begins = (random.random(samples + 2) < often).tolist()
        self._arrivals: list[tuple[float, int, EnergyTransfer]] = []
        self._sent = 0
        self.other = self
        self.given = self.received = 0.0  # J

    def begins(self, index: int, time_ns: int) -> bool:
        """Begin another ledger now and then, with or without its process."""
        if not self._begins[index]:
            return False
        if self._random.random() < 0.5:  # its process, too
            self._exchange = self._kind("", time_ns)  # after the number of any earlier ledger
        self._exchange.begin()
        return True

    def ends(self, index: int) -> bool:
        """Look whether one begins after the interval."""
        return bool(self._begins[index + 1])

    def credit(self, bounder: ForceBounder, time_ns: int) -> float:
        """Credit what has come through the link."""
        while self._arrivals and self._arrivals[0][0] <= time_ns:
            self._exchange.take(heappop(self._arrivals)[2])
        amount = self._exchange.credit()
        bounder.credit(amount)
        self.received += amount
        return amount

    def debit(self, bounder: ForceBounder, time_ns: int, commanded: Vector) -> float:
        """Give, and say so."""
        exchange = self._exchange
        most = exchange.offer(bounder.spare(commanded))
        if self._manner > 0:
            most = math.inf if self._manner == 2 else self._random.exponential(1e-3)
        taken = bounder.debit(most)
        exchange.give(taken)
        self.given += taken
        self.other.receive(exchange.packet(time_ns))
        return taken

    def receive(self, packet: EnergyTransfer) -> None:
        """Put a packet on the way, perhaps twice, perhaps not at all."""
        for _ in range(1 + (self._random.random() < self._doubles)):
            if self._random.random() >= self._loss:
                self._sent += 1
                after_ns = packet.time_ns + self._random.exponential(self._delay)
                heappush(self._arrivals, (after_ns, self._sent, packet))


@dataclass
class TwoHands(Restart):
    """What one restart has found on two devices: of each and, of their energy, the sum."""

    hands: ClassVar[int] = 2
    other: AttackedDevice = field(kw_only=True)
    kind: type[EnergyExchange] = field(kw_only=True)

    def __post_init__(self) -> None:
        cases = self.case, self.other
        self._cases = cases
        self._bounders = [ForceBounder(c.law, c.stated, c.axes, exchanges=True) for c in cases]

    def run(
        self, program: Program, vector: Floats, trace: list[Vector] | None = None
    ) -> PathResult:
        """Run once; ``trace`` gets the first hand."""
        random = np.random.default_rng(zlib.crc32(repr(program).encode()))  # the same in a search
        samples = len(program.order)
        sides = [Side(case, samples, random, self.kind) for case in self._cases]
        sides[0].other, sides[1].other = sides[1], sides[0]
        walks = []
        for hand, (case, bounder) in enumerate(zip(self._cases, self._bounders, strict=True)):
            genes, start = program.genes(vector, hand)
            traced = None if hand else trace
            walks.append(Walk(case, genes, bounder, start, traced, sides[hand]))
        done, lowest, energies = [0, 0], [math.inf] * 2, [0.0, 0.0]
        together, peak, share = 0.0, LEAST_PEAK, math.inf  # of the energies of both hands
        while min(done) < samples:
            ready = [hand for hand in (0, 1) if done[hand] < samples]
            hand = min(ready, key=lambda one: walks[one].time_ns)
            account = walks[hand].account
            account.lowest_end = account.lowest = math.inf
            walks[hand].step(done[hand])
            done[hand] += 1
            low = float(min(account.lowest_end, account.lowest))
            lowest[hand] = min(lowest[hand], low)
            energies[hand] = low - sides[hand].received + sides[hand].given
            together = min(together, sum(energies))
            if peak > LEAST_PEAK:
                share = min(share, sum(energies) / peak)
            peak = max(peak, sum(energies))
        for walk, low in zip(walks, lowest, strict=True):
            walk.account.lowest = low
        one, other = (walk.result() for walk in walks)
        highest = max(one.peak_j, other.peak_j)
        # A path of kilometres has energies, up to 1e12 J, whose sums are rounded by more than 1 nJ.
        return PathResult(
            min(one.lowest_j, other.lowest_j, together) + math.ulp(highest),
            math.inf,
            highest,
            min(one.share_left, other.share_left, share),
            min(one.left_j, other.left_j),
            max(one.excess_j, other.excess_j),
            one.samples + other.samples,
        )


def two_hands(law: str, random: Random, left_out: bool) -> TwoHands:
    """Return two random devices, strictly certified, whose ledgers exchange energy."""
    cases = [_drawn(law, random) for _ in range(2)]
    return TwoHands(cases[0], other=cases[1], kind=Forgetful if left_out else EnergyExchange)


def _drawn(law: str, random: Random) -> AttackedDevice:
    while True:
        case = draw("all" if random.random() < 0.7 else "plain", law, random)
        # Others get energy from late holds or from a weight, or start where it is not at rest.
        if not (case.ledger_only or case.late or case.stated.weight):
            return case
