"""Timing of a whole run before its simulation: when each answer arrives.

What the network does to a packet never depends on the forces in it. So the tick that each force
answers, the engage ramp and the age limit follow from delays, jitter, losses and the time that the
environment computes alone, and a whole run's timing is a few array operations: the same links, the
same random numbers, the same rules as in :mod:`forcebound.network.link`,
:mod:`forcebound.nodes.environment` and :mod:`forcebound.nodes.safety`.

Two things that happen in the same nanosecond are ordered by the runner's heap. The rules for the
ties that round delays make are written out below; a tie beyond them makes the timing
``is_exact = False``, and the run goes through the graph. So does every run with an impairment other
than delay, uniform jitter and independent loss, or with computations that do not all take the same
time.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.config.graph import GraphConfig
from forcebound.network.chances import plain_fates
from forcebound.network.impairment import Impairment
from forcebound.network.link import RESTART_NS, link_seed
from forcebound.nodes.safety import REMEMBERED
from forcebound.topology import LINKS

Times: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True)
class Timing:
    """The timing of one run; ``n`` ticks.

    Attributes:
        answered: Tick that the force of each tick answers, -1 for none, shape ``(n,)``.
        engagement: Factor of the engage ramp, 0 to 1, shape ``(n,)``.
        rejected: Packets rejected by the end of the run, by reason.
        is_exact: Whether the graph certainly has this timing.
    """

    answered: NDArray[np.int64]
    engagement: NDArray[np.float64]
    rejected: Mapping[str, int]
    is_exact: bool


def timing_of(config: GraphConfig, ticks: int) -> Timing:
    """Return the timing of the first ``ticks`` ticks of a run."""
    servo = config.device.servo
    links = tuple(config.links.get(topic, Impairment()) for topic in LINKS)
    computation = config.environment.computation
    is_random = any(link.jitter > 0.0 or link.loss > 0.0 for link in links)
    return _timing(
        ticks,
        servo.period_ns,
        round(servo.reply_wait * servo.period_ns),
        round(servo.age_limit * 1e9),
        round(servo.engage_time * 1e9),
        computation,
        links,
        config.seed if is_random else 0,
    )


class _Inexact(Exception):  # noqa: N818 - not an error
    """The order of a tie, or an impairment, is known to the graph alone."""


@lru_cache(maxsize=256)
def _timing(
    ticks: int,
    period_ns: int,
    wait_ns: int,
    age_limit_ns: int,
    engage_ns: int,
    computation: Impairment,
    links: tuple[Impairment, ...],
    seed: int,
) -> Timing:
    compute_ns = round(computation.delay * 1e9)
    writes = np.arange(ticks, dtype=np.int64) * period_ns + wait_ns
    try:
        if computation != Impairment(computation.delay):
            raise _Inexact  # it varies, and so does the query that is served next
        _check_limits(period_ns, age_limit_ns, compute_ns, links)
        sent = np.arange(ticks, dtype=np.int64) * period_ns
        origin = np.arange(ticks, dtype=np.int64)
        queries = _newest(*_travel(sent, origin, links[0], link_seed(seed, LINKS[0])), links[0])
        arrived = _newest(*_travel(*queries, links[1], link_seed(seed, LINKS[1])), links[1])
        started, answers = _serve(*arrived, compute_ns, period_ns, wait_ns)
        done = started + compute_ns
        if compute_ns:
            late = _comes_too_late(started, done, answers, period_ns, wait_ns)
            if links[2].delay == links[3].delay == 0.0:
                done = done + late
            elif np.any(late) and any(link.jitter > link.delay for link in links[2:]):
                raise _Inexact
        replies = _newest(*_travel(done, answers, links[2], link_seed(seed, LINKS[2])), links[2])
        through, answers = _travel(*replies, links[3], link_seed(seed, LINKS[3]))
        held, too_old = _accept(through, answers, ticks, period_ns, wait_ns, age_limit_ns)
    except _Inexact:
        nothing = np.full(ticks, -1, dtype=np.int64)
        return Timing(nothing, np.zeros(ticks), {}, is_exact=False)
    fresh = (held >= 0) & (writes - held * period_ns <= age_limit_ns)
    answered = np.where(fresh, held, -1)
    rejected = {"too_old": too_old} if too_old else {}
    return Timing(answered, _ramp(fresh, writes, engage_ns), rejected, is_exact=True)


def _check_limits(
    period_ns: int, age_limit_ns: int, compute_ns: int, links: tuple[Impairment, ...]
) -> None:
    if not all(link.is_plain for link in links):
        raise _Inexact  # only the graph knows the other impairments
    longest = compute_ns + sum(round((link.delay + link.jitter) * 1e9) for link in links)
    if longest >= RESTART_NS or age_limit_ns >= period_ns * (REMEMBERED - 1):
        raise _Inexact


def _travel(sent: Times, origin: Times, link: Impairment, seed: int) -> tuple[Times, Times]:
    """Return when packets are delivered and which ticks they answer, sorted by time."""
    lost, travel = plain_fates(link, seed, sent.size)
    through, origin = (sent + travel)[~lost], origin[~lost]
    order = np.argsort(through, kind="stable")
    return through[order], origin[order]


def _newest(through: Times, origin: Times, link: Impairment) -> tuple[Times, Times]:
    """Return the packets that are delivered: those newer than all before."""
    if link.jitter > 0.0 and np.any(np.diff(through) == 0):
        raise _Inexact
    before = np.maximum.accumulate(np.concatenate(([-1], origin[:-1])))
    newer = origin > before
    return through[newer], origin[newer]


def _serve(
    arrived: Times, origin: Times, compute_ns: int, period_ns: int, wait_ns: int
) -> tuple[Times, Times]:
    """Return when the environment starts on which query; only the newest query waits."""
    if compute_ns == 0:
        return arrived, origin
    starts: list[int] = []
    chosen: list[int] = []
    times = arrived.tolist()
    at_once = (arrived == origin * period_ns).tolist()  # in the very step in which it was sent
    count, index = len(times), 0
    start = times[0] if count else 0
    while index < count:
        starts.append(start)
        chosen.append(index)
        done = start + compute_ns
        newest = index
        while newest + 1 < count and times[newest + 1] <= done:
            newest += 1
        if newest > index + 1 and at_once[newest] and times[newest] == done:
            # A wake-up of the device and one of the environment, in the order in which they were
            # made: the device's when it wrote last.
            made = done - period_ns + wait_ns
            if start == made:
                raise _Inexact
            if start < made:
                newest -= 1
        if newest > index:
            index, start = newest, done
        else:
            index += 1
            start = times[index] if index < count else 0
    return np.array(starts, dtype=np.int64), origin[np.array(chosen, dtype=np.int64)]


def _comes_too_late(
    started: Times, done: Times, origin: Times, period_ns: int, wait_ns: int
) -> Times:
    """Return 1 ns for each answer that is done as the device writes, but after it in the heap."""
    tick, phase = np.divmod(done - wait_ns, period_ns)
    is_tied = phase == 0
    began = started - tick * period_ns  # since the device made its wake-up: when it sampled
    follows = (began == 0) & np.concatenate(([False], done[:-1] == started[1:]))
    if np.any(is_tied & follows):
        raise _Inexact
    own = (began == 0) & (origin == tick)
    late: Times = (is_tied & ((began > 0) | own)).astype(np.int64)
    return late


def _accept(
    through: Times, origin: Times, ticks: int, period_ns: int, wait_ns: int, age_limit_ns: int
) -> tuple[Times, int]:
    """Return the newest tick answered at each write, -1 for none, and how many came too old."""
    samples = np.arange(ticks, dtype=np.int64) * period_ns
    polls = np.stack((samples, samples + wait_ns), axis=1).ravel()
    newest = np.maximum.accumulate(np.concatenate(([-1], origin)))
    seen = newest[np.searchsorted(through, polls, side="right")]
    is_new = seen > np.concatenate(([-1], seen[:-1]))
    is_old = is_new & (polls - seen * period_ns > age_limit_ns)
    held = np.maximum.accumulate(np.where(is_new & ~is_old, seen, -1))
    return held[1::2], int(np.count_nonzero(is_old))


def _ramp(fresh: NDArray[np.bool_], writes: Times, engage_ns: int) -> NDArray[np.float64]:
    begins = fresh & ~np.concatenate(([False], fresh[:-1]))
    start = np.maximum.accumulate(np.where(begins, writes, 0))
    since = writes - start
    if engage_ns == 0:
        return fresh.astype(np.float64)
    return np.where(fresh, np.where(since >= engage_ns, 1.0, since / engage_ns), 0.0)
