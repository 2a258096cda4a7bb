"""Two hands in virtual time, coupled by a spring, whose ledgers exchange energy or do not."""

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

from msgspec.structs import replace

from forcebound.graph.servo import ServoSettings, dissipation_of
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.hands import Operator
from forcebound.messages.events import EventLog
from forcebound.messages.packets import DeviceState, ForceCommand, Packet, Telemetry
from forcebound.messages.topology import Graph, graph_of
from forcebound.network.impairment import Impairment
from forcebound.network.link import Link, link_seed
from forcebound.nodes import Node
from forcebound.nodes.device import DeviceNode
from forcebound.run.simulation import Simulation

HANDS = ("left", "right")
COUPLING = "left/controller"  # one process for both hands


def _graph() -> Graph:
    graph = graph_of(HANDS, exchanges=[HANDS])
    ends = {"device_state": "receiver", "force_command": "sender"}
    streams = [
        replace(stream, **({ends[stream.topic]: COUPLING} if stream.topic in ends else {}))
        for stream in graph.streams
        if stream.topic in (*ends, "energy_transfer")
    ]
    names = ("left/device", "right/device", COUPLING)
    return Graph({name: graph.nodes[name] for name in names}, tuple(streams))


class Coupling(Node):
    """A spring and damper from each hand to the state of the other one, ``delay_ns`` ago."""

    wakes_on_arrival: ClassVar[bool] = True
    wake_ns: ClassVar[None] = None

    def __init__(self, stiffness: float, damping: float, delay_ns: int) -> None:
        self._stiffness, self._damping, self._delay_ns = stiffness, damping, delay_ns
        self._states: dict[str, list[DeviceState]] = {hand: [] for hand in HANDS}
        self.events = EventLog(COUPLING)
        self._seq = 0

    def step(self, time_ns: int, received: Sequence[Packet]) -> list[Packet]:
        commands: list[Packet] = []
        for state in received:
            assert isinstance(state, DeviceState)
            self._states[state.hand].append(state)
            (others,) = (states for hand, states in self._states.items() if hand != state.hand)
            while len(others) > 1 and others[1].time_ns <= time_ns - self._delay_ns:
                others.pop(0)
            if others and others[0].time_ns <= time_ns - self._delay_ns:
                commands.append(self._command(state, others[0], time_ns))
        return commands

    def _command(self, own: DeviceState, other: DeviceState, time_ns: int) -> ForceCommand:
        k, b = self._stiffness, self._damping
        places = zip(own.position, other.position, strict=True)
        speeds = zip(own.velocity, other.velocity, strict=True)
        force = tuple(
            k * (x - y) + b * (v - w) for (x, y), (v, w) in zip(places, speeds, strict=True)
        )
        self._seq += 1
        return ForceCommand(self._seq, time_ns, own.seq, own.time_ns, force, hand=own.hand)


def run_coupled(
    operators: Mapping[str, Operator | None],
    seconds: float,
    *,
    exchanges: bool = True,
    law: str = "certified",
    delay: float = 0.0,
    stiffness: float = 500.0,
    damping: float = 0.0,
    impairment: Impairment | None = None,
    devices: Mapping[str, PhantomPremium15] | None = None,
    observe: Callable[[Packet], None] = lambda packet: None,
    restarts: Sequence[tuple[float, str]] = (),
    stops: Sequence[tuple[float, str]] = (),
) -> dict[str, list[Telemetry]]:
    """Return the telemetry of both hands; ``impairment``: of the energy alone.

    ``restarts``: times, in s, at which a hand is to begin a new ledger; ``stops``: to end.
    """
    nodes: list[Node] = [Coupling(stiffness, damping, round(delay * 1e9))]
    for hand, partner in (HANDS, HANDS[::-1]):
        servo = ServoSettings(law=law, energy_partner=partner if exchanges else "", age_limit=1.0)
        model = (devices or {}).get(hand, PhantomPremium15())
        device = model.open(operators[hand], servo.opening_hold)
        nodes.append(DeviceNode(device, dissipation_of(model, servo), servo, hand=hand))
    found: dict[str, list[Telemetry]] = {hand: [] for hand in HANDS}

    def take(packet: Packet) -> None:
        observe(packet)
        if isinstance(packet, Telemetry):
            found[packet.hand].append(packet)

    bad = impairment or Impairment(delay=delay)
    links = {f"{hand}/energy_transfer": Link[Packet](bad, link_seed(1, hand)) for hand in HANDS}
    simulation = Simulation(nodes, links if exchanges else {}, take, graph=_graph())
    for node in nodes[1:]:
        assert isinstance(node, DeviceNode)
        node.engage()
    for time, hand in sorted((*restarts, *stops)):
        simulation.run(round(time * 1e9))
        node = nodes[1 + HANDS.index(hand)]
        assert isinstance(node, DeviceNode)
        if (time, hand) in stops:
            node.stop(simulation.time_ns)
        else:
            node.set(law)
    simulation.run(round(seconds * 1e9))
    return found
