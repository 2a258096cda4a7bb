"""Command ``forcebound audit``: a campaign, or the replay of one run."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from forcebound.audit.campaign import run_campaign
from forcebound.audit.cases import ADVERSARIES, SENSORS
from forcebound.audit.report import draw_run, page
from forcebound.audit.run import replay
from forcebound.bounding import LAWS
from forcebound.errors import ConfigError
from forcebound.files import check_writable, reason
from forcebound.workers import progress_bar


def run(
    laws: Sequence[str],
    runs: int,
    searched: int,
    seed: int,
    workers: int | None,
    out: Path | None,
) -> dict[str, Any]:
    """Run a campaign and write its page; arguments as on the command line.

    Raises:
        ConfigError: If there is nothing to run, or a law is not known.
    """
    if out is not None and out.suffix != ".md":
        raise ConfigError(f"the page must end in .md, got {out.name!r}")
    if out is not None:
        check_writable(out, "the page")
    with progress_bar("audit") as show:
        document = run_campaign(
            list(laws) or list(LAWS), runs, searched, seed, workers=workers, progress=show
        )
    if out is not None:
        chosen = "".join(f" --law {law}" for law in laws)
        command = f"forcebound audit --runs {runs} --search {searched} --seed {seed}{chosen}"
        try:
            out.write_text(page(document, f"{command} --out {out}"), encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"cannot write the page {out}: {reason(error)}") from error
    return document


def run_again(law: str, case: str, seconds: float, picture: Path | None) -> dict[str, Any]:
    """Repeat one case, draw it on request, and return its description and result.

    Raises:
        ConfigError: If the law or the case is not known.
    """
    result, trace = replay(law, case, seconds)
    if picture is not None:
        draw_run(result, trace, picture)
    document = result._asdict()
    document["case"] = result.case._asdict() | {
        "adversary": ADVERSARIES[result.case.adversary],
        "sensor": SENSORS[result.case.sensor],
    }
    return document
