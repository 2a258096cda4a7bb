"""Second ports of controllers: their ends in the process of the environment.

:class:`forcebound.haptics.controllers.SecondPort` says what one decides.
"""

from collections.abc import Mapping

from forcebound.haptics.controllers import ControllerModel, SecondPort
from forcebound.haptics.environments import Environment
from forcebound.messages.packets import EnvironmentQuery, Vector


class Ports:
    """The second ports of ``controllers``, by hand; each is opened at the first query."""

    def __init__(self, controllers: Mapping[str, ControllerModel], axes: int) -> None:
        self._controllers, self._axes = controllers, axes
        self._ports: dict[str, SecondPort | None] = {}
        self._newest: dict[str, EnvironmentQuery] = {}

    def takes(self, query: EnvironmentQuery) -> bool:
        """Return whether to answer a query: not one that comes twice, or was overtaken."""
        model, newest = self._controllers.get(query.hand), self._newest.get(query.hand)
        if model is None or not isinstance(query.signals, Mapping):
            return True
        if newest is None or (query.seq < newest.seq and query.time_ns > newest.time_ns):
            self._ports[query.hand] = model.open_port(self._axes)  # it has begun, maybe again
        elif query.seq <= newest.seq:
            return False
        self._newest[query.hand] = query
        return True

    def force(self, query: EnvironmentQuery, environment: Environment, elapsed: float) -> Vector:
        """Return the force of the reply to a query that was taken, in N."""

        def ask(position: Vector, velocity: Vector) -> Vector:
            return environment.force(query.hand, position, velocity, elapsed)

        port = self._ports.get(query.hand)
        if port is None or not isinstance(query.signals, Mapping):
            return ask(query.position, query.velocity)
        force, numbers = port.answer(query, query.signals, ask)
        environment.published.numbers.update(numbers)
        return force
