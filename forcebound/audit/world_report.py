"""Report of the campaign against worlds: a page, and lines for a terminal."""

from collections.abc import Iterator
from importlib.metadata import version
from typing import Any

from forcebound.audit.report import show_energy, verdict
from forcebound.audit.world_campaign import UNBOUNDED
from forcebound.audit.world_run import SECONDS

INTRODUCTION = """\
# Audit in two and three axes

{certified:,} attacks on the certified laws through every world and every controller, some drawn at
random, some by a search (CMA-ES) for the lowest energy.

    {command}

made this page (forcebound {version}). `forcebound audit replay LAW CASE` repeats a run by its name.

Each run is a graph of the live nodes in virtual time, for {seconds:g} s: law, safety chain,
controller and environment are those of every other run. The device has two or three axes, each with
its own damping and friction, an encoder, a watchdog, late ticks; it dissipates exactly what the law
is informed of. The hand moves along a sine on each axis, into the surface and over it. The link to
the environment is late, jitters and loses packets. The ranges are those of `NUMBERS` in
`forcebound/audit/worlds.py`. *Lowest energy* is the lower of the energy that the hand has put in
and of the loss plus work (without the kinetic energy of the device), looked at four times a period;
0 is where a run begins. *Tight*: share of the runs that leave less than 1 % of the energy that was
there. The law `{unbounded}` meets some of the same random cases: what it gives away is what the
attacks can do.
"""


def page(document: dict[str, Any], command: str) -> str:
    """Return the result of :func:`.world_campaign.run_worlds` as a page in Markdown."""
    head = INTRODUCTION.format(
        certified=document["certified_runs"],
        command=command,
        version=version("forcebound"),
        seconds=SECONDS,
        unbounded=UNBOUNDED,
    )
    return "\n".join([head, *_tables(document["worlds"])]) + "\n"


def _tables(rows: list[dict[str, Any]]) -> Iterator[str]:
    yield "| world | law | runs | lowest energy | tight | verdict |"
    yield "|---|---|---|---|---|---|"
    for row in rows:
        tight = f"{row['tight_share']:.1%}" if row["is_certified"] else "–"
        yield (
            f"| `{row['world']}` | `{row['law']}` | {row['runs']:,} "
            f"| {show_energy(row['margin_min_j'])} | {tight} | {_verdict(row)} |"
        )
    controllers = list(rows[0]["controllers"])
    yield "\n## By controller\n"
    yield f"| world | law | {' | '.join(f'`{name}`' for name in controllers)} |"
    yield "|---|---|" + "---|" * len(controllers)
    for row in rows:
        energies = [show_energy(row["controllers"][name]) for name in controllers]
        yield f"| `{row['world']}` | `{row['law']}` | {' | '.join(energies)} |"
    yield "\n## Runs that leak\n"
    for row in rows:
        if row["margin_min_j"] < 0.0 and show_energy(row["margin_min_j"]) != "0":
            yield f"* {show_energy(row['margin_min_j'])}: `{row['law']} {row['case']}`"


def lines(document: dict[str, Any]) -> Iterator[str]:
    """Yield the result of the campaign for a terminal."""
    for row in document["worlds"]:
        lowest = show_energy(row["margin_min_j"])
        yield (
            f"{row['world']:<20}{row['law']:<22}{lowest:>10}  {_verdict(row):<9}"
            f"tight {row['tight_share']:>5.1%}"
            + ("" if row["holds"] else f"\n    case {row['case']}")
        )
    yield (
        f"{document['runs']} runs, {document['certified_runs']} of them of certified laws; repeat"
        " one with `forcebound audit replay LAW CASE`"
    )


def _verdict(row: dict[str, Any]) -> str:
    return verdict(row | {"loss_and_work_min_j": row["margin_min_j"]})
