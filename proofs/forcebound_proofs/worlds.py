"""Audit of laws through worlds and controllers, in two and three axes."""

from collections.abc import Iterator, Sequence
from typing import ClassVar
from zlib import crc32

import numpy as np

from forcebound.haptics.controllers import CONTROLLERS
from forcebound.haptics.environments.mujoco_scene import engine
from forcebound.haptics.laws import check_law
from forcebound.lab.engine import Row
from forcebound.lab.views import table
from forcebound.units import energy_in_words as energy
from forcebound_proofs.attack import (
    MARGIN,
    SEARCH,
    Budget,
    CodedAttack,
    Floats,
    Names,
    Outcome,
    Series,
    certified_laws,
    spans,
)
from forcebound_proofs.views import share
from forcebound_proofs.world_cases import (
    HAND_AND_DEVICE,
    WATCHDOGS,
    WorldScenario,
    case_of,
    numbers_of,
    worlds,
)
from forcebound_proofs.world_run import SECONDS, TRACE_COLUMNS, run_world

NEARLY_SPENT = 0.01  # share of the energy; an attack that leaves less has nearly spent it
UNBOUNDED, UNBOUNDED_SHARE = "none", 0.2  # of the random runs, for the law that does nothing


def _spent(row: Row) -> str:
    return f"{row['nearly_spent_share']:.1%}" if row["is_certified"] else "–"


def _by_controller(row: Row, controllers: Sequence[str]) -> list[str]:
    margins = [row["controller"][name][MARGIN] for name in controllers]
    return [f"`{row['target']}`", f"`{row['law']}`", *map(energy, margins)]


class WorldAttack(CodedAttack):
    """Certified laws through every world and every controller; a target is WORLD/CONTROLLER."""

    name = "worlds"
    title = "Audit in two and three axes"
    columns: ClassVar = {
        "world": lambda row: f"`{row['target']}`",
        "law": None,
        "runs": None,
        "lowest energy": None,
        "nearly spent": _spent,
        "verdict": None,
        "case": None,
    }
    groups = ("controller",)
    introduction = f"""\
## Certified laws through worlds and controllers

Each run is a graph of the live nodes in virtual time, for {SECONDS:g} s: law, safety chain,
controller and environment are those of every other run. The device has two or three axes, each with
its own damping and friction, an encoder, a watchdog, late ticks; it dissipates exactly what the law
is informed of. The hand moves along a sine on each axis, into the surface and over it. The link to
the environment is late, jitters and loses packets. The fields of environment and controller are
drawn from the ranges of their types. *Lowest energy* is the lower of the energy that the hand has
put in and of the loss plus work (without the kinetic energy of the device), looked at four times a
period; 0 is where a run begins. *Nearly spent*: share of the runs that leave less than
{NEARLY_SPENT:.0%} of the energy that was there. The law `{UNBOUNDED}` meets some of the same random
cases: what it gives away is what the attacks can do.
"""

    def series(self, laws: Names, targets: Names, budget: Budget) -> list[Series]:
        """Return what is to be run; a target without a world, or a controller, is all of them."""
        found, (runs, searched, seed) = list[Series](), budget
        laws = laws or certified_laws()
        for law in laws:
            check_law(law)
        for target in _every(targets or ["/"]):
            numbers_of(*target.split("/"))
            for law in dict.fromkeys((UNBOUNDED, *laws)):
                share = 1.0 if law in laws else UNBOUNDED_SHARE
                found += self.at_random(law, target, int(share * runs), seed)
                if searched and law in laws:
                    found.append(Series(self.name, law, target, SEARCH, seed, searched))
        if any(one.target.startswith("bodies/") for one in found):
            engine()  # its absence would show only after most of the runs
        return found

    def prefix(self, target: str) -> str:
        """Return what the names of a series begin with."""
        return f"{target}:"

    def space(self, series: Series) -> tuple[Sequence[int], int, np.random.Generator]:
        """Return no choices, the dimensions of a search, its chance."""
        random = np.random.default_rng((series.seed, crc32(series.target.encode())))
        return (), len(numbers_of(*series.target.split("/"))), random

    def labels(self, law: str, case: WorldScenario, outcome: Outcome) -> Row:
        """Return world and controller, and whether nearly all energy was spent."""
        return {
            "target": case.world,
            "controller": case.controller,
            "is_nearly_spent": outcome.share_left < NEARLY_SPENT,
        }

    def make(self, name: str) -> WorldScenario:
        """Return the case of a name."""
        return case_of(name)

    def run(self, law: str, case: WorldScenario, is_traced: bool = False) -> Outcome:
        """Run a case."""
        device = run_world(law, case)
        details = {
            "energy_min_j": device.energy_min,
            "loss_and_work_min_j": device.lost_min,
            "peak_force_n": device.peak_force,
        }
        margin = min(device.energy_min, device.lost_min)
        columns = np.array(device.looks).T if is_traced else ()
        trace: dict[str, Floats] = dict(zip(TRACE_COLUMNS, columns, strict=False))
        return Outcome(margin, device.share_left, details, trace)

    def description(self, case: WorldScenario) -> Row:
        """Return the numbers of a case."""
        watchdog = WATCHDOGS[int(case.numbers["watchdog"])]
        return {"seed": case.seed, **case.numbers, "axes": case.axes, "watchdog": watchdog}

    def further(self, rows: Sequence[Row]) -> Row:
        """Return the share of runs that have nearly spent the energy."""
        return {"nearly_spent_share": share(rows, "is_nearly_spent")}

    def section(self, rows: Sequence[Row]) -> Iterator[str]:
        """Yield the section of a page."""
        rows = sorted(rows, key=lambda row: (row["target"], row["law"]))
        yield from super().section(rows)
        controllers = list(rows[0]["controller"])
        yield "### By controller\n"
        heads = ("world", "law", *(f"`{name}`" for name in controllers))
        yield from table(heads, (_by_controller(row, controllers) for row in rows))
        yield "\n### Numbers of hand, device and link\n"
        yield from spans(HAND_AND_DEVICE)


def _every(targets: Sequence[str]) -> Iterator[str]:
    """Yield the pairs of worlds and controllers that are meant."""
    for target in targets:
        world, _, controller = target.partition("/")
        for one in [world] if world else worlds():
            for other in [controller] if controller else CONTROLLERS:
                yield f"{one}/{other}"
