"""The Haply Inverse3 as its service sees it: an arm, the filters before its motors, its idling.

The maker publishes neither geometry nor friction nor largest force, and of the filters only what
they are for. What is assumed here is marked so; docs/devices.md lists it.
"""

import math
from dataclasses import dataclass, replace
from itertools import product
from operator import mul

from forcebound.haptics.devices import AxesModel, Truth
from forcebound.haptics.devices.desktop_arm import DesktopArm
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws.dissipation import per_axis
from forcebound.hardware.emulators.inverse3_messages import Enabled, Gravity, Handedness, Shared
from forcebound.hardware.emulators.mechanism import Mechanism
from forcebound.messages.packets import Vector

AXES = 3
ZERO: Vector = (0.0,) * AXES
LINK = 0.2  # m, of both links, assumed
GRAVITY = 9.81  # m/s^2, along -z
# Of the osc-damper and the force gate, assumed: the tip oscillates when it has turned round more
# than ALLOWED times, counted with a memory of MEMORY s, each time faster than SLOW m/s.
ALLOWED, MEMORY, SLOW = 3.0, 0.2, 2e-3


def arm_of(stated: AxesModel, mass: float) -> DesktopArm:
    r"""Return the emulated arm of a model of axes, ``mass`` kg at its tip.

    Its tip has at least the damping and friction that the model states, and half its resolution,
    in the corners and the middle of its box. With the Jacobian J, friction of joint j is the
    largest :math:`\sum_i f_i |J_{ij}|` (one number f: that along the path, f times the
    length of column j), its damping :math:`\sum_i b_i |J_{ij}| \sum_k |J_{ik}|`.
    """
    scale = LINK / DesktopArm.upper
    up, out = (scale * x for x in DesktopArm.origin)
    wide, high, deep = (scale * x for x in DesktopArm.workspace)
    arm = DesktopArm(
        upper=LINK,
        lower=LINK,
        origin=(up, out),
        workspace=(wide, high, deep),
        inertia=mass * LINK**2,
        largest_speed=None,
    )
    frictions = per_axis("friction", stated.friction, AXES)
    dampings = per_axis("damping", stated.damping, AXES)
    steps = per_axis("resolution", stated.resolution, AXES)
    friction, damping, step = [0.0] * AXES, [0.0] * AXES, math.inf
    kinematics = arm.kinematics()
    assert kinematics is not None  # the arm presents its tip
    for place in product(*[(-x / 2, 0.0, x / 2) for x in arm.workspace]):
        angles = arm.angles(place)
        assert angles is not None
        rows = [[abs(x) for x in row] for row in kinematics.jacobian(angles)]
        sums = [math.fsum(row) for row in rows]
        step = min(step, *(r / total for r, total in zip(steps, sums, strict=True)))
        for j, column in enumerate(zip(*rows, strict=True)):
            along = not isinstance(stated.friction, tuple)
            most = frictions[0] * math.hypot(*column) if along else sum(map(mul, frictions, column))
            friction[j] = max(friction[j], most)
            damping[j] = max(damping[j], sum(map(mul, map(mul, dampings, column), sums)))
    return replace(arm, damping=tuple(damping), friction=tuple(friction), resolution=step / 2)


@dataclass(frozen=True)
class Pull:
    """What a session wants of the motors in one tick, until the next or until it is too old.

    Attributes:
        force: At the tip, N, positive pushes towards larger coordinates.
        gate: Gain of the session's force gate.
        damping: Of the session's filter, N s/m.
        since_ns: When it came.
    """

    force: Vector
    gate: float
    damping: Vector
    since_ns: int


def shared_defaults() -> Shared:
    """Return the maker's defaults of the settings that outlive every session."""
    return Shared(Gravity(enabled=True), Handedness("right"), Enabled(True), Enabled(False))


class Oscillation:
    """How often the tip has turned round lately: ``level``."""

    def __init__(self) -> None:
        self.level = 0.0
        self._velocity: Vector = ZERO

    def sense(self, velocity: Vector, duration: float) -> None:
        """Take the velocity of the tip, in m/s, ``duration`` s after the one before."""
        self.level *= math.exp(-duration / MEMORY)
        if math.hypot(*velocity) > SLOW:
            self.level += sum(map(mul, velocity, self._velocity)) < 0.0
            self._velocity = velocity

    @property
    def gain(self) -> float:
        """What the osc-damper leaves of a force: 1 unless the tip oscillates."""
        return ALLOWED / max(self.level, ALLOWED)


class Inverse3:
    """The device: forces of sessions in, position and velocity of the tip out.

    A session's force ends ``idle`` s after it came, if no other comes.

    Attributes:
        shared: Its settings that outlive every session.
        force_scale: Factor of every force, of the service's settings.
        pulls: By session.
        is_locked: A safety function keeps the motors without force.
        force: What the motors give at the tip for the sessions, in N.
        lowest_energy: Least ground-truth energy so far, in J.
        longest_hold: Longest time so far that a force was on and no message came, in s.
    """

    def __init__(
        self, model: AxesModel, mass: float, operator: Operator | None, idle: float
    ) -> None:
        arm = arm_of(model, mass)
        self.mechanism = Mechanism(arm, operator, ZERO)
        kinematics = arm.kinematics()
        assert kinematics is not None
        self.kinematics = kinematics
        self._largest, self._weight = model.saturation, GRAVITY * mass
        self._idle_ns = round(idle * 1e9)
        self._oscillation = Oscillation()
        self.shared = shared_defaults()
        self.force_scale = 1.0
        self.pulls: dict[int, Pull] = {}
        self.is_locked = False
        self.force = ZERO
        self.lowest_energy = self.longest_hold = 0.0
        self._time_ns = 0

    def start(self, time_ns: int) -> None:
        """Begin at this time, at rest."""
        self._time_ns = time_ns
        self.mechanism.start(time_ns)

    def advance(self, time_ns: int) -> Truth:
        """Move on, end the forces that are too old, and return the ground truth."""
        due = [pull.since_ns + self._idle_ns for pull in self.pulls.values()]
        for end_ns in sorted(end for end in due if end <= time_ns):
            self.mechanism.advance(end_ns)
            self.apply(end_ns)
        self.mechanism.advance(time_ns)
        truth = self.mechanism.truth()
        self._oscillation.sense(truth.velocity, (time_ns - self._time_ns) * 1e-9)
        self._time_ns = time_ns
        self.lowest_energy = min(self.lowest_energy, truth.energy)
        if any(self.force):
            last_ns = max([pull.since_ns for pull in self.pulls.values()], default=time_ns)
            self.longest_hold = max(self.longest_hold, (time_ns - last_ns) * 1e-9)
        return truth

    def pull(self, session: int, pull: Pull | None, time_ns: int) -> None:
        """Let what a session wants act in place of what it wanted before."""
        self.pulls.pop(session, None)
        if pull is not None:
            self.pulls[session] = pull
        self.apply(time_ns)

    def apply(self, time_ns: int) -> None:
        """Let the motors give, from now on, what the filters leave of the sessions' forces."""
        for session, pull in list(self.pulls.items()):
            if time_ns - pull.since_ns >= self._idle_ns:
                del self.pulls[session]
        total = ZERO if self.is_locked else self._filtered()
        self.force = total
        gravity = self.shared.gravity_compensation
        carried = gravity.scaling_factor if gravity.enabled else 0.0
        at_tip = (*total[:2], total[2] - (1.0 - carried) * self._weight)
        angles = self.mechanism.angles
        self.mechanism.hold(time_ns, self.kinematics.torque(angles, at_tip))

    def _filtered(self) -> Vector:
        """Return the sum of the sessions' forces behind the filters, in N.

        Assumed: the force gate takes its gain's share away while the tip oscillates; the largest
        force is cut along its direction with torque scaling, on each axis without.
        """
        gain, velocity = self._oscillation.gain, self.mechanism.truth().velocity
        total = ZERO
        for pull in self.pulls.values():
            share = gain * (1.0 - pull.gate if gain < 1.0 else 1.0)
            own = zip(pull.force, pull.damping, velocity, strict=True)
            filtered = [share * f - b * v for f, b, v in own]
            total = tuple([a + b for a, b in zip(total, filtered, strict=True)])
        total = tuple([self.force_scale * f for f in total])
        if self.shared.torque_scaling.enabled:
            cut = min(1.0, self._largest / (math.hypot(*total) or math.inf))
            return tuple([cut * f for f in total])
        return tuple([min(max(f, -self._largest), self._largest) for f in total])
