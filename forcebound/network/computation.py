"""Computation time of an environment: a pure, seeded model, as the delay of a link.

The words are those of a link (:class:`forcebound.network.impairment.Impairment`): ``delay``,
``jitter``, ``distribution``, ``correlation``, ``distribution_file``, ``trace``. Nothing else of an
impairment makes sense here, since a computation is no packet.
"""

from forcebound.network.chances import Chances, Draws
from forcebound.network.impairment import PERFECT, Impairment
from forcebound.network.trace import DelayTrace


class ComputationTime:
    """The time that each of a row of computations takes.

    ``trace`` is the content of the file ``impairment.trace``. ValueError if it is named and not
    given.
    """

    def __init__(
        self, impairment: Impairment = PERFECT, seed: int = 0, trace: DelayTrace | None = None
    ) -> None:
        self._draws = Draws(seed)
        self._first_ns: int | None = None
        self.change(impairment, trace)

    def change(self, impairment: Impairment, trace: DelayTrace | None = None) -> None:
        """Let computations that begin from now on take the time of ``impairment``."""
        if trace is None and impairment.trace is not None:
            raise ValueError(f"a computation needs the times of its trace {impairment.trace}")
        self._trace = trace
        self._delay_ns = round(impairment.delay * 1e9)
        self._chances = Chances(impairment, self._draws) if impairment.jitter else None

    def next_ns(self, time_ns: int) -> int | None:
        """Return how long the computation that begins now takes, in ns.

        None: it fails, by its trace, which begins with the first computation.
        """
        if self._first_ns is None:
            self._first_ns = time_ns
        if self._trace is not None:
            return self._trace.delay_ns(time_ns - self._first_ns)
        return self._delay_ns if self._chances is None else self._chances.travel_ns()
