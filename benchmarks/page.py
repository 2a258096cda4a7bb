"""The page of all benchmarks: one row each, with all rounds as JSON beside it.

Nothing is written if a benchmark failed or the bare loop was not steady, see :func:`refusal`.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from benchmarks.harness import STEADY, Figure, Result, steadiness
from forcebound.lab.views import table

Named: TypeAlias = Mapping[str, tuple[str, Result]]  # by benchmark: what is asked, and its result
PAGE = """# Figures of one machine

`make bench` makes this page; `python -m benchmarks NAME` measures one row and prints all figures of
that benchmark. Each contestant ran in turns with its reference, so ratios travel to other machines,
times do not. Percentiles are measured values (nearest rank). All rounds are in `benchmarks.json`
beside this page. Both are written only if no benchmark failed and if a bare loop of pyzmq, measured
before and after each round, stayed within {steady} times its quickest median in each benchmark;
here within {worst:.2f}.

{figures}

{conditions}

**Next**: [real time](realtime.md), how to measure a machine of yours.
"""


def refusal(name: str, result: Result) -> str | None:
    """Return why the numbers of a benchmark do not count; None: they do."""
    if (ratio := steadiness(result[0])) <= STEADY:
        return None
    return (
        f"{name}: before or after a round a bare loop of pyzmq took {ratio:.2f} times its quickest "
        f"median, more than {STEADY}: other programs disturbed it; stop them and repeat it"
    )


def missed_targets(name: str, figures: Iterable[Figure]) -> list[str]:
    """Return a line for each target that was not reached."""
    return [
        f"{name}: {one.what}: {text(one.value, one.unit)}, target {target(one)}"
        for one in figures
        if one.reached is False
    ]


def target(one: Figure) -> str:
    """Return the target of a figure as it is shown."""
    if one.target is None:
        return ""
    return f"{'at least' if one.at_least else 'at most'} {text(one.target, one.unit)}"


def text(value: float | None, unit: str) -> str:
    """Return a value as it is shown."""
    if value is None:
        return ""
    if unit == "us":
        return duration_text(1e3 * value)
    if unit == "%":
        return f"{value:.1%}"
    digits = ",.0f" if unit == "ticks" or value >= 1000.0 else ".3g"
    return f"{value:{digits}} {unit}".strip()


def duration_text(time_ns: float) -> str:
    """Return a time with a suitable unit."""
    for factor, unit in ((1e9, "s"), (1e6, "ms")):
        if time_ns >= factor:
            return f"{time_ns / factor:.3g} {unit}"
    return f"{time_ns / 1e3:.3g} us"


def page(conditions: Mapping[str, str], results: Named) -> str:
    """Return the page of results that count."""
    worst = max(steadiness(contestants) for _, (contestants, _) in results.values())
    rows = [
        (asked, ", ".join(map(_answer, filter(_is_shown, figures))), f"`{name}`")
        for name, (asked, (_, figures)) in results.items()
    ]
    return PAGE.format(
        steady=STEADY,
        worst=worst,
        figures="\n".join(table(("figure", "here", "benchmark"), rows)),
        conditions="\n".join(table(("machine", ""), conditions.items())),
    )


def _is_shown(one: Figure) -> bool:
    return bool(one.shown)


def _answer(one: Figure) -> str:
    return f"{text(one.value, one.unit)}{'' if one.unit else ' times'} {one.shown}"


def document(conditions: Mapping[str, str], results: Named) -> dict[str, Any]:
    """Return figures and all rounds with the bare loop before each and after the last one."""
    return {
        "conditions": dict(conditions),
        "benchmarks": {
            name: {
                "figures": [one._asdict() | {"reached": one.reached} for one in figures],
                "contestants": [
                    {
                        "label": one.label,
                        "rounds": [each._asdict() for each in one.rounds],
                        "bare_loop": [each._asdict() for each in one.loops],
                    }
                    for one in contestants
                ],
            }
            for name, (_, (contestants, figures)) in results.items()
        },
    }


def write(file: Path, conditions: Mapping[str, str], results: Named) -> None:
    """Write the page, and its rounds beside it."""
    lines = json.dumps(document(conditions, results), separators=(",", ":"), default=list)
    file.with_suffix(".json").write_text(lines.replace('{"label"', '\n{"label"') + "\n")
    file.write_text(page(conditions, results), encoding="utf-8")
