"""Why a hand at rest gets little force, as the page says it: the same for as long as it rests."""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from forcebound.messages.packets import EnvironmentReply, Telemetry
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.samples import Samples

#: Newest packets of a hand, oldest first.
Recent: TypeAlias = tuple[Sequence[Telemetry], Sequence[EnvironmentReply]]

REST = 1000  # samples in which a hand at rest stays where it is
STILL = 2e-4  # m; some steps of an encoder
SAME = 0.1  # of the share of the commanded force; a larger change has another cause
STAYS = 0.5  # a cause stays the first while it takes this much of what the first takes


class Reason:
    """The cause of little force of one hand, judged once it has come to rest.

    A twin of the last seconds takes a second of computation, so a share of the commanded force that
    has not changed has the cause that it had.
    """

    def __init__(self) -> None:
        self._share = 0.0
        self._code, self.text = "", ""

    def look(self, recent: Recent, run_of: Callable[[TelemetryColumns], Samples]) -> str:
        """Return the cause in words; empty: no force is lost, or the hand moves.

        Args:
            recent: Packets of the last seconds.
            run_of: Makes a run of their columns.
        """
        samples, replies = recent
        last = TelemetryColumns.from_packets(samples[-REST:])
        asked, given = (
            float(np.linalg.norm(one, axis=1).sum())
            for one in (last.commanded_force, last.applied_force)
        )
        if asked == 0.0 or np.ptp(last.position, axis=0).max() > STILL:
            self._share = 0.0
            return ""
        share = given / asked
        if abs(share - self._share) > SAME * self._share:
            run = run_of(TelemetryColumns.from_packets(samples, replies))
            causes = {cause.code: cause for cause in run.causes}
            first = max((float(one.data["takes"]) for one in causes.values()), default=0.0)
            kept = causes.get(self._code)
            if kept is None or float(kept.data["takes"]) < STAYS * first:
                kept = next(iter(causes.values()), None)
            self._share = share
            self._code, self.text = ("", "") if kept is None else (kept.code, kept.advice)
        return self.text
