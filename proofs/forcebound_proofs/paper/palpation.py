"""Figure 19: the laws under a 2 Hz sinusoidal motion, as in palpation."""

from forcebound_proofs.drawing import finish, law_line, line, rows_of
from forcebound_proofs.paper.contacts import minimum_energies
from forcebound_proofs.paper.outcome import Number, Outcome, by_law
from forcebound_proofs.paper.setup import CERTIFIED, Contact, Runs, command

LAWS = ("less_conservative", "aol", "more_conservative", *CERTIFIED)


def run(runs: Runs) -> Outcome:
    """Reproduce the figure."""
    contacts = {law: runs.contact("palpation", f"law:={law}") for law in LAWS}
    peaks = {law: peak_forces(contact) for law, contact in contacts.items()}
    stiffnesses = {law: (one.seen.mean_stiffness or 0.0) * 1e-3 for law, one in contacts.items()}
    numbers = by_law("displayed stiffness, mean in contact", "N/mm", stiffnesses)
    for law in LAWS:
        numbers.append(Number("peak force, first second", "N", peaks[law][0], None, law))
        numbers.append(Number("peak force, last second", "N", peaks[law][-1], None, law))
    growing = [law for law in LAWS if peaks[law][-1] > peaks[law][0] + 0.01]
    drawing, (position, force, last, energy, over_depth) = rows_of(5)
    some = contacts["more_conservative"]
    line(position, some.time, some.position * 1e3, "reading")
    for law, contact in contacts.items():
        law_line(force, law, contact.time, contact.applied)
        law_line(last, law, contact.time, contact.applied)
        columns, late = contact.run.columns, contact.time >= 4.0
        law_line(energy, law, columns.time, columns.true_energy * 1e3)
        law_line(over_depth, law, contact.depth[late] * 1e3, contact.applied[late])
    finish(position, "position (mm)")
    finish(force, "force (N)")
    finish(last, "force (N)\nlast second", window=(4.0, 5.0))
    finish(energy, "true energy (mJ)")
    finish(over_depth, "force (N)", "penetration (mm), last second", window=(0.0, 5.0))
    return Outcome(
        title="2 Hz palpation with every law",
        paper="Stable; stiffer with a memory; the force grows slightly with time for all methods.",
        finding=(
            "Stable with every law, and never out of the wall. The peak force grows from the first "
            f"to the last second with {', '.join(growing) or 'none of them'}. Each move adds "
            "friction to the bound, so laws without a memory grow too."
        ),
        numbers=[*numbers, *minimum_energies(contacts)],
        drawing=drawing,
        commands=[command("palpation", f"law:={law}") for law in LAWS],
    )


def peak_forces(contact: Contact) -> list[float]:
    """Return the largest force of each whole second, in N."""
    seconds = [(contact.time >= s) & (contact.time < s + 1.0) for s in range(int(contact.time[-1]))]
    return [float(contact.applied[second].max()) for second in seconds]
