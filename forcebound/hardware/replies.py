"""Replies of a board: how many, how many of them late, and the longest wait."""

import logging


class Replies:
    """Counts.

    Args:
        within: A reply later than this is late, in s.

    Attributes:
        count: Of the replies since the last :meth:`restart`.
        late: Of those that were late.
        longest_ns: That one of them took, in ns.
    """

    def __init__(self, within: float) -> None:
        self._late_ns = round(within * 1e9)
        self.restart()

    def restart(self) -> None:
        """Count from now on."""
        self.count = self.late = self.longest_ns = 0

    def note(self, took_ns: int) -> None:
        """Count one.

        Args:
            took_ns: From the message to its reply, in ns.
        """
        self.count += 1
        self.late += took_ns > self._late_ns
        self.longest_ns = max(self.longest_ns, took_ns)

    def log(self, logger: logging.Logger) -> None:
        """Say what has come, if anything has."""
        if self.count:
            share, limit = 100.0 * self.late / self.count, 1e-6 * self._late_ns
            message = "%d replies of the board, %.2f %% of them later than %.2g ms, the"
            message += " longest wait %.2g ms"
            logger.info(message, self.count, share, limit, 1e-6 * self.longest_ns)
