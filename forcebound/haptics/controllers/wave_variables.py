r"""Wave variables: the two ends exchange waves, which a delay cannot fill with energy.

With the wave impedance b, F on the hand (positive: it resists) and v of the hand,

.. math::

    u = \frac{b v + F}{\sqrt{2 b}}, \qquad w = \frac{b v - F}{\sqrt{2 b}}, \qquad
    F v = \tfrac12 u^2 - \tfrac12 w^2

u goes to the environment, w comes back, each vector axis by axis. At the hand w and the measured v
give the force; at the environment u and the answer of the environment give the motion, which is
solved for implicitly, since an explicit step is unstable below b = K T / 2:

.. math:: F = b v - \sqrt{2 b}\,w, \qquad
          v_e = \sqrt{2 / b}\,u - F_e / b, \qquad F_e = F_{env}(x_e + v_e\,dt, v_e)

A query carries :math:`\sqrt{2 / b}\,u` as its velocity and the time that it stands for as the
signal ``wave_time``; w follows from the reply's force and the u that it answers.

**Delay that varies.** What arrives between two states is one wave, of the mean of the waves and the
sum S of their times; it is scaled by :math:`\sqrt{S / dt}`, which is :math:`\sqrt{1 - dT/dt}` of
samples. It never has more energy than was sent. Nothing arrived: the wave is zero. The environment
steps with the time of each wave, so for it no delay varies, and a lost wave is left out. A lost or
scaled wave leaves a drift of the position: wave integrals and the drift correction of the 2004
paper are not implemented.

**What is felt.** At low frequency the delay, T each way, feels as a mass b T in free motion, as a
spring b / T in series with a stiff wall. Reflections (a period of 4 T in free motion) die out fast
where b is the damping of device and hand.

What the method leaves out is left out here, too: v is the device's low-passed difference of
readings, and F is held while the hand moves on. So the device gives some energy all the same where
its own damping is small; no law but `none` is of use.

Source: G. Niemeyer and J.-J. E. Slotine, Stable adaptive teleoperation, IEEE Journal of Oceanic
Engineering 16(1), 1991, and Telemanipulation with time delays, International Journal of Robotics
Research 23(9), 2004 (with a low-pass of the wave, ``cutoff``); the scaling: R. Lozano, N. Chopra
and M. W. Spong, Passivation of force reflecting bilateral teleoperators with time varying delay,
Mechatronics, 2002. The algebra was checked, not the papers' text.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from forcebound.haptics.controllers import Ask, Controller, ControllerModel, SecondPort
from forcebound.haptics.controllers.estimating import REMEMBERED
from forcebound.haptics.controllers.plane import along, dot
from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import DeviceState, EnvironmentQuery, EnvironmentReply, Vector
from forcebound.quantities import POSITIVE, Damping, Frequency, Ranged, Time

_SENT = ("wave_time", "energy_in", "energy_out")
TRIES, EXACT = 40, 1e-6  # of the implicit step: at most, and the relative error that ends it


@dataclass(frozen=True, kw_only=True)
class WaveVariables(Ranged, ControllerModel):
    """Parameters of the wave variables.

    Attributes:
        impedance: b, the wave impedance; best is about the damping of device and hand.
        cutoff: Of the low-pass of the wave that comes back.
        hold: Silence of the environment after which there is no force.
    """

    impedance: Annotated[Damping, POSITIVE] = 2.0
    cutoff: Annotated[Frequency, POSITIVE] = 100.0
    hold: Annotated[Time, POSITIVE] = 0.1

    answers_states = True
    takes_contacts = False
    signals = (
        Signal(_SENT[0], "s", "time that the wave of this query stands for"),
        Signal(_SENT[1], "J", "of the waves to the environment"),
        Signal(_SENT[2], "J", "of the waves from it"),
    )
    port_signals = (
        Signal("port_energy_in", "J", "of the waves that the environment sent"),
        Signal("port_energy_out", "J", "of the waves that it received"),
    )

    def open(self, axes: int) -> "HandPort":
        return HandPort(self, axes)

    def open_port(self, axes: int) -> "EnvironmentPort":
        return EnvironmentPort(self.impedance, axes)


class HandPort(Controller):
    """The port at the hand."""

    def __init__(self, model: WaveVariables, axes: int) -> None:
        self._model, self._zero = model, (0.0,) * axes
        self._root = math.sqrt(2.0 * model.impedance)
        self._sent: dict[int, tuple[Vector, float]] = {}  # u and its time, s, by tick
        self._arrived, self._time = self._zero, 0.0  # sum of w dt, and of dt, since the last state
        self._back = self._wave = self._zero  # w after the low-pass, u
        self._before_ns, self._heard_ns = 0, -1
        self._entered = self._left = 0.0  # J

    def on_state(self, state: DeviceState, time_ns: int) -> Vector | None:
        """Take what has arrived; return the force, and make the wave to send."""
        dt = max(state.time_ns - self._before_ns, 0) * 1e-9 if self._before_ns else 0.0
        angle = 2.0 * math.pi * self._model.cutoff * dt
        scale = angle / (1.0 + angle) / math.sqrt(self._time * dt) if self._time * dt > 0.0 else 0.0
        kept = along(self._zero, self._back, 1.0 / (1.0 + angle))
        self._back = along(kept, self._arrived, scale)
        self._wave = along(along(self._zero, self._back, -1.0), state.velocity, self._root)
        self._arrived, self._time, self._before_ns = self._zero, 0.0, state.time_ns
        self._entered += 0.5 * dot(self._wave, self._wave) * dt
        self._left += 0.5 * dot(self._back, self._back) * dt
        self._sent[state.seq] = self._wave, dt
        if len(self._sent) > REMEMBERED:
            del self._sent[next(iter(self._sent))]
        self.signal_all(_SENT, (dt, self._entered, self._left))
        if self._heard_ns < 0 or time_ns - self._heard_ns > self._model.hold * 1e9:
            return None
        resisting = along(self._zero, state.velocity, self._model.impedance)
        return along(resisting, self._back, -self._root)

    def query(self, state: DeviceState) -> tuple[Vector, Vector]:
        """Return the hand's position, where the environment's begins, and the wave, in m/s."""
        return state.position, along(self._zero, self._wave, self._root / self._model.impedance)

    def on_reply(self, reply: EnvironmentReply, time_ns: int) -> None:
        """Take the wave that comes back, once."""
        self._heard_ns = time_ns
        wave, dt = self._sent.pop(reply.device_seq, (self._zero, 0.0))
        back = along(wave, reply.force, -self._root / self._model.impedance)
        self._arrived = along(self._arrived, back, dt)
        self._time += dt


class EnvironmentPort(SecondPort):
    """The port at the environment."""

    def __init__(self, impedance: float, axes: int) -> None:
        self._impedance, self._zero = impedance, (0.0,) * axes
        self._place: Vector | None = None  # of the environment's end, m
        self._force: Vector = (0.0,) * axes  # N, of the last step
        self._share = 1.0  # of the force of a free step that remained at the last contact
        self._entered = self._left = 0.0  # J

    def answer(
        self, query: EnvironmentQuery, signals: Mapping[str, float], ask: Ask
    ) -> tuple[Vector, Mapping[str, float]]:
        """Move with the wave."""
        b, dt, free = self._impedance, signals["wave_time"], query.velocity  # v_e without a force
        place = query.position if self._place is None else self._place
        expected = along(free, self._force, -1.0 / b)
        ask(along(place, expected, dt), expected)  # with the first answer a moving world moves on
        force, velocity = self._step(free, dt, ask, place)
        self._force = force
        self._place = along(place, velocity, dt)
        back = along(free, force, -2.0 / b)  # sqrt(2 / b) w
        self._left += 0.25 * b * dot(free, free) * dt
        self._entered += 0.25 * b * dot(back, back) * dt
        return force, {"port_energy_in": self._entered, "port_energy_out": self._left}

    def _step(self, free: Vector, dt: float, ask: Ask, place: Vector) -> tuple[Vector, Vector]:
        """Return the force, in N, and the velocity, in m/s, that fit each other.

        The force is ``share`` of that of a free step, which is bisected down to a contact, where
        chords then find it.
        """
        force = ask(along(place, free, dt), free)
        size = math.hypot(*force)
        direction, velocity, share = force, free, self._share
        for _ in range(TRIES if size > 0.0 else 0):
            velocity = along(free, direction, -share / self._impedance)
            force = ask(along(place, velocity, dt), velocity)
            got = math.hypot(*force) / size
            if abs(got - share) <= EXACT * share:
                self._share = share
                break
            share = 0.5 * share if got == 0.0 else share / max(share + 1.0 - got, share)
            direction = along(self._zero, force, 1.0 / got) if got > 0.0 else direction
        return force, velocity
