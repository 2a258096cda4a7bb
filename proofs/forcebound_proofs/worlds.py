"""Audit of laws through worlds and controllers, in two and three axes."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

from forcebound.haptics.controllers import CONTROLLERS
from forcebound.haptics.environments.mujoco_scene import engine
from forcebound.haptics.laws import ENERGY_TOLERANCE, LAWS, check_law
from forcebound.lab.engine import Row
from forcebound.lab.views import groups, least, share, table, verdict
from forcebound.units import energy_in_words as energy
from forcebound_proofs.audit import Options
from forcebound_proofs.cases import objective, ranges, search
from forcebound_proofs.world_cases import NUMBERS, WATCHDOGS, WORLDS, case_of, check_name
from forcebound_proofs.world_run import SECONDS, attack

NEARLY_SPENT = 0.01  # share of the energy; an attack that leaves less has nearly spent it
PART = 50  # runs: about a second
UNBOUNDED, UNBOUNDED_SHARE = "none", 0.2  # of the random runs, for the law that does nothing
MARGIN = "margin_min_j"


class WorldCase(NamedTuple):
    """One random run, or a search, of a law through a world and a controller."""

    law: str
    world: str
    controller: str
    is_search: bool
    seed: int
    runs: int

    def rows(self) -> list[Row]:
        """Run it; return a row for each run."""
        title = f"{self.world}/{self.controller}:"
        if not self.is_search:
            return [self._row(f"{title}{self.seed}")]

        def run(code: str) -> tuple[Row, float]:
            row = self._row(title + code)
            return row, objective(row[MARGIN], row["share_left"])

        random = np.random.default_rng((self.seed, crc32(title.encode())))
        return list(search(run, (), len(NUMBERS), self.runs, random))

    def _row(self, name: str) -> Row:
        device = attack(self.law, case_of(name))
        return {
            "law": self.law,
            "world": self.world,
            "controller": self.controller,
            "case": name,
            MARGIN: min(device.energy_min, device.lost_min),
            "share_left": device.share_left,
            "is_nearly_spent": device.share_left < NEARLY_SPENT,
        }


def cases(
    laws: Sequence[str], worlds: Sequence[str], controllers: Sequence[str], options: Options
) -> list[WorldCase]:
    """Return the cases of an audit; arguments as of :func:`run`."""
    found, runs = [], options.runs
    for world in worlds:
        for controller in controllers:
            for law in dict.fromkeys((UNBOUNDED, *laws)):
                case, few = (law, world, controller), law not in laws
                random_runs = int(UNBOUNDED_SHARE * runs) if few else runs
                seeds = range(options.seed, options.seed + random_runs)
                found += [WorldCase(*case, False, one, 1) for one in seeds]
                if options.searched and not few:
                    found.append(WorldCase(*case, True, options.seed, options.searched))
    return found


def run(
    laws: Sequence[str] = (),
    worlds: Sequence[str] = (),
    controllers: Sequence[str] = (),
    **given: Any,
) -> Row:
    """Attack laws through worlds and controllers; return the worst results, ready for JSON.

    Args:
        laws: Keys of :data:`forcebound.haptics.laws.LAWS`; none: the certified ones.
        worlds: Keys of :data:`.WORLDS`; none: all.
        controllers: Keys of :data:`forcebound.haptics.controllers.CONTROLLERS`; none: all.
        given: :class:`.Options`, for each law with each world and controller.

    Returns:
        ``runs`` in all, those of certified laws as ``certified_runs``, ``seed``, and ``worlds``:
        one entry for each world and law with ``world``, ``law``, ``is_certified``, ``holds``
        (always true without a certificate), ``runs``, ``margin_min_j`` (the lowest energy) and its
        ``case``, ``nearly_spent_share``, and ``controllers``: the lowest energy through each, in J.

    Raises:
        ConfigError: If a law, a world or a controller is not known, or there is no run.
    """
    options = Options(**given)
    options.check()
    for law in laws:
        check_law(law)
    for what, names, known in (("world", worlds, WORLDS), ("controller", controllers, CONTROLLERS)):
        for name in names:
            check_name(what, name, known)
    under_attack = list(laws) or [name for name, law in LAWS.items() if law.is_certified]
    if "bodies" in (worlds or WORLDS):
        engine()  # its absence would show only after most of the runs
    found = cases(under_attack, worlds or list(WORLDS), controllers or list(CONTROLLERS), options)
    results = groups(options.run("audit of the worlds", found, PART), "world", "law")
    summary = [_summary(world, law, results[world, law]) for world, law in sorted(results)]
    document = {
        "runs": sum(case.runs for case in found),
        "certified_runs": sum(row["runs"] for row in summary if row["is_certified"]),
        "seed": options.seed,
        "worlds": summary,
    }
    chosen = {"law": laws, "world": worlds, "controller": controllers}
    options.write("audit worlds", chosen, _page(document))
    return document


def _summary(world: str, law: str, rows: list[Row]) -> Row:
    lowest, certified = least(rows, MARGIN), LAWS[law].is_certified
    by_controller = groups(rows, "controller").items()
    return {
        "world": world,
        "law": law,
        "is_certified": certified,
        "holds": not certified or lowest[MARGIN] >= -ENERGY_TOLERANCE,
        "verdict": verdict(lowest[MARGIN], certified),
        "runs": len(rows),
        MARGIN: lowest[MARGIN],
        "case": lowest["case"],
        "nearly_spent_share": share(rows, "is_nearly_spent"),
        "controllers": {name: least(own, MARGIN)[MARGIN] for (name,), own in by_controller},
    }


def replay(law: str, name: str, seconds: float | None) -> Row:
    """Run the case of a name; return its description and result.

    Raises:
        ConfigError: If law or case are not known.
    """
    case = case_of(name)
    device = attack(law, case, seconds or SECONDS)
    chosen = {"axes": case.axes, "watchdog": WATCHDOGS[int(case.numbers["watchdog"])]}
    return {
        "law": law,
        "energy_min_j": device.energy_min,
        "loss_and_work_min_j": device.lost_min,
        "share_left": device.share_left,
        "peak_force_n": device.peak_force,
        "case": {"name": name, "seed": case.seed, **case.numbers, **chosen},
    }


INTRODUCTION = """\
# Audit in two and three axes

{certified:,} attacks on the certified laws through every world and every controller, some drawn at
random, some by a search (CMA-ES) for the lowest energy.

{origin}
`forcebound audit replay LAW CASE` repeats a run by its name.

Each run is a graph of the live nodes in virtual time, for {seconds:g} s: law, safety chain,
controller and environment are those of every other run. The device has two or three axes, each with
its own damping and friction, an encoder, a watchdog, late ticks; it dissipates exactly what the law
is informed of. The hand moves along a sine on each axis, into the surface and over it. The link to
the environment is late, jitters and loses packets. *Lowest energy* is the lower of the
energy that the hand has put in and of the loss plus work (without the kinetic energy of the
device), looked at four times a period; 0 is where a run begins. *Nearly spent*: share of the runs
that leave less than 1 % of the energy that was there. The law `{unbounded}` meets some of the same
random cases: what it gives away is what the attacks can do.
"""


def _page(document: Row) -> Iterator[str]:
    rows = document["worlds"]
    yield INTRODUCTION.format(
        certified=document["certified_runs"],
        origin="{origin}",
        seconds=SECONDS,
        unbounded=UNBOUNDED,
    )
    yield from _worst(document)
    controllers = list(rows[0]["controllers"])
    yield "\n## By controller\n"
    cells = ((row, [energy(row["controllers"][name]) for name in controllers]) for row in rows)
    yield from table(
        ("world", "law", *(f"`{name}`" for name in controllers)),
        ((f"`{row['world']}`", f"`{row['law']}`", *one) for row, one in cells),
    )
    yield "\n## Numbers of the cases\n"
    yield from table(("number, SI units", "from", "to"), ranges(NUMBERS))


def _worst(document: Row) -> Iterator[str]:
    heads = ("world", "law", "runs", "lowest energy", "nearly spent", "verdict", "case")
    yield from table(heads, map(_shown, document["worlds"]))


def _shown(row: Row) -> tuple[str, ...]:
    spent = f"{row['nearly_spent_share']:.1%}" if row["is_certified"] else "–"
    names = f"`{row['world']}`", f"`{row['law']}`", f"{row['runs']:,}"
    return (*names, energy(row[MARGIN]), spent, row["verdict"], row["case"])


def lines(document: Row) -> Iterator[str]:
    """Yield the result of the campaign for a terminal."""
    yield from _worst(document)
    yield f"{document['runs']} runs; repeat one with `forcebound audit replay LAW CASE`"
