"""Application of changed parameters to nodes and links, live and in virtual time.

:func:`forcebound.graph.loader.change` makes the configuration that holds them.
"""

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from forcebound.errors import ConfigError
from forcebound.graph.graph import GraphConfig
from forcebound.graph.names import LAW, ParameterName, of_hand
from forcebound.graph.parameters import parameters
from forcebound.graph.resolved import with_parameters
from forcebound.messages.control import Configure, Parameters
from forcebound.messages.packets import Scene
from forcebound.messages.topology import HAND, in_hand
from forcebound.network.chances import ComputationTime
from forcebound.network.impairment import Impairment
from forcebound.nodes.device import DeviceNode
from forcebound.nodes.environment import EnvironmentNode
from forcebound.recordings.delay_traces import trace_of
from forcebound.run.build import build_link, served
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
        here = tuple(_prefixes(graph))
        changed = {
            name: value
            for name, value in request.parameters.items()
            if name.startswith(here) and value != self._known.get(name)
        }
        config = with_parameters(self._config, changed)
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
        impairment = config.hands[hand].links.get(topic, Impairment())
        with _refusing(of_hand(hand, f"links.{topic}")):
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


def _prefixes(graph: Runner | Simulation) -> Iterator[str]:
    """Prefixes of the parameters that belong to the nodes of a graph or process."""
    for node in graph.nodes:
        for stream in graph.graph.received(node.events.node):
            yield of_hand(stream.hand or HAND, f"links.{stream.topic}.")
        if isinstance(node, EnvironmentNode):
            yield "environment."
        if isinstance(node, DeviceNode):
            yield of_hand(node.hand, LAW)


def _apply(changed: Parameters, new: GraphConfig, graph: Runner | Simulation) -> None:
    names = [ParameterName.parse(name) for name in changed]
    if any(name.section == "environment" for name in names):  # first, since it may be refused
        for node in graph.nodes:
            if isinstance(node, EnvironmentNode):
                computation = new.environment.computation
                node.change(served(new.environment), computation, trace_of(computation))
    for hand, topic in sorted(
        {(name.hand, name.topic) for name in names if name.topic is not None}
    ):
        stream = in_hand(hand, topic)
        impairment, link = new.hands[hand].links.get(topic, Impairment()), graph.link(stream)
        if link is not None:
            link.change(impairment, trace_of(impairment))
        elif impairment != Impairment():
            graph.set_link(stream, build_link(stream, impairment, new.seed))
    for node in graph.nodes:
        if isinstance(node, DeviceNode) and of_hand(node.hand, LAW) in changed:
            node.take_law(new.hands[node.hand].device.servo.law)
