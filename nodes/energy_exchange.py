"""Exchange of energy between the ledgers of two hands: the protocol, and how much is given.

Once a tick each device sends to the other one how much its ledger has given in all. The
receiver credits the growth of this total since the largest that it has seen. So nothing is credited
twice, whatever the network does; ``docs/theory.md``, section 3.7, has the proof.

A new ledger begins when the force engages, when the law changes and when the process starts again;
each has a number that no other one has, larger than that of the one before unless a clock was set
back. The first total that is seen of a ledger is credited to nobody, because an earlier process of
the receiver may have credited it already. For the same reason a packet counts only if its sender
has heard of a ledger of this very process of the receiver. And a ledger gives nothing until the
other side has reported a first total of it.

How much is given is no part of the proof. Half of the difference makes both sides even at once;
what is still on its way counts as the receiver's, so that a delay makes nothing overshoot, and
energy that is not needed does not travel.
"""

from forcebound.haptics.laws.exchange import whole_grains
from forcebound.messages.packets import EnergyTransfer


class EnergyExchange:
    """One hand's side of an exchange.

    Its ledgers have the numbers after ``process``, which no other process has. It receives at most
    ``limit`` J beyond what it has given, and the rest waits; None: all.

    Attributes:
        given: J, that left the ledgers of this hand, in all.
        received: J, that was credited to them, in all.
    """

    def __init__(self, hand: str, process: int = 0, limit: float | None = None) -> None:
        self._hand = hand
        self._process, self._limit = process, limit
        self._seq = 0
        self._ledger = 0  # number; 0: none has begun
        self._given_before = 0.0  # J, by earlier ledgers
        self._spare = 0.0  # J
        self._seen_ledger = 0  # of the other side
        self._seen: float | None = None  # J, largest total of it
        self._waiting = 0.0  # J, to be credited
        self._newest: EnergyTransfer | None = None  # packet of the other side
        self.given = self.received = 0.0

    def begin(self) -> None:
        """Let a new ledger begin."""
        self._ledger = (self._ledger or self._process) + 1
        self._given_before, self._spare = self.given, 0.0

    def take(self, packet: EnergyTransfer) -> None:
        """Take in a packet of the other side, however late, or once more."""
        newest = self._newest
        if newest is None or (packet.ledger, packet.seq) > (newest.ledger, newest.seq):
            self._newest = packet
        if self._ledger == 0:
            return  # this ledger begins later, and so does what counts for it
        if packet.ledger > self._seen_ledger:
            self._seen_ledger, self._seen = packet.ledger, None
        if packet.ledger < self._seen_ledger:
            return
        if not self._process < packet.seen_ledger <= self._ledger:
            return  # its sender had not heard of this process
        if self._seen is None:
            self._seen = packet.given
        elif packet.given > self._seen:
            self._waiting += packet.given - self._seen
            self._seen = packet.given

    def credit(self) -> float:
        """Return what has come and was not credited yet, in J; it counts as credited."""
        credit = self._waiting
        if self._limit is not None:
            credit = whole_grains(min(credit, self.given + self._limit - self.received))
        self._waiting -= credit
        self.received += credit
        return credit

    def offer(self, spare: float) -> float:
        """Return how much to give, in J, if this ledger has so much to ``spare``."""
        self._spare, newest = spare, self._newest
        if newest is None or newest.seen is None or newest.seen_ledger != self._ledger:
            return 0.0
        on_its_way = self.given - self._given_before - newest.seen
        return 0.5 * (spare - newest.spare - on_its_way)

    def give(self, amount: float) -> None:
        """Count what has left the ledger, in J."""
        self.given += amount
        self._spare -= amount

    def packet(self, time_ns: int) -> EnergyTransfer:
        """Return the packet of this tick."""
        self._seq += 1
        return EnergyTransfer(
            self._seq - 1,
            time_ns,
            self._ledger,
            self.given - self._given_before,
            self._spare,
            self._seen_ledger,
            self._seen,
            hand=self._hand,
        )
