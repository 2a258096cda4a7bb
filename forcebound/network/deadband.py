"""A perceptual deadband: which packets of a link a hand could not feel, and need not be sent.

A packet is sent if what is felt of it, its force (of a device state or a query: its velocity), has
moved out of a sphere around that of the packet sent last, whose radius is a share k of it:

.. math:: |x - x_s| > k |x_s|

The receiver keeps what it got last. Of several axes it is one sphere, not an interval for each: a
small force across a large one is not felt, either. From rest, every motion is sent. After
``keep_alive`` a packet is sent in any case, so that its receiver knows that the sender lives, and
what a hand cannot feel at once does not add up for longer.

Source: P. Hinterseer, S. Hirche, S. Chaudhuri, E. Steinbach, M. Buss, Perception-based data
reduction and transmission of haptic data in telepresence and teleaction systems, IEEE Transactions
on Signal Processing 56(2), 2008. The keep-alive is ours.
"""

import math


class Deadband:
    """Of the packets of one link; ``share`` is k, ``keep_alive`` in s."""

    def __init__(self, share: float, keep_alive: float) -> None:
        self._share, self._keep_ns = share, round(keep_alive * 1e9)
        self._sent: tuple[float, ...] = ()  # what is felt of the last packet sent
        self._sent_ns = 0

    def saves(self, time_ns: int, packet: object) -> bool:
        """Return whether a packet at a time, in ns, need not be sent."""
        felt = getattr(packet, "velocity", None) or getattr(packet, "force", None)
        if felt is None:
            return False
        sent, is_due = self._sent, time_ns - self._sent_ns >= self._keep_ns
        if not is_due and len(sent) == len(felt):  # what is no number is sent, and rejected there
            moved = math.dist(felt, sent)
            if moved <= self._share * math.hypot(*sent):
                return True
        self._sent, self._sent_ns = felt, time_ns
        return False
