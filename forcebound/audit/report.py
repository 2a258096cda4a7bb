"""Report of an audit: a page, lines for a terminal, and the plot of one run."""

import platform
import re
import textwrap
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from forcebound.analysis.plots import save
from forcebound.audit.cases import DIMENSIONS, RANGES
from forcebound.audit.path_run import PathResult
from forcebound.audit.paths import SAMPLES
from forcebound.audit.plan import LONGEST
from forcebound.audit.run import TRACE_COLUMNS, Floats, Result
from forcebound.bounding import ENERGY_TOLERANCE

INTRODUCTION = """\
# Audit of the laws

{runs:,} attacks on the laws and their certificates, some drawn at random, some by a search for the
lowest energy.

    {command}

made this page (forcebound {version}, {processor}). Any run can be repeated by name:

    forcebound audit replay LAW CASE --out run.png

[audit-worlds.md](audit-worlds.md): the same laws in two and three axes, through every world and
controller.

The default watchdog, `guarding`, is attacked in the rows of the first and the last table that name
it, and in the worlds, which draw guarding, reporting and silent ones. All other rows, also those of
`forcebound audit sensitivity`, have the watchdog that they name, or a silent one.
"""

LAWS_INTRODUCTION = """\
## The laws against hands and walls

Each run simulates a device with a hand for {seconds:g} s, with an adversary as environment, a bad
network and a bad clock. It records the *loss plus work*: the energy that the device has dissipated
plus the work done against its motor. This equals the energy put in by the hand less the kinetic
energy of the device. A passive device keeps it at or above zero; the tolerance is {tolerance:.0e}
J. The device dissipates exactly the minimum that the law assumes, so no law has a hidden reserve.

A *random* case is named by its seed. The *search* is CMA-ES (N. Hansen) over the {dimensions}
continuous parameters of a case, in each of the 24 pairs of adversary and kind of reading, with the
same budget for each law; its cases are named by a code of their parameters. Without a leak the
search minimises the *share left*: the lowest ratio of the loss plus work to its earlier maximum.

{ranges}
"""

CERTIFICATES_INTRODUCTION = """\
## The certificates against any path

What [a device may do](assumptions.md) beside dissipating, and what the law must be informed of.
Each run lets the tip go along a path of {samples} samples that is chosen freely, without inertia:
whatever a hand could do, some path does. All terms of the energy are known in closed form
(`forcebound/audit/truth.py`); the law is the live bounder. The path drifts, trembles, follows the
force so as to take the most, chooses readings that are wrong by up to half the resolution,
intervals from 1 ns to {longest:g} T, forces, and the imperfection that the certificate is about.
The search is CMA-ES over the whole path. *Tight*: share of the runs that leave less than 1 % of the
energy that was there; searches get there, random paths hardly do. *Not informed*: what the same
attacks find if the law's number for the imperfection is zero. Without a watchdog a punctual hold
must not bring the energy below zero, and no hold below minus the allowance; the energy shown is
what is left above that.
"""

#: Units of the numbers of a case and of its result.
UNITS = {
    "mass": "kg",
    "damping": "N s/m",
    "friction": "N",
    "resolution": "m",
    "saturation": "N",
    "hold_limit": "s",
    "hand_mass": "kg",
    "hand_stiffness": "N/m",
    "hand_damping": "N s/m",
    "amplitude": "m",
    "slow": "Hz",
    "fast": "Hz",
    "stiffness": "N/m",
    "environment_damping": "N s/m",
    "magnitude": "N",
    "surface": "m",
    "delay": "samples",
    "jitter": "periods",
    "write_delay": "s",
    "presliding": "m",
    "lag": "s",
    "watchdog_limit": "s",
    "allowance": "J",
    "energy_cap": "J",
    "largest_speed": "m/s",
    "shortest": "ns",
    "energy_min": "J",
    "loss_and_work_min": "J",
    "balance_min": "J",
    "margin": "J",
    "reserve_min": "J",
    "time_of_min": "s",
    "peak_force": "N",
}

#: Difficulties listed for each law: the assumptions of the paper's laws, and one step beyond.
ASSUMED = ("clock and reading", ("steady, exact", "steady, quantised"))


def page(document: dict[str, Any], command: str) -> str:
    """Return the result of :func:`forcebound.audit.run_campaign` as a page in Markdown.

    Args:
        document: The result.
        command: Command that made it.
    """
    return "\n".join(_page(document, command)) + "\n"


def describe_ranges() -> str:
    """Return the ranges of the parameters, as a paragraph of text."""

    def ends(name: str, factor: float = 1.0) -> str:
        return f"{RANGES[name].low * factor:g} to {most(name, factor)}"

    def most(name: str, factor: float = 1.0) -> str:
        return f"{RANGES[name].high * factor:g}"

    low = RANGES["mass"].low + RANGES["hand_mass"].low
    high = RANGES["mass"].high + RANGES["hand_mass"].high
    hold = f"{1.0 + RANGES['hold_limit'].low:g} to {1.0 + RANGES['hold_limit'].high:g} T"
    return textwrap.fill(
        f"Ranges: moving mass {low:g} to {high:g} kg, b {ends('damping')} N s/m, "
        f"f_c {ends('friction')} N, resolution none or {ends('resolution', 1e3)} mm, readings "
        f"wrong by up to half of it in any way, saturation {ends('saturation')} N, hold limit "
        f"{hold}, hand {ends('hand_stiffness')} N/m moving up to {most('amplitude', 1e3)} mm at up "
        f"to {most('fast')} Hz; walls and active walls to {most('stiffness', 1e-3)} N/mm, negative "
        f"dampers to {most('environment_damping')} N s/m, random forces and forces along the "
        f"velocity to {most('magnitude')} N, all up to {most('delay')} samples late; up to "
        f"{most('loss', 100)} % of the forces lost, up to {most('corruption', 100)} % replaced by "
        f"random ones; periods from 0.3 to 2 T, up to {most('overruns', 100)} % of them another "
        "six times as long.",
        100,
    )


def _page(document: dict[str, Any], command: str) -> Iterator[str]:
    yield INTRODUCTION.format(
        runs=document["runs"],
        command=command,
        version=version("forcebound"),
        processor=f"{platform.system()} {platform.machine()}",
    )
    if "certificates" in document:
        yield from _certificates(document["certificates"])
    if "laws" in document:
        yield LAWS_INTRODUCTION.format(
            seconds=document["seconds"],
            tolerance=ENERGY_TOLERANCE,
            dimensions=DIMENSIONS,
            ranges=describe_ranges(),
        )
        yield from _laws(document["laws"])


def _certificates(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    yield CERTIFICATES_INTRODUCTION.format(samples=SAMPLES, longest=LONGEST)
    yield "| certificate | law | runs | lowest energy | tight | verdict | not informed |"
    yield "|---|---|---|---|---|---|---|"
    for row in rows:
        lowest = show_energy(row["margin_min_j"])
        without = show_energy(row["without"]["margin_min_j"]) if row["without"] else "–"
        yield (
            f"| {row['summary']} | `{row['law']}` | {row['runs']:,} | {lowest} "
            f"| {row['tight_share']:.1%} | {verdict(row)} | {without} |"
        )
    yield "\nRuns that break a law which is not informed, and certificates that are broken:\n"
    for row in rows:
        broken = [row["without"]] if row["without"] else []
        for one in broken if row["holds"] else [row, *broken]:
            energy = show_energy(one["margin_min_j"])
            yield f"* {row['summary']}: {energy}\n  `{row['law']} {one['case']}`"
    yield ""


def _laws(laws: Sequence[dict[str, Any]]) -> Iterator[str]:
    yield "### Worst case of each law\n"
    yield "| law | lowest loss plus work | random | search | share left | verdict |"
    yield "|---|---|---|---|---|---|"
    for row in laws:
        kinds = [
            show_energy(row[kind]["loss_and_work_min_j"]) if kind in row else "–"
            for kind in ("random", "search")
        ]
        yield (
            f"| `{row['law']}` | {show_energy(row['loss_and_work_min_j'])} | {' | '.join(kinds)} "
            f"| {_share(row)} | {verdict(row)} |"
        )
    yield (
        f"\nThe integrator's own error: a step of the plant has never made more than "
        f"{-min(row['balance_min_j'] for row in laws):.0e} J (of steps that move up to kilojoules "
        "where no law bounds the force).\n"
    )
    leaks = [row for row in laws if row["loss_and_work_min_j"] < -ENERGY_TOLERANCE]
    if leaks:
        yield "### The leaks, and the runs that cause them\n"
        yield "Law and case as `forcebound audit replay` takes them. *Steady*: the clock is as the"
        yield "paper's laws assume, neither jitter nor overruns; *exact*: so is the reading.\n"
        for row in leaks:
            yield f"* `{row['law']}` gives {show_energy(-row['loss_and_work_min_j'])} away"
            for kind in ("random", "search"):
                if kind in row:
                    yield from _leak(row["law"], row[kind], kind)
            assumed, steady = ASSUMED
            for name in steady:
                if name in row["difficulties"][assumed]:
                    yield from _leak(row["law"], row["difficulties"][assumed][name], name)
        yield ""
    yield from _by_difficulty(laws)


def _by_difficulty(laws: Sequence[dict[str, Any]]) -> Iterator[str]:
    yield "### By axis of difficulty\n"
    yield "Lowest loss plus work. Cases are hard on several axes at once.\n"
    for axis in laws[0]["difficulties"]:
        names = sorted(
            {name for row in laws for name in row["difficulties"].get(axis, {})}, key=_order
        )
        yield f"#### {axis.capitalize()}\n"
        yield f"| law | {' | '.join(names)} |"
        yield "|---|" + "---|" * len(names)
        for row in laws:
            cells = row["difficulties"].get(axis, {})
            energies = (
                show_energy(cells[name]["loss_and_work_min_j"]) if name in cells else "–"
                for name in names
            )
            yield f"| `{row['law']}` | {' | '.join(energies)} |"
        yield ""


def _leak(law: str, extreme: dict[str, Any], what: str) -> Iterator[str]:
    energy = extreme["loss_and_work_min_j"]
    if energy < -ENERGY_TOLERANCE:
        yield f"    * {what}: {show_energy(energy)}, `{law} {extreme['case']}`"


def _order(name: str) -> tuple[bool, float, str]:
    """No difficulty comes first, then ranges by their end, then words."""
    numbers = re.findall(r"[0-9.]+", name)
    return (name not in ("none", "exact"), float(numbers[-1]) if numbers else 0.0, name)


def _share(row: dict[str, Any]) -> str:
    return "–" if row["loss_and_work_min_j"] < -ENERGY_TOLERANCE else f"{row['share_left_min']:.2%}"


def verdict(row: dict[str, Any]) -> str:
    """Return the verdict of the campaign on a law, or on a law with a certificate."""
    if row.get("is_certified", True):
        return "passive" if row["holds"] else "BROKEN"
    leaks = row["loss_and_work_min_j"] < -ENERGY_TOLERANCE
    return "leaks" if leaks else "no leak found, none excluded"


def holds(document: dict[str, Any]) -> bool:
    """Return whether every certified law has kept what it promises."""
    rows = (*document.get("laws", ()), *document.get("certificates", ()))
    return all(row["holds"] for row in rows)


def lines(document: dict[str, Any]) -> Iterator[str]:
    """Yield the result of the campaigns for a terminal."""
    for row in document.get("certificates", ()):
        lowest = show_energy(row["margin_min_j"])
        without = row["without"] and show_energy(row["without"]["margin_min_j"])
        yield (
            f"{row['certificate']:<20}{row['law']:<22}{lowest:>10}  "
            f"{verdict(row):<9}tight {row['tight_share']:>5.1%}"
            + (f"  not informed {without}" if without else "")
            + ("" if row["holds"] else f"\n    case {row['case']}")
        )
    for row in document.get("laws", ()):
        lowest = show_energy(row["loss_and_work_min_j"])
        yield f"{row['law']:<27}{lowest:>14}  {verdict(row):<30}case {row['case']}"
    yield f"{document['runs']} runs; repeat one with `forcebound audit replay LAW CASE`"


def show_energy(energy: float) -> str:
    """Return an energy, in J, with a fitting unit; rounding errors are zero."""
    if abs(energy) < ENERGY_TOLERANCE:
        return "0"
    if abs(energy) >= 10.0:
        return f"{energy:,.0f} J"
    return f"{energy:.3g} J" if abs(energy) >= 1.0 else f"{1e3 * energy:.3g} mJ"


def replay_lines(document: dict[str, Any]) -> Iterator[str]:
    """Yield a run that was repeated for a terminal: its case, then its result, with units."""
    for name, value in [*document["case"].items(), *document.items()]:
        if name == "case":
            continue
        shown = f"{value:.6g}" if isinstance(value, float) else str(value)
        yield f"{name:<22}{shown} {UNITS.get(name, '')}".rstrip()


def draw_run(result: Result | PathResult, trace: Floats, picture: Path) -> None:
    """Draw a run: position, forces, energies over time; .png or .svg."""
    from matplotlib.figure import Figure

    columns = dict(zip(TRACE_COLUMNS, trace.T, strict=True))
    figure = Figure(figsize=(10.0, 7.0), layout="constrained")
    top, middle, bottom = figure.subplots(3, 1, sharex=True)
    top.plot(columns["time"], 1e3 * columns["position"], label="position")
    top.plot(columns["time"], 1e3 * columns["reading"], lw=0.7, label="reading")
    top.set_ylabel("position (mm)")
    middle.plot(columns["time"], columns["commanded"], lw=0.7, color="0.6", label="commanded")
    middle.plot(columns["time"], columns["force"], label="applied")
    middle.set_ylabel("force (N)")
    energies = columns["energy"], columns["loss_and_work"]
    scale, unit = (1e3, "mJ") if max(np.abs(one).max() for one in energies) < 10.0 else (1.0, "J")
    lowest = result.loss_and_work_min * scale
    bottom.plot(columns["time"], scale * energies[0], label="of the hand")
    bottom.plot(columns["time"], scale * energies[1], label="loss plus work")
    bottom.axhline(0.0, color="k", lw=0.7)
    bottom.axvline(
        result.time_of_min, color="r", lw=0.7, label=f"loss plus work lowest:\n{lowest:.3g} {unit}"
    )
    bottom.set_ylabel(f"energy ({unit})")
    bottom.set_xlabel("time (s)")
    for axes in (top, middle, bottom):
        axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize="small")
    figure.suptitle(
        f"{result.law}, case {result.case.name}: lowest loss plus work {lowest:.3g} {unit}",
        fontsize="small",
    )
    save(figure, picture)
