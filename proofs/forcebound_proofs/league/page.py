"""The page of the league, made whole from its rows; its text is ``league.md`` beside this file."""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound.lab.engine import Row
from forcebound.lab.views import groups, table
from forcebound.results.perception import WEBER_FRACTIONS
from forcebound.units import DB
from forcebound.units import energy_in_words as energy
from forcebound_proofs.attack import RANDOM, SEARCH
from forcebound_proofs.league.contest import CELL, ENERGY, TUNING, Budget, is_level
from forcebound_proofs.league.methods import CERTIFIED, Method
from forcebound_proofs.league.places import (
    ATTACKER,
    DELAYS,
    NETWORKS,
    PHANTOM,
    RESTING,
    TOUCHED,
    TUNED_AT,
    WALL,
    Place,
)
from forcebound_proofs.league.scores import (
    LITTLE,
    LOST_BY,
    SCORES,
    Loss,
    Score,
    Worst,
    cells,
    compared,
    leaks,
    losses,
    lowest,
    worst,
)

TEXT = Path(__file__).with_name("league.md")
NOTICED = 1.0 - WEBER_FRACTIONS["displayed_stiffness_n_per_m"][0]


def page(
    rows: Sequence[Row],
    methods: Mapping[str, Method],
    budget: Budget,
    made_by: str,
    pictures: Mapping[str, str],
) -> Iterator[str]:
    """Yield the page; ``pictures`` are their file names by what they show."""
    promises = _promises(rows, methods)
    played = cells(rows)
    counted = sum(map(len, played.values()))
    found = worst(rows)
    parts: dict[str, Iterable[str]] = {
        "count": [
            f"{len(methods)} methods, each in up to {len(played)} places ({counted} in all),"
        ],
        "origin": [made_by],
        "losses": _losses(rows, methods),
        "verdicts": _verdicts(found, promises),
        "worst": _worst(found, methods, promises),
        "stiffness": _over_delay(played),
        "places": _places(played, found, methods),
        "methods": _methods(methods),
        "places_in_words": [_in_words(played)],
        "networks": _networks(),
        "tuned": _tuned(rows),
    }
    words = {name: "\n".join(lines) for name, lines in parts.items()}
    shown = {f"{name}_picture": file for name, file in pictures.items()}
    text = TEXT.read_text(encoding="utf-8").rstrip()
    numbers = {
        "just_noticeable": f"{NOTICED:.0%}",
        "lost_by": f"{100 * LOST_BY:g} %",
        "tuned_at": TUNED_AT,
        "evaluations": budget.tuning,
        "at_random": budget.attacks[0],
        "searched": budget.attacks[1],
        "attacked": f"{budget.attacked:g}",
        "attacker": ", ".join(ATTACKER).replace("_", " "),
    }
    yield text.format(**words, **shown, **numbers)


def _gap(loss: Loss) -> float:
    """Return how large a loss is, 0 to 1, to compare those of one figure."""
    apart = abs(loss.theirs - loss.ours)
    return apart if loss.score.unit is DB else apart / max(abs(loss.theirs), abs(loss.ours))


def _against(loss: Loss) -> str:
    score, unit = loss.score, loss.score.unit.unit
    ours, theirs = (f"{score.show(one)} {unit}".strip() for one in (loss.ours, loss.theirs))
    return f"{loss.place.label}: {ours}, `{loss.method}` {theirs}"


def _losses(rows: Sequence[Row], methods: Mapping[str, Method]) -> Iterator[str]:
    """Yield where the certified law loses: in all, by figure, and each loss to a safer method."""
    safer, every = (list(losses(rows, most)) for most in (LITTLE, math.inf))
    count, little = sum(compared(rows, score) for score in SCORES), energy(LITTLE)
    none = sum(1 for _ in losses(rows, ENERGY_TOLERANCE))
    leaky = ", ".join(
        f"`{name}` ({methods[name].audit})"
        for name in dict.fromkeys(loss.method for loss in safer)
        if methods[name].audit.startswith("-")
    )
    yield (
        f"In {count} comparisons `{CERTIFIED}` loses **{len(every)}** to any method,"
        f" **{len(safer)}** to methods that gave a hand of that device at most {little}, and"
        f" **{none}** to methods of which no leak was found on it. It is compared with the best of"
        " them.\n\nThe devices"
        " here are exactly as they state, and their clocks are steady; the attacks have this"
        " page's budget. In the audit, with other devices, encoders and clocks, these of the"
        f" methods that gave at most {little} here gave more: {leaky or 'none'}. Only the certified"
        " laws of this league promise a bound that covers both.\n"
    )
    heads = (
        "figure",
        "least difference",
        "places",
        "lost to any",
        "worst",
        f"lost to methods that gave at most {little}",
        "worst",
    )
    yield from table(heads, _by_figure(rows, every, safer))
    if safer:
        yield f"\nEach loss to a method that gave at most {little}:\n"
        lines = ((loss.score.label, _against(loss)) for loss in safer)
        yield from table(("figure", f"place: `{CERTIFIED}`, the other"), lines)


def _by_figure(rows: Sequence[Row], *kinds: Sequence[Loss]) -> Iterator[list[object]]:
    for score in SCORES:
        least = f"{score.least * score.unit.factor:g} {score.unit.unit}"
        line: list[object] = [score.label, least, compared(rows, score)]
        for lost in kinds:
            own = [loss for loss in lost if loss.score is score]
            line += [len(own), _against(max(own, key=_gap)) if own else "–"]
        yield line


def _promises(rows: Sequence[Row], methods: Mapping[str, Method]) -> dict[tuple[str, str], str]:
    """Return, by method and device, whether what it gave is within its own promise."""
    found = {}
    for (name, device), own in groups(rows, "method", "device").items():
        method, numbers = methods[name], _numbers(own)
        giving = [row for row in own if row["kind"] != TUNING and leaks(row[ENERGY])]
        outside = [row for row in giving if not method.is_met(row, numbers)]
        why = method.excuse or ("outside of its condition" if giving == outside else "")
        found[name, device] = "–" if not giving else f"yes: {why}" if why else "**no**"
    return found


def _numbers(rows: Sequence[Row]) -> dict[str, float]:
    """Return the numbers with which a method was played on a device."""
    numbers: dict[str, float] = json.loads(next(r["numbers"] for r in rows if r["kind"] == CELL))
    return numbers


def _verdicts(found: Sequence[Worst], promises: Mapping[tuple[str, str], str]) -> Iterator[str]:
    for one in found:
        if promises[one.method, one.device] == "**no**":
            gave = f"`{one.method}` gave {energy(-one.energy)} on the {one.device}"
            yield f"**{gave}: a broken promise.**\n"
    if "**no**" not in promises.values():
        yield "No method broke its own promise. The energy below is what the hand got.\n"
    for device in dict.fromkeys(one.device for one in found):
        own = [one for one in found if one.device == device]
        kept = ", ".join(f"`{one.method}`" for one in own if not one.leaks) or "none"
        gave = ", ".join(f"`{one.method}` ({energy(-one.energy)})" for one in own if one.leaks)
        yield f"* {device}: no leak was found of {kept}. The hand got energy from {gave or 'none'}."
    yield ""
    yield "*No leak found* is no proof: only a certificate excludes one."


def _worst(
    found: Sequence[Worst],
    methods: Mapping[str, Method],
    promises: Mapping[tuple[str, str], str],
) -> Iterator[str]:
    heads = (
        "method",
        "device",
        "gave energy to the hand",
        "within its own promise?",
        "hands of the places",
        "random",
        "learned",
        "least share left",
        "failed",
        "worst in",
        "in the audit",
    )
    yield from table(
        heads,
        (
            (
                f"`{one.method}`",
                one.device,
                "**yes**" if one.leaks else "no",
                promises[one.method, one.device],
                *(energy(one.by_kind[kind]) for kind in (CELL, RANDOM, SEARCH)),
                "–" if one.leaks else f"{one.share_left:.1%}",
                one.failed,
                f"{one.row['world']}, {one.row['network']}",
                methods[one.method].audit,
            )
            for one in found
        ),
    )
    yield "\nThe worst runs, to repeat:\n"
    yield "```sh"
    for one in found:
        if one.leaks:
            yield f"{one.row['command']}  # {energy(one.energy)}"
    yield "```"


def _gave(rows: Sequence[Row]) -> str:
    given = lowest(rows)
    return energy(-given) if given is not None and leaks(given) else ""


def _over_delay(played: Mapping[Place, Mapping[str, list[Row]]]) -> Iterator[str]:
    at = [Place(PHANTOM, WALL, delay) for delay in DELAYS]
    known = [place for place in at if place in played]
    stiffness = SCORES[0]

    def cell(rows: Sequence[Row]) -> str:
        value, gave = stiffness.of(rows), _gave(rows)
        text = stiffness.show(value) if value else "moves"
        return f"{text}, gave {gave}" if gave else text

    heads = ("N/mm of 10", *(place.network for place in known))
    methods = played[known[0]]
    yield from table(heads, ((f"`{m}`", *(cell(played[p][m]) for p in known)) for m in methods))
    yield ""


def _places(
    played: Mapping[Place, Mapping[str, list[Row]]],
    found: Sequence[Worst],
    methods: Mapping[str, Method],
) -> Iterator[str]:
    for place, by_method in played.items():
        kept = [one.method for one in found if one.device == place.device and not one.leaks]
        yield f"### {place.label}\n"
        columns = [
            one for one in SCORES if any(one.of(rows) is not None for rows in by_method.values())
        ]
        best = {s: _best(s, place, [by_method[name] for name in kept]) for s in columns}
        lines = []
        for name, rows in by_method.items():
            marked = (_figure(score, place, rows, best[score], name in kept) for score in columns)
            felt = SCORES[0].of(rows)
            softer = "–" if felt is None else "yes" if felt < NOTICED * place.stiffness else "no"
            is_met = methods[name].is_met(rows[0], _numbers(rows))
            notes = ", ".join(_notes(rows, is_met))
            lines.append((f"`{name}`", *marked, softer, _gave(rows) or "–", notes))
        heads = (score.unit.label(score.label) for score in columns)
        yield from table(("method", *heads, "softer", "gave", "notes"), lines)
        yield ""


def _figure(score: Score, place: Place, rows: Sequence[Row], best: str, is_kept: bool) -> str:
    """Return a figure as text, bold if it is the best one."""
    value = score.of(rows)
    is_best = value is not None and score.show(score.counted(value, place)) == best
    return f"**{score.show(value)}**" if is_best and is_kept else score.show(value)


def _best(score: Score, place: Place, every: Iterable[Sequence[Row]]) -> str:
    """Return the best value of a figure, as it is shown."""
    join = max if score.is_higher_better else min
    values = (value for one in every if (value := score.of(one)) is not None)
    return score.show(join((score.counted(value, place) for value in values), default=None))


def _notes(rows: Sequence[Row], is_met: bool) -> Iterator[str]:
    if not is_met:
        yield "outside of its condition"
    for row in rows:
        if row["error"]:
            yield f"{row['hand']}: left the workspace"
        elif row["hand"] in RESTING and row["world"] in TOUCHED and not row["at_rest"]:
            yield f"{row['hand']} moves"


def _methods(methods: Mapping[str, Method]) -> Iterator[str]:
    lines = (
        (
            f"`{name}`",
            " ".join(f"`{re.sub(r'=/.*/', '=', word)}`" for word in one.words),
            one.promise,
            ", ".join(one.numbers) or "–",
            one.source,
        )
        for name, one in methods.items()
    )
    yield from table(("method", "in a launch file", "promise", "tuned", "source"), lines)


def _in_words(played: Mapping[Place, object]) -> str:
    parts = []
    rows = [place._asdict() for place in played]
    for (device, world), own in groups(rows, "device", "world").items():
        one = Place(device, world, TUNED_AT)
        networks = ", ".join(f"*{row['network']}*" for row in own)
        hands = ", ".join(f"`{hand}`" for hand in one.hands)
        parts.append(f"* {device}, {world} (`{one.file}`): hands {hands}; networks {networks}")
    return "\n\n" + "\n".join(parts)


def _networks() -> Iterator[str]:
    lines = ((name, " ".join(f"`{word}`" for word in words)) for name, words in NETWORKS.items())
    yield from table(("network", "each way"), lines)


def _tuned(rows: Sequence[Row]) -> Iterator[str]:
    lines = []
    tuning = [row for row in rows if row["kind"] == TUNING]
    for (method, device), own in groups(tuning, "method", "device").items():
        best = min(own, key=lambda row: float(row["cost"]))
        played = _numbers(
            [row for row in rows if (row["method"], row["device"]) == (method, device)]
        )
        numbers = ", ".join(f"{name} {value:g}" for name, value in played.items()) or "the defaults"
        felt = f"{-best['cost']:.1%}" if best["cost"] <= 0.0 else "gives energy"
        if is_level(own):
            felt = f"{felt}; not tuned: all evaluations equal"
        giving = sum(leaks(row["energy_j"]) for row in own)
        lines.append((f"`{method}`", device, len(own), giving, numbers, felt))
    heads = ("method", "device", "evaluations", "of them gave energy", "chosen", "share felt")
    yield from table(heads, lines)
