"""Application of changed parameters to nodes and links, live and in virtual time.

:func:`forcebound.graph.loader.change` makes the configuration that holds them.
"""

from collections.abc import Iterator

from forcebound.graph.graph import GraphConfig
from forcebound.graph.names import LAW, ParameterName
from forcebound.graph.parameters import differences, parameters
from forcebound.graph.resolved import with_parameters
from forcebound.messages.control import Configure, Parameters
from forcebound.network.impairment import Impairment
from forcebound.nodes.device import DeviceNode
from forcebound.nodes.environment import EnvironmentNode
from forcebound.run.build import change_environment, change_link
from forcebound.run.links import build_link
from forcebound.run.process import Runner
from forcebound.run.simulation import Simulation


def apply(old: GraphConfig, new: GraphConfig, graph: Runner | Simulation) -> Parameters:
    """Apply changed parameters to the nodes and links of a simulation or of one process.

    Returns the names and new values of those that have changed there.
    """
    here = tuple(_prefixes(graph))
    changed = {
        name: value for name, value in differences(old, new).items() if name.startswith(here)
    }
    _apply(changed, new, graph)
    return changed


class Tuner:
    """Applies the parameters of a request on its control socket to a running process.

    Of two requests that overtake each other, the newer one counts.
    """

    def __init__(self, config: GraphConfig) -> None:
        self._config = config
        self._known = parameters(config)
        self._time_ns = 0

    def __call__(self, runner: Runner, request: Configure) -> Parameters:
        """Apply newer parameters; return the changes in this process but for the law.

        The device node itself reports its law, as soon as it has taken it.
        """
        if request.time_ns < self._time_ns:
            return {}
        here = tuple(_prefixes(runner))
        changed = {
            name: value
            for name, value in request.parameters.items()
            if name.startswith(here) and value != self._known.get(name)
        }
        config = with_parameters(self._config, changed)
        _apply(changed, config, runner)
        self._config = config
        self._known |= changed
        self._time_ns = request.time_ns
        return {name: value for name, value in changed.items() if name != LAW}


def _prefixes(graph: Runner | Simulation) -> Iterator[str]:
    """Prefixes of the parameters that belong to the nodes of a graph or process."""
    for node in graph.nodes:
        yield from (f"links.{each.name}." for each in graph.graph.received(node.events.node))
        if isinstance(node, EnvironmentNode):
            yield "environment."
        if isinstance(node, DeviceNode):
            yield LAW


def _apply(changed: Parameters, new: GraphConfig, graph: Runner | Simulation) -> None:
    names = [ParameterName.parse(name) for name in changed]
    if any(name.section == "environment" for name in names):  # first, since it may be refused
        for node in graph.nodes:
            if isinstance(node, EnvironmentNode):
                change_environment(node, new.environment)
    for topic in sorted({name.topic for name in names if name.topic is not None}):
        _change_link(graph, topic, new)
    for node in graph.nodes:
        if LAW in changed and isinstance(node, DeviceNode):
            node.take_law(new.device.servo.law)


def _change_link(graph: Runner | Simulation, topic: str, config: GraphConfig) -> None:
    impairment = config.links.get(topic, Impairment())
    link = graph.link(topic)
    if link is not None:
        change_link(link, impairment)
    elif impairment != Impairment():
        graph.set_link(topic, build_link(topic, impairment, config.seed))
