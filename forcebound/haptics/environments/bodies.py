"""Rigid bodies of a MuJoCo scene, which the hand pushes.

A *probe*, a small ball that touches the bodies, hangs on the hand by a spring and a damper (a
virtual coupling). Or the probe touches nothing and holds a *tool* of the scene, such as the tip of
an arm. What the coupling pulls is what the hand feels. Each hand has a probe, which
appears when it first asks; all of them push the same bodies, and each other.

Source: E. Todorov, T. Erez, Y. Tassa, MuJoCo: a physics engine for model-based control, IROS 2012;
the coupling: J. E. Colgate, M. C. Stanley, J. M. Brown, Issues in the haptic display of tool use,
IROS 1995.
"""

import logging
import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from forcebound.errors import ConfigError
from forcebound.haptics.environments import (
    Environment,
    EnvironmentModel,
    SharedClock,
    within_reach,
)
from forcebound.haptics.environments.mujoco_scene import (
    PROBE,
    STEPS,
    body_of,
    check_coupling,
    compile_scene,
    engine,
    probe_name,
    shape_of,
)
from forcebound.haptics.environments.mujoco_state import SceneState
from forcebound.haptics.geometry.vectors import (
    ZERO,
    Vector3,
    add,
    along,
    cut,
    norm,
    pad3,
    scale,
    sub,
)
from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import MAX_NAME, Contact, SceneObject, Vector
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Damping,
    Length,
    Mass,
    Range,
    Ranged,
    Stiffness,
    Time,
)

MOST_STEPS = 20  # for one answer; a scene that falls farther behind stands still
TOUCH = 1e-6  # m, least distance between hand and probe of a contact
STATE = ("qpos", "qvel", "act", "ctrl", "mocap_pos", "mocap_quat", "qacc_warmstart")

# Warnings of MuJoCo after which it puts everything back: mjWARN_BADQPOS to BADQACC.
BAD = slice(3, 6)

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Bodies(Ranged, EnvironmentModel):
    """Rigid bodies of an MJCF or URDF file; needs the extra ``mujoco``.

    ``F = k (x - p) + b (v - v_p)``, of the probe's position ``p`` and velocity ``v_p``; the probe
    feels ``F``. The scene advances by its time step, as far as the time since the last question
    goes. It is compiled with a probe for each hand of the graph; one with a tool serves one hand.

    Attributes:
        file: The scene, in MuJoCo's XML format or as URDF. It may name other files, which MuJoCo
            reads itself.
        tool: Name of a site or body of the scene, which the hand takes where it is; null: none.
        timestep: Of the scene; null: that of the file.
        stiffness: Of the coupling between hand and probe.
        damping: Of the coupling.
        probe_mass: Of the probe; the hand feels it in free motion, too. With a tool it is added to
            the tool's, or is that of a mocap body.
        probe_radius: Of the probe.
        key: Name of the file's keyframe in which the scene begins; null: as the bodies are placed.
        record: Signals that carry the state of the scene: qpos, qvel, sensors, the name of a body
            (pose and velocity), "contact NAME" (force of contacts on a body or geom).
    """

    file: Path
    tool: str | None = None
    timestep: Annotated[Time, Range(at_least=STEPS[0], at_most=STEPS[1])] | None = None
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 1000.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 2.0
    probe_mass: Annotated[Mass, POSITIVE] = 0.010
    probe_radius: Annotated[Length, POSITIVE] = 0.005
    key: str | None = None
    record: tuple[str, ...] = ()

    def declared(self) -> Collection[Signal]:
        """Return what ``record`` chooses; nothing where MuJoCo is not installed."""
        return self._declared

    @cached_property
    def _declared(self) -> Collection[Signal]:
        if not self.record or find_spec("mujoco") is None:
            return ()
        return _Scene(self, 3).state.signals

    def check_files(self) -> None:
        """Compile the scene, unless MuJoCo is only installed where the environment runs."""
        if find_spec("mujoco") is not None:
            _Scene(self, 3)

    def check_hands(self, hands: tuple[str, ...]) -> None:
        if self.tool is not None and len(hands) > 1:
            message = f"a tool is for one hand, and the graph has {', '.join(hands)}"
            raise ConfigError(message, field="tool")

    def open(self, axes: int) -> "_Scene":
        return _Scene(self, axes)


class _Probe:
    """The probe of a hand, in a scene and its data."""

    def __init__(self, scene: Any, data: Any, number: int, tool: int | None) -> None:
        geom = scene.geom(probe_name(number))
        self.geom: int = geom.id
        self.body = scene.body(int(geom.bodyid[0]))
        self.joints = _three(self.body.jntadr[0])
        place = _three(scene.jnt_qposadr[self.body.jntadr[0]])
        self.motion = _three(scene.jnt_dofadr[self.body.jntadr[0]])
        # Views into MuJoCo's memory, which stays where it is: to make them takes a while.
        self.place, self.spring_end = data.qpos[place], scene.qpos_spring[place]  # m
        self.speed = data.qvel[self.motion]  # m/s
        self.applied = data.qfrc_applied[self.motion]  # N, by the hand's damper
        self.pushed = data.qfrc_constraint[self.motion]  # N, by contacts, and by the tie to a tool
        rigid = scene.body_weldid
        # By number of a geom, with one more for -1, which is none.
        touched = rigid[scene.geom_bodyid] == rigid[self.body.id if tool is None else tool]
        self.touches = np.append(touched, False)


@dataclass
class _Hand:
    """A hand at its probe."""

    number: int  # of the probe
    before: Vector3  # m, until where the scene has followed it
    place: Vector3  # m, as asked last
    speed: Vector = ZERO  # m/s
    is_away: bool = False


class _Scene(Environment):
    """An open scene."""

    def __init__(self, model: Bodies, axes: int) -> None:
        self._mujoco = engine()
        self._axes = axes
        self._expected = 1  # hands
        self._begin(model)

    def _begin(self, model: Bodies) -> None:
        """Begin where the file has everything."""
        self._model = model
        self._compile(self._expected)
        # Where the probe is before it has moved: in the scene, and in the hand's coordinates.
        self._home: Vector3 = tuple(self._probes[0].body.pos.tolist())
        self._origin: Vector3 = ZERO
        self._hands: dict[str, _Hand] = {}
        self._clock = SharedClock()
        self._elapsed = 0.0  # s, until which the scene has gone
        self._has_flown = False
        self.published.numbers.clear()

    def expect(self, users: Collection[str]) -> None:
        if len(users) > 1 and self._model.tool is None:
            self._expected = len(users)
            self._begin(self._model)

    def _compile(self, probes: int) -> None:
        model = self._model
        self._scene = compile_scene(self._mujoco, model, probes)
        self._data = self._mujoco.MjData(self._scene)
        self._step: float = self._scene.opt.timestep  # s
        self._warnings = self._data.warning.number[BAD]  # a view, as those of a probe
        self._drawn = [self._drawn_as(i) for i in range(self._scene.ngeom)]
        self._put_at_start()
        tool = None if model.tool is None else body_of(model.tool, self._scene)
        self._probes = [_Probe(self._scene, self._data, n, tool) for n in range(probes)]
        for number in range(probes):
            self._set_contacts(number, False)  # until a hand has it
        self._set_coupling(model)
        self.state = SceneState(self._mujoco, self._scene, self._data, model.record)

    def _set_coupling(self, model: Bodies) -> None:
        for probe in self._probes:
            self._scene.jnt_stiffness[probe.joints] = model.stiffness
            self._scene.dof_damping[probe.motion] = model.damping

    def _join(self, user: str, place: Vector3, now: float) -> _Hand:
        """Give a hand a probe; the bodies stay as they are."""
        number = len(self._hands)
        if number == 0:
            self._elapsed = now
        elif self._model.tool is not None:
            message = f"tool: the hand {next(iter(self._hands))!r} has it: a tool is for one hand"
            raise ConfigError(message, field="tool")
        elif number == len(self._probes):
            before = self._data
            self._compile(number + 1)
            self._data.time = before.time
            for name in STATE:  # what the new probe adds comes last
                old, new = getattr(before, name), getattr(self._data, name)
                new[: len(old)] = old
            for hand in self._hands.values():
                self._set_contacts(hand.number, not hand.is_away)
        hand = self._hands[user] = _Hand(number, place, place)
        self._set_contacts(number, True)
        self._couple(hand)
        if number > 0:
            self._mujoco.mj_forward(self._scene, self._data)
        return hand

    def leave(self, user: str) -> None:
        hand = self._hands.get(user)
        if hand is not None and self._model.tool is None:
            hand.is_away, hand.speed, hand.before = True, ZERO, hand.place
            self._set_contacts(hand.number, False)
        self._clock.leave(user)

    def _set_contacts(self, number: int, do_act: bool) -> None:
        """Let a probe, not one with a tool, touch things or pass through them."""
        if self._model.tool is None:
            geom = self._probes[number].geom
            self._scene.geom_contype[geom] = self._scene.geom_conaffinity[geom] = int(do_act)

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        x, y, z = map(within_reach, pad3(position))
        now, hand = self._clock.at(user, elapsed), self._hands.get(user)
        if hand is None:
            hand = self._join(user, (x, y, z), now)
        hand.before, hand.place = hand.place, (x, y, z)
        hand.speed = tuple(map(within_reach, pad3(velocity)))  # at most 10 m/s
        if hand.is_away:
            hand.is_away, hand.before = False, hand.place
            self._set_contacts(hand.number, True)
            self._couple(hand)
        self._advance(now)
        if self.state.names:
            self.signal_all(self.state.names, self.state.values())
        stiffness, damping = self._model.stiffness, self._model.damping
        speed = self._probes[hand.number].speed.tolist()
        pulls = zip(hand.place, self._probed(hand), hand.speed, speed, strict=True)
        force = [stiffness * (at - p) + damping * (v - v_p) for at, p, v, v_p in pulls]
        return cut((force[0], force[1], force[2]), self._axes)

    def _advance(self, now: float) -> None:
        """Let the scene go on while each hand comes from where it was."""
        scene, data = self._scene, self._data
        due = math.floor((now - self._elapsed) / self._step + 1e-9)
        if due <= 0:
            return
        steps = min(due, MOST_STEPS)
        hands = [(hand, self._probes[hand.number]) for hand in self._hands.values()]
        for hand, probe in hands:
            applied, damping, (u, v, w) = probe.applied, self._model.damping, hand.speed
            applied[0], applied[1], applied[2] = damping * u, damping * v, damping * w  # quick
        for i in range(steps):  # the spring ends where the hand was when the step began
            for hand, probe in hands:
                end = along(hand.before, sub(hand.place, hand.before), i / steps)
                spring_end = probe.spring_end
                spring_end[0], spring_end[1], spring_end[2] = sub(end, self._origin)
            self._mujoco.mj_step(scene, data)
        for hand, _ in hands:
            hand.before = hand.place
        self._elapsed += due * self._step
        if any(self._warnings.tolist()):
            self._start_again()

    def _couple(self, hand: _Hand) -> None:
        """Bring the probe to the hand; or let the hand take a tool that has not moved yet."""
        probe = self._probes[hand.number]
        if self._model.tool is None:
            probe.place[:], probe.speed[:] = hand.place, 0.0
        else:
            x, y, z = probe.place.tolist()
            self._origin = sub(hand.place, (x, y, z))

    def _probed(self, hand: _Hand) -> Vector3:
        """Return the place of the probe, in the coordinates of the hand."""
        x, y, z = self._probes[hand.number].place.tolist()
        return add(self._origin, (x, y, z))

    def _put_at_start(self) -> None:
        """Put everything where the file, or its keyframe, has it."""
        if self._scene.nkey:
            self._mujoco.mj_resetDataKeyframe(self._scene, self._data, 0)
        else:
            self._mujoco.mj_resetData(self._scene, self._data)
        self._mujoco.mj_forward(self._scene, self._data)

    def _start_again(self) -> None:
        """Begin again, coupled with the hands: MuJoCo has found numbers that cannot be."""
        if not self._has_flown:
            _logger.warning(
                "%s: the bodies flew apart, and are where they began; use a shorter timestep in"
                " the scene, or a softer or heavier probe",
                self._model.file,
            )
        self._has_flown = True
        self.reset()

    def reset(self) -> bool:
        """Put everything where it began, coupled with the hands; a tool is taken where it is."""
        self._put_at_start()
        for hand in self._hands.values():
            self._couple(hand)
        self._mujoco.mj_forward(self._scene, self._data)
        for name, hand in self._hands.items():
            if self._model.tool is None and self._is_touching(self._probes[hand.number]):
                self.event("in_the_way", f"a body begins where {name} is: go back first")
        return True

    def contact(self, user: str) -> Contact | None:
        hand = self._hands.get(user)
        if hand is None:
            return None
        place = self._probed(hand)
        offset = sub(place, hand.place)
        distance = norm(offset)
        if distance < TOUCH:
            return None
        if not self._is_touching(self._probes[hand.number]):
            return None
        normal = scale(offset, 1.0 / distance)
        return Contact(cut(place, self._axes), cut(normal, self._axes))

    def _is_touching(self, probe: _Probe) -> bool:
        """Return whether a contact of the last step is a probe's, or its tool's."""
        # Nothing but contacts pushes a free probe; there may be some that do not push.
        if self._model.tool is None and any(probe.pushed.tolist()):
            return True
        return bool(probe.touches.take(self._data.contact.geom).any())

    def scene(self) -> tuple[SceneObject, ...]:
        """Return the bodies' shapes where they are; a mesh is drawn as its box."""
        data, turned, objects = self._data, np.empty(4), []
        for drawn, (x, y, z), axes in zip(
            self._drawn, data.geom_xpos.tolist(), data.geom_xmat, strict=True
        ):
            if drawn is not None:
                self._mujoco.mju_mat2Quat(turned, axes)
                place = add(sub((x, y, z), self._home), self._origin)
                objects.append(drawn(position=place, orientation=tuple(turned.tolist())))
        return tuple(objects)

    def mujoco(self) -> tuple[Any, Any]:
        return self._scene, self._data

    def _drawn_as(self, geom: int) -> partial[SceneObject] | None:
        """Return what draws a geom; None: it is a probe's, which is not drawn."""
        scene = self._scene
        body = scene.geom_bodyid[geom]
        if scene.geom(geom).name.startswith(PROBE):
            return None
        half, box = scene.geom_size[geom].tolist(), scene.geom_aabb[geom][3:].tolist()
        shape, size = shape_of(self._mujoco.mjtGeom(scene.geom_type[geom]).name, half, box)
        name = scene.geom(geom).name or f"{scene.body(body).name or 'world'} {geom}"
        is_fixed = bool(scene.body_weldid[body] == 0)
        return partial(SceneObject, name[:MAX_NAME], shape, size=size, is_fixed=is_fixed)

    def change(self, model: Bodies) -> bool:
        """Take over stiffness and damping of the coupling; anything else starts again."""
        kept = replace(model, stiffness=self._model.stiffness, damping=self._model.damping)
        if kept != self._model:
            self._begin(model)
            return True
        check_coupling(model, self._step)
        self._set_coupling(model)
        self._model = model
        return True


def _three(start: Any) -> slice:
    """The entries of the probe's joints, which follow each other."""
    return slice(int(start), int(start) + 3)
