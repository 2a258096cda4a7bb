"""Setup of the paper's experiments: the hand, the two speeds, the runs of launch files.

One hand holds the device in all experiments. The two speeds differ only in approach speed, distance
to the wall and target behind the surface. ``experiments/fit_table1.py`` finds the values;
``docs/reproduce.md`` explains the fit.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from forcebound.graph.loader import from_document, load
from forcebound.graph.servo import dissipation_of
from forcebound.haptics.laws import Dissipation
from forcebound.results.bounder import saturated
from forcebound.results.contact import (
    count_bounces,
    displayed_stiffness,
    initial_rate_hardness,
)
from forcebound.results.surface import Floats, touch_of_run
from forcebound.run.results import RunResult
from forcebound.run.virtual import run_virtual

PAPER_SURFACE = 0.010  # m; paper 4.1: x_wall = 10 mm
# An encoder counts from where it is switched on, so the wall lies anywhere between two of its
# steps. Counts begin at 0 here, therefore the wall is moved: by 3.9 um, fitted (docs/reproduce.md).
SURFACE = PAPER_SURFACE - 3.9e-6
EARLY_SAMPLES = 500  # of contact, in which turns are counted: half a second
STEADY = 2.0  # s; paper 4.2: the steady state begins
DURATION = 5.1  # s; the displayed stiffness is a mean over 2 to 5 s, paper 4.2


@dataclass(frozen=True)
class Hand:
    """The hand that holds the device: mass, spring, damper, tremor."""

    mass: float  # kg, in addition to the device's own 0.075 kg
    stiffness: float  # N/m
    damping: float  # N s/m
    tremor: float  # N, amplitude
    tremor_frequency: float  # Hz

    @property
    def arguments(self) -> tuple[str, ...]:
        """The hand as arguments of ``paper_wall.yaml``."""
        return (
            f"mass:={self.mass:g} kg",
            f"hand_stiffness:={self.stiffness:g} N/m",
            f"hand_damping:={self.damping:g} N s/m",
            f"tremor:={self.tremor:g} N",
            f"tremor_frequency:={self.tremor_frequency:g} Hz",
        )


@dataclass(frozen=True)
class Approach:
    """Approach of the hand to the wall at one of the paper's two speeds."""

    speed: float  # m/s, of the hand's target before contact
    way: float  # m, from the start to the surface
    target: float  # m, depth of the target behind the surface

    @property
    def arguments(self) -> tuple[str, ...]:
        """The motion as arguments of ``paper_wall.yaml``."""
        return (
            f"approach_speed:={self.speed * 1e3:g} mm/s",
            f"start:={(SURFACE - self.way) * 1e3:.10g} mm",
            f"end:={(SURFACE + self.target) * 1e3:.10g} mm",
        )


# Fitted by experiments/fit_table1.py (docs/reproduce.md); the values of the hand are also the
# defaults of paper_wall.yaml. Soft and with far targets, it pushes with nearly a constant force,
# like the paper's soft grip (section 4.1). The bands of speed in the paper's section 5.2 are those
# of its user study; section 4 states none.
HAND = Hand(mass=0.617, stiffness=21.9, damping=0.37, tremor=0.181, tremor_frequency=10.4)
HIGH = Approach(speed=0.143, way=0.00611, target=0.107)
LOW = Approach(speed=0.0274, way=0.00687, target=0.102)
SPEEDS = {"high": HIGH, "low": LOW}
# A hand fitted to one half of Table 1 alone, which predicts the other; the search began at the hand
# above (--half first --near --seed 2).
HALF_HAND = Hand(mass=0.613, stiffness=21.4, damping=0.356, tremor=0.181, tremor_frequency=10.4)
HALF_SPEEDS = {
    "high": Approach(speed=0.144, way=0.00616, target=0.107),
    "low": Approach(speed=0.0275, way=0.00676, target=0.101),
}

PAPER_LAWS = {  # in the order and words of the paper's Table 1
    "less_conservative_viscous": "less conservative, viscous damping",
    "less_conservative": "less conservative, viscous damping + Coulomb friction",
    "aol": "AOL",
    "more_conservative_viscous": "more conservative, viscous damping",
    "more_conservative": "more conservative, viscous damping + Coulomb friction",
}
CERTIFIED = ("certified", "certified_fading")


@dataclass(frozen=True)
class UserStudy:
    """Averages of the paper's user study of the more conservative law, section 5.3."""

    depth: float  # m, penetration
    force: float  # N
    stiffness: float  # N/mm, displayed


USER_STUDY = {
    "high": UserStudy(depth=3.94e-3, force=2.68, stiffness=0.68),
    "low": UserStudy(depth=1.52e-3, force=1.21, stiffness=0.80),
}


class Contact:
    """A run against a wall, along its normal: arrays over the samples since the force engaged."""

    def __init__(self, run: RunResult) -> None:
        """Take a run of a launch file that has a wall."""
        columns = run.columns
        touch = touch_of_run(columns, (), run.document)
        assert touch is not None, "every launch file of the experiments has a surface"
        shown = slice(int(np.searchsorted(columns.time, 0.0)), None)
        self.run = run
        self.time = columns.time[shown]  # s
        self.position = columns.position[shown, 0]  # m, reading
        self.true_position = columns.true_position[shown, 0]  # m
        self.commanded = saturated(columns, run.document["device"])[shown, 0]  # N, after saturation
        self.applied = columns.applied_force[shown, 0]  # N
        self.depth: Floats = touch.depth[shown]  # m, of the reading; outside: < 0
        self.in_contact = self.depth > 0.0
        self.lowest_energy = float(columns.true_energy[shown].min()) * 1e3  # mJ, ground truth

    @property
    def rate_hardness(self) -> float:
        """H_R of Table 1, in N/mm."""
        return (initial_rate_hardness(self.applied, self.depth) or math.nan) * 1e-3

    @property
    def displayed_stiffness(self) -> float:
        """S_D of Table 1, in N/mm."""
        return (displayed_stiffness(self.time, self.applied, self.depth) or math.nan) * 1e-3

    @property
    def contact_speed(self) -> float:
        """True speed of the handle over the sample in which it reaches the surface, in m/s."""
        true, time = self.true_position, self.time
        first = max(int(np.argmax(true > SURFACE)), 1)
        return float((true[first] - true[first - 1]) / (time[first] - time[first - 1]))

    @property
    def turns(self) -> int:
        """Number of turning points, 0.1 mm apart at least, in the first half second of contact."""
        first = int(np.argmax(self.in_contact))
        return count_bounces(self.position[first : first + EARLY_SAMPLES])

    @property
    def rest(self) -> tuple[float, float]:
        """Mean penetration, in mm, and applied force, in N, from 2 s on."""
        steady = self.time >= STEADY
        return float(self.depth[steady].mean()) * 1e3, float(self.applied[steady].mean())


def dissipation(contact: Contact) -> Dissipation:
    """Return the dissipation on which the law of a run relied."""
    device = from_document(contact.run.document).device
    return dissipation_of(device.model, device.servo)


class Runs:
    """Runs launch files in virtual time, each only once; ``progress`` gets a line on each run."""

    def __init__(self, progress: Callable[[str], None] = lambda line: None) -> None:
        self.progress = progress
        self._done: dict[tuple[str, ...], Contact] = {}

    def contact(self, file: str, *arguments: str) -> Contact:
        """Return the run of a launch file with these arguments."""
        key = (file, *arguments)
        if key not in self._done:
            self.progress(f"  {command(file, *arguments)}")
            self._done[key] = Contact(run_virtual(load(file, arguments), DURATION))
        return self._done[key]

    def wall(self, law: str, approach: Approach, hand: Hand = HAND) -> Contact:
        """Return the run against the paper's wall of 10 N/mm."""
        own = () if hand == HAND else hand.arguments  # HAND is the launch file's
        return self.contact("paper_wall", f"law:={law}", *approach.arguments, *own)


def command(file: str, *arguments: str) -> str:
    """Return the command that repeats a run."""
    quoted = (f'"{word}"' if " " in word else word for word in arguments)
    return " ".join(["forcebound simulate", file, *quoted, f"--duration {DURATION:g}s"])


def wall_command(law: str, approach: Approach) -> str:
    """Return the command that repeats :meth:`Runs.wall`."""
    return command("paper_wall", f"law:={law}", *approach.arguments)
