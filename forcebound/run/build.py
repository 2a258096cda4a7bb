"""Nodes and links of a graph, made from its configuration."""

import random
import time
from collections.abc import Callable

from forcebound.errors import ConfigError, DeviceError
from forcebound.graph.graph import KINDS, GraphConfig, HandConfig
from forcebound.graph.model import Makes
from forcebound.graph.servo import dissipation_of
from forcebound.haptics.devices import Device
from forcebound.haptics.devices.guard import GuardedDevice
from forcebound.haptics.devices.simulated import SimulatedDevice
from forcebound.haptics.parts.user_module import describe_user_error
from forcebound.messages.packets import Packet
from forcebound.messages.topology import HAND, node_name
from forcebound.network.chances import ComputationTime
from forcebound.network.impairment import Impairment
from forcebound.network.link import Link, link_seed
from forcebound.nodes import Node
from forcebound.nodes.controller import ControllerNode
from forcebound.nodes.device import DeviceNode
from forcebound.nodes.environment import EnvironmentNode
from forcebound.nodes.lease import LEASE_NS
from forcebound.nodes.ports import Ports
from forcebound.recordings.delay_traces import trace_of
from forcebound.roles import CONTROLLER, DEVICE, ENVIRONMENT
from forcebound.run.bus import reads_once


def parts_of(role: str) -> Makes:
    """Return which parts of a configuration the process of a node makes: those it runs."""
    more = {DEVICE: "operator", ENVIRONMENT: "controller"}  # which has its second port there
    sections = (role, more.get(role, role))
    return lambda section, kind: section in sections


def build_node(
    name: str,
    config: GraphConfig,
    environment_name: str = ENVIRONMENT,
    clock: Callable[[], int] | None = None,
) -> Node:
    """Return a node of a graph with its parts.

    The graph knows an environment process from others by ``environment_name``. ``clock`` gives the
    time, in ns, of a device without stamps; None: virtual time. ConfigError or DeviceError if a
    part cannot be opened.
    """
    node = config.graph.nodes[name]
    if node.role == ENVIRONMENT:
        model, computation = config.environment.served, config.environment.computation
        seed = link_seed(config.seed, "computation")
        times = ComputationTime(computation, seed, trace_of(computation))
        axes = next(iter(config.hands.values())).axes  # all have as many
        models = {name: hand.controller for name, hand in config.hands.items()}
        models = {name: model for name, model in models.items() if model.port_signals}
        ports = Ports(models, axes) if models else None
        return EnvironmentNode(model, times, environment_name, axes, list(config.hands), ports)
    hand_name = node.hand or HAND
    hand = config.hands[hand_name]
    if node.role == DEVICE:
        return build_device(hand, clock, name=hand_name)
    if node.role == CONTROLLER:
        try:
            controller = hand.controller.open(hand.axes)
        except Exception as error:
            raise ConfigError(f"controller: open: {describe_user_error(error)}") from error
        leases = lease_ns(hand), dead_lease_ns(hand)
        signals, has_port = hand.controller.declared(), bool(hand.controller.port_signals)
        return ControllerNode(controller, *leases, hand_name, signals, has_port)
    raise KeyError(name)


def lease_ns(hand: HandConfig) -> int:
    """Return the silence after which another environment may serve, in ns."""
    return max(LEASE_NS, dead_lease_ns(hand))


def dead_lease_ns(hand: HandConfig) -> int:
    """Return the same for an environment whose process has ended, in ns.

    The force of its last answer is at zero after the age limit.
    """
    return round(2e9 * hand.servo.age_limit)


def build_device(
    hand: HandConfig,
    clock: Callable[[], int] | None = None,
    lateness: Callable[[], int] | None = None,
    name: str = HAND,
) -> DeviceNode:
    """Return the device node of a hand with its device, opened; DeviceError if that fails."""
    model, servo, operator = hand.device, hand.servo, hand.operator
    hands = KINDS["operator"]
    try:
        device = model.open(operator, servo.opening_hold)
    except Exception as error:
        words = str(error) if isinstance(error, DeviceError) else describe_user_error(error)
        raise DeviceError(f"the device cannot be opened: {words}") from error
    if not isinstance(device, Device):
        raise DeviceError(f"open must return a forcebound.haptics.devices.Device, got {device!r}")
    kind = hands.kind_of(type(operator))
    is_shipped = operator is None or (kind is not None and hands.is_shipped(kind))
    # A simulated one cannot fail in a hand of ours, and runs in sweeps.
    if not (isinstance(device, SimulatedDevice) and is_shipped):
        device = GuardedDevice(device)
    signals = model.declared()
    dissipation = dissipation_of(model, servo)
    process = 0 if clock is None else process_number()
    try:
        once = reads_once(device, model, servo, clock)
    except BaseException:
        device.close()
        raise
    return DeviceNode(device, dissipation, servo, clock, lateness, name, signals, process, once)


def process_number() -> int:
    """Return a number after which this process counts its ledgers, and no other process does.

    The s of the wall clock, so that it grows also with a restart of the machine, then 31 bits by
    chance.
    """
    return (int(time.time()) << 31) + random.SystemRandom().getrandbits(31)


def build_links(config: GraphConfig) -> dict[str, Link[Packet]]:
    """Return the impaired links by stream; the others are perfect."""
    return {
        node_name(name, topic): build_link(node_name(name, topic), impairment, config.seed)
        for name, hand in config.hands.items()
        for topic, impairment in hand.links.items()
        if impairment != Impairment()
    }


def build_link(stream: str, impairment: Impairment, seed: int) -> Link[Packet]:
    """Return the link of a stream in a graph with this seed."""
    return Link(impairment, link_seed(seed, stream), trace_of(impairment))
