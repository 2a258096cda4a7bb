"""Figures 18, 20, 21: laws computed on the recorded trace of another law's run.

The trace has readings and commanded forces. A law computed on it has its own ledger and forces, but
its forces do not move the hand: only the laws are compared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from forcebound.analysis.surface import Floats
from forcebound.bounding import Dissipation, ForceBounder
from forcebound.config.loader import from_document
from forcebound.experiments.drawing import Line, Row, draw_rows, law_line
from forcebound.experiments.noncausal import (
    less_conservative_noncausal,
    more_conservative_noncausal,
)
from forcebound.experiments.outcome import Number, Outcome
from forcebound.experiments.setup import CERTIFIED, HIGH, SPEEDS, Contact, Runs, wall_command
from forcebound.nodes.servo import dissipation_of

NonCausal = Callable[[Sequence[float], Sequence[float], Dissipation], list[float]]


def dissipation(contact: Contact) -> Dissipation:
    """Return the dissipation on which the law of a run relied."""
    device = from_document(contact.run.document).device
    return dissipation_of(device.model, device.servo)


def on_trace(law: str, contact: Contact) -> Floats:
    """Return the force of ``law`` at each sample of a run's trace, in N."""
    relied_on = dissipation(contact)
    period_ns = round(relied_on.period * 1e9)
    bounder = ForceBounder(law, relied_on)
    bounder.start(0, (float(contact.position[0]),))
    forces = [0.0]
    readings, commanded = contact.position.tolist(), contact.commanded.tolist()
    for n in range(1, len(readings)):
        force = bounder.bound(n * period_ns, (readings[n],), (commanded[n],))
        bounder.settle(force)
        forces.append(force[0])
    return np.array(forces)


def relative_extra(more: Floats, less: Floats, contact: Contact) -> float:
    """Return the excess of ``more`` over ``less``, in %, of the mean forces in contact."""
    where = contact.in_contact
    return float(100.0 * (more[where].mean() / less[where].mean() - 1.0))


def run_fig18(runs: Runs) -> Outcome:
    """Compute the AOL on the trace of Fig. 10 (less conservative, high speed)."""
    contact = runs.wall("less_conservative", HIGH)
    forces = {law: on_trace(law, contact) for law in ("less_conservative", "aol", *CERTIFIED)}
    where = contact.in_contact
    repeated = float(np.abs(forces["less_conservative"] - contact.applied).max())
    extra = {law: relative_extra(forces[law], contact.applied, contact) for law in forces}
    aol = forces["aol"][where] / contact.applied[where]
    numbers = [
        Number("more force than less conservative", "%", extra["aol"], 5.9, "aol"),
        *(
            Number("more force than less conservative", "%", extra[law], None, law)
            for law in CERTIFIED
        ),
        Number("the same, mean of the ratios", "%", float(100.0 * (aol.mean() - 1.0)), 5.9, "aol"),
        Number("trace repeated, largest difference", "N", repeated, 0.0, "less_conservative"),
    ]
    mean_force = float(contact.applied[where].mean())
    lines = [law_line("less_conservative", contact.time, contact.applied, " (the run)")]
    lines += [
        law_line(law, contact.time, forces[law], " on its trace") for law in ("aol", *CERTIFIED)
    ]
    return Outcome(
        title="AOL computed on the position trace of Fig. 10",
        paper="The AOL gives slightly more force, 5.9 %.",
        finding=(
            f"{extra['aol']:.1f} % more force: mean AOL force over mean applied force, all samples "
            "in contact. The AOL is a reconstruction (docs/theory.md): the exact causal bound, "
            "whose F_max has f_c where the less conservative law extrapolates the last move, so "
            f"the extra is about 0.12 N over the force, here {mean_force:.1f} N; 5.9 % are 2.0 N. "
            f"The certified law gives {extra['certified']:+.1f} %, its memoryless variant "
            f"{extra['certified_memoryless']:+.1f} % on the same trace; both hold for the "
            "true position, which the encoder only quantises."
        ),
        numbers=numbers,
        drawing=draw_rows(
            [
                Row("position (mm)", [Line("reading", contact.time, contact.position * 1e3)]),
                Row("force (N)", lines),
                Row("force (N)\nat contact", lines, window=around_contact(contact)),
            ]
        ),
        commands=[wall_command("less_conservative", HIGH)],
    )


def around_contact(contact: Contact) -> tuple[float, float]:
    """Return the window from just before to 150 ms after first contact, in s."""
    first = float(contact.time[int(np.argmax(contact.in_contact))])
    return first - 0.02, first + 0.15


@dataclass(frozen=True)
class CausalAgainstOriginal:
    """Figures 20 and 21: the causal law of a run against its non-causal original on the trace."""

    law: str
    original: NonCausal
    figures: tuple[str, str]  # whose traces these are, high and low speed

    def run(self, runs: Runs) -> Outcome:
        """Reproduce the figure."""
        numbers: list[Number] = []
        rows: list[Row] = []
        for speed, name in zip(SPEEDS, self.figures, strict=True):
            contact = runs.wall(self.law, SPEEDS[speed])
            positions, commanded = contact.position.tolist(), contact.commanded.tolist()
            original = np.array(self.original(positions, commanded, dissipation(contact)))
            numbers += self._numbers(speed, contact, original - contact.applied)
            rows += self._rows(name, contact, original)
        shares = [number.ours for number in numbers if number.unit == "%"]
        return Outcome(
            title=f"{self.law.replace('_', ' ')} law against its non-causal original",
            paper="Almost the same values; no number.",
            finding=(
                f"RMS difference over the samples in contact {shares[0]:.2f} % of the mean force "
                f"at high and {shares[1]:.2f} % at low speed. The certified laws are causal from "
                "the start and have no such original; they are drawn on the same traces."
            ),
            numbers=numbers,
            drawing=draw_rows(rows),
            commands=[wall_command(self.law, approach) for approach in SPEEDS.values()],
        )

    def _numbers(self, speed: str, contact: Contact, difference: Floats) -> list[Number]:
        where = contact.in_contact
        start, end = around_contact(contact)
        early = where & (contact.time >= start) & (contact.time <= end)
        share = 100.0 * _rms(difference[where]) / float(contact.applied[where].mean())
        early_label = f"RMS difference, first 150 ms of contact, {speed} speed"
        return [
            Number(f"RMS difference, {speed} speed", "N", _rms(difference[where]), None, self.law),
            Number("the same, of the mean force in contact", "%", share, None, self.law),
            Number(early_label, "N", _rms(difference[early]), None, self.law),
        ]

    def _rows(self, name: str, contact: Contact, original: Floats) -> list[Row]:
        time = contact.time
        lines = [
            *(law_line(law, time, on_trace(law, contact), " on the trace") for law in CERTIFIED),
            law_line(self.law, time, contact.applied, ", causal (the run)"),
            Line("non-causal original", time, original, "--"),
        ]
        return [
            Row(f"force (N)\ntrace of {name}", lines),
            Row(f"force (N)\n{name}, contact", lines, window=around_contact(contact)),
        ]


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


LESS_CONSERVATIVE = CausalAgainstOriginal(
    "less_conservative", less_conservative_noncausal, ("Fig. 10", "Fig. 11")
)
MORE_CONSERVATIVE = CausalAgainstOriginal(
    "more_conservative", more_conservative_noncausal, ("Fig. 14", "Fig. 15")
)
