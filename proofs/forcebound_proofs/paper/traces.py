"""Figures 18, 20, 21: laws computed on the recorded trace of another law's run.

The trace has readings and commanded forces. A law computed on it has its own ledger and forces, but
its forces do not move the hand: only the laws are compared.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from forcebound.haptics.laws import Dissipation, ForceBounder
from forcebound.results.surface import Floats
from forcebound_proofs.drawing import finish, law_line, line, rows_of
from forcebound_proofs.paper.noncausal import (
    less_conservative_noncausal,
    more_conservative_noncausal,
)
from forcebound_proofs.paper.outcome import Number, Outcome, by_law
from forcebound_proofs.paper.setup import (
    CERTIFIED,
    HIGH,
    SPEEDS,
    Contact,
    Runs,
    dissipation,
    wall_command,
)

NonCausal = Callable[[Sequence[float], Sequence[float], Dissipation], list[float]]


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


def run_fig18(runs: Runs) -> Outcome:
    """Compute the AOL on the trace of Fig. 10 (less conservative, high speed)."""
    contact = runs.wall("less_conservative", HIGH)
    forces = {law: on_trace(law, contact) for law in ("less_conservative", "aol", *CERTIFIED)}
    where = contact.in_contact
    mean = contact.applied[where].mean()
    extra = {law: float(100.0 * (f[where].mean() / mean - 1.0)) for law, f in forces.items()}
    ratios = float(100.0 * ((forces["aol"][where] / contact.applied[where]).mean() - 1.0))
    repeated = float(np.abs(forces["less_conservative"] - contact.applied).max())
    more = "more force than less conservative"
    drawing, (position, force, early) = rows_of(3)
    line(position, contact.time, contact.position * 1e3, "reading")
    for axes in (force, early):
        law_line(axes, "less_conservative", contact.time, contact.applied, " (the run)")
        for law in ("aol", *CERTIFIED):
            law_line(axes, law, contact.time, forces[law], " on its trace")
    finish(position, "position (mm)")
    finish(force, "force (N)")
    finish(early, "force (N)\nat contact", window=around_contact(contact))
    return Outcome(
        title="AOL computed on the position trace of Fig. 10",
        paper="The AOL gives slightly more force, 5.9 %.",
        finding=(
            f"{extra['aol']:.1f} % more force: mean AOL force over mean applied force, all samples "
            "in contact. The AOL is a reconstruction (docs/theory.md), whose F_max has f_c where "
            "the less conservative law extrapolates the last move: about 0.12 N more, here over "
            f"{mean:.1f} N; 5.9 % are 2.0 N."
        ),
        numbers=[
            Number(more, "%", extra["aol"], 5.9, "aol"),
            *by_law(more, "%", {law: extra[law] for law in CERTIFIED}),
            Number("the same, mean of the ratios", "%", ratios, 5.9, "aol"),
            Number("trace repeated, largest difference", "N", repeated, 0.0, "less_conservative"),
        ],
        drawing=drawing,
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
        drawing, panels = rows_of(4)
        for index, (speed, name) in enumerate(zip(SPEEDS, self.figures, strict=True)):
            contact = runs.wall(self.law, SPEEDS[speed])
            positions, commanded = contact.position.tolist(), contact.commanded.tolist()
            original = np.array(self.original(positions, commanded, dissipation(contact)))
            numbers += self._numbers(speed, contact, original - contact.applied)
            traced = {law: on_trace(law, contact) for law in CERTIFIED}
            whole, early = panels[2 * index : 2 * index + 2]
            for axes in (whole, early):
                for law, force in traced.items():
                    law_line(axes, law, contact.time, force, " on the trace")
                law_line(axes, self.law, contact.time, contact.applied, ", causal (the run)")
                line(axes, contact.time, original, "non-causal original", linestyle="--")
            finish(whole, f"force (N)\ntrace of {name}")
            finish(early, f"force (N)\n{name}, contact", window=around_contact(contact))
        shares = [number.ours for number in numbers if number.unit == "%"]
        return Outcome(
            title=f"{self.law.replace('_', ' ')} law against its non-causal original",
            paper="Almost the same values; no number.",
            finding=(
                f"RMS difference over the samples in contact {shares[0]:.2f} % of the mean force "
                f"at high and {shares[1]:.2f} % at low speed."
            ),
            numbers=numbers,
            drawing=drawing,
            commands=[wall_command(self.law, approach) for approach in SPEEDS.values()],
        )

    def _numbers(self, speed: str, contact: Contact, difference: Floats) -> list[Number]:
        where = contact.in_contact
        start, end = around_contact(contact)
        early = where & (contact.time >= start) & (contact.time <= end)
        rms, first = (float(np.sqrt(np.mean(difference[one] ** 2))) for one in (where, early))
        share = 100.0 * rms / float(contact.applied[where].mean())
        label = f"RMS difference, first 150 ms of contact, {speed} speed"
        return [
            Number(f"RMS difference, {speed} speed", "N", rms, None, self.law),
            Number("the same, of the mean force in contact", "%", share, None, self.law),
            Number(label, "N", first, None, self.law),
        ]


LESS_CONSERVATIVE = CausalAgainstOriginal(
    "less_conservative", less_conservative_noncausal, ("Fig. 10", "Fig. 11")
)
MORE_CONSERVATIVE = CausalAgainstOriginal(
    "more_conservative", more_conservative_noncausal, ("Fig. 14", "Fig. 15")
)
