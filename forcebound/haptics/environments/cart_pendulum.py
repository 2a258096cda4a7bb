r"""A cup with a ball that swings in it: a cart with a pendulum, coupled to the hand.

With the place x of the cup, the angle :math:`\theta` of the ball from where it hangs, and the force
F of the coupling on the cup,

.. math::
    (M + m)\,\ddot x + m l\,(\ddot\theta \cos\theta - \dot\theta^2 \sin\theta) = F, \qquad
    l\,\ddot\theta + \ddot x \cos\theta + g \sin\theta + c\,l\,\dot\theta / m = 0.

``coupled``: by spring and damper, :math:`F = k (x_h - x) + b (\dot x_h - \dot x)`, with the place
:math:`x_h` of the hand. ``acceleration``: the cup is where the hand is, and F follows from the
first equation, with the acceleration from differences of the velocity through a low-pass filter of
first order: F = M a, which a device that displays forces cannot render for a mass well above its
own.

Source of the case and its numbers: the project hapticore, decision record 010 and its
``CartPendulumField``, 2026: a task for a delta.3 at 4 kHz.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from forcebound.errors import ConfigError
from forcebound.haptics.environments import Environment, EnvironmentModel, within_reach
from forcebound.haptics.environments.walls import on_first_axis
from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import SceneObject, Vector
from forcebound.quantities import Damping, Frequency, Length, Mass, Range, Stiffness, check_ranges

STEP, LONGEST = 1e-4, 0.1  # s: of the integration; a cup that is not asked for longer stands still
GRAVITY = 9.81  # m/s^2
CUP = 0.040  # m, as drawn


@dataclass(frozen=True)
class CartPendulum(EnvironmentModel):
    """A cup with a ball in it, along the first axis, for one hand that holds the cup.

    Attributes:
        cup: Mass of the cup.
        ball: Mass of the ball.
        length: Of the pendulum.
        ball_damping: Of the ball against the cup.
        rendering: Whether the hand holds the cup by spring and damper, or moves it as its own.
        stiffness: Of the coupling.
        damping: Of the coupling.
        cutoff: Of the low-pass filter of the acceleration.
    """

    signals = (
        Signal("cup", "m", "place of the cup"),
        Signal("angle", "rad", "angle of the ball"),
    )

    cup: Annotated[Mass, Range(at_least=0.01)] = 2.4
    ball: Annotated[Mass, Range(at_least=0.01)] = 0.6
    length: Annotated[Length, Range(at_least=0.01)] = 0.3
    ball_damping: Annotated[Damping, Range(at_least=0, at_most=10)] = 1.0
    rendering: Literal["coupled", "acceleration"] = "coupled"
    stiffness: Annotated[Stiffness, Range(at_least=0, at_most=1e5)] = 800.0
    damping: Annotated[Damping, Range(at_least=0, at_most=50)] = 2.0
    cutoff: Annotated[Frequency, Range(above=0)] = 30.0

    def __post_init__(self) -> None:
        check_ranges(self)

    def check_hands(self, hands: tuple[str, ...]) -> None:
        if len(hands) > 1:
            raise ConfigError(f"one hand holds the cup, and the graph has {', '.join(hands)}")

    def open(self, axes: int) -> "_Cup":
        return _Cup(self, axes)


class _Cup(Environment):
    """An open cup and its ball, integrated by the symplectic Euler rule."""

    def __init__(self, model: CartPendulum, axes: int) -> None:
        self._model, self._axes, self._time = model, axes, 0.0
        self._hand = self._hand_speed = self._acceleration = 0.0  # as asked last
        self._place = self._speed = self._angle = self._turning = 0.0

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        x, v = within_reach(position[0]), within_reach(velocity[0])
        dt, self._time = min(max(elapsed - self._time, 0.0), LONGEST), elapsed
        if elapsed <= 0.0:  # taken where the hand is, at rest
            self._hand, self._hand_speed, self._place = x, v, x
        is_coupled = self._model.rendering == "coupled"
        force = (self._coupled if is_coupled else self._accelerated)(x, v, dt)
        self._hand, self._hand_speed = x, v
        self.signal("cup", self._place)
        self.signal("angle", self._angle)
        return on_first_axis(force, self._axes)

    def _coupled(self, x: float, v: float, dt: float) -> float:
        """Move the cup while the hand goes evenly to ``x``; return the force of the coupling."""
        model, steps = self._model, math.ceil(dt / STEP)
        for i in range(steps):
            hand = self._hand + (x - self._hand) * (i + 0.5) / steps
            pull = model.stiffness * (hand - self._place) + model.damping * (v - self._speed)
            self._swing(self._acceleration_by(pull), dt / steps)
        return model.stiffness * (x - self._place) + model.damping * (v - self._speed)

    def _acceleration_by(self, pull: float) -> float:
        """Return the acceleration of the cup under a force, in m/s^2: both equations solved."""
        model, sin, cos = self._model, math.sin(self._angle), math.cos(self._angle)
        swing = model.length * self._turning
        ball = model.ball * sin * (swing * self._turning + GRAVITY * cos)
        return (pull + ball + model.ball_damping * swing * cos) / (model.cup + model.ball * sin**2)

    def _swing(self, acceleration: float, dt: float) -> float:
        """Move cup and ball; return the angular acceleration of the ball, in rad/s^2."""
        model, sin, cos = self._model, math.sin(self._angle), math.cos(self._angle)
        drag = model.ball_damping * self._turning / model.ball
        turning = -(acceleration * cos + GRAVITY * sin) / model.length - drag
        self._turning += dt * turning
        self._angle += dt * self._turning
        self._speed += dt * acceleration
        self._place += dt * self._speed
        return turning

    def _accelerated(self, x: float, v: float, dt: float) -> float:
        """Take the cup along with the hand; return what moves both, M a and the ball's part."""
        model = self._model
        if dt > 0.0:
            share = -math.expm1(-2.0 * math.pi * model.cutoff * dt)
            self._acceleration += share * ((v - self._hand_speed) / dt - self._acceleration)
        steps, turning = max(math.ceil(dt / STEP), 1), 0.0
        for _ in range(steps):
            turning = self._swing(self._acceleration, dt / steps)
        self._place, self._speed = x, v
        bends = turning * math.cos(self._angle) - self._turning**2 * math.sin(self._angle)
        return (model.cup + model.ball) * self._acceleration + model.ball * model.length * bends

    def scene(self) -> tuple[SceneObject, ...]:
        length, angle = self._model.length, self._angle
        ball = (self._place + length * math.sin(angle), 0.0, length * (1.0 - math.cos(angle)))
        return (
            SceneObject("cup", "box", (self._place, 0.0, 0.0), size=(CUP,) * 3, is_fixed=False),
            SceneObject("ball", "sphere", ball, size=(0.3 * CUP,), is_fixed=False),
        )

    def change(self, model: CartPendulum) -> bool:
        self._model = model
        return True
