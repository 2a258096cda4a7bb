"""Small stand-ins that tests pass in."""

from forcebound.bounding import Dissipation
from forcebound.devices.plant import Truth
from forcebound.messages.packets import DeviceState, ForceCommand, Vector
from forcebound.nodes.device import DeviceNode, ServoSettings

MS = 1_000_000  # ns

DISSIPATION = Dissipation(
    damping=0.27, friction=0.12, resolution=0.0, period=1e-3, hold_limit=1.25e-3, saturation=8.5
)


class FakeDevice:
    """A device that the test moves, and that remembers what was written."""

    def __init__(self, axes: int = 1) -> None:
        self.axes = axes
        self.position: Vector = (0.0,) * axes
        self.written: list[tuple[int, Vector]] = []
        self.engaged_ns: int | None = None

    def engage(self, time_ns: int) -> None:
        self.engaged_ns = time_ns

    def read(self, time_ns: int) -> Vector:
        return self.position

    def write(self, time_ns: int, force: Vector) -> Vector:
        self.written.append((time_ns, force))
        return force

    def truth(self) -> Truth | None:
        return None


def device_node(axes: int = 1, **settings: float | str) -> tuple[DeviceNode, FakeDevice]:
    """Return a device node over a fake device; no law, no ramp, unless the settings say so."""
    device = FakeDevice(axes)
    servo = ServoSettings(**{"law": "none", "engage_time": 0.0, **settings})  # type: ignore[arg-type]
    return DeviceNode(device, DISSIPATION, servo), device


def answer(state: DeviceState, force: Vector, seq: int = 0) -> ForceCommand:
    """Return the command that answers ``state``."""
    return ForceCommand(seq, state.time_ns, state.seq, state.time_ns, force)
