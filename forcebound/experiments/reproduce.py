"""Reproduction: runs experiments and writes their pictures and numbers."""

import json
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from forcebound.analysis.plots import save
from forcebound.errors import ConfigError
from forcebound.experiments import ALIASES, EXPERIMENTS
from forcebound.experiments.outcome import Outcome, label
from forcebound.experiments.setup import Runs


@dataclass(frozen=True)
class Reproduction:
    """Result of ``forcebound reproduce``."""

    outcomes: dict[str, Outcome]  # by name, in the requested order
    document: dict[str, Any]  # for JSON
    folder: Path


def reproduce(names: Sequence[str], out: Path, runs: Runs) -> Reproduction:
    """Run experiments and write ``NAME.png`` and ``numbers.json``.

    Args:
        names: Keys of ``EXPERIMENTS`` or ``ALIASES``; none: all of them.
        out: Folder to write into; made if missing.
        runs: Of launch files; what is done already is not run again.

    Raises:
        ConfigError: If a name is not known or the folder cannot be written.
    """
    chosen = choose(names)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"cannot make the folder {out}: {error.strerror}") from error
    outcomes: dict[str, Outcome] = {}
    for name in chosen:
        runs.progress(name)
        outcome = outcomes[name] = EXPERIMENTS[name](runs)
        save(outcome.drawing, out / f"{name}.png")
    command = shlex.join(["forcebound", "reproduce", *names])
    document = to_document(outcomes, command)
    _write(out / "numbers.json", json.dumps(document, indent=2, allow_nan=False) + "\n")
    return Reproduction(outcomes, document, out)


def choose(names: Sequence[str]) -> list[str]:
    """Return the experiments meant by ``names``, each once; without names, all.

    Raises:
        ConfigError: If a name is not known.
    """
    chosen: list[str] = []
    for name in names or EXPERIMENTS:
        name = ALIASES.get(name, name)
        if name not in EXPERIMENTS:
            raise ConfigError(f"no experiment {name!r}; known are {', '.join(EXPERIMENTS)}")
        if name not in chosen:
            chosen.append(name)
    return chosen


def to_document(outcomes: dict[str, Outcome], command: str) -> dict[str, Any]:
    """Return everything as plain JSON types."""
    document: dict[str, Any] = {"command": command, "version": version("forcebound")}
    for outcome in outcomes.values():
        document |= outcome.document
    document["experiments"] = {
        name: {
            "title": outcome.title,
            "paper": outcome.paper,
            "finding": outcome.finding,
            "numbers": [number.to_json() for number in outcome.numbers],
            "picture": f"{name}.png",
            "commands": list(outcome.commands),
        }
        for name, outcome in outcomes.items()
    }
    return document


def tables(done: Reproduction) -> Iterator[Any]:
    """Yield the numbers of each experiment as a table for the terminal, and its finding."""
    from rich.table import Table

    for name, outcome in done.outcomes.items():
        title = f"{label(name)}: {outcome.title}"
        table = Table(title=title, title_justify="left", box=None, pad_edge=False)
        table.add_column("quantity")
        table.add_column("law")
        for head in ("ours", "paper"):
            table.add_column(head, justify="right")
        table.add_column("unit")
        for number in outcome.numbers:
            unit = "" if number.unit == "1" else number.unit
            table.add_row(number.quantity, number.law, show(number.ours), show(number.paper), unit)
        yield table
        yield f"{outcome.finding}\n"


def show(value: float | None) -> str:
    """Return a number with three significant digits, or a dash."""
    if value is None:
        return "–"
    if value == 0.0:
        return "0"
    if abs(value) < 1e-3 or abs(value) >= 1e5:
        return f"{value:.1e}"
    return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}") from error
