"""Why a hand gets little force, as the page says it: the first cause that the verdict would name.

It is the same for as long as a contact lasts and gets the same share of its force.
"""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from forcebound.messages.packets import EnvironmentReply, Telemetry
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.little_force import WHOLE, takes
from forcebound.results.samples import Samples

#: Newest packets of a hand, oldest first.
Recent: TypeAlias = tuple[Sequence[Telemetry], Sequence[EnvironmentReply]]

REST = 1000  # samples in which a hand at rest stays where it is
STILL = 2e-4  # m; some steps of an encoder
SAME = 0.1  # of the share of the commanded force; a larger change has another cause
STAYS = 0.5  # a cause stays the first while it takes this much of what the first takes
HELD_NS = 5_000_000_000  # for which a cause is said, at least: nobody reads faster
BOUNCE_NS = 250_000_000  # without a force, that a hand which bounces may be in the air


class Reason:
    """The cause of little force of one hand, judged over its contact once it has come to rest.

    A twin of the last seconds takes a second of computation, so a share of the commanded force that
    has not changed has the cause that it had.
    """

    def __init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        self._share, self._until_ns = 0.0, 0
        self._code, self.text = "", ""

    def look(self, recent: Recent, run_of: Callable[[TelemetryColumns], Samples]) -> str:
        """Return the cause in words; empty: no force is lost, or none is known yet.

        Args:
            recent: Packets of the last seconds.
            run_of: Makes a run of their columns.
        """
        samples, replies = recent[0][_contact(recent[0]) :], recent[1]
        if not samples:
            self._forget()
            return ""
        last = TelemetryColumns.from_packets(samples[-REST:])
        asked, given = (
            float(np.linalg.norm(one, axis=1).sum())
            for one in (last.commanded_force, last.applied_force)
        )
        if given >= WHOLE * asked:
            return ""
        share, is_still = given / asked, np.ptp(last.position, axis=0).max() <= STILL
        is_known = abs(share - self._share) <= SAME * self._share
        if samples[-1].time_ns >= self._until_ns and is_still and not is_known:
            self._judge(run_of(TelemetryColumns.from_packets(samples, replies)))
            self._share, self._until_ns = share, samples[-1].time_ns + HELD_NS
        return self.text

    def _judge(self, run: Samples) -> None:
        causes = {cause.code: cause for cause in run.causes}
        kept, first = causes.get(self._code), next(iter(causes.values()), None)
        if first is None or kept is None or takes(kept) < STAYS * takes(first):
            kept = first
        self._code, self.text = ("", "") if kept is None else (kept.code, kept.advice)


def _contact(samples: Sequence[Telemetry]) -> int:
    """Return where the contact of now begins; after all samples if there is none."""
    begin, now_ns = len(samples), samples[-1].time_ns if samples else 0
    for index in range(len(samples) - 1, -1, -1):
        if samples[index].time_ns < now_ns - BOUNCE_NS:
            break
        if any(samples[index].commanded_force):
            begin, now_ns = index, samples[index].time_ns
    return begin
