"""Checks of parts against their contracts, for ``forcebound check``."""

import dataclasses
import json
import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from forcebound.bounding import contract as laws
from forcebound.config.parts import law_of, member_of
from forcebound.config.resolved import member_document
from forcebound.config.users_code import tried
from forcebound.controllers import contract as controllers
from forcebound.devices import contract as devices
from forcebound.environments import (
    Environment,
    EnvironmentModel,
    open_environment,
)
from forcebound.environments import contract as environments
from forcebound.environments.strokes import ACROSS, INWARDS, Touch, feel
from forcebound.errors import ConfigError
from forcebound.messages.packets import MAX_AXES
from forcebound.operators import contract as operators
from forcebound.parts import overridden
from forcebound.parts.contract import Report
from forcebound.parts.user_module import file_of, names_file
from forcebound.units import parse_quantity

CONTRACTS: Mapping[str, Any] = {
    "law": laws,
    "device": devices,
    "operator": operators,
    "controller": controllers,
    "environment": environments,
}

PROBES = (-0.010, 0.0, 0.005, 0.010, 0.011, 0.015, 0.020, 0.050)  # m, positions for forces at rest
FEWEST_CALLS, CALLS = 10, 300  # that are timed
FEWEST_STROKES, STROKES = 2, 40
# s, approximately: queries of the contract, timed calls, strokes.
QUERYING, TIMING, STROKING = 10.0, 2.0, 2.0
CHECK_S = 120.0  # for all of it, in a process of its own

Progress: TypeAlias = Callable[[str, int, int], None]


def no_progress(doing: str, done: int, total: int) -> None:
    """Report no progress."""


def check_part(
    section: str,
    kind: str,
    arguments: Sequence[str] = (),
    axes: Sequence[int] = (),
    rest: Sequence[str] = (),
    progress: Progress = no_progress,
) -> dict[str, Any]:
    """Return what the contract test finds of a part, in plain JSON types.

    A file of the user's own runs in a process of its own. A slow environment gets fewer queries.

    Args:
        section: ``"law"``, ``"device"``, ``"operator"``, ``"controller"`` or ``"environment"``.
        kind: ``FILE.py``, ``FILE.py:NAME`` or a kind that is installed.
        arguments: Its parameters, each ``name:=value``; a law has none.
        axes: Numbers of axes of an environment; none: 1 to 6.
        rest: Forces expected of an environment at rest, each ``POSITION=FORCE``.
        progress: Called before each answer of an environment, where it runs, with the question,
            the answers so far and their number in all.

    Returns:
        ``part`` (kind and parameters), ``passed``, ``questions``, ``promises`` (which were kept)
        and ``violations``. Of an environment ``part`` is called ``environment``, and there are
        ``axes`` (the numbers of axes that were tried), ``left_out`` (queries that were not sent),
        ``at_rest`` (position and force on the first axis, in m and N; no force where it gave none),
        ``touch`` (what strokes towards the scene felt, as
        :class:`forcebound.environments.strokes.Touch`; None without contact or scene) and
        ``seconds_per_answer`` (``median``, ``max`` of ``answers``; None if it gives none).

    Raises:
        ConfigError: If there is no such part, a parameter is wrong, or the user's code was too slow
            or ended its process.
    """
    check = partial(check_here, section, kind, arguments, axes, rest, progress)
    if not names_file(kind):
        return check()
    data = tried(partial(_as_json, check), [file_of(kind, Path())], CHECK_S)
    document: dict[str, Any] = json.loads(data)
    return document


def _as_json(check: Callable[[], dict[str, Any]]) -> bytes:
    return json.dumps(check()).encode()


def check_here(
    section: str,
    kind: str,
    arguments: Sequence[str] = (),
    axes: Sequence[int] = (),
    rest: Sequence[str] = (),
    progress: Progress = no_progress,
) -> dict[str, Any]:
    """Do the work of :func:`check_part` in this process."""
    if section == "law":
        law = law_of(kind)
        return {"part": {"kind": law}, **_found(laws.check(law))}
    expected = dict(map(_expected, rest))
    model = member_of(section, kind, arguments)
    if section == "environment":
        return _check_environment(progress, model, axes, expected)
    return {"part": member_document(section, model), **_found(CONTRACTS[section].check(model))}


def _found(report: Report) -> dict[str, Any]:
    return {
        "passed": not report.violations,
        "questions": report.questions,
        "promises": report.held,
        "violations": [dataclasses.asdict(v) for v in report.violations],
    }


def _check_environment(
    progress: Progress,
    model: EnvironmentModel,
    axes: Sequence[int],
    expected: Mapping[float, float],
) -> dict[str, Any]:
    one = min(axes, default=1)
    axes = axes or range(1, MAX_AXES + 1)
    environment = open_environment(model, one)
    at_rest, times = [], []
    for position in PROBES:
        progress(f"force at rest, at {position * 1e3:g} mm,", 0, 0)
        began = time.perf_counter()
        at_rest.append({"position_m": position, "force_n": _at_rest(environment, position, one)})
        times.append(time.perf_counter() - began)
    usual = statistics.median(times)
    report = environments.check(
        model,
        axes,
        expected,
        at_most=round(QUERYING / usual / 2),
        progress=progress,
    )
    touch = _touch(model, min(max(axes), 3), round(STROKING / usual), progress)
    times = _times(environment, one, min(max(FEWEST_CALLS, round(TIMING / usual)), CALLS), progress)
    return {
        "environment": member_document("environment", model),
        **_found(report),
        "axes": sorted(set(axes)),
        "left_out": report.left_out,
        "at_rest": at_rest,
        "touch": None if touch is None else dataclasses.asdict(touch),
        "seconds_per_answer": {
            "median": statistics.median(times) if times else None,
            "max": max(times, default=None),
            "answers": len(times),
        },
    }


def lines(section: str, document: Mapping[str, Any]) -> list[str]:
    """Return the result of :func:`check_part` as lines of text."""
    text = []
    for promise, held in document["promises"].items():
        words = CONTRACTS[section].PROMISES[promise]
        text.append(f"{'kept  ' if held else 'BROKEN'}  {promise:<8} {words}")
        for violation in document["violations"]:
            if violation["promise"] == promise:
                text.append(f"          {violation['where']}")
                text.append(f"            expected {violation['expected']}")
                text.append(f"            got      {violation['got']}")
    return text + (_measured(document) if section == "environment" else [])


def _measured(document: Mapping[str, Any]) -> list[str]:
    shown = ", ".join(
        f"{one['position_m'] * 1e3:g} mm: "
        + ("no answer" if one["force_n"] is None else f"{one['force_n']:.4g} N")
        for one in document["at_rest"]
    )
    tried = ", ".join(map(str, document["axes"]))
    text = [f"numbers of axes tried: {tried}", f"at rest, on the first axis: {shown}"]
    if document["touch"] is not None:
        text += _touched(document["touch"])
    if document["left_out"]:
        known = document["questions"] + document["left_out"]
        text.append(f"{document['questions']} of {known} queries, since answers are slow")
    answer = document["seconds_per_answer"]
    if answer["answers"]:
        text.append(
            f"one answer takes {answer['median'] * 1e6:.1f} us (longest of {answer['answers']}:"
            f" {answer['max'] * 1e6:.0f} us); at 1 kHz a tick has 1000 us"
        )
    return text


def _touched(touch: Mapping[str, Any]) -> list[str]:
    count, touched = touch["strokes"], touch["touched"]
    text = [f"strokes towards what the scene shows: {count}, of which touched it: {touched}"]
    if touch["stiffness"] is not None:
        least, median, most = (f"{stiffness * 1e-3:.3g} N/mm" for stiffness in touch["stiffness"])
        text.append(
            f"along the normal {median} ({least} to {most}); across it at most"
            f" {touch['across']:.2g} of that"
        )
    return text


def _touch(model: EnvironmentModel, axes: int, calls: int, progress: Progress) -> Touch | None:
    """What strokes feel; None of an environment without contact or scene."""
    progress("strokes towards its scene", 0, 0)
    try:
        environment = open_environment(model, axes)
        try:
            scene = environment.scene()
            if scene is None or "contact" not in overridden(environment, Environment):
                return None
            count = min(max(calls // (INWARDS + ACROSS), FEWEST_STROKES), STROKES)
            return feel(environment, scene, axes, count)
        finally:
            environment.close()
    except Exception:  # reported by the contract
        return None


def _expected(text: str) -> tuple[float, float]:
    position, separator, force = text.partition("=")
    try:
        if separator:
            return parse_quantity(position, "m"), parse_quantity(force, "N")
    except ConfigError as error:
        raise ConfigError(f"--rest {text}: {error}") from None
    raise ConfigError(f"--rest {text}: expected POSITION=FORCE, for example 0mm=0N")


def _at_rest(environment: Environment, position: float, axes: int) -> float | None:
    still = (0.0,) * axes
    try:
        force = float(environment.force("", (position, *still[1:]), still, 1.0)[0])
    except (Exception, SystemExit):  # reported by the contract
        return None
    return force if math.isfinite(force) else None


def _times(environment: Environment, axes: int, calls: int, progress: Progress) -> list[float]:
    """Time for each answer, in s, at positions with a force; none if one fails."""
    times = []
    for call in range(calls):
        position = (0.05 * call / calls,) + (0.0,) * (axes - 1)
        progress(f"force({position}, {(0.1,) * axes}, 1.0)", call, calls)
        began = time.perf_counter()
        try:
            environment.force("", position, (0.1,) * axes, 1.0)
        except (Exception, SystemExit):  # reported by the contract
            return []
        times.append(time.perf_counter() - began)
    return times
