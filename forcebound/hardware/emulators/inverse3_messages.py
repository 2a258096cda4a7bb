"""What clients of the Inverse3's service send, and the settings that it keeps, as JSON has them."""

from typing import Annotated, Any, Literal, TypeAlias

from msgspec import UNSET, Meta, Struct, UnsetType

from forcebound.messages.packets import Vector

NotNegative: TypeAlias = Annotated[float, Meta(ge=0.0)]
#: Settings of the service that can be written.
Writable: TypeAlias = dict[Literal["devices/force_scale"], NotNegative]


class Vec(Struct, frozen=True):
    """A vector of the tip."""

    x: float
    y: float
    z: float

    def entries(self) -> Vector:
        return self.x, self.y, self.z


class Angles(Struct, frozen=True):
    """A number of each joint."""

    a0: float
    a1: float
    a2: float

    def entries(self) -> Vector:
        return self.a0, self.a1, self.a2


class CursorForce(Struct, frozen=True):
    """A force in N; ``values`` is the form before 3.5."""

    vector: Vec | UnsetType = UNSET
    values: Vec | UnsetType = UNSET


class Commands(Struct, frozen=True):
    """What a device is to do in this tick: a force at the tip, torques of its joints."""

    set_cursor_force: CursorForce | UnsetType = UNSET
    set_angular_torques: dict[Literal["torques"], Angles] | UnsetType = UNSET


class Gravity(Struct, frozen=True):
    """The motors carry the arm's weight, or a share of it."""

    enabled: bool
    scaling_factor: float = 1.0


class Enabled(Struct, frozen=True):
    """A setting that is on or off."""

    enabled: bool


class Handedness(Struct, frozen=True):
    """For which hand the arm is mounted."""

    handedness: Literal["left", "right"]


class Preset(Struct, frozen=True):
    """A named mount, basis and origin."""

    preset: str


class ForceGate(Struct, frozen=True):
    """The share that is taken off while the tip oscillates."""

    gain: Annotated[float, Meta(ge=0.0, le=1.0)]


class Damping(Struct, frozen=True):
    """Damping at the tip in N s/m, alike or for each axis."""

    scalar: NotNegative | UnsetType = UNSET
    vector: Vec | UnsetType = UNSET

    def entries(self) -> Vector:
        """Return it for each axis."""
        alike = 0.0 if self.scalar is UNSET else self.scalar
        own = (0.0, 0.0, 0.0) if self.vector is UNSET else self.vector.entries()
        return tuple([alike + each for each in own])


class Configure(Struct, frozen=True):
    """Settings of a session, kept until it ends."""

    preset: Preset
    force_gate: ForceGate
    damping: Damping


class ToDevice(Struct, frozen=True):
    """What a message has for a device; ``configure`` is a part of :class:`Configure`."""

    device_id: str
    commands: Commands = Commands()
    configure: dict[str, Any] = {}


class Message(Struct, frozen=True):
    """A message to the state channel."""

    session: dict[str, Any] = {}
    inverse3: tuple[ToDevice, ...] = ()


class Shared(Struct, frozen=True):
    """Settings of the device that outlive every session."""

    gravity_compensation: Gravity
    handedness: Handedness
    torque_scaling: Enabled
    home_return: Enabled
