"""Rigid bodies of a MuJoCo scene, which the hand pushes.

A *probe*, a small ball that touches the bodies, hangs on the hand by a spring and a damper (a
virtual coupling). Or the probe touches nothing and holds a *tool* of the scene, such as the tip of
an arm. What the coupling pulls is what the hand feels.

Source: E. Todorov, T. Erez, Y. Tassa, MuJoCo: a physics engine for model-based control, IROS 2012;
the coupling: J. E. Colgate, M. C. Stanley, J. M. Brown, Issues in the haptic display of tool use,
IROS 1995.
"""

import logging
import math
import warnings
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
from forcebound.haptics.geometry.vectors import Vector3, add, along, cut, norm, pad3, scale, sub
from forcebound.messages.packets import MAX_NAME, Contact, SceneObject, Shape, Vector
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Damping,
    Length,
    Mass,
    Range,
    Stiffness,
    Time,
    check_ranges,
)

MOST_STEPS = 20  # for one answer; a scene that falls farther behind stands still
TOUCH = 1e-6  # m, least way between hand and probe of a contact
HARD = [0.99, 0.99, 0.001, 0.5, 2.0]  # of what the probe touches or holds: the coupling is soft
SECONDS, MEMORY = 30.0, 2_000_000_000  # s and bytes for the compilation and a first step
STEPS = (1e-5, 0.1)  # s, range of the scene's timestep
PROBE, TOOL = "forcebound_probe", "forcebound_tool"
MOST_NAMES = 30  # in an error

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Bodies(EnvironmentModel):
    """Rigid bodies of an MJCF file; needs the extra ``mujoco``.

    ``F = k (x - p) + b (v - v_p)``, of the probe's position ``p`` and velocity ``v_p``; the probe
    feels ``F``. The scene advances by its own time step, as far as the time since the last question
    goes.

    Attributes:
        file: The scene, in MuJoCo's XML format. It may name other files, which MuJoCo reads itself.
        tool: Name of a site or body of the scene, which the hand takes where it is; null: none.
        timestep: Of the scene; null: that of the file.
        stiffness: Of the coupling between hand and probe.
        damping: Of the coupling.
        probe_mass: Of the probe; the hand feels it in free motion, too. With a tool it is added to
            the tool's, or is that of a mocap body.
        probe_radius: Of the probe.
    """

    file: Path
    tool: str | None = None
    timestep: Annotated[Time, Range(at_least=STEPS[0], at_most=STEPS[1])] | None = None
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 1000.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 2.0
    probe_mass: Annotated[Mass, POSITIVE] = 0.010
    probe_radius: Annotated[Length, POSITIVE] = 0.005

    def __post_init__(self) -> None:
        check_ranges(self)

    def check_files(self) -> None:
        """Compile the scene, unless MuJoCo is only installed where the environment runs."""
        if find_spec("mujoco") is not None:
            _Scene(self, 3)

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
        self._probe = self._scene.body(int(self._scene.geom(PROBE).bodyid[0]))
        self._place = _three(self._scene.jnt_qposadr[self._probe.jntadr[0]])
        self._motion = _three(self._scene.jnt_dofadr[self._probe.jntadr[0]])
        # Where the probe is before it has moved: in the scene, and in the hand's coordinates.
        self._home: Vector3 = tuple(self._probe.pos.tolist())
        self._origin: Vector3 = (0.0, 0.0, 0.0)
        rigid = self._scene.body_weldid
        body = self._probe.id if model.tool is None else _body_of(model.tool, self._scene)
        # By number of a geom, with one more for -1, which is none.
        self._touches = np.append(rigid[self._scene.geom_bodyid] == rigid[body], False)
        self._hand: Vector3 | None = None
        self._elapsed = 0.0  # s, until which the scene has gone
        self._resets = 0

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        x, y, z = map(within_reach, pad3(position))
        speed = tuple(map(within_reach, pad3(velocity)))  # at most 10 m/s
        if self._hand is None:
            self._hand, self._elapsed = (x, y, z), elapsed
            self._couple(self._hand)
        before, self._hand = self._hand, (x, y, z)
        self._advance(before, speed, elapsed)
        model, data = self._model, self._data
        force = [
            model.stiffness * (here - p) + model.damping * (v - v_p)
            for here, p, v, v_p in zip(
                self._hand,
                self._probed(),
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
        data.qfrc_applied[self._motion] = [self._model.damping * v for v in speed]
        for i in range(steps):  # the spring ends where the hand was when the step began
            end = along(before, sub(hand, before), i / steps)
            scene.qpos_spring[self._place] = sub(end, self._origin)
            self._mujoco.mj_step(scene, data)
        self._elapsed += due * scene.opt.timestep
        if _resets(data) != self._resets:
            self._start_again(hand)

    def _couple(self, hand: Vector3) -> None:
        """Bring the probe to the hand; or let the hand take a tool that has not moved yet."""
        if self._model.tool is None:
            self._data.qpos[self._place] = hand
        else:
            self._origin = hand

    def _probed(self) -> Vector3:
        """Where the probe is, in the coordinates of the hand."""
        x, y, z = self._data.qpos[self._place].tolist()
        return add(self._origin, (x, y, z))

    def _start_again(self, hand: Vector3) -> None:
        """Couple again with the hand: MuJoCo has put everything where the file has it."""
        if self._resets == 0:
            _logger.warning(
                "%s: the bodies flew apart, and are where they began; use a shorter timestep in"
                " the scene, or a softer or heavier probe",
                self._model.file,
            )
        self._resets = _resets(self._data)
        self._couple(hand)

    def contact(self, user: str) -> Contact | None:
        if self._hand is None or not self._touches[self._data.contact.geom].any():
            return None
        place = self._probed()
        way = sub(place, self._hand)
        distance = norm(way)
        if distance < TOUCH:
            return None
        normal = scale(way, 1.0 / distance)
        return Contact(cut(place, self._axes), cut(normal, self._axes))

    def scene(self) -> tuple[SceneObject, ...]:
        """Return the bodies' shapes where they are; a mesh is drawn as its box."""
        drawn = (self._drawn(i) for i in range(self._scene.ngeom))
        return tuple(one for one in drawn if one is not None)

    def _drawn(self, geom: int) -> SceneObject | None:
        scene, mujoco = self._scene, self._mujoco
        body = scene.geom_bodyid[geom]
        if scene.geom(geom).name == PROBE:
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
            position=add(sub((x, y, z), self._home), self._origin),
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
    """Return the scene of the file with the probe in it, compiled in bounded time and memory.

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
    warnings.simplefilter("ignore")  # Python's, about keys that are going out of use
    try:
        spec = mujoco.MjSpec.from_file(str(model.file))
        if model.timestep is not None:
            spec.option.timestep = model.timestep
        step = spec.option.timestep
        if not STEPS[0] <= step <= STEPS[1]:
            raise ConfigError(f"timestep: expected {STEPS[0]} to {STEPS[1]} s, got {step} s")
        _add_probe(mujoco, spec, model)
        scene = spec.compile()
        mujoco.mj_step(scene, mujoco.MjData(scene))
    except Exception as error:  # MuJoCo's own kinds
        raise ConfigError(f"{model.file}: {' '.join(str(error).split())}") from error
    binary = np.empty(mujoco.mj_sizeModel(scene), np.uint8)
    mujoco.mj_saveModel(scene, None, binary)
    return binary.tobytes()


def _add_probe(mujoco: Any, spec: Any, model: Bodies) -> None:
    """Add the probe to a scene, and what ties a tool to it; a mocap body becomes the probe."""
    site = None if model.tool is None else spec.site(model.tool)
    held = site if model.tool is None or site is not None else spec.body(model.tool)
    hard = {"solref": [2.0 * spec.option.timestep, 1.0], "solimp": HARD}
    axes = np.eye(3)
    if held is None:
        probe = spec.worldbody.add_body(name=PROBE, gravcomp=1.0)
        touching = {**hard, "priority": 1, "contype": 1, "conaffinity": 1}
    else:
        touching = {"contype": 0, "conaffinity": 0}
        data = mujoco.MjData(spec.compile())
        mujoco.mj_kinematics(data.model, data)
        probe = held if site is None else site.parent
        carrier = probe  # a part that is fixed to a mocap body moves with it
        while carrier.parent is not None and not (carrier.mocap or carrier.joints):
            carrier = carrier.parent
        probe = carrier if carrier.mocap else probe
        if probe.mocap:
            probe.mocap, probe.gravcomp = False, 1.0
            axes = data.xmat[probe.id].reshape(3, 3)  # rows: axes of the scene, seen from the body
            for geom in probe.geoms:
                geom.mass, geom.priority = 0.0, 1
                geom.solref, geom.solimp = hard["solref"], HARD
        else:
            place = (data.xpos if site is None else data.site_xpos)[held.id]
            held = probe.add_site(name=TOOL) if site is None else site
            probe = spec.worldbody.add_body(name=PROBE, pos=place, gravcomp=1.0)
            probe.add_site(name=PROBE)
            tie, kind = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtObj.mjOBJ_SITE
            spec.add_equality(type=tie, objtype=kind, name1=PROBE, name2=held.name, **hard)
    spring = {"stiffness": model.stiffness, "damping": model.damping}
    free = {"limited": 0, "armature": 0.0, "frictionloss": 0.0}  # whatever the file's defaults
    for axis in axes:
        probe.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis, **spring, **free)
    ball = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [model.probe_radius, 0.0, 0.0]}
    probe.add_geom(name=PROBE, mass=model.probe_mass, **ball, **touching)


def _body_of(tool: str, scene: Any) -> int:
    """Return the number of a body, or of that of a site; ConfigError if it is none that moves."""
    bodies = {scene.body(i).name: i for i in range(scene.nbody)}
    sites = {scene.site(i).name: int(scene.site_bodyid[i]) for i in range(scene.nsite)}
    ours = ("", PROBE, TOOL)
    found = {n: i for n, i in (bodies | sites).items() if scene.body_weldid[i] and n not in ours}
    if tool in found:
        return found[tool]
    known = (
        "none"
        if not found
        else ", ".join(list(found)[:MOST_NAMES]) + ("" if len(found) <= MOST_NAMES else ", ...")
    )
    message = f"expected the name of a site or body that moves, got {tool!r}; known: {known}"
    raise ConfigError(message, field="tool")


def _check_coupling(model: Bodies, step: float) -> None:
    """Refuse a spring that the scene's time step cannot integrate."""
    most = model.probe_mass / step**2
    if model.stiffness > most:
        raise ConfigError(
            f"a stiffness of {model.stiffness:g} N/m is too much for a probe of"
            f" {model.probe_mass * 1e3:g} g and the scene's timestep of {step * 1e3:g} ms: at most"
            f" {most:g} N/m; take a shorter timestep, or a heavier probe",
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
