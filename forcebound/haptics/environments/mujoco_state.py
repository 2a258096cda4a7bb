"""The state of a MuJoCo scene as signals: what a policy or a replay needs, in each answer.

``qpos``, ``qvel`` and ``sensors`` choose all joints or sensors of the file, the name of a body its
pose and velocity, ``contact NAME`` the force of contacts on a body or geom. All is in MuJoCo's own
coordinates and units. ``qpos`` and ``qvel`` are those after the last step; poses, velocities of
bodies, sensors and contacts are those that MuJoCo computed for it, one time step earlier.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from forcebound.errors import ConfigError
from forcebound.haptics.environments.mujoco_scene import PROBE, TOOL, listed
from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import MAX_SIGNALS

LONGEST, LABEL = 32, 60  # characters of the name of a signal, and of its label
CONTACT = "contact "
# Suffixes and units of numbers. Of joints by their type: free, ball, slide, hinge.
PLACE, TURN, FORCE = "x:m,y:m,z:m", "qw:1,qx:1,qy:1,qz:1", "x:N,y:N,z:N"
SPEED, TURNING = "vx:m/s,vy:m/s,vz:m/s", "wx:rad/s,wy:rad/s,wz:rad/s"
JOINTS = {
    "qpos": (f"{PLACE},{TURN}", TURN, ":m", ":rad"),
    "qvel": (f"{SPEED},{TURNING}", TURNING, ":m/s", ":rad/s"),
}
#: Units of sensors by their types.
UNITS = {
    "TOUCH": "N", "ACCELEROMETER": "m/s^2", "VELOCIMETER": "m/s", "GYRO": "rad/s", "FORCE": "N",
    "TORQUE": "N m", "RANGEFINDER": "m", "FRAMEPOS": "m", "FRAMELINVEL": "m/s",
    "FRAMEANGVEL": "rad/s", "FRAMELINACC": "m/s^2", "FRAMEANGACC": "rad/s^2",
    "BALLQUAT": "1", "BALLANGVEL": "rad/s", "FRAMEQUAT": "1",
}  # fmt: skip
#: Of a slide and a hinge, by the end of the type: JOINTPOS, JOINTLIMITVEL, JOINTACTFRC.
JOINT_UNITS = {"POS": ("m", "rad"), "VEL": ("m/s", "rad/s"), "FRC": ("N", "N m")}


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
        scene, data, name = self._scene, self._data, one.removeprefix(CONTACT)
        bodies, geoms = _numbers(scene.body, scene.nbody), _numbers(scene.geom, scene.ngeom)
        if one in JOINTS:
            self._add_joints(one)
        elif one == "sensors":
            for i in range(scene.nsensor):
                self._add("sensor_", scene.sensor(i).name or str(i), self._of_sensor(i), one)
            self._reads.append(data.sensordata.tolist)
        elif one in bodies:
            self._add("", one, f"{PLACE},{TURN}", "pose of the body")
            self._add("", one, f"{SPEED},{TURNING}", "velocity of the body")
            self._reads += [data.xpos[bodies[one]].tolist, data.xquat[bodies[one]].tolist]
            self._reads.append(partial(self._moving, bodies[one], np.empty(6)))
        elif one.startswith(CONTACT) and name in {*bodies, *geoms}:
            self._add("contact_", name, FORCE, "force of contacts on it")
            of_body = bodies.get(name)
            touched = [i for i in range(scene.ngeom) if scene.geom_bodyid[i] == of_body]
            self._reads.append(partial(self._pushed, touched or [geoms[name]]))
        else:
            known = listed([*JOINTS, "sensors", *(name for name in bodies if name != "world")])
            message = f"record: expected {known}, or contact and the name of a body or geom"
            if one in _numbers(scene.sensor, scene.nsensor):
                message = "record: expected sensors, which records all of them"
            raise ConfigError(f"{message}, got {one!r}", field="record")

    def _add(self, kind: str, name: str, entries: str, label: str) -> None:
        """Add the signals of a thing, whose suffixes are at most two letters."""
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
        kind = kind if kind or plain[0].isalpha() else "body_"
        for suffix, unit in (entry.split(":") for entry in entries.split(",")):
            own = f"{kind}{plain}"[: LONGEST - 3] + (f"_{suffix}" if suffix else "")
            self.signals.append(Signal(own, unit, f"{label}: {plain}"[:LABEL]))

    def _add_joints(self, array: str) -> None:
        scene, view, places = self._scene, getattr(self._data, array), list[int]()
        starts = scene.jnt_qposadr if array == "qpos" else scene.jnt_dofadr
        for i in range(scene.njnt):
            joint, body = scene.joint(i), scene.body(int(scene.jnt_bodyid[i]))
            if not joint.name.startswith(PROBE):
                of_body = f"{body.name or body.id}{f'_{i}' if body.jntnum[0] > 1 else ''}"
                entries = JOINTS[array][int(scene.jnt_type[i])]
                self._add(f"{array}_", joint.name or of_body, entries, array)
                places += range(int(starts[i]), int(starts[i]) + len(entries.split(",")))
        index = np.array(places, np.int64)
        self._reads.append(lambda: view.take(index).tolist())

    def _of_sensor(self, number: int) -> str:
        """Return suffixes and units of a sensor's numbers."""
        kind = self._mujoco.mjtSensor(int(self._scene.sensor_type[number])).name
        kind, count = kind.removeprefix("mjSENS_"), self._scene.sensor_dim[number]
        unit = UNITS.get(kind, "")
        if kind.startswith("JOINT"):
            joint = self._scene.jnt_type[self._scene.sensor_objid[number]]
            unit = JOINT_UNITS[kind[-3:]][joint == self._mujoco.mjtJoint.mjJNT_HINGE]
        suffixes = {1: ("",), 3: ("x", "y", "z")}.get(int(count)) or range(count)
        return ",".join(f"{suffix}:{unit}" for suffix in suffixes)

    def _moving(self, body: int, spun: Any) -> list[float]:
        """Return velocity and angular velocity of a body, in the axes of the scene."""
        kind = self._mujoco.mjtObj.mjOBJ_XBODY
        self._mujoco.mj_objectVelocity(self._scene, self._data, kind, body, spun, 0)
        return [*spun[3:].tolist(), *spun[:3].tolist()]

    def _pushed(self, geoms: Sequence[int]) -> list[float]:
        """Return the sum of the contact forces on some geoms, in N."""
        total, force, contacts = np.zeros(3), np.empty(6), self._data.contact
        for i, (one, two) in enumerate(contacts.geom.tolist()):
            sign = (two in geoms) - (one in geoms)
            if sign:  # axes of a contact are the rows of its frame; the first goes to geom two
                self._mujoco.mj_contactForce(self._scene, self._data, i, force)
                total += sign * (force[:3] @ contacts.frame[i].reshape(3, 3))
        return total.tolist()


def _numbers(named: Callable[[int], Any], count: int) -> dict[str, int]:
    """Return the numbers of a scene's things by the names in its file."""
    names = {named(i).name: i for i in range(count)}
    return {name: i for name, i in names.items() if name and not name.startswith((PROBE, TOOL))}
