"""Audit of laws through worlds and controllers, in two and three axes: live nodes in virtual time.

Law, safety chain, controller and environment are those of every run. The device is the simulated
one; it dissipates exactly what the law is informed of, so no law has a hidden reserve. Its energies
are looked at four times a period.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

from forcebound.bounding import ENERGY_TOLERANCE, LAWS, check_law
from forcebound.controllers import CONTROLLERS
from forcebound.devices.phantom import PhantomPremium15
from forcebound.devices.simulated import SimulatedDevice
from forcebound.lab.attack import EARNED
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
    share,
    table,
    verdict,
    write_page,
)
from forcebound.lab.world_cases import (
    NUMBERS,
    WATCHDOGS,
    WORLDS,
    Case,
    case_of,
    check_name,
    controller_of,
)
from forcebound.messages.packets import TOPIC_OF, EnvironmentQuery, EnvironmentReply, Packet, Vector
from forcebound.network.impairment import Impairment
from forcebound.network.link import Link, link_seed
from forcebound.nodes.controller import ControllerNode
from forcebound.nodes.device import DeviceNode
from forcebound.nodes.environment import EnvironmentNode
from forcebound.nodes.servo import ServoSettings, dissipation_of
from forcebound.operators import Operator
from forcebound.simulation import LateTicks, Simulation

SECONDS = 0.25  # of a run
ENGAGE = 0.01  # s: soon at full force
START, ARRIVAL = -0.002, 0.03  # m, before the surface; s, until the hand presses
SHORTEST_LATE = 0.3e-3  # s
TIGHT = 0.01  # an attack that leaves less than this share of the energy is tight
PART = 50  # runs: about a second
UNBOUNDED, UNBOUNDED_SHARE = "none", 0.2  # of the random runs, for the law that does nothing
MARGIN = "margin_min_j"
_SIDES = 2  # energies are looked at in the middle and at the end of each stretch of a hold


@dataclass(frozen=True)
class SpaceHand(Operator):
    """A hand that goes from before the surface to ``pressing``, with a sine along each axis."""

    mass: float
    stiffness: float
    damping: float
    pressing: float  # m
    amplitudes: Vector  # m
    frequencies: Vector  # Hz

    def target(self, elapsed: float) -> Vector:
        """Return the target after ``elapsed`` s; see :class:`forcebound.operators.Operator`."""
        turn = 2.0 * math.pi * elapsed
        places = zip(self.amplitudes, self.frequencies, strict=True)
        first, *others = [a * math.cos(turn * f) for a, f in places]
        arrived = min(elapsed / ARRIVAL, 1.0)
        return (START + arrived * (self.pressing - START) - first, *others)


class WatchedDevice(SimulatedDevice):
    """A simulated device that keeps the lowest energies of its hand.

    Attributes:
        energy_min: Lowest energy of the hand, in J.
        lost_min: Lowest loss plus work: that energy less the kinetic energy of the device, in J.
        share_left: Lowest share left of the loss plus work so far; 1 if there was none.
        peak_force: Largest force that was written, in N.
    """

    def __init__(self, model: PhantomPremium15, hand: SpaceHand, hold_limit: float) -> None:
        super().__init__(model, hand, hold_limit)
        self._half_mass = 0.5 * model.mass
        self.energy_min = self.lost_min = self._earned = 0.0
        self.share_left = 1.0
        self.peak_force = 0.0

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Hold ``force`` from now on; see :class:`forcebound.devices.Device`."""
        held = super().write(time_ns, force)
        self.peak_force = max(self.peak_force, math.hypot(*held))
        return held

    def _hold_until(self, time_ns: int) -> None:
        assert self._time_ns is not None
        begin_ns, step_ns = self._time_ns, (time_ns - self._time_ns) / _SIDES
        for side in range(1, _SIDES + 1):
            super()._hold_until(time_ns if side == _SIDES else begin_ns + round(side * step_ns))
            truth = self._body.truth()
            lost = truth.energy - self._half_mass * math.hypot(*truth.velocity) ** 2
            self.energy_min = min(self.energy_min, truth.energy)
            self.lost_min = min(self.lost_min, lost)
            self._earned = max(self._earned, lost)
            if self._earned > EARNED:
                self.share_left = min(self.share_left, lost / self._earned)


def attack(law: str, case: Case, seconds: float = SECONDS) -> WatchedDevice:
    """Run a case, and return its device with the energies that it has kept.

    Raises:
        ConfigError: If the law is not known.
    """
    check_law(law)
    numbers = case.numbers
    model, servo = device_of(case), servo_of(law, case)
    device = WatchedDevice(model, hand_of(case), servo.opening_hold)
    lateness = LateTicks(
        rate=numbers["late_rate"],
        shortest=SHORTEST_LATE,
        longest=numbers["lateness"],
        jitter=numbers["jitter"],
        seed=case.seed,
    ).of(servo)
    device_node = DeviceNode(device, dissipation_of(model, servo), servo, lateness=lateness)
    nodes = [
        EnvironmentNode(WORLDS[case.world](numbers), axes=case.axes),
        ControllerNode(controller_of(case.controller, numbers).open(case.axes)),
        device_node,
    ]
    simulation = Simulation(nodes, _links_of(case), lambda packet: None, ())
    for node in nodes:
        node.events.is_logged = False
    device_node.engage()
    end_ns = round(seconds * 1e9)
    try:
        simulation.run(end_ns)
    finally:
        for node in nodes:
            node.stop(end_ns)
            node.close()
    return device


def device_of(case: Case) -> PhantomPremium15:
    """Return the device of a case, which has just what it states."""
    numbers, axes = case.numbers, case.axes
    damping, friction = (
        tuple([numbers[name] * numbers[f"{name}_ratio"] ** axis for axis in range(axes)])
        for name in ("damping", "friction")
    )
    return PhantomPremium15(
        axes=axes,
        mass=numbers["mass"],
        damping=damping,
        friction=friction,
        resolution=numbers["resolution"],
        saturation=numbers["saturation"],
        watchdog=WATCHDOGS[int(numbers["watchdog"])],
    )


def hand_of(case: Case) -> SpaceHand:
    """Return the hand of a case."""
    numbers, others = case.numbers, range(1, case.axes)
    frequency, detuning = numbers["frequency"], numbers["detuning"]
    return SpaceHand(
        numbers["hand_mass"],
        numbers["hand_stiffness"],
        numbers["hand_damping"],
        numbers["pressing"],
        (numbers["amplitude"], *(numbers["sideways"] for _ in others)),
        (frequency, *(frequency * detuning**axis for axis in others)),
    )


def servo_of(law: str, case: Case) -> ServoSettings:
    """Return the servo of a case."""
    numbers = case.numbers
    return ServoSettings(
        law=law,
        reply_wait=numbers["reply_wait"],
        hold_limit=1.0 + numbers["hold_limit"] if numbers["hold_limit"] else "auto",
        engage_time=ENGAGE,
    )


def _links_of(case: Case) -> dict[str, Link[Packet]]:
    numbers = case.numbers
    impairment = Impairment(
        delay=numbers["delay"], jitter=numbers["delay_jitter"], loss=numbers["loss"]
    )
    if impairment == Impairment():
        return {}
    topics = [TOPIC_OF[kind] for kind in (EnvironmentQuery, EnvironmentReply)]
    return {topic: Link(impairment, link_seed(case.seed, topic)) for topic in topics}


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
                case, few = (law, world, controller), law == UNBOUNDED
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
        laws: Keys of :data:`forcebound.bounding.LAWS`; none: the certified ones.
        worlds: Keys of :data:`.WORLDS`; none: all.
        controllers: Keys of :data:`forcebound.controllers.CONTROLLERS`; none: all.
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
the environment is late, jitters and loses packets. The ranges are those of `NUMBERS` in
`forcebound/lab/world_cases.py`. *Lowest energy* is the lower of the energy that the hand has put in
and of the loss plus work (without the kinetic energy of the device), looked at four times a period;
0 is where a run begins. *Tight*: share of the runs that leave less than 1 % of the energy that was
there. The law `{unbounded}` meets some of the same random cases: what it gives away is what the
attacks can do.
"""


def _page(document: dict[str, Any], command: str) -> Iterator[str]:
    rows = document["worlds"]
    yield INTRODUCTION.format(
        certified=document["certified_runs"],
        origin=origin(command),
        seconds=SECONDS,
        unbounded=UNBOUNDED,
    )
    heads = ("world", "law", "runs", "lowest energy", "tight", "verdict")
    yield from table(heads, map(_shown, rows))
    controllers = list(rows[0]["controllers"])
    yield "\n## By controller\n"
    cells = ((row, [energy(row["controllers"][name]) for name in controllers]) for row in rows)
    yield from table(
        ("world", "law", *(f"`{name}`" for name in controllers)),
        ((f"`{row['world']}`", f"`{row['law']}`", *one) for row, one in cells),
    )
    yield "\n## Runs that leak\n"
    for row in rows:
        if row[MARGIN] < -ENERGY_TOLERANCE:
            yield f"* {energy(row[MARGIN])}: `{row['law']} {row['case']}`"


def _shown(row: dict[str, Any]) -> tuple[str, ...]:
    tight = f"{row['tight_share']:.1%}" if row["is_certified"] else "–"
    names = f"`{row['world']}`", f"`{row['law']}`", f"{row['runs']:,}"
    return (*names, energy(row[MARGIN]), tight, row["verdict"])


def lines(document: dict[str, Any]) -> Iterator[str]:
    """Yield the result of the campaign for a terminal."""
    for row in document["worlds"]:
        yield (
            f"{row['world']:<20}{row['law']:<22}{energy(row[MARGIN]):>10}  {row['verdict']:<9}"
            f"tight {row['tight_share']:>5.1%}"
            + ("" if row["holds"] else f"\n    case {row['case']}")
        )
    yield (
        f"{document['runs']} runs, {document['certified_runs']} of them of certified laws; repeat"
        " one with `forcebound audit replay LAW CASE`"
    )
