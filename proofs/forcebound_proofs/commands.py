"""Commands ``forcebound audit``, ``league`` and ``reproduce``, found as entry points."""

import sys
from collections.abc import Callable, Mapping, Sequence
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

with when_used():
    from forcebound_proofs import audit as audits
    from forcebound_proofs.league import play as leagues
    from forcebound_proofs.paper import reproduce as paper
    from forcebound_proofs.paper import setup


def _campaign(of_each: str, runs: int) -> Callable[[Function], Function]:
    """Return the options of an audit: laws, numbers of runs, seed, report."""
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
    )


def _only(what: str) -> Any:
    return opt.repeated(f"Only this {what}; repeatable.", f"--{what}")


def _words(**selected: Sequence[str]) -> list[str]:
    return [f"--{name} {one}" for name, ones in selected.items() for one in ones]


def _attack(
    attacks: Mapping[str, Sequence[str]],
    laws: Sequence[str],
    as_json: bool,
    options: dict[str, Any],
) -> None:
    """Run attacks and print what they have found; status 1 if a certified law does not hold."""
    chosen = audits.Options(**options)
    with continued("the same command" if chosen.rows else ""):
        document = audits.run(attacks, laws, chosen)
    print_document(document, as_json, audits.lines)
    sys.exit(0 if audits.holds(document) else 1)


@command(cls=Group, invoke_without_command=True, short_help="Attack the laws in simulation.")
@_campaign("each law, and of it with each certificate", 1000)
def audit(
    laws: tuple[str, ...],
    as_json: bool,
    certificate: tuple[str, ...] = _only("certificate"),
    **options: Any,
) -> None:
    r"""Attack the laws and their certificates; exit status 1 if a certified law leaks energy.

    With --law alone the certificates are left out, with --certificate alone the laws.

    \b
    forcebound audit
    forcebound audit --law tdpa --runs 100 --search 0
    """
    if click.get_current_context().invoked_subcommand is None:
        attacks: dict[str, Sequence[str]] = {}
        if certificate or not laws:
            attacks["paths"] = certificate
        if laws or not certificate:
            attacks["laws"] = ()
        words = _words(law=laws, certificate=certificate)
        _attack(attacks, laws, as_json, {**options, "words": words})


@command("replay", audit, short_help="Repeat one run of an audit.")
def replay(
    law: str = opt.argument(),
    case: str = opt.argument(),
    out: Path | None = opt.output("Draw the run to this file, .png or .svg.", metavar="RUN.png"),
    as_json: bool = opt.as_json,
) -> None:
    r"""Repeat one run of an audit: LAW under CASE, as an audit names it. Numbers are in SI units.

    \b
    forcebound audit replay tdpa laws:7 -o attack.png
    forcebound audit replay certified paths:guarding:s3.17
    """
    print_document(audits.replay(law, case, out), as_json, audits.replay_lines)


@command("worlds", audit, short_help="Attack the laws through worlds, in two and three axes.")
@_campaign("each law with each world and controller", 100)
def worlds(
    laws: tuple[str, ...],
    as_json: bool,
    world: tuple[str, ...] = _only("world"),
    controller: tuple[str, ...] = _only("controller"),
    **options: Any,
) -> None:
    r"""Attack the certified laws through every world and controller; status 1 if one leaks.

    The law none meets some of the random cases, to show what the attacks can do.

    \b
    forcebound audit worlds --world mesh --runs 20 --search 0
    """
    targets = [f"{one}/{other}" for one in world or ("",) for other in controller or ("",)]
    words = ["worlds", *_words(law=laws, world=world, controller=controller)]
    _attack({"worlds": targets}, laws, as_json, {**options, "words": words})


@command("sensitivity", audit, short_help="Show what a wrong number of a device costs.")
def sensitivity(
    device: tuple[str, ...] = _only("device"),
    searched: int = opt.number("Runs of the search for each.", "--runs", default=2000),
    workers: int | None = opt.workers,
    as_json: bool = opt.as_json,
) -> None:
    r"""Show what each wrong number of a device costs: the lowest energy that a search finds.

    \b
    forcebound audit sensitivity --device knob --runs 100
    """
    options = {"runs": 0, "searched": searched, "workers": workers}
    _attack({"sensitivity": device}, (), as_json, options)


def league(
    is_small: bool = opt.flag(
        "A smoke test: few places, a small budget; two minutes on an idle machine.", "--small"
    ),
    files: tuple[str, ...] = opt.repeated(
        "File of a law or controller that plays, too; repeatable.", "--method", metavar="FILE.py"
    ),
    out: Path = opt.output("Page to write; its pictures beside it.", Path("league.md")),
    rows: Path = opt.file(
        "All runs; a league that was interrupted goes on.",
        "--table",
        default=Path("league.parquet"),
        show_default=True,
    ),
    drawn: Path | None = opt.file("Draw the page of this finished table; play nothing.", "--from"),
    restart: bool = opt.flag("Discard what an earlier league left of the table."),
    workers: int | None = opt.workers,
    as_json: bool = opt.as_json,
) -> None:
    r"""Compare every passivity method on the same plants, networks and attacks.

    Each is tuned by one budget and attacked where it is worst; the page says first where the
    certified laws lose. Status 1 if one of them leaks.

    \b
    forcebound league --small
    forcebound league --method my_law.py -o my_league.md --table my_league.parquet
    """
    with continued("the same command"):
        found = leagues.play(leagues.Options(out, rows, files, is_small, restart, workers, drawn))
    print_document(found, as_json, leagues.lines)
    sys.exit(0 if leagues.holds(found) else 1)


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
