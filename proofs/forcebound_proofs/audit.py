"""Command ``forcebound audit``: the campaigns against laws and certificates, and their page."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from forcebound.errors import ConfigError
from forcebound.haptics.laws import LAWS
from forcebound.lab.engine import Campaign, Row, run_here
from forcebound.lab.views import check_page, origin, write_page
from forcebound_proofs import laws as of_laws
from forcebound_proofs.cases import optimiser
from forcebound_proofs.law_run import SECONDS
from forcebound_proofs.paths import campaign as of_paths
from forcebound_proofs.paths.certificates import CERTIFICATES

INTRODUCTION = """\
# Audit of the laws

{runs:,} attacks on the laws and their certificates, some drawn at random, some by a search for the
lowest energy.

{origin}
Any run can be repeated by name:

    forcebound audit replay LAW CASE --output run.png

[audit-worlds.md](audit-worlds.md): the same laws in two and three axes, through every world and
controller. [audit-method.md](audit-method.md): how the attacks work, and what they rest on.
"""


class Options(NamedTuple):
    """Options of an audit, as on the command line."""

    runs: int = 100  # at random, of each case
    searched: int = 100  # in a search, of each case
    seed: int = 1  # of the first random run, and of the search
    workers: int | None = None  # processes; None: one for each core; 0: this process
    out: Path | None = None  # page to write
    rows: Path | None = None  # Parquet file that gets the rows

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

    def run(self, name: str, cases: Sequence[Any], part: int = 500) -> list[Row]:
        """Return the rows of cases."""
        return run_here(Campaign(name, cases, part=part), self.workers, self.rows).rows

    def write(self, name: str, chosen: dict[str, Sequence[str]], lines: Iterable[str]) -> None:
        """Write the page; its introduction gets the command line of the audit ``name``."""
        words = "".join(f" --{what} {one}" for what, given in chosen.items() for one in given)
        numbers = f"--runs {self.runs} --search {self.searched} --seed {self.seed}"
        command = origin(f"forcebound {name} {numbers}{words} --output {self.out}")
        write_page(self.out, (line.replace("{origin}", command) for line in lines))


def run(laws: Sequence[str] = (), certificates: Sequence[str] = (), **given: Any) -> Row:
    """Run the campaigns and write their page; ``given``: :class:`Options`.

    With laws alone, or certificates alone, only that campaign runs.

    Returns:
        ``runs`` in all, ``seed``, ``seconds``, and ``laws`` and ``certificates`` as returned by
        :func:`forcebound_proofs.laws.summary` and :func:`forcebound_proofs.paths.campaign.summary`.

    Raises:
        ConfigError: If there is nothing to run, or a law or a certificate is not known.
    """
    options = Options(**given)
    options.check()
    numbers = options[:3]
    cases: list[Any] = []
    if laws or not certificates:
        cases += of_laws.cases(list(laws) or list(LAWS), *numbers)
    if certificates or not laws:
        certified = list(laws) or [name for name, law in LAWS.items() if law.is_certified]
        cases += of_paths.cases(certified, list(certificates) or list(CERTIFICATES), *numbers)
    found = options.run("audit", cases)
    document: Row = {
        "runs": sum(case.runs for case in cases),
        "seed": options.seed,
        "seconds": SECONDS,
    }
    parts = {
        "laws": of_laws.summary([row for row in found if not row.get("certificate")]),
        "certificates": of_paths.summary([row for row in found if row.get("certificate")]),
    }
    document |= {name: part for name, part in parts.items() if part}
    options.write("audit", {"law": laws, "certificate": certificates}, _page(document))
    return document


def _page(document: Row) -> Iterator[str]:
    yield INTRODUCTION.replace("{runs:,}", f"{document['runs']:,}")
    if "certificates" in document:
        yield from of_paths.section(document["certificates"])
    if "laws" in document:
        yield from of_laws.section(document)


def holds(document: Row) -> bool:
    """Return whether every certified law has kept what it promises."""
    rows = (row for part in ("laws", "certificates", "worlds") for row in document.get(part, ()))
    return all(row["holds"] for row in rows)


def lines(document: Row) -> Iterator[str]:
    """Yield the result of the campaigns for a terminal."""
    if "certificates" in document:
        yield from of_paths.worst(document["certificates"])
    if "laws" in document:
        yield from of_laws.worst(document["laws"])
    yield f"{document['runs']} runs; repeat one with `forcebound audit replay LAW CASE`"
