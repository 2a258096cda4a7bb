"""Command ``forcebound audit``: the campaigns against laws and certificates, and their page."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from forcebound.errors import ConfigError
from forcebound.haptics.laws import LAWS
from forcebound.lab import laws as of_laws
from forcebound.lab.attack import SECONDS
from forcebound.lab.cases import optimiser
from forcebound.lab.engine import Campaign, run_here, runs_of
from forcebound.lab.paths import campaign as of_paths
from forcebound.lab.paths.certificates import CERTIFICATES
from forcebound.lab.views import check_page, origin, write_page

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


def run(
    laws: Sequence[str],
    certificates: Sequence[str],
    runs: int,
    searched: int,
    seed: int,
    workers: int | None,
    out: Path | None,
    rows: Path | None = None,
) -> dict[str, Any]:
    """Run the campaigns and write their page; arguments as on the command line.

    With laws alone, or certificates alone, only that campaign runs.

    Returns:
        ``runs`` in all, ``seed``, ``seconds``, and ``laws`` and ``certificates`` as returned by
        :func:`forcebound.lab.laws.summary` and :func:`forcebound.lab.paths.campaign.summary`.

    Raises:
        ConfigError: If there is nothing to run, or a law or a certificate is not known.
    """
    check_page(out)
    check_runs(runs, searched)
    cases: list[Any] = []
    if laws or not certificates:
        cases += of_laws.cases(list(laws) or list(LAWS), runs, searched, seed, SECONDS)
    if certificates or not laws:
        certified = list(laws) or [name for name, law in LAWS.items() if law.is_certified]
        chosen = list(certificates) or list(CERTIFICATES)
        cases += of_paths.cases(certified, chosen, runs, searched, seed)
    campaign = Campaign("audit", cases, runs_of=runs_of)
    found = run_here(campaign, workers, rows).rows
    document: dict[str, Any] = {
        "runs": sum(case.runs for case in cases),
        "seed": seed,
        "seconds": SECONDS,
    }
    parts = {
        "laws": of_laws.summary([row for row in found if not row.get("certificate")]),
        "certificates": of_paths.summary([row for row in found if row.get("certificate")]),
    }
    document |= {name: part for name, part in parts.items() if part}
    names = {"law": laws, "certificate": certificates}
    command = command_of("audit", runs, searched, seed, names, out)
    write_page(out, _page(document, command))
    return document


def check_runs(runs: int, searched: int) -> None:
    """Check that there is something to run, and what it needs.

    Raises:
        ConfigError: If there is not.
    """
    if runs + searched < 1:
        raise ConfigError(f"runs must be >= 1, got {runs} random and {searched} searched")
    if searched:
        optimiser()  # its absence would show only after the random runs


def command_of(
    name: str,
    runs: int,
    searched: int,
    seed: int,
    names: dict[str, Sequence[str]],
    out: Path | None,
) -> str:
    """Return the command line of a campaign."""
    chosen = "".join(f" --{what} {one}" for what, given in names.items() for one in given)
    options = f"--runs {runs} --search {searched} --seed {seed}{chosen}"
    return f"forcebound {name} {options} --output {out}"


def _page(document: dict[str, Any], command: str) -> Iterator[str]:
    yield INTRODUCTION.format(runs=document["runs"], origin=origin(command))
    if "certificates" in document:
        yield from of_paths.section(document["certificates"])
    if "laws" in document:
        yield from of_laws.section(document)


def holds(document: dict[str, Any]) -> bool:
    """Return whether every certified law has kept what it promises."""
    rows = (*document.get("laws", ()), *document.get("certificates", ()))
    return all(row["holds"] for row in rows)


def lines(document: dict[str, Any]) -> Iterator[str]:
    """Yield the result of the campaigns for a terminal."""
    if "certificates" in document:
        yield from of_paths.worst(document["certificates"])
    if "laws" in document:
        yield from of_laws.worst(document["laws"])
    yield f"{document['runs']} runs; repeat one with `forcebound audit replay LAW CASE`"
