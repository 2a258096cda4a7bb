"""Command ``forcebound audit``: a campaign, or the replay of one run."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from forcebound.analysis.plots import check_picture
from forcebound.audit.campaign import run_campaign
from forcebound.audit.cases import ADVERSARIES
from forcebound.audit.cases import SENSORS as PLANT_SENSORS
from forcebound.audit.certificates import CERTIFICATES
from forcebound.audit.certify import run_certificates
from forcebound.audit.path_run import replay_path
from forcebound.audit.paths import SENSORS
from forcebound.audit.plan import with_units
from forcebound.audit.report import draw_run, page
from forcebound.audit.run import replay
from forcebound.audit.search import optimiser
from forcebound.audit.sensitivity import run_sensitivity
from forcebound.audit.world_campaign import run_worlds
from forcebound.audit.world_report import page as world_page
from forcebound.audit.world_run import SECONDS, replay_world
from forcebound.audit.worlds import WATCHDOGS
from forcebound.bounding import LAWS
from forcebound.errors import ConfigError
from forcebound.files import MAX_TABLE, check_writable, read_text, reason
from forcebound.workers import progress_bar

#: Where the part of the page begins that is not made by a campaign, and stays.
BY_HAND = "## A second, independent attack"


def run(
    laws: Sequence[str],
    certificates: Sequence[str],
    runs: int,
    searched: int,
    seed: int,
    workers: int | None,
    out: Path | None,
) -> dict[str, Any]:
    """Run the campaigns and write their page; arguments as on the command line.

    With laws alone, or certificates alone, only that campaign runs.

    Returns:
        The document of :func:`~forcebound.audit.run_campaign` or of
        :func:`~forcebound.audit.certify.run_certificates`, or both in one.

    Raises:
        ConfigError: If there is nothing to run, or a law or a certificate is not known.
    """
    _check_page(out)
    if searched:
        optimiser()  # its absence would show only after the random runs
    document: dict[str, Any] = {"runs": 0}
    for name, campaign in _campaigns(laws, certificates).items():
        with progress_bar(f"audit of the {name}") as show:
            part = campaign(runs, searched, seed, workers=workers, progress=show)
        document |= part | {"runs": document["runs"] + part["runs"]}
    if out is not None:
        chosen = "".join(f" --law {law}" for law in laws)
        chosen += "".join(f" --certificate {certificate}" for certificate in certificates)
        command = f"forcebound audit --runs {runs} --search {searched} --seed {seed}{chosen}"
        _write(out, page(document, f"{command} --output {out}") + _written_by_hand(out))
    return document


def _check_page(out: Path | None) -> None:
    if out is None:
        return
    if out.suffix != ".md":
        raise ConfigError(f"the page must end in .md, got {out.name!r}")
    check_writable(out, "the page")


def _write(out: Path, text: str) -> None:
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write the page {out}: {reason(error)}") from error


def _written_by_hand(out: Path) -> str:
    """Return the end of the page that is there already, which no campaign makes."""
    before = read_text(out, "the page", MAX_TABLE) if out.is_file() else ""
    _, heading, rest = before.partition(BY_HAND)
    return heading + rest


def _campaigns(laws: Sequence[str], certificates: Sequence[str]) -> dict[str, Any]:
    chosen: dict[str, Any] = {}
    if laws or not certificates:
        chosen["laws"] = partial(run_campaign, list(laws) or list(LAWS))
    if certificates or not laws:
        certified = list(laws) or [name for name, law in LAWS.items() if law.is_certified]
        chosen["certificates"] = partial(
            run_certificates, certified, list(certificates) or list(CERTIFICATES)
        )
    return chosen


def run_again(law: str, case: str, seconds: float | None, picture: Path | None) -> dict[str, Any]:
    """Repeat one case, draw it on request, and return its description and result.

    Raises:
        ConfigError: If the law or the case is not known, or the case has a length of its own.
    """
    if picture is not None:
        check_picture(picture)
    if "/" in case:
        return _run_world_again(law, case, seconds, picture)
    if ":" in case:
        return _run_path_again(law, case, seconds, picture)
    result, trace = replay(law, case, seconds or 2.0)
    if picture is not None:
        draw_run(result, trace, picture)
    document = result._asdict()
    document["case"] = result.case._asdict() | {
        "adversary": ADVERSARIES[result.case.adversary],
        "sensor": PLANT_SENSORS[result.case.sensor],
    }
    return document


def _run_path_again(
    law: str, case: str, seconds: float | None, picture: Path | None
) -> dict[str, Any]:
    if seconds is not None:
        raise ConfigError("the case of a certificate has a length of its own: omit --duration")
    result, trace = replay_path(law, case)
    if picture is not None:
        draw_run(result, trace, picture)
    document = result._asdict()
    document["case"] = {
        "name": result.case.name,
        "summary": result.case.certificate.summary,
        "is_stated": result.case.is_stated,
        "sensor": SENSORS[result.case.sensor],
        **result.case.numbers,
        **with_units(result.case),
    }
    return document


def _run_world_again(
    law: str, case: str, seconds: float | None, picture: Path | None
) -> dict[str, Any]:
    if picture is not None:
        raise ConfigError("a run against a world is not drawn: omit --output")
    result = replay_world(law, case, seconds or SECONDS)
    document = result._asdict()
    document["case"] = {
        "name": result.case.name,
        "seed": result.case.seed,
        **result.case.numbers,
        "axes": result.case.axes,
        "watchdog": WATCHDOGS[int(result.case.numbers["watchdog"])],
    }
    return document


def run_in_worlds(
    laws: Sequence[str],
    worlds: Sequence[str],
    controllers: Sequence[str],
    runs: int,
    searched: int,
    seed: int,
    workers: int | None,
    out: Path | None,
) -> dict[str, Any]:
    """Run the campaign against worlds and write its page; arguments as on the command line.

    Raises:
        ConfigError: If there is nothing to run, a name is not known, or the page cannot be written.
    """
    _check_page(out)
    if searched:
        optimiser()
    with progress_bar("audit of the worlds") as show:
        document = run_worlds(laws, worlds, controllers, runs, searched, seed, workers, show)
    if out is not None:
        names = {"law": laws, "world": worlds, "controller": controllers}
        chosen = "".join(f" --{what} {name}" for what, given in names.items() for name in given)
        command = f"forcebound audit worlds --runs {runs} --search {searched} --seed {seed}{chosen}"
        _write(out, world_page(document, f"{command} --output {out}"))
    return document


def run_mistakes(kind: str, runs: int, workers: int | None) -> dict[str, Any]:
    """Search for the lowest energy with each wrong number; arguments as on the command line.

    Raises:
        ConfigError: If there is no such device.
    """
    with progress_bar("sensitivity") as show:
        return run_sensitivity(kind, runs, workers, show)
