"""Application of changed parameters to nodes and links, live and in virtual time.

:func:`forcebound.graph.parameters.change` makes the configuration that holds them.
"""

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from forcebound.errors import ConfigError
from forcebound.graph.graph import GraphConfig
from forcebound.graph.names import ParameterName, parameter_name
from forcebound.graph.parameters import PERFECT, check_takeable, parameters, with_values
from forcebound.messages.control import Configure, Parameters
from forcebound.messages.packets import Scene
from forcebound.messages.topology import node_name
from forcebound.network.chances import ComputationTime
from forcebound.nodes.device import DeviceNode
from forcebound.nodes.environment import EnvironmentNode
from forcebound.recordings.delay_traces import trace_of
from forcebound.run.build import build_link
from forcebound.run.process.runner import Runner
from forcebound.run.simulation import Simulation


class Tuner:
    """Applies parameters to the nodes and links of a running process, or of a simulation.

    Of two requests that overtake each other, the newer one counts; none from before ``begun_ns``,
    which the configuration has, unless the launcher has taken it back since.
    """

    def __init__(self, config: GraphConfig, begun_ns: int = 0) -> None:
        self._config = config
        self._known = parameters(config)
        self._time_ns = begun_ns

    def __call__(self, graph: Runner | Simulation, request: Configure) -> Parameters:
        """Apply newer parameters; return the changes there but for the law.

        The device node itself reports its law, as soon as it has taken it.
        """
        if request.time_ns < self._time_ns:
            return {}
        known = self._known.items()
        changed = {n: v for n, v in request.parameters.items() if (n, v) not in known}
        for name, value in changed.items():
            if ParameterName.parse(name).is_law:  # before its file is read
                check_takeable(name, value, self._known.get(name, ""))
        config = with_values(self._config, changed)
        _apply(changed, config, graph)
        self._config = config
        self._known |= changed
        self._time_ns = request.time_ns
        return {n: value for n, value in changed.items() if not ParameterName.parse(n).is_law}


def try_out(config: GraphConfig, changed: Iterable[str]) -> None:
    """Try changed parameters on copies of links and of the computation, before a process has them.

    ConfigError if one fails with a packet. The environment was asked when ``config`` was made.
    """
    names = [ParameterName.parse(name) for name in changed]
    now_ns = time.monotonic_ns()
    for hand, topic in {(name.hand, name.topic) for name in names if name.topic is not None}:
        impairment = config.hands[hand].links.get(topic, PERFECT)
        with _refusing(parameter_name(hand, f"links.{topic}")):
            link = build_link(topic, impairment, config.seed)
            link.accept(now_ns, Scene(0, now_ns, ()))
            link.due(now_ns)
    if any(name.section == "environment" for name in names):
        computation = config.environment.computation
        with _refusing("environment"):
            ComputationTime(computation, config.seed, trace_of(computation)).next_ns(now_ns)


@contextmanager
def _refusing(place: str) -> Iterator[None]:
    try:
        yield
    except ConfigError:
        raise
    except Exception as error:
        raise ConfigError(f"{place}: cannot work with these values: {error!r}") from error


def _apply(changed: Parameters, new: GraphConfig, graph: Runner | Simulation) -> None:
    names = [ParameterName.parse(name) for name in changed]
    environment, computation = new.environment, new.environment.computation
    if any(name.section == "environment" for name in names):  # first, since it may be refused
        for node in graph.nodes:
            if isinstance(node, EnvironmentNode):
                node.set(environment.served, computation, trace_of(computation))
    for hand, topic in sorted(
        {(name.hand, name.topic) for name in names if name.topic is not None}
    ):
        stream = node_name(hand, topic)
        impairment, link = new.hands[hand].links.get(topic, PERFECT), graph.link(stream)
        if link is not None:
            link.change(impairment, trace_of(impairment))
        elif impairment != PERFECT:
            graph.set_link(stream, build_link(stream, impairment, new.seed))
    laws = {name.hand for name in names if name.is_law}
    for node in graph.nodes:
        if isinstance(node, DeviceNode) and node.hand in laws:
            node.set(new.hands[node.hand].servo.law)
