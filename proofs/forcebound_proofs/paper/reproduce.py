"""Reproduction: runs experiments and writes their pictures and numbers."""

import json
import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

from forcebound.errors import ConfigError
from forcebound.results.plots import save
from forcebound.results.printing import print_rows
from forcebound_proofs.paper import ALIASES, EXPERIMENTS
from forcebound_proofs.paper.outcome import Outcome
from forcebound_proofs.paper.setup import Runs

HEADS = ("quantity", "law", "ours", "10 to 90 %", "paper", "unit")


@dataclass(frozen=True)
class Reproduction:
    """Result of ``forcebound reproduce``."""

    outcomes: dict[str, Outcome]  # by name, in the requested order
    document: dict[str, object]  # for JSON
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
    outcomes: dict[str, Outcome] = {}
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name in chosen:
            runs.progress(name)
            outcomes[name] = EXPERIMENTS[name](runs)
            save(outcomes[name].drawing, out / f"{name}.png")
        document = to_document(outcomes, shlex.join(["forcebound", "reproduce", *names]))
        text = json.dumps(document, indent=2, allow_nan=False) + "\n"
        (out / "numbers.json").write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write into the folder {out}: {error.strerror}") from error
    return Reproduction(outcomes, document, out)


def choose(names: Sequence[str]) -> list[str]:
    """Return the experiments meant by ``names``, each once; without names, all.

    Raises:
        ConfigError: If a name is not known.
    """
    chosen = list(dict.fromkeys(ALIASES.get(name, name) for name in names or EXPERIMENTS))
    for name in chosen:
        if name not in EXPERIMENTS:
            raise ConfigError(f"no experiment {name!r}; known are {', '.join(EXPERIMENTS)}")
    return chosen


def to_document(outcomes: dict[str, Outcome], command: str) -> dict[str, object]:
    """Return everything as plain JSON types."""
    document: dict[str, object] = {"command": command, "version": version("forcebound")}
    for outcome in outcomes.values():
        document |= outcome.document
    document["experiments"] = {
        name: {
            "title": outcome.title,
            "paper": outcome.paper,
            "finding": outcome.finding,
            "numbers": [asdict(one) | {"law": one.law or None} for one in outcome.numbers],
            "picture": f"{name}.png",
            "commands": list(outcome.commands),
        }
        for name, outcome in outcomes.items()
    }
    return document


def print_tables(done: Reproduction) -> None:
    """Print the numbers of each experiment as a table, and its finding."""
    for name, outcome in done.outcomes.items():
        rows = []
        for number in outcome.numbers:
            unit = "" if number.unit == "1" else number.unit
            spread = " to ".join(show(one) for one in number.spread or ())
            numbers = (show(number.ours), spread, show(number.paper))
            rows.append((number.quantity, number.law, *numbers, unit))
        print_rows(HEADS, rows, f"{name}: {outcome.title}", flush_left=2)
        print(f"{outcome.finding}\n")


def show(value: float | None) -> str:
    """Return a number with three significant digits, or a dash."""
    return "–" if value is None else f"{value:.3g}"
