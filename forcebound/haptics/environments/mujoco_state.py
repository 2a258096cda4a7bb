"""The state of a MuJoCo scene as signals: what a policy or a replay needs, in each answer.

``qpos``, ``qvel`` and ``sensors`` choose all joints or sensors of the file, the name of a body its
pose and velocity, ``contact NAME`` the force of contacts on a body or geom. All is in MuJoCo's own
coordinates and units. ``qpos`` and ``qvel`` are those after the last step; poses, velocities of
bodies, sensors and contacts are those that MuJoCo computed for it, one time step earlier.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from forcebound.errors import ConfigError
from forcebound.haptics.environments.mujoco_scene import PROBE, TOOL, listed
from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import MAX_SIGNALS

LONGEST = 32  # characters of the name of a signal
CONTACT = "contact "
PLACE = (("x", "m"), ("y", "m"), ("z", "m"))
TURN = (("qw", "1"), ("qx", "1"), ("qy", "1"), ("qz", "1"))
SPEED = (("vx", "m/s"), ("vy", "m/s"), ("vz", "m/s"))
TURNING = (("wx", "rad/s"), ("wy", "rad/s"), ("wz", "rad/s"))
FORCE = (("x", "N"), ("y", "N"), ("z", "N"))
#: Entries of joints by their type: free, ball, slide, hinge.
QPOS = ((*PLACE, *TURN), TURN, (("", "m"),), (("", "rad"),))
QVEL = ((*SPEED, *TURNING), TURNING, (("", "m/s"),), (("", "rad/s"),))
#: Units of sensors by the end of their type's name.
UNITS = {
    "TOUCH": "N", "ACCELEROMETER": "m/s^2", "VELOCIMETER": "m/s", "GYRO": "rad/s", "FORCE": "N",
    "TORQUE": "N m", "RANGEFINDER": "m", "FRAMEPOS": "m", "FRAMELINVEL": "m/s",
    "FRAMEANGVEL": "rad/s", "FRAMELINACC": "m/s^2", "FRAMEANGACC": "rad/s^2", "CLOCK": "s",
}  # fmt: skip

_Entries: TypeAlias = Sequence[tuple[str, str]]  # suffix and unit of each number


class SceneState:
    """Chosen numbers of a scene.

    Attributes:
        signals: What they are; of each chosen thing in turn.
        names: Their names.

    Raises:
        ConfigError: If there is no such body or geom, or there are too many numbers.
    """

    def __init__(self, mujoco: Any, scene: Any, data: Any, chosen: Iterable[str]) -> None:
        self._mujoco, self._scene, self._data = mujoco, scene, data
        self.signals: list[Signal] = []
        self._reads: list[Callable[[], list[float]]] = []
        for one in chosen:
            self._choose(one)
        self.names = [signal.name for signal in self.signals]
        twice = sorted({name for name in self.names if self.names.count(name) > 1})
        if twice or len(self.names) > MAX_SIGNALS:
            got = f"{len(self.names)} numbers" + (f", two named {twice[0]}" if twice else "")
            message = f"record: expected at most {MAX_SIGNALS} numbers of different names, got "
            raise ConfigError(message + got, field="record")

    def values(self) -> list[float]:
        """Return the numbers as they are now."""
        return [value for read in self._reads for value in read()]

    def _choose(self, one: str) -> None:
        mujoco, scene, data = self._mujoco, self._scene, self._data
        bodies = _numbers(scene.body, scene.nbody)
        if one in ("qpos", "qvel"):
            self._add_joints(one, QPOS if one == "qpos" else QVEL)
        elif one == "sensors":
            for i in range(scene.nsensor):
                self._add("sensor", scene.sensor(i).name or str(i), self._of_sensor(i), one)
            self._reads.append(data.sensordata.tolist)
        elif one in bodies:
            number, spun = bodies[one], np.empty(6)
            self._add("", one, (*PLACE, *TURN), "pose of the body")
            self._add("", one, (*SPEED, *TURNING), "velocity of the body")
            self._reads += [data.xpos[number].tolist, data.xquat[number].tolist]
            kind = mujoco.mjtObj.mjOBJ_XBODY
            ask = partial(mujoco.mj_objectVelocity, scene, data, kind, number, spun, 0)
            self._reads.append(lambda: ask() or [*spun[3:].tolist(), *spun[:3].tolist()])
        else:
            geoms = _numbers(scene.geom, scene.ngeom)
            name = one.removeprefix(CONTACT)
            if not one.startswith(CONTACT) or name not in {*bodies, *geoms}:
                known = listed(["qpos", "qvel", "sensors", *bodies])
                message = f"record: expected {known}, or contact and the name of a body or geom"
                raise ConfigError(f"{message}, got {one!r}", field="record")
            touched = np.arange(scene.ngeom) == geoms.get(name, -1)
            if name in bodies:
                touched = scene.geom_bodyid == bodies[name]
            self._add("contact", name, FORCE, "force of contacts on it")
            self._reads.append(partial(self._pushed, frozenset(np.flatnonzero(touched).tolist())))

    def _add(self, kind: str, name: str, entries: _Entries, label: str) -> None:
        kind = f"{kind}_" if kind else ""
        longest = max((len(suffix) + 1 for suffix, _ in entries if suffix), default=0)
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
        if not kind and not plain[0].isalpha():
            kind = "body_"
        base = kind + plain[: LONGEST - len(kind) - longest]
        for suffix, unit in entries:
            own = f"{base}_{suffix}" if suffix else base
            self.signals.append(Signal(own, unit, f"{label}: {plain}"[:60]))

    def _add_joints(self, array: str, entries: Sequence[_Entries]) -> None:
        scene = self._scene
        places: list[int] = []
        starts = scene.jnt_qposadr if array == "qpos" else scene.jnt_dofadr
        for i in range(scene.njnt):
            joint, body = scene.joint(i), scene.body(int(scene.jnt_bodyid[i]))
            if joint.name.startswith(PROBE):
                continue
            of_body = f"{body.name or body.id}{f'_{i}' if body.jntnum[0] > 1 else ''}"
            own = entries[int(scene.jnt_type[i])]
            self._add(array, joint.name or of_body, own, array)
            places += range(int(starts[i]), int(starts[i]) + len(own))
        view, index = getattr(self._data, array), np.array(places, np.int64)
        self._reads.append(lambda: view.take(index).tolist())

    def _of_sensor(self, number: int) -> _Entries:
        """Return suffixes and units of a sensor's numbers."""
        scene = self._scene
        kind = self._mujoco.mjtSensor(int(scene.sensor_type[number])).name
        unit, count = UNITS.get(kind.removeprefix("mjSENS_"), ""), int(scene.sensor_dim[number])
        suffixes = {1: ("",), 3: ("x", "y", "z")}.get(count) or map(str, range(count))
        return [(suffix, unit) for suffix in suffixes]

    def _pushed(self, geoms: frozenset[int]) -> list[float]:
        """Return the sum of the contact forces on some geoms, in N."""
        contacts = self._data.contact
        signs = [(two in geoms) - (one in geoms) for one, two in contacts.geom.tolist()]
        found = [i for i, sign in enumerate(signs) if sign]
        if not found:
            return [0.0, 0.0, 0.0]
        total, force, frames = np.zeros(3), np.empty(6), contacts.frame
        for i in found:  # axes of a contact are the rows of its frame; the first goes to geom two
            self._mujoco.mj_contactForce(self._scene, self._data, i, force)
            total += signs[i] * (force[:3] @ frames[i].reshape(3, 3))
        return total.tolist()


def _numbers(named: Callable[[int], Any], count: int) -> dict[str, int]:
    """Return the numbers of a scene's things by the names in its file."""
    names = {named(i).name: i for i in range(count)}
    return {name: i for name, i in names.items() if name and not name.startswith((PROBE, TOOL))}
