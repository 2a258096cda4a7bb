r"""The twin of a run: what its hand would have felt with other numbers of device, law or clock.

The bounder gets the recorded readings and commands once more, moved by what another force does to
the hand. With the recorded force F and the other one F', the tip leaves its recorded path by y,

.. math:: m \ddot y + b \dot y + k y = F - F' ,

beside the device's friction, whatever the hand wants to do: mass, damping and stiffness are those
of the simulated hand, of a person those of a soft grip. The command changes by the environment's
stiffness times the change of depth. With the numbers of the run the twin is the run.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from operator import add, mul, sub
from typing import TYPE_CHECKING, Any

import numpy as np

from forcebound.axes import AxisKind, at_lever, common_kind
from forcebound.errors import ConfigError
from forcebound.haptics.devices import DEVICES, DeviceModel
from forcebound.haptics.hands.hands import SoftGrip
from forcebound.haptics.laws import Dissipation, ForceBounder
from forcebound.haptics.laws.bounder import shorten
from forcebound.haptics.laws.dissipation import per_axis
from forcebound.haptics.laws.hold_limit import FLOOR
from forcebound.haptics.parts.plain import key_of
from forcebound.messages.packets import Vector
from forcebound.messages.topology import Document
from forcebound.recordings.launched import DeviceSection
from forcebound.results.contact import STEADY_WINDOW, steady_window
from forcebound.results.surface import Floats, touch_of_run
from forcebound.results.ticks import device_time
from forcebound.units import N_MM, in_unit

if TYPE_CHECKING:
    from forcebound.results.samples import Samples


SMOOTH = 10  # ticks to either side, over which a recorded speed is a mean
ENOUGH = 3.0  # s of a long run that touches then, for the sake of speed
STEP = 1e-4  # m, over which joints turn as at a point


@dataclass(frozen=True)
class Change:
    """What is other in a twin than in its run."""

    numbers: Mapping[str, float | Vector | str | None] = field(default_factory=dict)  # stated
    law: str = ""
    rate: float = 1.0  # over that of the run
    delays: float = 1.0  # from reading to write, over those of the run
    is_punctual: bool = False  # no tick is late or missed
    is_prompt: bool = False  # every answer is to the state of now
    is_engaged: bool = False  # no engage ramp


class Twin:
    """A run with an engaged force and a surface of known stiffness, for some seconds.

    Attributes:
        stated: What the law relied on.
        model: Of the device; None: of a user.
        time: Of the readings, in s, shape ``(n,)``.
        write_delay: From each reading until its force acts, in s; 0 where it is not recorded.
        busy: What reads and writes of a tick take, in s: its state is read before, too.
        felt: Stiffness that the hand felt, in N/m, a mean over the samples in steady contact.
        asked: Stiffness of the environment, in N/m, likewise.
    """

    def __init__(self, run: "Samples") -> None:
        """Take a run; ConfigError if its device has no twin here."""
        is_long = run.run.time[-1] >= STEADY_WINDOW[1] and run.contact[run.time <= ENOUGH][-1]
        until = ENOUGH if is_long else STEADY_WINDOW[1]
        self._columns = columns = run.run.slice(run.since & (run.run.time <= until))
        touch = touch_of_run(columns, run.events, run.config)
        assert touch is not None
        assert touch.stiffness is not None
        self._touch, self._stiffness = touch, np.nan_to_num(touch.stiffness)
        has_stamps = bool((columns.read_ns >= 0).all())
        read_ns = columns.read_ns if has_stamps else columns.time_ns
        self.time: Floats = 1e-9 * (read_ns - read_ns[0]).astype(np.float64)
        self.write_delay: Floats = (columns.write_ns - read_ns).astype(np.float64)
        self.write_delay *= 1e-9 * has_stamps
        self.busy = has_stamps * (device_time(run) or 0.0)
        section = run.config["device"].items()
        device: Document = {k: tuple(v) if isinstance(v, list) else v for k, v in section}
        self._rate, self._report, self._law = run.rate, run.report, str(run.device.law)
        self.model: DeviceModel | None = None
        if DEVICES.is_shipped(run.device.kind):
            kind: Any = DEVICES[run.device.kind]
            own = {each.name for each in fields(kind) if each.init} - {"truth"}
            known = {name: device[key_of(name)] for name in own if key_of(name) in device}
            self.model = kind(**known)
        self._kinematics = None if self.model is None else self.model.kinematics()
        is_arm = bool(np.isfinite(columns.torques).any())
        place = tuple(columns.position[-1].tolist())
        kind, self._unit = run.launched.axis_kind, run.launched.shown(N_MM).unit
        held = kind if self.model is None else common_kind(self.model.hand_axes)
        if kind is None or held != kind:
            raise ConfigError("the hand does not hold the axes that this run has, all alike")
        if is_arm and (self.model is None or self.model.angles(place) is None):
            raise ConfigError("the joints of this arm cannot be computed from places of its tip")
        self.stated = self._state(device, run.device)
        motors = columns.applied_force if self._kinematics is None else columns.torques
        self._first: Vector = tuple(motors[0].tolist())
        self._hand = self._hold(run, kind)
        # Energy of the ledger, when the run began in the middle of another; what the twin errs.
        start = self._bounder(Change())[0].estimated_energy
        self._before = float(np.nan_to_num(columns.estimated_energy[0] - start))
        force = touch.along(columns.applied_force)
        self.felt, self.asked = self._mean(columns.time, force, touch.depth, self._stiffness)
        self._error: float | None = None

    def _state(self, device: Document, stated: DeviceSection) -> Dissipation:
        limit = stated.watchdog_limit if self.model is None else self.model.longest_force
        hold = stated.hold_limit
        hold_limit = (hold if isinstance(hold, float) else FLOOR) / self._rate
        if not isinstance(hold, float) and self._report is not None:
            hold_limit = max(self._report.hold_limit, hold_limit)
        numbers = {
            **device,
            "period": 1.0 / self._rate,
            "hold_limit": hold_limit,
            "watchdog_limit": math.inf if limit in (None, "auto") else limit,
            "watchdog_tolerance": stated.watchdog_tolerance or 0.0,
            "largest_speed": stated.largest_speed or math.inf,
            "hand_speed": stated.hand_speed or math.inf,
            "energy_cap": stated.cap,
        }
        names = {each.name for each in fields(Dissipation)}
        return Dissipation(**{name: one for name, one in numbers.items() if name in names})

    def _hold(self, run: "Samples", kind: AxisKind) -> tuple[float, float, Floats, Floats]:
        """Return mass and stiffness of the hand; damping and friction with the device, per axis."""
        grip, units = run.launched.operator, {"mass": "kg", "stiffness": "N/m", "damping": "N s/m"}
        mass, spring, damper = (
            getattr(grip, name) or at_lever(getattr(SoftGrip, name), unit, kind)
            for name, unit in units.items()
        )
        own = run.mass or 0.0
        if kind == "angle":
            own = float(np.mean(run.config["device"].get("inertia") or 0.0))
        turns = unit = np.eye(self._columns.position.shape[1])
        if self.model is not None and self._kinematics is not None:
            places = (
                tuple(self._columns.position[-1] + STEP * one) for one in (*unit, 0.0 * unit[0])
            )
            turned = np.array([self.model.angles(place) for place in places])
            turns = (turned[:-1] - turned[-1]) / STEP
        damping = damper + (turns**2 * np.array(self.stated.damping)).sum(axis=1)
        friction = (np.abs(turns) * np.array(self.stated.friction)).sum(axis=1)
        return mass + own, spring, damping, friction

    def would_feel(self, change: Change) -> float:
        """Return the stiffness that the hand would have felt, in N/m."""
        if change.is_punctual:  # what the twin errs is of late ticks
            return self._run(change)
        if self._error is None:
            self._error = self.felt - self._run(Change())
        return max(self._run(change) + self._error, 0.0)

    def text(self, stiffness: float) -> str:
        """Return a stiffness for people."""
        return in_unit(stiffness, self._unit, 2)

    def _bounder(self, change: Change) -> tuple[ForceBounder, Dissipation]:
        limit, report = self.stated.hold_limit, self._report
        if change.is_punctual and report and report.longest_hold_limit > report.hold_limit:
            limit = FLOOR / self._rate  # the limit was learned
        numbers: Any = {"period": self.stated.period / change.rate}
        numbers |= {"hold_limit": limit / change.rate, **change.numbers}
        stated = replace(self.stated, **numbers)
        return ForceBounder(change.law or self._law, stated, len(self._first)), stated

    def _mean(self, time: Floats, force: Floats, depth: Floats, of: Floats) -> tuple[float, float]:
        chosen = steady_window(time) & (depth > 0.0) & (of > 0.0)
        if not chosen.any():
            return 0.0, 0.0
        return float(np.mean(force[chosen] / depth[chosen])), float(np.mean(of[chosen]))

    def _run(self, change: Change) -> float:
        columns, touch, time = self._columns, self._touch, self.time
        if change.rate != 1.0 or change.is_punctual:
            time = np.arange(0.0, time[-1], 1.0 / (self._rate * change.rate))

        def at(values: Floats) -> Floats:
            flat = values.reshape(values.shape[0], -1).T
            found = np.stack([np.interp(time, self.time, one) for one in flat], axis=1)
            return found.reshape(time.shape + values.shape[1:])

        engagement, depth, stiffness = map(at, (columns.engagement, touch.depth, self._stiffness))
        ramp, age = engagement, at(np.nan_to_num(columns.reply_age))
        if change.is_prompt:
            ramp, age = np.maximum.accumulate(ramp), 0.0 * age
        if change.is_engaged:
            ramp = np.ones(time.shape)
        answered = np.maximum(np.searchsorted(time, time - age + 1e-9, "right") - 1, 0)
        commanded = at(columns.commanded_force)
        if change.is_prompt:
            answered = np.arange(time.size)
            commanded = (stiffness * ramp * np.maximum(depth, 0.0))[:, np.newaxis] * -at(
                touch.normal
            )
        elif change.is_engaged:
            commanded = commanded / np.where(engagement > 0.0, engagement, np.inf)[:, np.newaxis]
        held = np.diff(self.time)[:, np.newaxis] * columns.applied_force[:-1]
        impulse = at(np.concatenate((0.0 * columns.applied_force[:1], np.cumsum(held, axis=0))))
        truth = columns.true_position
        place = at(np.where(np.isfinite(truth), truth, columns.position))
        near = np.clip(np.arange(time.size) + np.array([[-SMOOTH], [SMOOTH]]), 0, time.size - 1)
        speed = np.diff(place[near], axis=0)[0] / np.diff(time[near], axis=0)[0][:, np.newaxis]
        rows = (
            *(time, at(columns.position), place, speed, commanded),
            np.diff(impulse, axis=0, prepend=impulse[:1]),
            *(ramp, depth, at(-touch.normal), ramp * stiffness, answered),
            *(np.maximum(depth[answered], 0.0), change.delays * at(self.write_delay)),
        )
        ticks = zip(*[row.tolist() for row in rows], strict=True)
        force, depth = np.array(list(self._pushes(change, ticks))).T
        return self._mean(time + columns.time[0], force, depth, stiffness)[0]

    def _pushes(self, change: Change, ticks: Iterator[Any]) -> Iterator[tuple[float, float]]:
        """Yield the force into the surface, in N, and the depth there, in m, of each tick."""
        (bounder, stated), kinematics = self._bounder(change), self._kinematics
        mass, spring, damping, friction = self._hand
        steps = per_axis("resolution", stated.resolution, len(self._first))
        applied = last = tuple(self._columns.applied_force[0].tolist())
        zero, depths, before = (0.0,) * len(applied), [], 0.0
        away, speed = list(zero), list(zero)
        for time, position, place, was, command, impulse, *rest in ticks:
            ramp, depth, inward, stiffness, answered, then, delay = rest
            dt, before = time - before, time
            for k, (b, f) in enumerate(zip(damping, friction, strict=True)):
                inertia = mass + dt * b + dt * dt * spring  # implicit, so stable at any rate
                push = impulse[k] - dt * (applied[k] + spring * away[k])
                push += math.copysign(dt * f, was[k]) if was[k] else 0.0
                now = was[k] + (mass * speed[k] + push) / inertia
                speed[k] = math.copysign(max(abs(now) - dt * f / inertia, 0.0), now) - was[k]
                away[k] += dt * speed[k]
            reading, tip = self._read(position, tuple(map(add, place, away)), steps)
            depths.append(depth + sum(map(mul, map(sub, tip, position), inward)))
            more = stiffness * (max(depths[answered], 0.0) - then)
            command = tuple([f + more * u for f, u in zip(command, inward, strict=True)])
            if sum(map(mul, command, inward)) <= 0.0:
                command = zero
            asked = command if kinematics is None else kinematics.torque(reading, command)
            size, time_ns = math.hypot(*asked), round(time * 1e9)
            if len(depths) == 1:
                bounder.start(time_ns, reading)
                bounder.settle(self._first, time_ns + round(delay * 1e9))
                bounder.credit(self._before)
            else:
                asked = shorten(asked, size, stated.saturation * ramp)
                if stated.watchdog == "reporting" and dt > stated.hold_limit:
                    dropped = before - dt + delay + stated.hold_limit
                    bounder.report_cut(round(dropped * 1e9), last)
                motors = bounder.bound(time_ns, reading, asked)
                bounder.settle(motors, time_ns + round(delay * 1e9))
                applied = tuple([math.hypot(*motors) / (size or math.inf) * f for f in command])
            last = reading
            yield sum(map(mul, applied, inward)), depths[-1]

    def _read(self, was: Vector, now: Vector, steps: Vector) -> tuple[Vector, Vector]:
        """Return the reading of a tip that is ``now`` there, and its place."""
        if self.model is None or self._kinematics is None:
            reading = _stepped(was, now, steps)
            return reading, reading
        joints = self.model.angles(was) or now
        reading = _stepped(joints, self.model.angles(now) or joints, steps)
        return reading, self._kinematics.position(reading)


def _stepped(was: Vector, now: Vector, steps: Vector) -> Vector:
    triples = zip(was, now, steps, strict=True)
    return tuple([a + (round((b - a) / step) * step if step else b - a) for a, b, step in triples])
