"""Command ``forcebound audit``: a campaign with progress on standard error, or one run again."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from forcebound.audit.campaign import run_campaign
from forcebound.audit.cases import ADVERSARIES, SENSORS
from forcebound.audit.report import draw_run, page
from forcebound.audit.run import replay
from forcebound.bounding import LAWS
from forcebound.errors import ConfigError
from forcebound.files import check_writable, reason


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
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("audit"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("runs, left:"),
        TimeRemainingColumn(elapsed_when_finished=False),
    )
    bar = Progress(*columns, console=Console(stderr=True))
    task = bar.add_task("audit", total=None)
    with ExitStack() as stack:

        def show(done: int, total: int) -> None:
            if not bar.live.is_started:  # not before the arguments have been found to be good
                stack.enter_context(bar)
            bar.update(task, completed=done, total=total)

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
    """Run one case again, draw it on request, and return its description and result.

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
