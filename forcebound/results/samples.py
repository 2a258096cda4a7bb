"""A run as its figures see it: the samples with an engaged force, what they touched, what is known.

What several figures share is worked out once. ``fb.Run.samples`` gives it to users: what happened
in a contact is defined here and nowhere else.
"""

import math
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from forcebound.axes import LEVER
from forcebound.errors import ConfigError
from forcebound.haptics.laws import LAWS
from forcebound.haptics.laws.hold_limit import FLOOR
from forcebound.messages.packets import Event
from forcebound.messages.topology import Document
from forcebound.recordings.launched import launched
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.bounder import Cause, bounder_report, saturated
from forcebound.results.contact import (
    REST_SPEED,
    Settling,
    at_end,
    count_bounces,
    displayed_stiffness,
    extended_rate_hardness,
    final_speed,
    mean_stiffness,
    rate_hardness,
    settling,
    steady_window,
)
from forcebound.results.energy import Fall, Holds, Observed, largest_fall, observe
from forcebound.results.little_force import causes_of_little_force
from forcebound.results.spectrum import Impedance, Vibration, displayed_impedance, vibration
from forcebound.results.surface import Floats, Mask, Touch, scale_of, touch_of_run

LONGEST_FORCE = 0.1  # s, of device.watchdog_limit: auto
GAP = 1.5  # periods; samples further apart do not belong to one stretch


def is_certified(name: str | None) -> bool:
    """Return whether a law has a certificate of forcebound."""
    return name is not None and LAWS.is_shipped(name) and LAWS[name].is_certified


class Samples:
    """A run and what its figures are made of, in SI units: of angles rad for m, N m for N.

    Arrays have one row per sample with an engaged force; forces and positions are ``(n, axes)``.
    A number that the run does not have is None.

    Attributes:
        time: In s since the force engaged, ``(n,)``.
        columns: Telemetry of these samples.
        contact: Which samples are in contact, ``(n,)``: behind a surface; where the environment
            has none, a force is commanded.
        depth: Of the reading behind the surface, in m, ``(n,)``, below 0 outside; NaN: no surface.
        saturated: Commanded force after saturation, in N.
        rate: Of the ticks, in Hz.
        scale: m of a threshold for one unit of the axes: of angles, at a lever of 0.1 m.
        has_truth: Whether the true positions are known, as of a simulated device.
    """

    def __init__(
        self,
        run: TelemetryColumns,
        config: Document,
        events: Sequence[Event] = (),
        explains: bool = True,
    ) -> None:
        """Take a run.

        Args:
            run: Telemetry of the run, all samples.
            config: The launch file as resolved for the run, in SI numbers.
            events: Of the run; they say when its surface was moved or changed.
            explains: Whether causes of little force are looked for, which takes a second or more.

        Raises:
            ConfigError: If the launch file describes a surface that does not fit the run.
        """
        self.run, self.config, self.events, self._explains = run, config, events, explains
        engaged = run.engagement > 0.0
        self.since: Mask = run.time >= 0.0 if engaged.any() else engaged  # since it engaged, (all,)
        self.columns = columns = run.slice(engaged)
        self.time = columns.time
        self.touch = touch = touch_of_run(columns, events, config)
        self.depth: Floats = np.full(self.time.size, np.nan) if touch is None else touch.depth
        # Without a surface: a force is commanded.
        felt = np.linalg.norm(columns.commanded_force, axis=1) if touch is None else self.depth
        self.contact: Mask = felt > 0.0
        self.launched = launched(config)
        self.device = self.launched.device
        self.saturated = saturated(columns, self.device)  # N, (n, axes), commanded force
        self.scale = LEVER if self.launched.axis_kind == "angle" else 1.0
        self.mass = self.device.mass  # kg
        measured = 1.0 / float(np.median(np.diff(self.time))) if self.time.size > 1 else math.nan
        self.rate: float = self.device.rate or measured  # Hz
        self.has_truth = bool(np.isfinite(columns.true_position).all())
        self.report = bounder_report(events)

    def lacks(self) -> dict[str, str]:
        """Return what the run lacks of what figures need, each with the reason of a figure."""
        no_stiffness = "the environment has no constant stiffness"
        touch = self.touch
        kind = self.launched.axis_kind
        has = {
            "named": (self.launched.axes, "the device names no axes"),
            "size": (kind is not None, _NO_SIZE),
            "lengths": (kind == "length", "thresholds of a hand are known for lengths alone"),
            "force": (self.time.size > 0, "the force never engaged"),
            "truth": (self.has_truth, "needs ground truth, which only a simulated device has"),
            "axes": (self.columns.position.shape[1] > 1, "the run has one axis"),
            "surface": (touch is not None, _NO_SURFACE if scale_of(self.config) else _NO_SCALE),
            "proxy": (touch and touch.proxy is not None, "the environment says no proxy"),
            "stiffness": (touch and touch.stiffness is not None, no_stiffness),
            "constant": (touch and touch.constant_stiffness is not None, no_stiffness),
            "contact": (self.contact.any(), "no contact"),
            "mass": (self.mass is not None, "the launch file states no mass of the device"),
        }
        return {need: reason for need, (is_met, reason) in has.items() if not is_met}

    @property
    def surface(self) -> Touch:
        """The touched surface, for figures that need one."""
        assert self.touch is not None
        return self.touch

    @property
    def path(self) -> Floats:
        """Depth behind the surface, in m: the true one where it is known."""
        return self.surface.true_depth if self.has_truth else self.depth

    @cached_property
    def normal_force(self) -> Floats:
        """Applied force against the surface's normal, in N."""
        return self.surface.along(self.columns.applied_force)

    @property
    def peaks(self) -> dict[str, float]:
        """Largest force on each named axis, in N."""
        peaks = np.abs(self.columns.applied_force).max(axis=0).tolist()
        return {axis.name: one for axis, one in zip(self.launched.axes, peaks, strict=True)}

    @property
    def first_contact(self) -> int | None:
        """Index of the first sample in contact."""
        return int(np.argmax(self.contact)) if self.contact.any() else None

    @property
    def entries(self) -> int:
        """How often the hand entered the contact: samples in contact that follow one outside."""
        return int(np.count_nonzero(self.contact[1:] & ~self.contact[:-1]))

    @property
    def bounces(self) -> int:
        """Turning points of the depth since first contact; see :func:`.contact.count_bounces`."""
        first = self.first_contact
        return 0 if first is None else count_bounces(self.scale * self.depth[first:])

    @property
    def contact_speed(self) -> float | None:
        """Speed into the surface over the sample that reaches it first, in m/s."""
        first = int(np.argmax(self.path > 0.0))
        if not first:
            return None
        moved, time = self.path[first - 1 : first + 1], self.time[first - 1 : first + 1]
        return float(np.diff(moved)[0] / np.diff(time)[0])

    @property
    def displayed_stiffness(self) -> float | None:
        """In N/m; see :func:`.contact.displayed_stiffness`."""
        return displayed_stiffness(self.time, self.normal_force, self.depth)

    @property
    def rate_hardness(self) -> float | None:
        """In N/m; see :func:`.contact.rate_hardness`."""
        return rate_hardness(self.time, self.normal_force, self.depth)

    @property
    def extended_rate_hardness(self) -> float | None:
        """In N/m; see :func:`.contact.extended_rate_hardness`."""
        return extended_rate_hardness(self.time, self.normal_force, self.depth)

    @property
    def mean_stiffness(self) -> float | None:
        """In N/m; see :func:`.contact.mean_stiffness`."""
        return mean_stiffness(self.normal_force, self.depth)

    @property
    def is_at_rest(self) -> bool | None:
        """Whether it is slower than 1 mm/s at the end, see :attr:`final_speed`."""
        return None if self.final_speed is None else self.scale * self.final_speed < REST_SPEED

    @property
    def resting_depth(self) -> float | None:
        """Mean depth in the last 0.5 s of a hand at rest in contact, in m."""
        resting = self.depth[at_end(self.time) & self.contact]
        return float(resting.mean()) if resting.size and self.is_at_rest else None

    @cached_property
    def final_speed(self) -> float | None:
        """See :func:`.contact.final_speed`."""
        return final_speed(self.time, self.columns.true_position)

    @cached_property
    def settling(self) -> Settling | None:
        """See :func:`.contact.settling`."""
        return settling(self.time, self.scale * self.depth)

    @cached_property
    def fall(self) -> Fall | None:
        """See :func:`.energy.largest_fall`."""
        return largest_fall(self.time, self.columns.true_energy)

    @cached_property
    def observed(self) -> Observed | None:
        """See :func:`.energy.observe`."""
        return observe(self.holds)

    @cached_property
    def holds(self) -> Holds:
        """When and where the forces acted, since the first one; of an arm at its joints.

        A latch jitter that the device does not report, as one without stamps, may be as long as
        the time from a reading to its write.
        """
        columns, device = self.run.slice(self.since), self.device
        start_ns, known = columns.time_ns[:1], (columns.read_ns, columns.write_ns)
        read, write = (np.where(ns < 0, columns.time_ns, ns) - start_ns for ns in known)
        jitter = np.diff(columns.ahead_ns, prepend=columns.ahead_ns[:1])
        if not self.has_truth:
            jitter = np.where(columns.ahead_ns < 0, write - read, jitter)
        longest = LONGEST_FORCE
        if device.watchdog == "silent":
            longest = self.hold_limits[0]
        elif device.watchdog_limit is None:
            raise ConfigError("device.watchdog_limit is null: the run is of another version")
        elif device.watchdog_limit != "auto":
            longest = device.watchdog_limit
        # A report comes with the next write.
        dropped = np.append(columns.cut_ns[1:], -1) - start_ns
        return Holds(
            _seconds(read),
            _seconds(write),
            np.where(dropped <= write, _seconds(write) + longest, _seconds(dropped)),
            device.lag,
            columns.torques if self.is_arm else columns.applied_force,
            columns.joints if self.is_arm else columns.position,
            np.asarray(device.resolution),
            _seconds(jitter),
        )

    @property
    def is_arm(self) -> bool:
        """Whether the run has readings and torques of joints."""
        columns = self.run
        return bool(np.isfinite(columns.torques).all() and np.isfinite(columns.joints).all())

    @property
    def hold_limits(self) -> tuple[float, float]:
        """The hold limit that forces were planned for, and that without late ticks, in s."""
        period, stated = 1.0 / self.rate, self.device.hold_limit
        if isinstance(stated, float):
            return stated * period, stated * period
        shortest = FLOOR * period
        if self.report is None:
            return shortest, shortest
        plans = is_certified(self.device.law)
        return self.report.hold_limit, shortest if plans else self.report.hold_limit

    @cached_property
    def causes(self) -> list[Cause]:
        """See :func:`.little_force.causes_of_little_force`."""
        return causes_of_little_force(self) if self._explains else []

    @cached_property
    def wall_error(self) -> Floats | None:
        """What the ideal wall would push more than the motor, in N; None if it is unknown."""
        if self.surface.stiffness is None or not self.has_truth:
            return None
        return np.asarray(self.surface.stiffness * np.maximum(self.path, 0.0) - self.normal_force)

    @cached_property
    def vibration(self) -> Vibration | None:
        """Vibration of the error to the ideal wall, else of the force error, in steady contact."""
        window = steady_window(self.time)
        if not (window & self.contact).any():
            return None
        error = self.wall_error
        if error is None:
            error = self.surface.along(self.saturated - self.columns.applied_force)
        return vibration(error[self._stretch(window)], self.rate, self.mass)

    @cached_property
    def impedance(self) -> Impedance | None:
        """The displayed impedance, of the longest time in contact."""
        stretch = self._stretch(self.contact)
        return displayed_impedance(self.normal_force[stretch], self.path[stretch], self.rate)

    def _stretch(self, mask: Mask) -> slice:
        """Return the longest run of samples in the mask that has no gap in time."""
        joined = mask[1:] & mask[:-1] & (np.diff(self.time) <= GAP / self.rate)
        edges = np.flatnonzero(np.diff(np.concatenate(([False], joined, [False])).astype(np.int8)))
        if not edges.size:
            return slice(0, 0)
        starts, ends = edges[::2], edges[1::2]
        longest = int(np.argmax(ends - starts))
        return slice(int(starts[longest]), int(ends[longest]) + 1)


def _seconds(ns: NDArray[np.int64]) -> Floats:
    return np.asarray(ns, np.float64) * 1e-9


_NO_SIZE = "its axes are lengths and angles, which have no common size: see those of each axis"
_NO_SCALE = "a clutch or a border of the controller `scaled` moves the environment along the hand"
_NO_SURFACE = "the environment describes no surface, and its method `contact` reported no contact"


class Needs(NamedTuple):
    """What a figure needs of a run."""

    of_run: str = ""  # keys of Samples.lacks; without any but the size, of all laws of a run
    otherwise: str = "the run is too short"  # why it is missing in a run that has all of that
    is_optional: bool = False  # without it there is no row, in place of a dash


_TOUCHED = "force surface contact"
_NO_EXCITATION = (
    "needs 4 s of contact without gaps in which the hand moves by 1 um RMS or more in a third-"
    "octave band, with coherence 0.9; launch file impedance gives it"
)
_NOT_INWARDS = "needs a first contact of three samples in which the hand moves inwards"
_NOT_STEADY = "needs 0.5 s without gaps in the steady window, with contact in it"
_NOT_TOUCHED = "no contact in the steady window"
_NOT_SETTLED = "the penetration does not stay within 5 % of its final value for the last 0.5 s"

ALWAYS = Needs()
ENGAGED = Needs("force")
PUSHED = Needs("force contact")
FORCES = Needs("force contact size")
NAMED = Needs("force named", is_optional=True)
LEDGER = Needs("force", "the law keeps no ledger")
TRUTH = Needs("force truth")
TOUCHED = Needs("force truth contact")
SIZE = Needs("size")
MOVED = Needs("force truth size")
REGAINED = Needs("force truth", "not regained by the end of the run")
SURFACE = Needs("force surface")
STEADY = Needs(_TOUCHED, _NOT_TOUCHED)
ASKED = Needs(f"{_TOUCHED} stiffness", _NOT_TOUCHED)
SHARED = Needs(f"{_TOUCHED} stiffness", f"{_NOT_TOUCHED}, or the hand moves to and fro")
INWARDS = Needs(_TOUCHED, _NOT_INWARDS)
SETTLED = Needs(_TOUCHED, _NOT_SETTLED)
IMPEDANCE = Needs(_TOUCHED, _NO_EXCITATION)
BANDWIDTH = Needs(f"{_TOUCHED} constant", _NO_EXCITATION)
SPECTRUM = Needs(_TOUCHED, _NOT_STEADY)
VIBRATION = Needs(f"{_TOUCHED} mass lengths", _NOT_STEADY)
AT_REST = Needs("force surface truth size contact", "the hand is not at rest in contact")
ACROSS = Needs("force axes size surface contact", _NOT_TOUCHED, is_optional=True)
PROXY = Needs("force size surface proxy contact", is_optional=True)
WALL = Needs("force surface truth stiffness contact")
BROUGHT = Needs("force truth surface contact mass")
