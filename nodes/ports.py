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
        self._ports: dict[str, tuple[SecondPort, EnvironmentQuery]] = {}  # with the newest query

    def force(
        self, query: EnvironmentQuery, environment: Environment, elapsed: float
    ) -> Vector | None:
        """Return the force of the reply, in N; None: another query has overtaken this one."""

        def ask(position: Vector, velocity: Vector) -> Vector:
            return environment.force(query.hand, position, velocity, elapsed)

        if query.hand not in self._controllers or not isinstance(query.signals, Mapping):
            return ask(query.position, query.velocity)
        port, newest = self._ports.get(query.hand, (None, query))
        if port is None or (query.seq < newest.seq and query.time_ns > newest.time_ns):
            port = self._controllers[query.hand].open_port(self._axes)  # it has begun, maybe again
        elif query.seq <= newest.seq:
            return None
        self._ports[query.hand] = port, query
        force, numbers = port.answer(query, query.signals, ask)
        environment.published.numbers.update(numbers)
        return force
