"""Rigid bodies of a MuJoCo scene, which the hand pushes.

The hand is a mocap body; a *probe*, a small ball that touches the bodies, hangs on it by a spring
and a damper (a virtual coupling). What the coupling pulls is what the hand feels.

Source: E. Todorov, T. Erez, Y. Tassa, MuJoCo: a physics engine for model-based control, IROS 2012;
the coupling: J. E. Colgate, M. C. Stanley, J. M. Brown, Issues in the haptic display of tool use,
IROS 1995.
"""

import logging
import math
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from forcebound.bounded_child import ChildError, in_bounded_child
from forcebound.errors import ConfigError
from forcebound.files import open_file, reason
from forcebound.haptics.environments import Environment, EnvironmentModel, within_reach
from forcebound.haptics.geometry.vectors import Vector3, along, cut, norm, pad3, scale, sub
from forcebound.messages.packets import MAX_NAME, Contact, SceneObject, Shape, Vector
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Damping,
    Length,
    Mass,
    Stiffness,
    check_ranges,
)

MOST_STEPS = 20  # for one answer; a scene that falls farther behind stands still
TOUCH = 1e-6  # m, least way between hand and probe of a contact
HARD = [0.99, 0.99, 0.001, 0.5, 2.0]  # of the probe's contacts: the coupling is the soft part
SECONDS, MEMORY = 30.0, 2_000_000_000  # s and bytes for the compilation and a first step
STEPS = (1e-5, 0.1)  # s, range of the scene's timestep
PROBE, HAND = "forcebound_probe", "forcebound_hand"

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Bodies(EnvironmentModel):
    """Rigid bodies of an MJCF file; needs the extra ``mujoco``.

    ``F = k (x - p) + b (v - v_p)``, of the probe's position ``p`` and velocity ``v_p``; the probe
    feels ``F``. The scene advances by its own time step, as far as the time since the last question
    goes.

    Attributes:
        file: The scene, in MuJoCo's XML format. It may name other files, which MuJoCo reads itself.
        stiffness: Of the coupling between hand and probe.
        damping: Of the coupling.
        probe_mass: Of the probe; the hand feels it in free motion, too.
        probe_radius: Of the probe.
    """

    file: Path
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 1000.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 2.0
    probe_mass: Annotated[Mass, POSITIVE] = 0.010
    probe_radius: Annotated[Length, POSITIVE] = 0.005

    def __post_init__(self) -> None:
        check_ranges(self)

    def check_files(self) -> None:
        """Compile the scene, unless MuJoCo is only installed where the environment runs."""
        if find_spec("mujoco") is not None:
            _compile(engine(), self)

    def open(self, axes: int) -> "_Scene":
        return _Scene(self, axes)


class _Scene(Environment):
    """An open scene."""

    def __init__(self, model: Bodies, axes: int) -> None:
        self._mujoco = engine()
        self._axes = axes
        self._begin(model)

    def _begin(self, model: Bodies) -> None:
        """Begin where the file has everything."""
        self._model = model
        self._scene = _compile(self._mujoco, model)
        self._data = self._mujoco.MjData(self._scene)
        self._mujoco.mj_forward(self._scene, self._data)
        self._probe = self._scene.body(PROBE)
        self._geom = int(self._scene.geom(PROBE).id)
        self._place = _three(self._scene.jnt_qposadr[self._probe.jntadr[0]])
        self._motion = _three(self._scene.jnt_dofadr[self._probe.jntadr[0]])
        self._hand: Vector3 | None = None
        self._elapsed = 0.0  # s, until which the scene has gone
        self._resets = 0

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        x, y, z = map(within_reach, pad3(position))
        speed = tuple(map(within_reach, pad3(velocity)))  # at most 10 m/s
        if self._hand is None:
            self._hand, self._elapsed = (x, y, z), elapsed
            self._data.qpos[self._place] = self._hand
        before, self._hand = self._hand, (x, y, z)
        self._advance(before, speed, elapsed)
        model, data = self._model, self._data
        force = [
            model.stiffness * (here - p) + model.damping * (v - v_p)
            for here, p, v, v_p in zip(
                self._hand,
                data.qpos[self._place].tolist(),
                speed,
                data.qvel[self._motion].tolist(),
                strict=True,
            )
        ]
        return cut((force[0], force[1], force[2]), self._axes)

    def _advance(self, before: Vector3, speed: Vector, elapsed: float) -> None:
        """Let the scene go on while the hand comes from ``before``."""
        scene, data, hand = self._scene, self._data, self._hand
        assert hand is not None  # force() has set it
        due = math.floor((elapsed - self._elapsed) / scene.opt.timestep + 1e-9)
        if due <= 0:
            return
        steps = min(due, MOST_STEPS)
        data.mocap_pos[0] = hand
        data.qfrc_applied[self._motion] = [self._model.damping * v for v in speed]
        for i in range(steps):  # the spring ends where the hand was when the step began
            scene.qpos_spring[self._place] = along(before, sub(hand, before), i / steps)
            self._mujoco.mj_step(scene, data)
        self._elapsed += due * scene.opt.timestep
        if _resets(data) != self._resets:
            self._start_again()

    def _start_again(self) -> None:
        """Put the probe to the hand: MuJoCo has put everything where the file has it."""
        if self._resets == 0:
            _logger.warning(
                "%s: the bodies flew apart, and are where they began; use a shorter timestep in"
                " the scene, or a softer or heavier probe",
                self._model.file,
            )
        self._resets = _resets(self._data)
        self._data.qpos[self._place] = self._hand

    def contact(self, user: str) -> Contact | None:
        if self._hand is None or not (self._data.contact.geom == self._geom).any():
            return None
        x, y, z = self._data.qpos[self._place].tolist()
        way = sub((x, y, z), self._hand)
        distance = norm(way)
        if distance < TOUCH:
            return None
        normal = scale(way, 1.0 / distance)
        return Contact(cut((x, y, z), self._axes), cut(normal, self._axes))

    def scene(self) -> tuple[SceneObject, ...]:
        """Return the bodies' shapes where they are; a mesh is drawn as its box."""
        drawn = (self._drawn(i) for i in range(self._scene.ngeom))
        return tuple(one for one in drawn if one is not None)

    def _drawn(self, geom: int) -> SceneObject | None:
        scene, mujoco = self._scene, self._mujoco
        body = scene.geom_bodyid[geom]
        if scene.body(body).name in (PROBE, HAND):
            return None
        half, box = scene.geom_size[geom].tolist(), scene.geom_aabb[geom][3:].tolist()
        shape, size = _shape(mujoco.mjtGeom(scene.geom_type[geom]).name, half, box)
        turned = np.empty(4)
        mujoco.mju_mat2Quat(turned, self._data.geom_xmat[geom])
        w, i, j, k = turned.tolist()
        x, y, z = self._data.geom_xpos[geom].tolist()
        name = scene.geom(geom).name or f"{scene.body(body).name or 'world'} {geom}"
        return SceneObject(
            name[:MAX_NAME],
            shape,
            position=(x, y, z),
            orientation=(w, i, j, k),
            size=size,
            is_fixed=bool(scene.body_weldid[body] == 0),
        )

    def change(self, model: Bodies) -> bool:
        """Take over stiffness and damping of the coupling; anything else starts again."""
        kept = replace(model, stiffness=self._model.stiffness, damping=self._model.damping)
        if kept != self._model:
            self._begin(model)
            return True
        _check_coupling(model, self._scene.opt.timestep)
        joints = _three(self._probe.jntadr[0])
        self._scene.jnt_stiffness[joints] = model.stiffness
        self._scene.dof_damping[self._motion] = model.damping
        self._model = model
        return True


def engine() -> Any:
    """Return the module ``mujoco``, whose warnings go to our log."""
    try:
        import mujoco
    except ImportError:
        words = "environment bodies needs MuJoCo: pip install 'forcebound[mujoco]'"
        raise ConfigError(words) from None
    # It would write its warnings into a file of the current folder.
    mujoco.set_mju_user_warning(lambda words: _logger.debug("MuJoCo: %s", words))
    return mujoco


def _compile(mujoco: Any, model: Bodies) -> Any:
    """Return the scene of the file with hand and probe in it, compiled in bounded time and memory.

    A scene may name files that have no end, or things a million times over.
    """
    try:
        open_file(model.file).close()
        binary = in_bounded_child(partial(_compiled, model), SECONDS, MEMORY)
    except ConfigError as error:
        raise ConfigError(str(error), field="file") from None
    except (OSError, ChildError) as error:
        words = reason(error) if isinstance(error, OSError) else error
        raise ConfigError(
            f"{model.file}: {words}; expected a scene in MJCF that compiles within {SECONDS:g} s"
            f" and {MEMORY / 1e9:g} GB, from regular files",
            field="file",
        ) from None
    scene = mujoco.MjModel.from_binary_path("scene.mjb", {"scene.mjb": binary})
    _check_coupling(model, scene.opt.timestep)
    return scene


def _compiled(model: Bodies) -> bytes:
    """Do the work of :func:`_compile`, and a first step, in the child."""
    mujoco = engine()
    try:
        spec = mujoco.MjSpec.from_file(str(model.file))
        step = spec.option.timestep
        if not STEPS[0] <= step <= STEPS[1]:
            raise ConfigError(f"timestep: expected {STEPS[0]} to {STEPS[1]} s, got {step} s")
        _add_hand(mujoco, spec, model)
        scene = spec.compile()
        mujoco.mj_step(scene, mujoco.MjData(scene))
    except Exception as error:  # MuJoCo's own kinds
        raise ConfigError(f"{model.file}: {' '.join(str(error).split())}") from error
    binary = np.empty(mujoco.mj_sizeModel(scene), np.uint8)
    mujoco.mj_saveModel(scene, None, binary)
    return binary.tobytes()


def _add_hand(mujoco: Any, spec: Any, model: Bodies) -> None:
    hand = spec.worldbody.add_body(name=HAND, mocap=True)
    ball, size = mujoco.mjtGeom.mjGEOM_SPHERE, [model.probe_radius, 0.0, 0.0]
    hand.add_geom(name=HAND, type=ball, size=size, contype=0, conaffinity=0)
    probe = spec.worldbody.add_body(name=PROBE, gravcomp=1.0)
    for axis in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]):
        slide = mujoco.mjtJoint.mjJNT_SLIDE
        probe.add_joint(type=slide, axis=axis, stiffness=model.stiffness, damping=model.damping)
    touching = {"solref": [2.0 * spec.option.timestep, 1.0], "solimp": HARD, "priority": 1}
    probe.add_geom(name=PROBE, type=ball, size=size, mass=model.probe_mass, **touching)


def _check_coupling(model: Bodies, step: float) -> None:
    """Refuse a spring that the scene's time step cannot integrate."""
    most = model.probe_mass / step**2
    if model.stiffness > most:
        raise ConfigError(
            f"a stiffness of {model.stiffness:g} N/m is too much for a probe of"
            f" {model.probe_mass * 1e3:g} g and the scene's timestep of {step * 1e3:g} ms: at most"
            f" {most:g} N/m; take a shorter timestep in the scene, or a heavier probe",
            field="stiffness",
        )


def _resets(data: Any) -> int:
    """How often MuJoCo found numbers that cannot be and put everything back."""
    return sum(data.warning[kind].number for kind in range(len(data.warning)))


def _shape(kind: str, half: list[float], box: list[float]) -> tuple[Shape, tuple[float, ...]]:
    """The shape of a geom by the name of its type, and its size as scenes have it."""
    if kind == "mjGEOM_PLANE":
        return "plane", ()
    if kind == "mjGEOM_SPHERE":
        return "sphere", (half[0],)
    if kind in ("mjGEOM_CYLINDER", "mjGEOM_CAPSULE"):
        return "cylinder", (half[0], 2.0 * half[1])
    return "box", (2.0 * box[0], 2.0 * box[1], 2.0 * box[2])


def _three(start: Any) -> slice:
    """The entries of the probe's joints, which follow each other."""
    return slice(int(start), int(start) + 3)
