"""A hand at a virtual world as an environment of gymnasium: the graph of a launch file, in steps.

Importing this module registers ``forcebound/Hand-v0`` with gymnasium. It needs the extra
``gymnasium``.
"""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from forcebound.errors import ConfigError, RunError
from forcebound.extras import check_installed
from forcebound.graph.graph import GraphConfig
from forcebound.graph.parameters import change
from forcebound.graph.problems import unknown
from forcebound.graph.resolved import kind_of
from forcebound.haptics.devices.simulated import pad
from forcebound.haptics.environments import Environment
from forcebound.haptics.environments.bodies import Bodies
from forcebound.haptics.hands import Operator
from forcebound.haptics.hands.hands import coordinates
from forcebound.haptics.hands.pointer import PointerHand
from forcebound.haptics.parts import overridden
from forcebound.interface.mujoco_picture import Painter
from forcebound.interface.runs import LaunchFile, configuration
from forcebound.messages.control import Point
from forcebound.messages.events import CODE_FAILED
from forcebound.messages.packets import (
    DeviceState,
    EnvironmentReply,
    Event,
    ForceCommand,
    Packet,
    SceneObject,
    Telemetry,
    Vector,
)
from forcebound.messages.topology import HAND
from forcebound.realtime import without_garbage_collection
from forcebound.run.virtual import VirtualGraph, check_has_virtual_time

check_installed("forcebound.interface.gym", "gymnasium")
import gymnasium  # noqa: E402

Numbers: TypeAlias = NDArray[np.float64]
OBSERVED = ("position", "velocity", "applied_force", "commanded_force")
TAKEN = (DeviceState, Telemetry, Event, EnvironmentReply, ForceCommand)

#: Ticks of a step, the newest last; the scene by the names of its objects; signals by their names.
Ticks: TypeAlias = Sequence[Telemetry]
Objects: TypeAlias = Mapping[str, SceneObject]
SignalValues: TypeAlias = Mapping[str, float]


class HapticEnv(gymnasium.Env[Any, Numbers]):
    """A simulated hand on its device at a world, in virtual time, ``frame_skip`` ticks a step.

    The action is the target of the hand, in m, shape (axes,). The hand follows it as that of
    ``operator: {kind: pointer}`` does: through a low-pass, no faster than its speed, and pulled by
    the spring and the damper of the hand in the launch file. So no action gives a hand that a
    person could not have, and the account of the energy stays exact.

    The observation is that of the newest tick, each of shape (axes,): ``position`` (m, as the
    device reads it), ``velocity`` (m/s), ``applied_force`` (N, by the motor) and
    ``commanded_force`` (N, before the law and the motor's limit). A force is positive where it
    resists motion in the positive direction. ``info`` has of the same tick its number ``tick``,
    ``elapsed`` (s), ``engagement`` (0 to 1), ``energy`` (J, from the hand into the device so far;
    below zero, the hand has received energy; None of a device without ground truth) and
    ``force_limit`` (N); and ``law`` and ``seed``.

    The reward is 0, and no episode ends by itself: override :meth:`reward` and :meth:`is_over`. One
    is truncated after the duration of the launch file. For another observation, override
    :meth:`observation` and set ``observation_space`` after ``super().__init__``.

    Attributes:
        config: The graph.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 100}  # noqa: RUF012 (of gymnasium)

    def __init__(
        self,
        file: LaunchFile = "stiff_wall",
        *,
        frame_skip: int = 10,
        render_mode: str | None = None,
        camera: str | None = None,
        width: int = 640,
        height: int = 480,
        **arguments: object,
    ) -> None:
        """Read a launch file.

        Args:
            file: A path, the name of one that comes with forcebound, or its content.
            frame_skip: Ticks of the servo for each step.
            render_mode: "rgb_array": :meth:`render` returns pictures of a world of kind ``bodies``.
            camera: Name of one in the scene; None: a view of all of it.
            width: Of a picture, in pixels.
            height: Of a picture, in pixels.
            arguments: As of :func:`forcebound.simulate`.

        Raises:
            ConfigError: With every problem of the file or an argument.
        """
        if not isinstance(frame_skip, int) or frame_skip < 1:
            raise ConfigError(f"frame_skip: expected a number of ticks >= 1, got {frame_skip}")
        config = configuration(file, arguments)
        check_has_virtual_time(config)
        if len(config.hands) > 1:
            raise ConfigError(f"HapticEnv has one hand; this graph has {', '.join(config.hands)}")
        modes = ["rgb_array"] if isinstance(config.environment.model, Bodies) else []
        if render_mode not in (None, *modes):
            kind = kind_of("environment", config.environment.model)
            raise ConfigError(
                'render_mode: expected None, or "rgb_array" with a world of kind bodies, which'
                f" MuJoCo draws; got {render_mode!r} with {kind}"
            )
        methods = {"observation", "reward", "is_over"}
        self._is_task = bool(methods & overridden(self, HapticEnv))
        self.render_mode = render_mode
        self._painter: Painter | None = None
        self._camera, self._size = camera, (width, height)
        hand, axes = _pointed(config.only.operator), config.only.axes
        self.config = config.with_hand(operator=hand)
        self._step_ns = frame_skip * config.only.servo.period_ns
        self.metadata = {"render_modes": modes, "render_fps": round(1e9 / self._step_ns)}
        self._seed = config.seed
        self._graph: VirtualGraph | None = None
        start = np.array(pad(coordinates(hand.start), axes))
        self.action_space = gymnasium.spaces.Box(
            start - hand.reach, start + hand.reach, dtype=np.float64
        )
        any_number = gymnasium.spaces.Box(-np.inf, np.inf, (axes,), np.float64)
        self.observation_space = gymnasium.spaces.Dict(dict.fromkeys(OBSERVED, any_number))

    @property
    def world(self) -> Environment:
        """The open environment of this episode; ResetNeeded before the first :meth:`reset`."""
        if self._graph is None:
            raise gymnasium.error.ResetNeeded("call reset() first")
        return self._graph.world.views.environment

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, object] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Open the graph again, the hand at rest at its start, and let its first tick pass.

        The force comes in over ``device.engage_time``.

        Args:
            seed: Of the graph, as ``forcebound simulate FILE --seed``; None: drawn from
                ``np_random``, so that the environments of a vector differ. ``info`` has it.
            options: Other parameters for this episode, by the names that ``forcebound param list``
                has, such as ``environment.stiffness``.

        Raises:
            ConfigError: If there is no such parameter, or it cannot have this value.
        """
        super().reset(seed=seed)
        self._seed = int(self.np_random.integers(2**31)) if seed is None else seed
        config = replace(self.config, seed=self._seed)
        config = change(config, dict(options)) if options else config
        self._end()
        self._begin(config)
        return self.observation(*self._seen()), self._info()

    def __deepcopy__(self, memo: dict[int, Any]) -> "HapticEnv":
        """Return a copy in the same state: the episode is repeated, which is exact."""
        made: HapticEnv = type(self).__new__(type(self))
        memo[id(self)] = made
        made.__dict__ |= deepcopy(self.__dict__ | {"_graph": None, "_painter": None}, memo)
        if self._graph is not None:
            made._begin(made._episode)
            for target in self._targets:
                made._go_to(target)
        return made

    def step(self, action: Numbers) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Move the target of the hand to ``action`` (m); let ``frame_skip`` ticks pass.

        Raises:
            ConfigError: If the action is no place.
            RunError: If code of the environment or the controller fails.
            gymnasium.error.ResetNeeded: Before the first :meth:`reset`.
        """
        graph = self._graph
        if graph is None:
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        target, shape = np.asarray(action, np.float64), self.action_space.shape
        if target.shape != shape or not np.isfinite(target).all():
            raise ConfigError(f"action: expected numbers in m, shape {shape}, got {action}")
        self._go_to(tuple(target.tolist()))
        seen = self._seen()
        observation, reward, is_over = (
            self.observation(*seen),
            self.reward(*seen),
            self.is_over(*seen),
        )
        is_late = graph.time_ns >= round(self.config.duration * 1e9)
        return observation, reward, is_over, is_late, self._info()

    def _begin(self, config: GraphConfig) -> None:
        self._episode, self._targets = config, list[Vector]()
        self._ticks: list[Telemetry] = []
        self._law = config.only.servo.law
        self._signals: dict[type[Packet], SignalValues] = {}
        taken = TAKEN if self._is_task else TAKEN[:3]
        self._graph = VirtualGraph(config, self._take, taken, has_views=False)
        self._graph.run(config.only.servo.period_ns)

    def _go_to(self, target: Vector) -> None:
        assert self._graph is not None
        self._targets.append(target)
        self._graph.devices[HAND].handle(Point(target))
        self._ticks = []
        with without_garbage_collection():
            self._graph.run(self._graph.time_ns + self._step_ns)

    def observation(self, telemetry: Ticks, scene: Objects, signals: SignalValues) -> Any:
        """Return the observation after a step, in ``observation_space``; to be overridden.

        Args:
            telemetry: Of the ticks of the step, the newest last; after :meth:`reset`, of the first.
            scene: What the environment draws, as it is now, by name.
            signals: Newest numbers that device, controller and environment publish, by name.
        """
        tick = telemetry[-1]
        seen = (tick.position, self._velocity, tick.applied_force, tick.commanded_force)
        return {name: np.array(value) for name, value in zip(OBSERVED, seen, strict=True)}

    def reward(self, telemetry: Ticks, scene: Objects, signals: SignalValues) -> float:
        """Return the reward of a step, with what :meth:`observation` gets: 0; to be overridden."""
        return 0.0

    def is_over(self, telemetry: Ticks, scene: Objects, signals: SignalValues) -> bool:
        """Return whether the episode has ended, likewise: no; to be overridden."""
        return False

    def render(self) -> Any:
        """Return a picture of the world, uint8, (height, width, 3); None without ``render_mode``.

        Raises:
            ConfigError: If nothing can draw here, or the scene has no such camera.
            gymnasium.error.ResetNeeded: Before the first :meth:`reset`.
        """
        if self.render_mode is None:
            return None
        drawn = self.world.mujoco()
        assert drawn is not None  # of bodies
        if self._painter is None or self._painter.signature != drawn[0].signature:
            self._end_painter()
            self._painter = Painter(drawn[0], *self._size, self._camera)
        return self._painter.picture(*drawn)

    def close(self) -> None:
        """Close the graph."""
        self._end()
        self._end_painter()

    def _end(self) -> None:
        if self._graph is not None:
            self._graph.close()
            self._graph = None

    def _end_painter(self) -> None:
        if self._painter is not None:
            self._painter.close()
            self._painter = None

    def _take(self, packet: Packet) -> None:
        if isinstance(packet, Telemetry):
            self._ticks.append(packet)
        elif isinstance(packet, DeviceState | EnvironmentReply | ForceCommand):
            if isinstance(packet, DeviceState):
                self._velocity = packet.velocity
            self._signals[type(packet)] = {} if packet.signals is UNSET else packet.signals
        elif isinstance(packet, Event) and packet.event in CODE_FAILED:
            raise RunError(packet.message)

    def _seen(self) -> tuple[Ticks, Objects, SignalValues]:
        """Return what the methods to be overridden get; nothing is asked if there are none."""
        if not self._is_task:
            return self._ticks, {}, {}
        drawn = self.world.scene() or ()
        signals = {name: value for each in self._signals.values() for name, value in each.items()}
        return self._ticks, _Objects((one.name, one) for one in drawn), signals

    def _info(self) -> dict[str, Any]:
        tick = self._ticks[-1]
        return {
            "tick": tick.seq,
            "elapsed": tick.elapsed,
            "engagement": tick.engagement,
            "energy": tick.true_energy,
            "force_limit": tick.force_limit,
            "law": self._law,
            "seed": self._seed,
        }


class _Objects(dict[str, SceneObject]):
    """What the world shows; a wrong name gets an error with those that there are."""

    def __missing__(self, name: str) -> SceneObject:
        raise KeyError(unknown("object of the scene", name, self))


def _pointed(hand: Operator | None) -> PointerHand:
    """The hand of a launch file, with a target that moves as somebody points."""
    if hand is None:
        raise ConfigError("no hand holds the device: expected a section operator")
    if isinstance(hand, PointerHand):
        return hand
    grip = {"mass": hand.mass, "stiffness": hand.stiffness, "damping": hand.damping}
    return PointerHand(start=hand.target(0.0), **grip)


gymnasium.register("forcebound/Hand-v0", "forcebound.interface.gym:HapticEnv")
