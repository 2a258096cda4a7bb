"""Figures 4 to 17: one law in one contact, with the certified laws for comparison."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from forcebound.results.plots import figure
from forcebound_proofs.paper.outcome import Number, Outcome, by_law
from forcebound_proofs.paper.setup import (
    CERTIFIED,
    HIGH,
    PAPER_LAWS,
    SPEEDS,
    Contact,
    Runs,
    command,
    wall_command,
)
from forcebound_proofs.paper.table1 import WORDS, paper_value

TURNS = "turning points in the first half second of contact"
PANELS = ("position", "force", "contact", "energy", "force_over_penetration")


@dataclass(frozen=True)
class TimeVaryingWall:
    """Figures 4 to 6: a wall so soft that the bounder never reduces the force."""

    law: str

    def run(self, runs: Runs) -> Outcome:
        """Reproduce the figure."""
        arguments = {
            law: ("paper_time_varying_wall", f"law:={law}", *HIGH) for law in (self.law, *CERTIFIED)
        }
        contacts = {law: runs.contact(*words) for law, words in arguments.items()}
        numbers = [
            Number("applied over commanded force, mean in contact", "1", shown(contact), paper, law)
            for (law, contact), paper in zip(contacts.items(), (1.0, None, None), strict=True)
        ]
        unreduced = [law for law, contact in contacts.items() if shown(contact) > 0.9999]
        return Outcome(
            title=f"time-varying wall, 0.3 N/mm + 0.06 N/mm per second, {PAPER_LAWS[self.law]}",
            paper="The full stiffness of the wall: the bounder is never active.",
            finding=f"Never reduced by the bounder: {', '.join(unreduced) or 'none'}.",
            numbers=[*numbers, *minimum_energies(contacts)],
            drawing=_draw(contacts),
            commands=[command(*words) for words in arguments.values()],
        )


def no_law(runs: Runs) -> Outcome:
    """Reproduce Figure 7: the wall of 10 N/mm without any law."""
    contacts = {law: runs.wall(law, HIGH) for law in ("none", *CERTIFIED)}
    bounces = {law: contact.run.summary["contact_bounces"] for law, contact in contacts.items()}
    peaks = {law: contact.run.summary["peak_force_n"] for law, contact in contacts.items()}
    return Outcome(
        title="wall of 10 N/mm without any law",
        paper="Clear instability in position and force, and negative energy.",
        finding=(
            f"Without a law the hand oscillates, {bounces['none']} bounces in "
            f"{contacts['none'].time[-1]:.0f} s, and receives "
            f"{-contacts['none'].lowest_energy:.1f} mJ from the wall; with the certified laws "
            "it receives none, and trembles. The paper states neither speed nor depth: here the "
            "high speed."
        ),
        numbers=[
            *minimum_energies(contacts),
            *by_law("contact bounces", "1", bounces),
            *by_law("largest force", "N", peaks),
        ],
        drawing=_draw(contacts),
        commands=[wall_command(law, HIGH) for law in contacts],
    )


@dataclass(frozen=True)
class StiffWall:
    """Figures 8 to 17: the wall of 10 N/mm with one law at one speed."""

    law: str
    speed: str

    def run(self, runs: Runs) -> Outcome:
        """Reproduce the figure."""
        speed, words = self.speed, SPEEDS[self.speed]
        contacts = {law: runs.wall(law, words) for law in (self.law, *CERTIFIED)}
        numbers = [
            Number(name, "N/mm", getattr(contact, key), paper_value(law, key, speed), law)
            for key, name in WORDS.items()
            for law, contact in contacts.items()
        ]
        turns = {law: contact.turns for law, contact in contacts.items()}
        numbers += [*by_law(TURNS, "1", turns), *minimum_energies(contacts)]
        return Outcome(
            title=f"wall of 10 N/mm at {speed} speed, {PAPER_LAWS[self.law]}",
            paper=PAPER_SHOWS[self.law],
            finding=(
                f"{TURNS.capitalize()}: {turns[self.law]}; with the certified law "
                f"{turns['certified']}, fading {turns['certified_fading']}. The hand "
                "trembles with every law."
            ),
            numbers=numbers,
            drawing=_draw(contacts),
            commands=[wall_command(law, words) for law in contacts],
        )


PAPER_SHOWS = {
    "less_conservative_viscous": "Stable; oscillates after contact, with losses of free motion.",
    "less_conservative": "Much stiffer than with viscous damping only; severe oscillations.",
    "aol": "Very similar to the less conservative law, also with oscillations.",
    "more_conservative": "No severe oscillation: no memory; softer.",
    "more_conservative_viscous": "0.54 N/mm, exactly 2B, in contact and at rest.",
}


def shown(contact: Contact) -> float:
    """Return the applied over the commanded force, averaged over samples with a commanded force.

    At rest on the last edge of the encoder a wall commands a force at zero depth, so contact is
    defined by the force here.
    """
    where = contact.commanded > 0.0
    return float(np.mean(contact.applied[where] / contact.commanded[where]))


def minimum_energies(contacts: Mapping[str, Contact]) -> list[Number]:
    """Return the minimum energy of each law's run."""
    energies = {law: contact.lowest_energy for law, contact in contacts.items()}
    return by_law("minimum energy (ground truth)", "mJ", energies)


def _draw(contacts: dict[str, Contact]) -> Figure:
    return figure(
        [(law, contact.run.columns, contact.run.document) for law, contact in contacts.items()],
        PANELS,
    )
