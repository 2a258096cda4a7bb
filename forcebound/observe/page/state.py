"""The state of a hand while its graph runs, in the words of the verdict on its run.

It counts from the beginning of the law in use, or from when the page began to look.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from forcebound.axes import at_lever
from forcebound.messages.control import BounderReport
from forcebound.messages.packets import Telemetry
from forcebound.messages.topology import Document
from forcebound.recordings.launched import launched
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.cells import Summary
from forcebound.results.contact import REST_SPEED, REST_WINDOW, final_speed
from forcebound.results.energy import BESIDE, MotorAccount
from forcebound.results.figures import OF_STATE
from forcebound.results.promises import BrokenPromise
from forcebound.results.samples import Samples
from forcebound.results.state import Passivity, State, state
from forcebound.units import N, energy_in_words

MEMORY = 2.0  # s of samples that are looked at
LEAST_FORCE = 0.02  # N; less is no contact
BOUNCE = 0.25  # s without a force that a hand which bounces may be in the air
WHOLE = 0.95  # share of the commanded force from which on nothing is missing
LATE = 0.02  # share of missed ticks that a hand can feel
LASTING = 0.02  # s of missed ticks in one contact that a hand can feel
EMPTY = "the ledger began empty with the law, and only motion fills it"
AGAIN = "Let go, and press again."
BEGAN = 0.1  # s since the force engaged, after which something may have been before the page


class Judged(NamedTuple):
    """What is known of a hand beside its samples, each second again."""

    document: Document  # its launch file, with the law of now
    report: BounderReport
    cause: str = ""  # of little force; empty: none is known
    broken: Sequence[BrokenPromise] = ()


class LiveState:
    """The state of one hand."""

    def __init__(self) -> None:
        self.judged: Judged | None = None
        self.is_led = False  # the page makes the hand let go, and press again
        self._past = deque[Telemetry]()
        self.begin("")

    def begin(self, law: str) -> None:
        """Begin again, with a law; empty: with the same one."""
        #: Whether the hand has been in contact ever since the law began: its ledger began empty.
        self.is_inside = bool(law) and self._contact[0] > 0.0
        self._law, self._lowest, self._began = law, math.inf, bool(law)
        self._motor, self._holds = MotorAccount(), list[Telemetry]()
        self._past, self._energy = deque[Telemetry](), 0.0
        self._broken: Sequence[BrokenPromise] = ()
        self._misses_before: int | None = None  # the contact
        self._seen_from = 0.0

    def take(self, samples: Sequence[Telemetry], energies: Sequence[float | None]) -> None:
        """Take the next samples of the law, with their true energies since it began, in J."""
        for sample, energy in zip(samples, energies, strict=True):
            if sample.engagement > 0.0 and not self._began:
                self._began = True
                self._seen_from = sample.elapsed if sample.elapsed > BEGAN else 0.0
            if self._began and energy is not None:
                self._lowest = min(self._lowest, energy)
            elif self._began and sample.engagement > 0.0:
                self._holds.append(sample)
            if self.is_inside and sample.engagement == 1.0 and not _asked(sample):
                self.is_inside = False
            shown = sample.estimated_energy if energy is None else energy
            self._energy = shown if math.isfinite(shown) else 0.0
        self._past.extend(samples)
        while self._past and self._past[0].time_ns < self._past[-1].time_ns - MEMORY * 1e9:
            self._past.popleft()

    def describe(self) -> dict[str, str] | None:
        """Return the words for a page; None: nothing is known yet."""
        if not self._past or self.judged is None:
            return None
        document = self.judged.document
        document = {**document, "device": {**document["device"]}}
        law = self._law or str(document["device"]["law"])
        is_of_now = document["device"]["law"] == law
        if is_of_now and self.judged.broken:
            self._broken = self.judged.broken
        document["device"]["law"] = law
        figures = self._figures(document, is_of_now)
        run = launched(document)
        now = state(figures, run)
        unit = run.shown(N).unit
        kind, head, more = self._words(now, law, bool(figures["at_rest"]), unit)
        asked, given = self._contact
        paid = "" if law == "none" or not self.is_short else f"{given / asked:.0%}"
        seen = f"Seen from {self._seen_from:.3g} s on." if self._seen_from else ""
        return {
            "kind": kind,
            "head": head,
            "more": " ".join(part for part in (more, seen) if part),
            "force": f"{math.hypot(*self._past[-1].applied_force):.3g} {unit}",
            "energy": energy_in_words(self._energy),
            "cause": self.judged.cause,
            "paid": paid,
        }

    def _figures(self, document: Document, is_of_now: bool) -> Summary:
        """Return the figures of the state so far; those of a finished run are None."""
        assert self.judged is not None
        if len(self._holds) > 3 * BESIDE:
            columns = TelemetryColumns.from_packets(self._holds)
            run = Samples(columns, {"device": document["device"]})
            run.report = self.judged.report
            self._motor.take(run.holds)
            del self._holds[: -2 * BESIDE - 1]
        report = self.judged.report if is_of_now else None
        speed = self._speed
        rest = at_lever(REST_SPEED, "m/s", launched(document).axis_kind or "angle")
        return {
            **dict.fromkeys(figure.key for figure in OF_STATE),
            "law": document["device"]["law"],
            "true_energy_min_j": self._lowest if math.isfinite(self._lowest) else None,
            "observed_energy_min_j": self._motor.energy_min,
            "observed_energy_error_j": self._motor.error,
            "final_speed_m_per_s": speed,
            "at_rest": None if speed is None else speed < rest,
            "broken_promises": self._broken,
            "largest_allowance_j": None if report is None else report.largest_allowance,
            "hold_limit_overruns": None if report is None else report.overruns,
            "fast_holds": None if report is None else report.fast_holds,
            "speed_leak_j": None if report is None else report.speed_leak,
        }

    @property
    def _speed(self) -> float | None:
        since = self._past[-1].time_ns - REST_WINDOW * 1e9
        last = [one for one in self._past if one.time_ns >= since and one.true_position is not None]
        if not last:
            return None
        time = np.array([one.time_ns for one in last]) * 1e-9
        return final_speed(time, np.array([one.true_position for one in last]))

    def _words(self, now: State, law: str, at_rest: bool, unit: str) -> tuple[str, str, str]:
        """Return a word for the colour, the state as a sentence, and what explains it."""
        assert self.judged is not None
        last, missed = self._past[-1], self._missed
        if last.loop_delay is None:
            return "off", "No force.", "Controller or environment does not answer."
        if last.engagement < 1.0:
            return "off", f"The force engages: {last.engagement:.0%}.", ""
        asked, given = self._contact
        late = f" {missed:.0%} of the ticks are missed." if missed >= LATE else ""
        is_short, is_free = self.is_short, law == "none"
        share = f"{given:.3g} {unit} of the {asked:.3g} {unit} that the environment commands"
        motion = "At rest." if at_rest else "In contact." if asked else "Moving freely."
        if now.kind is not Passivity.PASSIVE:
            known = f"{now.known[0].upper()}{now.known[1:]}. Law {law}."
            return now.kind, f"{now.head}. {motion}", f"{known}{late}"
        cause = self.judged.cause
        if (self.is_inside or self.is_led) and is_short and not is_free:
            again = "The hand lets go, and presses again." if self.is_led else AGAIN
            return now.kind, f"{now.head}. {motion}", f"The hand gets {share}: {EMPTY}. {again}"
        if late and is_short and not is_free and (not cause or "ticks come late" in cause):
            return "late", "Late ticks: the surface feels softer.", f"{share}.{late}"
        why = f": {cause.partition(': ')[0]}" if cause and not is_free else ""
        more = f"The hand gets all {asked:.3g} {unit}." if asked else "No contact."
        if is_short:
            more = f"The hand gets {share}{why}.{'' if late or is_free else self._lasting}"
        head = f"{'No law. ' * is_free}{now.head}. {motion}"
        return "off" if is_free else now.kind, head, f"{more}{late} {now.costly}".strip()

    @property
    def newest(self) -> Telemetry | None:
        """The newest sample of this law; None: there is none yet."""
        return self._past[-1] if self._past else None

    @property
    def is_short(self) -> bool:
        """Whether the hand gets less than what is commanded."""
        asked, given = self._contact
        return given < WHOLE * asked

    def is_free_for(self, time_ns: int) -> bool:
        """Whether no force has been commanded for so long."""
        since = self._past[-1].time_ns - time_ns
        return not any(_asked(sample) for sample in self._past if sample.time_ns >= since)

    def is_held_for(self, time_ns: int) -> bool:
        """Whether a force has been commanded for so long, without a pause."""
        since = self._past[-1].time_ns - time_ns
        own = (_asked(sample) for sample in self._past if sample.time_ns >= since)
        return self._past[0].time_ns <= since and all(own)

    @property
    def _contact(self) -> tuple[float, float]:
        """The newest commanded force, and that which was applied, in N; 0: no contact."""
        for sample in reversed(self._past):
            if sample.time_ns < self._past[-1].time_ns - BOUNCE * 1e9:
                break
            if asked := _asked(sample):
                if self._misses_before is None:
                    self._misses_before = sample.deadline_misses
                return asked, math.hypot(*sample.applied_force)
        self._misses_before = None
        return 0.0, 0.0

    @property
    def _period(self) -> float:
        assert self.judged is not None
        return 1.0 / float(self.judged.document["device"]["rate"])

    @property
    def _missed(self) -> float:
        """Share of the ticks of the last 2 s that was missed."""
        first, last = self._past[0], self._past[-1]
        seconds = max((last.time_ns - first.time_ns) * 1e-9, BOUNCE)
        return (last.deadline_misses - first.deadline_misses) * self._period / seconds

    @property
    def _lasting(self) -> str:
        ticks = self._past[-1].deadline_misses - (self._misses_before or 0)
        if ticks * self._period <= LASTING:
            return ""
        return f" {ticks} ticks were missed in this contact: let go, and press again."


def _asked(sample: Telemetry) -> float:
    """The commanded force of a sample, in N; 0: no contact."""
    asked = math.hypot(*sample.commanded_force)
    return asked if asked >= LEAST_FORCE else 0.0
