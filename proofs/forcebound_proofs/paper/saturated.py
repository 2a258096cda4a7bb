"""Displayed stiffness of the saturated more conservative law over depth."""

import math
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes

from forcebound.haptics.laws import Dissipation
from forcebound.results.colours import NEUTRAL
from forcebound.results.surface import Floats
from forcebound_proofs.drawing import LOG_TICKS, finish, law_line, line, rows_of
from forcebound_proofs.paper.outcome import Number, Outcome
from forcebound_proofs.paper.setup import (
    CERTIFIED,
    HIGH,
    SPEEDS,
    USER_STUDY,
    Contact,
    Runs,
    dissipation,
    wall_command,
)

LAW = "more_conservative"
SHALLOWEST = 0.1e-3  # m; three encoder steps: at smaller depths rounding dominates the ratio


def next_force(force: float, move: float, relied_on: Dissipation) -> float:
    r"""Return the next force of the saturated law, in N, after a move in m.

    .. math:: F_d(i) = \sqrt{(F_d(i-1) + 2 B \Delta x(i))^2 + 4 B f_c |\Delta x(i)|}

    Source: paper, Eq. 41, first line; B = b/T.
    """
    capability = relied_on.least_damping / relied_on.period
    gained = 4.0 * capability * relied_on.least_friction * abs(move)
    return math.sqrt((force + 2.0 * capability * move) ** 2 + gained)


def stiffness_at(depth: float, move: float, relied_on: Dissipation) -> float:
    """Return Eq. 42's displayed stiffness at ``depth``, reached in steps of ``move``, in N/mm."""
    force, steps = 0.0, max(1, round(depth / move))
    for _ in range(steps):
        force = next_force(force, move, relied_on)
    return force / (steps * move) * 1e-3


def recursion(contact: Contact, relied_on: Dissipation) -> tuple[slice, Floats]:
    """Return the samples of the first contact while the bound is active, and the forces of Eq. 41.

    The recursion begins with the first force that the bound reduces.
    """
    first = int(np.argmax(contact.in_contact & (contact.commanded > contact.applied + 1e-9)))
    free = np.flatnonzero(contact.commanded[first + 1 :] <= contact.applied[first + 1 :])
    last = first + 1 + (int(free[0]) if free.size else contact.time.size - first - 1)
    forces = [float(contact.applied[first])]
    for before, after in pairwise(contact.position[first:last].tolist()):
        forces.append(next_force(forces[-1], after - before, relied_on))
    return slice(first, last), np.array(forces)


def run(runs: Runs) -> Outcome:
    """Compare both equations with runs, and with the measurements of the paper's user study."""
    numbers: list[Number] = []
    drawing, panels = rows_of(len(SPEEDS), height=2.8)
    for speed, axes in zip(SPEEDS, panels, strict=True):
        numbers += _numbers(runs, speed)
        _draw(axes, runs, speed)
    relied_on = dissipation(runs.wall(LAW, HIGH))
    deep = stiffness_at(1.0, 3e-5, relied_on)
    two_b = 2.0 * relied_on.least_damping / relied_on.period * 1e-3
    label = "Eq. 42 at 1 m, the limit for great depth (2B)"
    largest = max(number.ours or 0.0 for number in numbers if number.unit == "N")
    return Outcome(
        title="displayed stiffness of the saturated more conservative law",
        paper="Depends on penetration: larger when shallow, 2B when deep.",
        finding=(
            f"Eq. 41 gives the forces of the runs to {largest:.1e} N as long as the bound is "
            "active. Eq. 42 falls with depth to 2B; in the runs every move, inwards or outwards, "
            "adds friction, so the force is larger after a bounce."
        ),
        numbers=[*numbers, Number(label, "N/mm", deep, two_b, LAW)],
        drawing=drawing,
        commands=[wall_command(LAW, approach) for approach in SPEEDS.values()],
    )


def _numbers(runs: Runs, speed: str) -> list[Number]:
    """Eq. 41 against the run, and Eq. 42 against the paper's user study."""
    contact = runs.wall(LAW, SPEEDS[speed])
    relied_on = dissipation(contact)
    where, forces = recursion(contact, relied_on)
    difference = float(np.abs(forces - contact.applied[where]).max())
    over = f"largest difference over {forces.size} samples"
    depth, paper = USER_STUDY[speed].depth, USER_STUDY[speed].stiffness
    move = contact.contact_speed * relied_on.period
    steps = f"in even steps of {move * 1e3:.3f} mm (paper: mean of its user study)"
    stiffness = stiffness_at(depth, move, relied_on)
    return [
        Number(f"Eq. 41 against the run, {speed} speed, {over}", "N", difference, None, LAW),
        Number(f"Eq. 42 at {depth * 1e3:g} mm {steps}", "N/mm", stiffness, paper, LAW),
    ]


def _draw(axes: Axes, runs: Runs, speed: str) -> None:
    contact = runs.wall(LAW, SPEEDS[speed])
    relied_on = dissipation(contact)
    where, forces = recursion(contact, relied_on)
    move = contact.contact_speed * relied_on.period
    depths = np.arange(np.ceil(SHALLOWEST / move), 5e-3 / move) * move
    even = np.array([stiffness_at(float(depth), move, relied_on) for depth in depths])
    x, y = _over_depth(contact.depth[where], contact.applied[where])
    law_line(axes, LAW, x, y, ", run", linewidth=3.5, alpha=0.4)
    line(axes, *_over_depth(contact.depth[where], forces), "Eq. 41 on its readings", linestyle=":")
    line(axes, depths * 1e3, even, "Eq. 42, even steps", linestyle="--")
    for law in CERTIFIED:
        other = runs.wall(law, SPEEDS[speed])
        law_line(axes, law, *_over_depth(other.depth, other.applied), ", run")
    two_b = 2.0 * relied_on.least_damping / relied_on.period * 1e-3
    line(axes, np.array([0.1, 5.0]), np.full(2, two_b), "2B", NEUTRAL, linestyle=":")
    axes.set_yscale("log")
    label = f"force over penetration\n(N/mm), {speed} speed"
    finish(axes, label, "penetration (mm)", window=(0.1, 5.0))
    axes.set_ylim(0.4, 12.0)
    axes.set_yticks(LOG_TICKS, [f"{tick:g}" for tick in LOG_TICKS])
    axes.minorticks_off()


def _over_depth(depth: Floats, force: Floats) -> tuple[Floats, Floats]:
    """Return penetrations, in mm, and force over penetration, in N/mm."""
    deep = depth >= SHALLOWEST
    return depth[deep] * 1e3, force[deep] / depth[deep] * 1e-3
