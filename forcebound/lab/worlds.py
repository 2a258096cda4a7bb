"""Audit of laws through worlds and controllers, in two and three axes."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

from forcebound.haptics.controllers import CONTROLLERS
from forcebound.haptics.environments.bodies import engine
from forcebound.haptics.laws import ENERGY_TOLERANCE, LAWS, check_law
from forcebound.lab.audit import check_runs, command_of
from forcebound.lab.cases import encode, search
from forcebound.lab.engine import Campaign, Row, run_here, runs_of
from forcebound.lab.laws import objective
from forcebound.lab.views import (
    check_page,
    energy,
    groups,
    least,
    origin,
    ranges,
    share,
    table,
    verdict,
    write_page,
)
from forcebound.lab.world_cases import NUMBERS, WATCHDOGS, WORLDS, case_of, check_name
from forcebound.lab.world_run import SECONDS, attack

TIGHT = 0.01  # an attack that leaves less than this share of the energy is tight
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

        def run(noise: int, point: Sequence[float]) -> tuple[Row, float]:
            row = self._row(title + encode((noise,), point))
            return row, objective(row[MARGIN], row["share_left"])

        random = np.random.default_rng((self.seed, crc32(title.encode())))
        return list(search(run, len(NUMBERS), self.runs, random))

    def _row(self, name: str) -> Row:
        device = attack(self.law, case_of(name))
        return {
            "law": self.law,
            "world": self.world,
            "controller": self.controller,
            "case": name,
            MARGIN: min(device.energy_min, device.lost_min),
            "share_left": device.share_left,
            "is_tight": device.share_left < TIGHT,
        }


def cases(
    laws: Sequence[str],
    worlds: Sequence[str],
    controllers: Sequence[str],
    runs: int,
    searched: int,
    seed: int = 1,
) -> list[WorldCase]:
    """Return the cases of an audit; arguments as of :func:`run`."""
    found = []
    for world in worlds:
        for controller in controllers:
            for law in dict.fromkeys((UNBOUNDED, *laws)):
                case, few = (law, world, controller), law not in laws
                seeds = range(seed, seed + (int(UNBOUNDED_SHARE * runs) if few else runs))
                found += [WorldCase(*case, False, one, 1) for one in seeds]
                if searched and not few:
                    found.append(WorldCase(*case, True, seed, searched))
    return found


def run(
    laws: Sequence[str] = (),
    worlds: Sequence[str] = (),
    controllers: Sequence[str] = (),
    runs: int = 100,
    searched: int = 100,
    seed: int = 1,
    workers: int | None = None,
    out: Path | None = None,
    rows: Path | None = None,
) -> dict[str, Any]:
    """Attack laws through worlds and controllers; return the worst results, ready for JSON.

    Args:
        laws: Keys of :data:`forcebound.haptics.laws.LAWS`; none: the certified ones.
        worlds: Keys of :data:`.WORLDS`; none: all.
        controllers: Keys of :data:`forcebound.haptics.controllers.CONTROLLERS`; none: all.
        runs: Random runs of each law with each world and controller.
        searched: Runs of each in a search.
        seed: Seed of the first random run, and of the search.
        workers: Processes; None: one for each core; 0: this process.
        out: Page to write.
        rows: Parquet file that gets a row for each run.

    Returns:
        ``runs`` in all, those of certified laws as ``certified_runs``, ``seed``, and ``worlds``:
        one entry for each world and law with ``world``, ``law``, ``is_certified``, ``holds``
        (always true without a certificate), ``runs``, ``margin_min_j`` (the lowest energy) and its
        ``case``, ``tight_share``, and ``controllers``: the lowest energy through each, in J.

    Raises:
        ConfigError: If a law, a world or a controller is not known, or there is no run.
    """
    check_page(out)
    check_runs(runs, searched)
    for law in laws:
        check_law(law)
    for world in worlds:
        check_name("world", world, WORLDS)
    for controller in controllers:
        check_name("controller", controller, CONTROLLERS)
    under_attack = list(laws) or [name for name, law in LAWS.items() if law.is_certified]
    if "bodies" in (worlds or WORLDS):
        engine()  # its absence would show only after most of the runs
    through = list(controllers) or list(CONTROLLERS)
    found = cases(under_attack, list(worlds) or list(WORLDS), through, runs, searched, seed)
    campaign = Campaign("audit of the worlds", found, part=PART, runs_of=runs_of)
    results = groups(run_here(campaign, workers, rows).rows, "world", "law")
    summary = [_summary(world, law, results[world, law]) for world, law in sorted(results)]
    document = {
        "runs": sum(case.runs for case in found),
        "certified_runs": sum(row["runs"] for row in summary if row["is_certified"]),
        "seed": seed,
        "worlds": summary,
    }
    names = {"law": laws, "world": worlds, "controller": controllers}
    command = command_of("audit worlds", runs, searched, seed, names, out)
    write_page(out, _page(document, command))
    return document


def _summary(world: str, law: str, rows: list[Row]) -> dict[str, Any]:
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
        "tight_share": share(rows, "is_tight"),
        "controllers": {name: least(own, MARGIN)[MARGIN] for (name,), own in by_controller},
    }


def replay(law: str, name: str, seconds: float | None) -> dict[str, Any]:
    """Run the case of a name; return its description and result.

    Raises:
        ConfigError: If law or case are not known.
    """
    case = case_of(name)
    device = attack(law, case, seconds or SECONDS)
    chosen = {"axes": case.axes, "watchdog": WATCHDOGS[int(case.numbers["watchdog"])]}
    return {
        "law": law,
        "energy_min": device.energy_min,
        "loss_and_work_min": device.lost_min,
        "share_left": device.share_left,
        "peak_force": device.peak_force,
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
device), looked at four times a period; 0 is where a run begins. *Tight*: share of the runs that
leave less than 1 % of the energy that was there. The law `{unbounded}` meets some of the same
random cases: what it gives away is what the attacks can do.
"""


def _page(document: dict[str, Any], command: str) -> Iterator[str]:
    rows = document["worlds"]
    yield INTRODUCTION.format(
        certified=document["certified_runs"],
        origin=origin(command),
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


def _worst(document: dict[str, Any]) -> Iterator[str]:
    heads = ("world", "law", "runs", "lowest energy", "tight", "verdict", "case")
    yield from table(heads, map(_shown, document["worlds"]))


def _shown(row: dict[str, Any]) -> tuple[str, ...]:
    tight = f"{row['tight_share']:.1%}" if row["is_certified"] else "–"
    names = f"`{row['world']}`", f"`{row['law']}`", f"{row['runs']:,}"
    return (*names, energy(row[MARGIN]), tight, row["verdict"], row["case"])


def lines(document: dict[str, Any]) -> Iterator[str]:
    """Yield the result of the campaign for a terminal."""
    yield from _worst(document)
    yield f"{document['runs']} runs; repeat one with `forcebound audit replay LAW CASE`"
