"""From a configuration to the objects that run: the nodes and the links of a graph."""

from forcebound.launch.config import GraphConfig
from forcebound.messages.packets import Packet
from forcebound.network.impairment import Impairment
from forcebound.network.link import Link, link_seed
from forcebound.nodes import Node
from forcebound.nodes.controller import ControllerNode
from forcebound.nodes.device import DeviceNode, dissipation_of
from forcebound.nodes.environment import EnvironmentNode

NODE_KINDS = ("environment", "controller", "device")  # in the order in which they start


def build_node(kind: str, config: GraphConfig) -> Node:
    """Return the node of ``kind``, one of ``NODE_KINDS``."""
    if kind == "device":
        return build_device(config)
    if kind == "controller":
        return ControllerNode(config.controller.model)
    if kind == "environment":
        environment = config.environment
        return EnvironmentNode(environment.model, round(environment.compute_delay * 1e9))
    raise ValueError(f"expected a kind of node ({', '.join(NODE_KINDS)}), got {kind!r}")


def build_device(config: GraphConfig) -> DeviceNode:
    """Return the device node with its device, opened."""
    model, servo = config.device.model, config.device.servo
    device = model.open(config.operator, servo.longest_hold)
    return DeviceNode(device, dissipation_of(model, servo), servo)


def build_links(config: GraphConfig) -> dict[str, Link[Packet]]:
    """Return the links that do something to their packets, by topic; the others are perfect.

    Consumers want the newest value of every topic.
    """
    return {
        topic: Link(impairment, link_seed(config.seed, topic), newest_only=True)
        for topic, impairment in config.links.items()
        if impairment != Impairment()
    }
