"""Commands ``forcebound audit`` and ``forcebound reproduce``, which it finds as entry points."""

import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import click

from forcebound.cli import complete
from forcebound.cli import options as opt
from forcebound.cli.common import (
    Function,
    Group,
    command,
    continued,
    print_document,
    print_json,
    say,
    show,
)
from forcebound.cli.lazy import when_used
from forcebound.units import energy_in_words

with when_used():
    from forcebound_proofs import audit as of_laws
    from forcebound_proofs import audit_replay
    from forcebound_proofs import sensitivity as wrong_numbers
    from forcebound_proofs import worlds as of_worlds
    from forcebound_proofs.paper import reproduce as paper
    from forcebound_proofs.paper import setup


def _campaign(of_each: str, runs: int, *only: str) -> Callable[[Function], Function]:
    """Return the options of an audit: laws, numbers of runs, seed, report, and parts to select."""
    return opt.several(
        runs=opt.number(f"Random runs of {of_each}.", default=runs),
        searched=opt.number(
            "Runs of each in a CMA-ES search for the lowest energy.", "--search", default=runs
        ),
        laws=opt.repeated("Only this law; repeatable.", "--law", shell_complete=complete.laws),
        seed=opt.number("Seed of the runs.", default=1),
        workers=opt.workers,
        out=opt.output("Write the report to this file.", metavar="REPORT.md"),
        rows=opt.file(
            "Keep all runs in this file; an audit that was interrupted goes on.",
            metavar="RUNS.parquet",
        ),
        as_json=opt.as_json,
        **{f"{one}s": opt.repeated(f"Only this {one}; repeatable.", f"--{one}") for one in only},
    )


def _attack(
    run: Callable[..., Any],
    lines: Callable[[Any], Iterable[str]],
    as_json: bool,
    campaign: dict[str, object],
) -> None:
    with continued("the same command" if campaign["rows"] else ""):
        document = run(**campaign)
    print_document(document, as_json, lines)
    sys.exit(0 if of_laws.holds(document) else 1)


@command(cls=Group, invoke_without_command=True, short_help="Attack the laws in simulation.")
@_campaign("each law, and of it with each certificate", 1000, "certificate")
def audit(as_json: bool, **campaign: Any) -> None:
    r"""Attack the laws and their certificates; exit status 1 if a certified law leaks energy.

    With --law alone the certificates are left out, with --certificate alone the laws.

    \b
    forcebound audit
    forcebound audit --law tdpa --runs 100 --search 0
    """
    if click.get_current_context().invoked_subcommand is None:
        _attack(of_laws.run, of_laws.lines, as_json, campaign)


@command("replay", audit, short_help="Repeat one run of an audit.")
def replay(
    law: str = opt.argument(),
    case: str = opt.argument(),
    duration: float | None = opt.run_duration,
    out: Path | None = opt.output("Draw the run to this file, .png or .svg.", metavar="RUN.png"),
    as_json: bool = opt.as_json,
) -> None:
    r"""Repeat one run of an audit: LAW under CASE, a seed or a code, or one of a certificate.

    \b
    forcebound audit replay tdpa 7 -o attack.png
    """
    print_document(audit_replay.run_again(law, case, duration, out), as_json, audit_replay.lines)


@command("worlds", audit, short_help="Attack the laws through worlds, in two and three axes.")
@_campaign("each law with each world and controller", 100, "world", "controller")
def worlds(as_json: bool, **campaign: Any) -> None:
    r"""Attack the certified laws through every world and controller; status 1 if one leaks.

    The law none meets some of the random cases, to show what the attacks can do.

    \b
    forcebound audit worlds --world mesh --runs 20 --search 0
    """
    _attack(of_worlds.run, of_worlds.lines, as_json, campaign)


@command("sensitivity", audit, short_help="Show what a wrong number of a device costs.")
def sensitivity(
    kind: str = opt.option(
        "Kind of device.", "--device", default="phantom_premium_1_5", show_default=True
    ),
    runs: int = opt.number("Runs of the search for each.", type=opt.COUNT, default=2000),
    workers: int | None = opt.workers,
    as_json: bool = opt.as_json,
) -> None:
    r"""Show what each wrong number of a device costs: the lowest energy that a search finds.

    \b
    forcebound audit sensitivity --device knob --runs 100
    """
    document = wrong_numbers.run(kind, runs, workers)
    rows = document["mistakes"]
    lines = [f"{row['summary']:<46}{energy_in_words(row['energy_min_j']):>12}" for row in rows]
    print_document(document, as_json, lambda _: lines)


def reproduce(
    names: tuple[str, ...] = opt.arguments("[NAME]..."),
    out: Path = opt.folder("Folder for pictures and numbers.", Path("results/reproduce")),
    as_json: bool = opt.as_json,
) -> None:
    r"""Repeat the paper's experiments: table1, fig4 to fig21, eq41_42. Default: all.

    \b
    forcebound reproduce table1
    forcebound reproduce -o results/paper
    """
    done = paper.reproduce(names, out, setup.Runs(say))
    if as_json:
        print_json(done.document)
        return
    paper.print_tables(done)
    show(f"pictures and numbers: {out}")
