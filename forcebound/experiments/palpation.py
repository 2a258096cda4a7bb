"""Figure 19: the laws under a 2 Hz sinusoidal motion, as in palpation."""

from __future__ import annotations

import numpy as np

from forcebound.experiments.contacts import minimum_energies
from forcebound.experiments.drawing import Line, Row, draw_rows, law_line
from forcebound.experiments.outcome import Number, Outcome, by_law
from forcebound.experiments.setup import CERTIFIED, Contact, Runs, command

LAWS = ("less_conservative", "aol", "more_conservative", *CERTIFIED)


def run(runs: Runs) -> Outcome:
    """Reproduce the figure."""
    contacts = {law: runs.contact("palpation", f"law:={law}") for law in LAWS}
    peaks = {law: peak_forces(contact) for law, contact in contacts.items()}
    stiffnesses = {law: mean_stiffness(contact) for law, contact in contacts.items()}
    numbers = by_law("displayed stiffness, mean in contact", "N/mm", stiffnesses)
    for law in LAWS:
        first, last = float(peaks[law][0]), float(peaks[law][-1])
        numbers.append(Number("peak force, first second", "N", first, None, law))
        numbers.append(Number("peak force, last second", "N", last, None, law))
    numbers += minimum_energies(contacts)
    some = contacts["more_conservative"]
    forces = [law_line(law, contact.time, contact.applied) for law, contact in contacts.items()]
    growing = [law for law in LAWS if peaks[law][-1] > peaks[law][0] + 0.01]
    return Outcome(
        title="2 Hz palpation with every law",
        paper=(
            "Stable forces; AOL and less conservative stiffer than more conservative; the force "
            "grows slightly with time for all methods."
        ),
        finding=(
            "Stable with every law, and never out of the wall. The peak force grows from the first "
            f"to the last second with {', '.join(growing) or 'none of them'}; more_conservative, "
            f"second by second: {', '.join(f'{peak:.2f}' for peak in peaks['more_conservative'])} "
            "N. Each move adds friction to the bound, so laws without a memory grow too; contact "
            "at the surface begins anew, and a sine that crosses it would not grow."
        ),
        numbers=numbers,
        drawing=draw_rows(
            [
                Row("position (mm)", [Line("reading", some.time, some.position * 1e3)]),
                Row("force (N)", forces),
                Row("force (N)\nlast second", forces, window=(4.0, 5.0)),
                Row(
                    "true energy (mJ)",
                    [
                        law_line(law, c.run.columns.time, c.run.columns.true_energy * 1e3)
                        for law, c in contacts.items()
                    ],
                ),
                Row(
                    "force (N)",
                    [
                        law_line(law, c.depth[c.time >= 4.0] * 1e3, c.applied[c.time >= 4.0])
                        for law, c in contacts.items()
                    ],
                    x_label="penetration (mm), last second",
                    window=(0.0, 5.0),
                ),
            ]
        ),
        commands=[command("palpation", f"law:={law}") for law in LAWS],
    )


def peak_forces(contact: Contact) -> list[float]:
    """Return the largest force of each whole second, in N."""
    seconds = int(contact.time[-1] + 1e-9)
    return [
        float(contact.applied[(contact.time >= s) & (contact.time < s + 1.0)].max())
        for s in range(seconds)
    ]


def mean_stiffness(contact: Contact) -> float:
    """Return mean force over mean penetration of the samples in contact, in N/mm.

    Not the mean of the ratios: a shallow sample of a moving hand would weigh as much as a deep one.
    """
    where = contact.in_contact
    return float(np.mean(contact.applied[where]) / np.mean(contact.depth[where])) * 1e-3
