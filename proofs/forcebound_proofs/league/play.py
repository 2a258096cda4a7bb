"""Command ``forcebound league``: all methods in all places, their table, page and pictures."""

import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from forcebound.errors import ConfigError
from forcebound.files import check_writable
from forcebound.lab.engine import Campaign, run
from forcebound.lab.views import table
from forcebound.lab.workers import local_executor
from forcebound.run.progress import progress_bar
from forcebound.units import energy_in_words as energy
from forcebound_proofs.cases import optimiser
from forcebound_proofs.league import methods as methods_of
from forcebound_proofs.league.contest import Budget, Contest
from forcebound_proofs.league.methods import OURS
from forcebound_proofs.league.page import page
from forcebound_proofs.league.places import TABLES, Place, places
from forcebound_proofs.league.scores import Worst, worst
from forcebound_proofs.views import check_page, write_page

SMOKE = "\n\n**A page of `--small` is a smoke test**: four evaluations are samples, no tuning."
SMALL = Budget(tuning=4, attacks=(4, 8), seconds=1.5, long=5.0, attacked=1.0)


class Options(NamedTuple):
    """Options of the command."""

    out: Path
    rows: Path  # Parquet file
    files: tuple[str, ...] = ()  # of a user's methods
    is_small: bool = False
    restart: bool = False
    workers: int | None = None
    drawn: Path | None = None  # finished table, to draw without playing

    @property
    def command(self) -> str:
        """The command that plays these runs."""
        own = [f"--method {Path(file).name}" for file in self.files]
        words = [*(["--small"] if self.is_small else []), *own]
        return " ".join(["forcebound league", *words])


def play(options: Options) -> list[Worst]:
    """Play the league, write table, page and pictures; return the worst of each method.

    Raises:
        ConfigError: If a file of a method is wrong, or something cannot be written.
    """
    check_page(options.out)
    methods, parts = methods_of.chosen(options.files)
    if options.drawn:
        if not options.drawn.exists():
            raise ConfigError(f"--from: there is no {options.drawn}; the league makes a table")
        return _draw(options.drawn, methods, options)
    check_writable(options.rows, "the table")
    optimiser()
    budget = SMALL if options.is_small else Budget()
    played = places(options.is_small)
    contests = [
        Contest(name, method, own, budget)
        for device in TABLES["devices"]
        if (own := tuple(place for place in played if place.device == device))
        for name, method in methods.items()
    ]
    about = {"command": options.command, "version": version("forcebound")}
    campaign = Campaign("league", contests, part=1, decisive=[TABLES, *parts], about=about)
    with progress_bar("league") as bar, local_executor(options.workers) as executor:
        show = bar if sys.stderr.isatty() else _say
        run(campaign, executor, show, options.rows, options.restart, options.restart)
    return _draw(options.rows, methods, options)


def _say(done: int, total: int) -> None:
    print(f"league: {done} of {total} runs", file=sys.stderr, flush=True)


def _draw(file: Path, methods: dict[str, methods_of.Method], options: Options) -> list[Worst]:
    """Write page and pictures of a finished table."""
    from forcebound.lab.table import read_table
    from forcebound_proofs.league import pictures  # slow to import

    content = read_table(file)
    rows, about = content.rows, content.about
    own = {row["method"] for row in rows}
    if unknown := own - methods.keys():
        raise ConfigError(f"{file} has runs of {', '.join(unknown)}: give its file with --method")
    methods = {name: one for name, one in methods.items() if name in own}
    is_small = {row["network"] for row in rows} <= {one.network for one in places(is_small=True)}
    made_by = (
        f"    {about.get('command', 'forcebound league')}\n\n"  # older tables have none
        f"played these runs (forcebound {about.get('version', '0.2.0')}, digest"
        f" {about['digest'][:12]}), and `forcebound league --from {file.name}` draws this page from"
        " their table."
    )
    names = ("stiffness", "transparency", "energy")
    files = {one: options.out.with_name(f"{options.out.stem}_{one}.png") for one in names}
    pictures.draw(rows, files)
    shown = {one: file.name for one, file in files.items()}
    budget = SMALL if is_small else Budget()
    lines = page(rows, methods, budget, f"{made_by}{SMOKE if is_small else ''}", shown)
    write_page(options.out, lines)
    return worst(rows)


def holds(found: list[Worst]) -> bool:
    """Return whether no certified law gave energy."""
    return not any(one.leaks for one in found if one.method in OURS)


def lines(found: list[Worst]) -> Iterator[str]:
    """Yield the result for a terminal."""
    rows = (
        (
            one.method,
            one.device,
            energy(one.energy),
            Place(*(one.row[k] for k in Place._fields)).label,
        )
        for one in found
    )
    yield from table(("method", "device", "lowest energy", "in"), rows)
