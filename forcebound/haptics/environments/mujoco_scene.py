"""Scenes of MuJoCo, compiled with the probes of hands in them."""

import logging
import warnings
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from forcebound.bounded_child import ChildError, in_bounded_child
from forcebound.errors import ConfigError
from forcebound.extras import needed
from forcebound.files import open_file, reason
from forcebound.messages.packets import Shape

if TYPE_CHECKING:
    from forcebound.haptics.environments.bodies import Bodies

HARD = [0.99, 0.99, 0.001, 0.5, 2.0]  # of what the probe touches or holds: the coupling is soft
SECONDS, MEMORY = 30.0, 2_000_000_000  # s and bytes for the compilation and a first step
STEPS = (1e-5, 0.1)  # s, range of the scene's timestep
PROBE, TOOL = "forcebound_probe", "forcebound_tool"
MOST_NAMES = 30  # in an error
SAME_TURN = 1.0 - 1e-9  # of the product of two quaternions

_logger = logging.getLogger(__name__)


def engine() -> Any:
    """Return the module ``mujoco``, whose warnings go to our log."""
    mujoco = needed("the environment bodies", "mujoco")
    # It would write its warnings into a file of the current folder.
    mujoco.set_mju_user_warning(lambda words: _logger.debug("MuJoCo: %s", words))
    return mujoco


def compile_scene(mujoco: Any, model: "Bodies", probes: int) -> Any:
    """Return the scene of the file with so many probes in it, compiled in bounded time and memory.

    A scene may name files that have no end, or things a million times over.
    """
    try:
        open_file(model.file).close()
        binary = in_bounded_child(partial(_compiled, model, probes), SECONDS, MEMORY)
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
    check_coupling(model, scene.opt.timestep)
    return scene


def _compiled(model: "Bodies", probes: int) -> bytes:
    """Do the work of :func:`compile_scene`, and a first step, in the child."""
    mujoco = engine()
    warnings.simplefilter("ignore")  # Python's, about keys that are going out of use
    try:
        spec = mujoco.MjSpec.from_file(str(model.file))
        if model.timestep is not None:
            spec.option.timestep = model.timestep
        step = spec.option.timestep
        if not STEPS[0] <= step <= STEPS[1]:
            raise ConfigError(f"timestep: expected {STEPS[0]} to {STEPS[1]} s, got {step} s")
        start = None if model.tool is model.key is None else _start(mujoco, spec, model.key)
        for key in list(spec.keys):  # they do not fit once there are probes
            spec.delete(key)
        for number in range(probes):
            _add_probe(mujoco, spec, model, number, start)
        if model.key is not None:
            spec.add_key()
        scene = spec.compile()
        if model.tool is not None:
            ball = scene.geom(PROBE).id
            scene.geom_contype[ball] = scene.geom_conaffinity[ball] = 0
        data = mujoco.MjData(scene)
        if model.key is not None:
            _fill_key(scene, start)
            mujoco.mj_resetDataKeyframe(scene, data, 0)
        mujoco.mj_step(scene, data)
    except Exception as error:  # of MuJoCo
        raise ConfigError(f"{model.file}: {' '.join(str(error).split())}") from error
    binary = np.empty(mujoco.mj_sizeModel(scene), np.uint8)
    mujoco.mj_saveModel(scene, None, binary)
    return binary.tobytes()


def _start(mujoco: Any, spec: Any, key: str | None) -> Any:
    """Return the scene without probes as it begins, in a keyframe or as its bodies are placed."""
    start = mujoco.MjData(spec.compile())
    if key is not None:
        known = [one.name for one in spec.keys]
        if key not in known:
            words = f"key: expected the name of a keyframe, got {key!r}; known: "
            raise ConfigError(words + listed(known))
        mujoco.mj_resetDataKeyframe(start.model, start, known.index(key))
    mujoco.mj_kinematics(start.model, start)
    return start


def _fill_key(scene: Any, start: Any) -> None:
    """Make the only keyframe of a scene with probes the state ``start`` of the scene without."""
    before = start.model
    ours = np.arange(scene.njnt)[[scene.joint(i).name.startswith(PROBE) for i in range(scene.njnt)]]
    places, motions = scene.jnt_qposadr[ours], scene.jnt_dofadr[ours]
    scene.key_qpos[0] = np.insert(start.qpos, places - np.arange(len(ours)), 0.0)
    scene.key_qvel[0] = np.insert(start.qvel, motions - np.arange(len(ours)), 0.0)
    scene.key_act[0], scene.key_ctrl[0] = start.act, start.ctrl
    mocap = np.nonzero(before.body_mocapid >= 0)[0]
    still = before.body_mocapid[mocap[scene.body_mocapid[mocap] >= 0]]
    scene.key_mpos[0] = start.mocap_pos[still].ravel()
    scene.key_mquat[0] = start.mocap_quat[still].ravel()
    for body in mocap[scene.body_mocapid[mocap] < 0]:  # a tool: it slides, and is never turned
        turn = before.body_quat[body] @ start.xquat[body]
        if abs(turn) < SAME_TURN:
            raise ConfigError("key: it turns the tool, a mocap body that keeps its orientation")
        scene.key_qpos[0][places[:3]] = start.xpos[body] - before.body_pos[body]


def _add_probe(mujoco: Any, spec: Any, model: "Bodies", number: int, start: Any) -> None:
    """Add the probe to a scene, and what ties a tool to it; a mocap body becomes the probe.

    ``start`` is the scene without probes, as it begins, where there is a tool.
    """
    site = None if model.tool is None else spec.site(model.tool)
    held = site if model.tool is None or site is not None else spec.body(model.tool)
    hard = {"solref": [2.0 * spec.option.timestep, 1.0], "solimp": HARD}
    axes = np.eye(3)
    if held is None:
        probe = spec.worldbody.add_body(name=probe_name(number), gravcomp=1.0)
        touching = {**hard, "priority": 1}
    else:
        touching = {}  # nothing, in the end
        probe = held if site is None else site.parent
        carrier = probe  # a part that is fixed to a mocap body moves with it
        while carrier.parent is not None and not (carrier.mocap or carrier.joints):
            carrier = carrier.parent
        probe = carrier if carrier.mocap else probe
        if probe.mocap:
            probe.mocap, probe.gravcomp = False, 1.0
            axes = start.xmat[probe.id].reshape(3, 3)  # rows: axes of the scene, seen from the body
            for geom in probe.geoms:
                geom.mass, geom.priority = 0.0, 1
                geom.solref, geom.solimp = hard["solref"], HARD
        else:
            place = (start.xpos if site is None else start.site_xpos)[held.id]
            held = probe.add_site(name=TOOL) if site is None else site
            probe = spec.worldbody.add_body(name=PROBE, pos=place, gravcomp=1.0)
            probe.add_site(name=PROBE)
            tie, kind = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtObj.mjOBJ_SITE
            spec.add_equality(type=tie, objtype=kind, name1=PROBE, name2=held.name, **hard)
    spring = {"stiffness": model.stiffness, "damping": model.damping}
    free = {"limited": 0, "armature": 0.0, "frictionloss": 0.0}  # whatever the file's defaults
    for i, axis in enumerate(axes):
        name = f"{probe_name(number)}_{'xyz'[i]}"
        probe.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis, **spring, **free)
    ball = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [model.probe_radius, 0.0, 0.0]}
    ball |= {"contype": 1, "conaffinity": 1}  # a URDF file is compiled without what cannot touch
    probe.add_geom(name=probe_name(number), mass=model.probe_mass, **ball, **touching)


def probe_name(number: int) -> str:
    """The name of a probe, and of its ball."""
    return PROBE if number == 0 else f"{PROBE}_{number}"


def body_of(tool: str, scene: Any) -> int:
    """Return the number of a body, or of that of a site; ConfigError if it is none that moves."""
    bodies = {scene.body(i).name: i for i in range(scene.nbody)}
    sites = {scene.site(i).name: int(scene.site_bodyid[i]) for i in range(scene.nsite)}
    ours = ("", PROBE, TOOL)
    found = {n: i for n, i in (bodies | sites).items() if scene.body_weldid[i] and n not in ours}
    if tool in found:
        return found[tool]
    message = f"expected the name of a site or body that moves, got {tool!r}; known: "
    raise ConfigError(message + listed(list(found)), field="tool")


def listed(names: list[str]) -> str:
    """Return the first of some names, for an error."""
    if not names:
        return "none"
    return ", ".join(names[:MOST_NAMES]) + ("" if len(names) <= MOST_NAMES else ", ...")


def check_coupling(model: "Bodies", step: float) -> None:
    """Refuse a spring that the scene's time step cannot integrate."""
    most = model.probe_mass / step**2
    if model.stiffness > most:
        raise ConfigError(
            f"a stiffness of {model.stiffness:g} N/m is too much for a probe of"
            f" {model.probe_mass * 1e3:g} g and the scene's timestep of {step * 1e3:g} ms: at most"
            f" {most:g} N/m; take a shorter timestep, or a heavier probe",
            field="stiffness",
        )


def shape_of(kind: str, half: list[float], box: list[float]) -> tuple[Shape, tuple[float, ...]]:
    """The shape of a geom by the name of its type, and its size as scenes have it."""
    if kind == "mjGEOM_PLANE":
        return "plane", ()
    if kind == "mjGEOM_SPHERE":
        return "sphere", (half[0],)
    if kind in ("mjGEOM_CYLINDER", "mjGEOM_CAPSULE"):
        return "cylinder", (half[0], 2.0 * half[1])
    return "box", (2.0 * box[0], 2.0 * box[1], 2.0 * box[2])
