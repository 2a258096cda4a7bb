"""The environment node: serves one virtual environment.

While an answer is computed no other query is answered, as in a real computation. Of the queries of
a hand that arrive during that time only the newest waits. The injected computation time is added to
that of the environment's code.

A query names the environment whose answers its hand accepts. If it names another one, this one is
rejected: it emits an event and waits. It still answers that hand once a second, so that the hand's
controller knows of it.

One process answers all hands. When a hand's queries end, its contact gives no more force to others.

An answer carries the contact that the environment reports; its scene is sent in separate steps
(:mod:`forcebound.nodes.scene`).
"""

import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import ClassVar, TypeAlias

from msgspec import UnsetType

from forcebound.errors import ConfigError
from forcebound.haptics.environments import (
    Environment,
    EnvironmentModel,
    change_environment,
    open_environment,
)
from forcebound.haptics.parts import overridden
from forcebound.haptics.parts.user_module import describe_user_error
from forcebound.messages import control
from forcebound.messages.events import STATE_INTERVAL_NS, EventLog
from forcebound.messages.packets import EnvironmentQuery, EnvironmentReply, Event, Packet, Vector
from forcebound.messages.topology import HAND
from forcebound.network.chances import ComputationTime
from forcebound.network.impairment import Impairment
from forcebound.network.trace import DelayTrace
from forcebound.nodes import Node, close_part
from forcebound.nodes.ports import Ports
from forcebound.nodes.publishing import Signals
from forcebound.nodes.scene import SceneSource
from forcebound.roles import ENVIRONMENT

PROBE_INTERVAL_NS = 1_000_000_000  # between two answers of an environment that is rejected
ABSENT_NS = 100_000_000  # without a query, after which a hand has left the world
FAILED_NS = 100_000_000  # without a good answer, after which a world that had some is opened again
SLACK = 1.0  # s that a hand's time may be ahead of ours: packets are late by different times
DRIFT = 1.01  # how many times as fast as ours another machine's clock may go

_logger = logging.getLogger(__name__)


# Answer of the environment's code to a query: force, in N, proxy, in m, normal, and signals.
_Answer: TypeAlias = tuple[Vector, Vector | None, Vector | None, Mapping[str, float] | UnsetType]


@dataclass
class _User:
    """A hand that has asked.

    Its time moves a world that others share, so it passes no faster than ours. A time that jumps
    goes on from where it was; one that goes back began again.
    """

    heard_ns: int = 0  # last query that was taken
    is_present: bool = False
    is_serving: bool = False
    refused_for: str | None = None  # the environment that serves it instead
    probed_ns: int = 0
    time: float = inf  # s, of its last query, as the world has it
    asked_ns: int = 0  # when that was answered
    credit: float = SLACK  # s that its time may gain on ours
    cut: float = 0.0  # s that do not pass in the world
    emitted: tuple[bool, str | None] = (False, None)
    emit_ns: int = 0

    def passed(self, elapsed: float, now_ns: int) -> float:
        """Return the time of a query for the world, in s: ``elapsed`` if that is plausible."""
        before, time = self.time, elapsed - self.cut
        credit = self.credit + DRIFT * 1e-9 * (now_ns - self.asked_ns)
        if credit > SLACK:
            credit = SLACK
        most = before + credit
        if time < before:
            self.cut = max(elapsed - before, 0.0)
            time = min(elapsed - self.cut, most)
        elif time > most:
            self.cut = elapsed - most
            time = min(elapsed - self.cut, most)
        if time > before:
            credit -= time - before
        self.time, self.asked_ns, self.credit = time, now_ns, credit
        return time


class EnvironmentNode(Node):
    """Answers the newest query, one at a time, each after its computation time.

    The node opens the model for its ``hands``, and closes it in the end. No other environment has
    its ``name`` in the graph. ``ports`` stand between it and the hands.

    Raises:
        ConfigError: If the environment cannot be opened.
    """

    wakes_on_arrival: ClassVar[bool] = True
    requests: ClassVar[tuple[type[control.Request], ...]] = (control.ResetWorld,)

    def __init__(
        self,
        model: EnvironmentModel,
        computation: ComputationTime | None = None,
        name: str = ENVIRONMENT,
        axes: int = 1,
        hands: Collection[str] = (),
        ports: Ports | None = None,
    ) -> None:
        self._model = model
        self._axes, self._hands, self._ports = axes, hands, ports
        self._environment = open_environment(model, axes, hands)
        self._computation = ComputationTime() if computation is None else computation
        self._answering: tuple[EnvironmentQuery, _Answer] | None = None
        self._waiting: dict[str, EnvironmentQuery] = {}  # by hand; the first is answered first
        self._done_ns = 0
        self._step_ns = 0  # the last step
        self._seq = 0
        self._users: dict[str, _User] = {}  # by hand
        self._serving_changed = False  # so an event may be due
        self.events = EventLog(ENVIRONMENT)
        self._signals = Signals(self._environment, model.declared(), self.events, self.reject)
        self.views = SceneSource(self._environment, self.events)
        self._proxies: dict[str, Vector] = {}  # of the last answer to each hand
        self._watch()
        self.name = name
        self.faults = 0  # queries that the environment's code failed to answer
        self._failing_ns: int | None = None  # since when it has failed to answer any
        self._is_sound = False  # whether it has answered since it was opened
        self._failure = ""  # the first of them, until it is reported

    @property
    def answered(self) -> int:
        """Number of queries that it has answered."""
        return self._seq

    @property
    def wake_ns(self) -> int | None:
        if self.views.is_due:
            return self._step_ns
        return None if self._answering is None else self._done_ns

    def set(
        self, model: EnvironmentModel, computation: Impairment, trace: DelayTrace | None = None
    ) -> None:
        """Answer from the next query on with other parameters, or in another time.

        The answer in work keeps its time. An environment keeps its state if its ``change`` does, or
        if only the time changes; otherwise it is opened again. ConfigError, and no change, if its
        code fails.
        """
        if model != self._model:
            opened = self._environment
            self._environment = change_environment(opened, model, self._axes, self._hands)
            self._model = model
            self._watch()
        self._computation.change(computation, trace)

    def handle(self, request: control.ResetWorld) -> control.Answer:
        """Let the world begin again, with the hands where they are."""
        try:
            if not self._environment.reset():
                self._renew()
        except Exception as error:  # of a user's code
            return control.Refused(describe_user_error(error))
        self._proxies.clear()
        return control.Accepted()

    def _watch(self) -> None:
        self._signals.watch(self._environment)
        self.views.watch(self._environment)
        methods = overridden(self._environment, Environment)
        self._takes_readings = "take_readings" in methods
        self._notices_leaving = "leave" in methods

    def close(self) -> None:
        close_part(self._environment.close, ENVIRONMENT)

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        self._step_ns = time_ns
        for packet in received:
            if type(packet) is EnvironmentQuery:
                self._take(packet, time_ns)
        if len(self._users) > 1:
            self._drop_absent(time_ns)
        was_due, answered = self.views.is_due, self._seq
        packets = self._answers(time_ns)
        if self._signals.waiting:
            packets += self._signals.events(time_ns)
        if self._seq != answered:
            self.views.note_answer(time_ns)
        if was_due and (self._seq == answered or not self.views.may_wait(time_ns)):
            packets += self.views.packets(time_ns, self._proxies)
        return packets

    def _take(self, query: EnvironmentQuery, time_ns: int) -> None:
        """Let a query wait for its answer if it is sound and this environment may serve it."""
        more = (*(query.orientation or ()), *(query.measured_force or ()))
        if not all(map(isfinite, (*query.position, *query.velocity, query.elapsed, *more))):
            self.reject("not_finite")
            return
        user = self._users.get(query.hand)
        if user is None:
            user = self._users[query.hand] = _User()
        is_as_before = user.is_serving and query.environment == self.name
        if not is_as_before and not self._may_serve(user, query.environment, time_ns):
            return
        user.heard_ns = time_ns
        user.is_present = True
        if self._ports is None or self._ports.takes(query):
            self._waiting[query.hand] = query

    def _drop_absent(self, time_ns: int) -> None:
        """Let hands leave whose queries have ended."""
        for hand, user in self._users.items():
            if user.is_present and time_ns - user.heard_ns > ABSENT_NS:
                user.is_present = False
                self._waiting.pop(hand, None)
                self._proxies.pop(hand, None)
                if self._notices_leaving:
                    try:
                        self._environment.leave(hand)
                    except Exception as error:
                        self._count_failure(error)

    def _answers(self, time_ns: int) -> list[Packet]:
        """Return the answers that are ready, and events about them."""
        replies: list[Packet] = self._states(time_ns) if self._serving_changed else []
        if self._answering is not None and time_ns >= self._done_ns:
            replies.append(self._reply(*self._answering, time_ns))
            self._answering = None
        while self._answering is None and self._waiting:
            query = self._waiting.pop(next(iter(self._waiting)))
            answer = self._answer(query)
            if answer is None:
                continue
            delay_ns = self._computation.next_ns(time_ns)
            if delay_ns == 0:
                replies.append(self._reply(query, answer, time_ns))
            elif delay_ns is not None:
                self._answering = (query, answer)
                self._done_ns = time_ns + delay_ns
        if self._failure:
            message, self._failure = f"the environment's code failed: {self._failure}", ""
            replies.append(self.events.emit(time_ns, "environment_failed", message, is_fault=True))
        return replies

    def status(self) -> control.EnvironmentStatus:
        return control.EnvironmentStatus(
            rejected=dict(self.rejected),
            name=self.name,
            refused_for=next(filter(None, (u.refused_for for u in self._users.values())), None),
            failures=self.faults,
        )

    def _states(self, time_ns: int) -> list[Packet]:
        """Return the events that this environment begins or ceases to serve hands."""
        events: list[Packet] = []
        self._serving_changed = False
        for hand, user in self._users.items():
            state = (user.is_serving, user.refused_for)
            if state == user.emitted:
                continue
            if time_ns < user.emit_ns:
                self._serving_changed = True
                continue
            user.emitted = state
            if state != (False, None):
                events.append(self._emit_state(hand, user, time_ns))
        return events

    def _emit_state(self, hand: str, user: _User, time_ns: int) -> Event:
        """Return the event that this environment begins or ceases to serve a hand."""
        user.emit_ns = time_ns + STATE_INTERVAL_NS
        data = {"environment": self.name} | ({"hand": hand} if hand != HAND else {})
        served = f"the hand {hand}" if hand != HAND else "this graph"
        if user.refused_for is None:
            message = f"serving {served} now, as {self.name}"
            return self.events.emit(time_ns, "serving", message, data)
        message = (
            f"not serving: {user.refused_for} serves {served}; "
            f"{self.name} is waiting until it leaves"
        )
        return self.events.emit(time_ns, "environment_refused", message, data, is_fault=True)

    def _may_serve(self, user: _User, serving: str | None, time_ns: int) -> bool:
        """Return whether to answer a query; once a second if it is for another environment."""
        self._serving_changed = True
        user.is_serving = serving == self.name
        if user.is_serving or serving is None:
            user.refused_for = None
            return True
        if user.refused_for is None:
            user.probed_ns = time_ns - PROBE_INTERVAL_NS
        user.refused_for = serving
        if time_ns - user.probed_ns < PROBE_INTERVAL_NS:
            return False
        user.probed_ns = time_ns
        return True

    def _answer(self, query: EnvironmentQuery) -> _Answer | None:
        # Any failure of a user's environment must end in silence, to which the device responds
        # with zero force, not in the end of the node.
        try:
            environment = self._environment
            if self._takes_readings:
                felt = query.measured_force or None
                environment.take_readings(query.hand, query.buttons, felt)
            elapsed = self._users[query.hand].passed(query.elapsed, self._step_ns)
            if self._ports is None:
                answer = environment.force(query.hand, query.position, query.velocity, elapsed)
            else:
                answer = self._ports.force(query, environment, elapsed)
            force = _vector(answer, query)
            if not all(map(isfinite, force)):
                raise ValueError(f"expected a finite force, got {force} N")
            contact = environment.contact(query.hand) if self.views.reports_contacts else None
            signals = self._signals.numbers()
            self._is_sound, self._failing_ns = True, None
            if contact is None:
                return force, None, None, signals
            proxy, normal = contact
            return force, _vector(proxy, query), _vector(normal, query), signals
        except Exception as error:
            self._count_failure(error)
            self._open_again()
            return None

    def _open_again(self) -> None:
        """Open the world again if it has answered and now fails to: its state is lost."""
        if self._failing_ns is None:
            self._failing_ns = self._step_ns
        if not self._is_sound or self._step_ns - self._failing_ns < FAILED_NS:
            return
        self._is_sound = False
        try:
            self._renew()
        except ConfigError as error:
            self._count_failure(error)
            return
        self._failure = f"no answer for {FAILED_NS / 1e6:g} ms, so it was opened again"

    def _renew(self) -> None:
        """Open another one in place of this one; ConfigError, and no change, if it fails."""
        opened = open_environment(self._model, self._axes, self._hands)
        self.close()
        self._environment = opened
        self._watch()

    def _count_failure(self, error: Exception) -> None:
        self.faults += 1
        if self.faults == 1:
            self._failure = describe_user_error(error)
            _logger.error("the environment's code failed", exc_info=error)

    def _reply(self, query: EnvironmentQuery, answer: _Answer, time_ns: int) -> EnvironmentReply:
        seq = self._seq
        self._seq += 1
        force, proxy, normal, signals = answer
        if proxy is not None:
            self._proxies[query.hand] = proxy
        elif self._proxies:
            self._proxies.pop(query.hand, None)
        return EnvironmentReply(
            seq,
            time_ns,
            query.device_seq,
            query.device_time_ns,
            query.seq,
            query.time_ns,
            force,
            self.name,
            proxy,
            normal,
            signals,
            hand=query.hand,
        )


def _vector(answer: Vector, query: EnvironmentQuery) -> Vector:
    try:
        vector = tuple(map(float, answer))  # numbers of numpy cannot be sent
    except TypeError:
        raise ValueError(f"expected one number per axis, such as (1.0,), got {answer!r}") from None
    if len(vector) != len(query.position):
        raise ValueError(f"expected {len(query.position)} entries, got {len(vector)}")
    return vector
