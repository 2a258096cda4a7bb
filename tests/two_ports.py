"""A controller, its second port and a network in between, by ticks of a millisecond."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from forcebound.haptics.controllers import ControllerModel
from forcebound.haptics.environments import Environment
from forcebound.messages.packets import DeviceState, EnvironmentQuery, EnvironmentReply, Vector
from forcebound.nodes.ports import Ports

MS = 1_000_000
PERIOD = 1e-3  # s
ZERO = (0.0,)


class Row(NamedTuple):
    """A tick: where the hand is, in m, its force, in N, and what both ports count, in J."""

    position: float
    force: float
    hand: Mapping[str, float]
    port: Mapping[str, float]
    place: float  # of the environment's end, m


class Asked(Environment):
    """A world of a function, which notes where it was asked."""

    def __init__(self, function: Callable[[float], float]) -> None:
        self.function, self.place = function, 0.0

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        (self.place,) = position
        return (self.function(self.place),)


def exchange(
    model: ControllerModel,
    world: Callable[[float], float],
    motion: Callable[[int, float], float],
    ticks: int,
    *links: Callable[[int], Sequence[int]],
) -> list[Row]:
    """Return what comes of ``motion``, the hand's place at a tick under the force before.

    ``links`` give the delays of the copies of packet k, in ticks, of queries and of replies.
    """
    there, back = links if len(links) == 2 else links * 2
    hand, world_ = model.open(1), Asked(world)
    ports = Ports({"hand": model} if model.port_signals else {}, 1)
    queries: dict[int, list[EnvironmentQuery]] = {}
    replies: dict[int, list[EnvironmentReply]] = {}
    rows: list[Row] = []
    before, force = motion(0, 0.0), 0.0

    def serve(tick: int) -> None:
        for query in queries.pop(tick, []):
            if not ports.takes(query):
                continue
            answer = ports.force(query, world_, 0.0)
            signals = dict(world_.published.numbers)
            times = (query.seq, query.time_ns, query.seq, query.time_ns, query.seq, query.time_ns)
            reply = EnvironmentReply(*times, answer, "world", signals=signals)
            for delay in back(query.seq):
                replies.setdefault(tick + delay, []).append(reply)

    def take(tick: int) -> None:
        nonlocal force
        for reply in replies.pop(tick, []):
            force = (hand.on_reply(reply, tick * MS) or (force,))[0]

    for tick in range(ticks):
        now = (tick + 1) * MS
        position = motion(tick, force)
        velocity = (position - before) / PERIOD
        before = position
        state = DeviceState(tick, now, 0.0, (position,), (velocity,), ZERO)
        serve(tick)
        take(tick)
        force = (hand.on_state(state, now) or ZERO)[0]
        place, speed = hand.query(state)
        signals = dict(hand.published.numbers)
        query = EnvironmentQuery(tick, now, tick, now, 0.0, place, speed, None, signals=signals)
        for delay in there(tick):
            queries.setdefault(tick + delay, []).append(query)
        serve(tick)
        take(tick)
        numbers = dict(world_.published.numbers)
        rows.append(Row(position, force, signals, numbers, world_.place))
    return rows
