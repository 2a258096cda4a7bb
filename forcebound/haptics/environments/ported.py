"""An environment behind the second ports of controllers."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import partial

from msgspec import UNSET

from forcebound.haptics.environments import Environment, EnvironmentModel
from forcebound.haptics.environments.wrapped import Wrapped
from forcebound.haptics.parts.ports import SecondPort, TwoPort
from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import EnvironmentQuery, Vector


@dataclass(frozen=True)
class WithPorts(EnvironmentModel):
    """An environment, and by hand the controllers that have a second port at it."""

    model: EnvironmentModel
    controllers: Mapping[str, TwoPort]

    def declared(self) -> Collection[Signal]:
        sent = [each.port_signals for each in self.controllers.values()]
        own = {each.name: each for signals in sent for each in signals}
        return (*self.model.declared(), *own.values())

    def check_hands(self, hands: tuple[str, ...]) -> None:
        self.model.check_hands(hands)

    def open(self, axes: int) -> Environment:
        return _Ported(self, axes)


class _Ported(Wrapped):
    def __init__(self, model: WithPorts, axes: int) -> None:
        super().__init__(model.model, axes)
        self._controllers = model.controllers
        self._ports: dict[str, tuple[SecondPort, EnvironmentQuery]] = {}  # with the newest query
        self._query: EnvironmentQuery | None = None  # that is answered next

    def take_query(self, query: EnvironmentQuery) -> None:
        self._query = query

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        query, self._query = self._query, None
        ask = partial(self._ask, user, elapsed)
        if query is None or query.signals is UNSET or user not in self._controllers:
            return ask(position, velocity)
        port, newest = self._ports.get(user, (None, query))
        if port is None or (query.seq < newest.seq and query.time_ns > newest.time_ns):
            port = self._controllers[user].open_port(self._axes)  # the controller has begun again
        self._ports[user] = (port, query if query.time_ns >= newest.time_ns else newest)
        force, numbers = port.answer(query, ask)
        self.published.numbers.update(numbers)
        return force

    def _ask(self, user: str, elapsed: float, position: Vector, velocity: Vector) -> Vector:
        return self._opened.force(user, position, velocity, elapsed)

    def change(self, model: WithPorts) -> bool:
        if model.controllers != self._controllers:
            return False
        self.change_inner(model.model)
        return True
