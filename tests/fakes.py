"""Small stand-ins that tests pass in."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from addresses import topic_endpoint

from forcebound.graph.servo import ServoSettings, dissipation_of
from forcebound.haptics.controllers.direct import DirectController
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.environments import EnvironmentModel
from forcebound.haptics.environments.walls import Wall
from forcebound.haptics.hands.hands import PressingHand
from forcebound.haptics.laws import Dissipation
from forcebound.messages.codec import encode
from forcebound.messages.packets import DeviceState, ForceCommand, Packet, Vector
from forcebound.network.chances import ComputationTime
from forcebound.network.impairment import Impairment
from forcebound.network.link import Link, link_seed
from forcebound.network.sockets import Network
from forcebound.nodes import Node
from forcebound.nodes.controller import ControllerNode
from forcebound.nodes.device import DeviceNode
from forcebound.nodes.environment import EnvironmentNode
from forcebound.run.simulation import LateTicks, Simulation
from forcebound.testing import Handle, OpenHandle

DISSIPATION = Dissipation(
    damping=0.27, friction=0.12, resolution=0.0, period=1e-3, hold_limit=1.25e-3, saturation=8.5
)


def device_node(axes: int = 1, **settings: Any) -> tuple[DeviceNode, OpenHandle]:
    """Return a device node over a handle; no law, no ramp, unless the settings say so."""
    device = OpenHandle(Handle(axes=axes))
    servo = ServoSettings(**{"law": "none", "engage_time": 0.0, **settings})
    return DeviceNode(device, DISSIPATION, servo), device


def answer(state: DeviceState, force: Vector, seq: int = 0) -> ForceCommand:
    """Return the command that answers ``state``."""
    return ForceCommand(seq, state.time_ns, state.seq, state.time_ns, force)


def press(
    law: str,
    seconds: float,
    *,
    servo: ServoSettings | None = None,
    environment: EnvironmentModel | None = None,
    computation: ComputationTime | None = None,
    late_ticks: LateTicks | None = None,
    **impairments: Impairment,
) -> list[Packet]:
    """Press a hand into a wall in virtual time; return every packet that was sent."""
    servo = replace(servo or ServoSettings(reply_wait=0.0), law=law)
    model = PhantomPremium15()
    device = DeviceNode(
        model.open(PressingHand(), servo.longest_hold),
        dissipation_of(model, servo),
        servo,
        lateness=None if late_ticks is None else late_ticks.of(servo),
    )
    links = {
        topic: Link[Packet](impairment, link_seed(1, topic))
        for topic, impairment in impairments.items()
    }
    nodes: list[Node] = [
        EnvironmentNode(environment or Wall(), computation),
        ControllerNode(DirectController()),
        device,
    ]
    packets: list[Packet] = []
    simulation = Simulation(nodes, links, packets.append)
    device.engage()
    simulation.run(round(seconds * 1e9))
    return packets


class Sender:
    """Publishes by hand on one topic."""

    def __init__(self, network: Network, run_dir: Path, topic: str) -> None:
        self._publisher = network.publisher(topic_endpoint(run_dir, topic))

    def send(self, data: Packet | bytes) -> None:
        self._publisher.send(data if isinstance(data, bytes) else encode(data))
