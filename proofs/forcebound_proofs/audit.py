"""Command ``forcebound audit``: attacks on laws, their page, and one run again by its name."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from forcebound.errors import ConfigError
from forcebound.lab.engine import Campaign, Row, run_here
from forcebound.results.plots import check_picture, save
from forcebound_proofs.attack import ATTACKS, Budget, Floats, attack_named, attack_of
from forcebound_proofs.cases import optimiser
from forcebound_proofs.views import check_page, origin, write_page

PART = 100  # runs, at least, of a part of the work

INTRODUCTION = """\
# {title}

{runs:,} attacks, some drawn at random, some by a search for the lowest energy.

{origin}
Any run can be repeated by name:

    forcebound audit replay LAW CASE --output run.png

[audit.md](audit.md) has the laws and their certificates, [audit-worlds.md](audit-worlds.md) the
certified laws in two and three axes, through every world and controller;
[evidence.md](evidence.md#how-the-attacks-work) says how the attacks work, and what they rest on.
"""


class Options(NamedTuple):
    """Options of an audit, as on the command line."""

    runs: int = 100  # at random, of each law and target
    searched: int = 100  # in a search, of each
    seed: int = 1  # of the first random run, and of the search
    workers: int | None = None  # processes; None: one for each core; 0: this process
    out: Path | None = None  # page to write
    rows: Path | None = None  # Parquet file that gets the rows
    words: Sequence[str] = ()  # of the command line, beside these options

    def check(self) -> None:
        """Check, before the work begins, that there is something to run, and what it needs.

        Raises:
            ConfigError: If there is not, or the page cannot be written.
        """
        check_page(self.out)
        if self.runs + self.searched < 1:
            raise ConfigError(
                f"runs must be >= 1, got {self.runs} random and {self.searched} searched"
            )
        if self.searched:
            optimiser()  # its absence would show only after the random runs

    @property
    def command(self) -> str:
        """The command that makes the page."""
        words = f"forcebound audit {' '.join(self.words)}".rstrip()
        numbers = f"--runs {self.runs} --search {self.searched} --seed {self.seed}"
        return f"{words} {numbers} --output {self.out}"


def run(attacks: Mapping[str, Sequence[str]], laws: Sequence[str], options: Options) -> Row:
    """Run attacks and write their page.

    Args:
        attacks: Keys of :data:`.ATTACKS`, and what each attacks laws through; none: everything.
        laws: Keys of :data:`forcebound.haptics.laws.LAWS`; none: those that each is meant for.
        options: Of the audit.

    Returns:
        ``runs`` in all, ``seed``, and by the name of each attack what its
        :meth:`forcebound_proofs.attack.Attack.summary` returns.

    Raises:
        ConfigError: If there is nothing to run, or a law or a target is not known.
    """
    options.check()
    series = [
        one
        for name, targets in attacks.items()
        for one in attack_named(name).series(laws, targets, Budget(*options[:3]))
    ]
    rows = run_here(Campaign("audit", series, part=PART), options.workers, options.rows).rows
    document: Row = {"runs": sum(one.runs for one in series), "seed": options.seed}
    for name in attacks:
        own = [row for row in rows if row["attack"] == name]
        document[name] = attack_named(name).summary(own)
    write_page(options.out, _page(document, options.command))
    return document


def _attacks_of(document: Row) -> list[str]:
    return [name for name in ATTACKS if name in document]


def _page(document: Row, command: str) -> Iterator[str]:
    names = _attacks_of(document)
    title = attack_named(names[0]).title
    yield INTRODUCTION.format(title=title, runs=document["runs"], origin=origin(command))
    for name in names:
        yield from attack_named(name).section(document[name])
    yield "\n**Next**: [what a number costs](prices.md), in stiffness."


def holds(document: Row) -> bool:
    """Return whether every certified law has kept what it promises."""
    return all(row["holds"] for name in _attacks_of(document) for row in document[name])


def lines(document: Row) -> Iterator[str]:
    """Yield the result of an audit for a terminal."""
    for name in _attacks_of(document):
        yield from attack_named(name).worst(document[name])
    yield f"{document['runs']} runs; repeat one with `forcebound audit replay LAW CASE`"


def replay(law: str, name: str, picture: Path | None = None) -> Row:
    """Repeat a run by its name, draw it on request; return its case and its result.

    Raises:
        ConfigError: If the law or the run is not known, or the picture cannot be drawn.
    """
    if picture is not None:
        check_picture(picture)
    attack, rest = attack_of(name)
    case = attack.make(rest)
    outcome = attack.run(law, case, is_traced=picture is not None)
    if picture is not None:
        _draw(outcome.trace, f"{law}, {name}", picture)
    found = {"margin_j": outcome.margin_j, "share_left": outcome.share_left, **outcome.details}
    described = {**attack.description(case), "name": name}
    return {"law": law, "case": _finite(described), **_finite(found)}


def _finite(numbers: Row) -> Row:
    """Leave out what is not stated, and what is infinite, which JSON has not."""
    return {key: one for key, one in numbers.items() if one not in (None, math.inf, -math.inf)}


def replay_lines(document: Row) -> Iterator[str]:
    """Yield a repeated run for a terminal: its case, then its result, in SI units."""
    for name, value in [*document["case"].items(), *document.items()]:
        if name != "case":
            shown = f"{value:.6g}" if isinstance(value, float) else str(value)
            yield f"{name:<22}{shown}"


def _draw(columns: dict[str, Floats], title: str, picture: Path) -> None:
    """Draw position, forces and energies over time; .png or .svg."""
    from forcebound.results.colours import COMMANDED, PHYSICAL
    from forcebound_proofs import drawing as drawing_of

    colours = (COMMANDED, PHYSICAL)
    judged, called = ("lowest", "lowest so far")  # of which the margin is the least
    if judged not in columns:
        judged, called = ("loss_and_work", "loss plus work")
    energies = columns["energy"], columns[judged]
    in_joules = max(np.abs(one).max() for one in energies) >= 1.0
    scale, unit = (1.0, "J") if in_joules else (1e3, "mJ")
    lowest = int(np.argmin(energies[1]))
    words = f"lowest {scale * energies[1][lowest]:.3g} {unit}"
    panels = {
        "position (mm)": (1e3, {"position": "position", "reading": "reading"}),
        "force (N)": (1.0, {"commanded": "commanded", "applied": "force"}),
        f"energy ({unit})": (scale, {"of the hand": "energy", called: judged}),
    }
    shown = {key: one for key, one in panels.items() if {*one[1].values()} & {*columns}}
    drawing, every = drawing_of.rows_of(len(shown))
    for axes, (label, (factor, curves)) in zip(every, shown.items(), strict=True):
        for colour, (name, column) in zip(colours, curves.items(), strict=True):
            if column in columns:
                drawing_of.line(axes, columns["time"], factor * columns[column], name, colour)
        axes.axvline(columns["time"][lowest], color="r", lw=0.7, label=words)
        drawing_of.finish(axes, label, "time (s)")
    every[-1].axhline(0.0, color="k", lw=0.7)
    drawing.suptitle(f"{title}: {words}", fontsize="small")
    save(drawing, picture)
