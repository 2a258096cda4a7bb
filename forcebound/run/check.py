"""Checks of parts against their contracts, for ``forcebound check``."""

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import msgspec
from msgspec import Struct

from forcebound.bounded_child import tried
from forcebound.errors import ConfigError
from forcebound.graph import document
from forcebound.graph.loader import hand_of, launch_file_of
from forcebound.graph.parts import law_of, member_of
from forcebound.graph.resolved import part_document
from forcebound.haptics.controllers import contract as controllers
from forcebound.haptics.devices import DEVICES, DeviceModel
from forcebound.haptics.devices import contract as devices
from forcebound.haptics.environments import Environment, EnvironmentModel, open_environment
from forcebound.haptics.environments import contract as environments
from forcebound.haptics.hands import contract as operators
from forcebound.haptics.laws import contract as laws
from forcebound.haptics.parts.contract import Report, Violation
from forcebound.haptics.parts.user_module import file_of, names_file
from forcebound.messages.packets import MAX_AXES
from forcebound.messages.topology import HAND, Document
from forcebound.run.bus import TickTimes, described, doubted_unit, time_ticks
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
QUERYING, TIMING = 10.0, 2.0  # s, approximately: queries of the contract, timed calls
HOLD_LIMIT = 1.25e-3  # s, of a device while it is timed
CHECK_S = 120.0  # for all of it, in another process

Progress: TypeAlias = Callable[[str, int, int], None]


class AtRest(Struct, frozen=True):
    """Force of an environment at rest, on the first axis."""

    position_m: float
    force_n: float | None  # None: no answer


class AnswerTimes(Struct, frozen=True):
    """Times of the answers of an environment, in s; None: it gives none."""

    median: float | None
    max: float | None
    answers: int


class Checked(Struct, kw_only=True, omit_defaults=True):
    """Findings of the contract test of a part."""

    part: Document  # kind and parameters
    passed: bool
    questions: int
    promises: dict[str, bool]  # which were kept
    violations: list[Violation]
    # Of an environment:
    axes: list[int] = []  # numbers of axes that were tried
    left_out: int | None = None  # queries that were not sent
    at_rest: list[AtRest] = []
    seconds_per_answer: AnswerTimes | None = None
    # Of a device:
    seconds_per_tick: TickTimes | None = None
    permits: list[str] = []  # by these times: rates, readings, write delay


def check_part(
    section: str,
    kind: str,
    arguments: Sequence[str] = (),
    axes: Sequence[int] = (),
    rest: Sequence[str] = (),
    progress: Progress = lambda doing, done, total: None,
    is_child: bool = False,
) -> Checked:
    """Return what the contract test finds of a part.

    A user's file runs in another process. A slow environment gets fewer queries.

    Args:
        section: ``"law"``, ``"device"``, ``"operator"``, ``"controller"`` or ``"environment"``.
        kind: ``FILE.py``, ``FILE.py:NAME`` or a kind that is installed; of a device also
            ``FILE.yaml`` or ``FILE.yaml:HAND``, of a launch file, or one that ships, by name.
        arguments: Its parameters, each ``name:=value``; a law has none.
        axes: Numbers of axes of an environment; none: 1 to 8.
        rest: Forces expected of an environment at rest, each ``POSITION=FORCE``.
        progress: Called before each answer with the question, answers so far and in all.
        is_child: A user's file runs in this process, too.

    Raises:
        ConfigError: If there is no such part, or the user's code was too slow or ended its process.
    """
    if section == "device" and kind not in DEVICES and f"{kind}.yaml" in document.shipped():
        kind = f"{kind}.yaml"
    if (names_file(kind) or launch_file_of(kind)[0]) and not is_child:
        here = partial(check_part, section, kind, arguments, axes, rest, progress, is_child=True)
        data = tried(partial(_as_json, here), _files(kind), CHECK_S)
        return msgspec.json.decode(data, type=Checked)
    if section == "law":
        law = law_of(kind)
        return _checked({"kind": law}, laws.check(law))
    expected = dict(map(_expected, rest))
    model: Any
    servo = None
    if section == "device" and launch_file_of(kind)[0]:
        hand = hand_of(kind, arguments)
        model, servo = hand.device, hand.servo
    else:
        model = member_of(section, kind, arguments)
    part = part_document(section, model)
    if section == "environment":
        return _check_environment(part, progress, model, axes, expected)
    checked = _checked(part, CONTRACTS[section].check(model))
    if section == "device" and checked.passed:
        checked.seconds_per_tick = times = _tick_times(model)
        if times is not None:
            permits = (*described(times, servo), doubted_unit(times, model))
            checked.permits = list(filter(None, permits))
    return checked


def _files(kind: str) -> list[Path]:
    return [file_of(kind, Path()) if names_file(kind) else Path(launch_file_of(kind)[0])]


def _as_json(check: Callable[[], Checked]) -> bytes:
    return msgspec.json.encode(check())


def _checked(part: Document, report: Report) -> Checked:
    return Checked(
        part=part,
        passed=not report.violations,
        questions=report.questions,
        promises=report.held,
        violations=list(report.violations),
    )


def _check_environment(
    part: Document,
    progress: Progress,
    model: EnvironmentModel,
    axes: Sequence[int],
    expected: Mapping[float, float],
) -> Checked:
    one = min(axes, default=1)
    axes = axes or range(1, MAX_AXES + 1)
    environment = open_environment(model, one)
    at_rest, times = [], []
    for position in PROBES:
        progress(f"force at rest, at {position * 1e3:g} mm,", 0, 0)
        began = time.perf_counter()
        at_rest.append(AtRest(position, _at_rest(environment, position, one)))
        times.append(time.perf_counter() - began)
    usual = statistics.median(times)
    report = environments.check(
        model,
        axes,
        expected,
        at_most=round(QUERYING / usual / 2),
        progress=progress,
    )
    checked = _checked(part, report)
    checked.axes, checked.left_out, checked.at_rest = sorted(set(axes)), report.left_out, at_rest
    times = _times(environment, one, min(max(FEWEST_CALLS, round(TIMING / usual)), CALLS), progress)
    median = statistics.median(times) if times else None
    checked.seconds_per_answer = AnswerTimes(median, max(times, default=None), len(times))
    return checked


def lines(section: str, checked: Checked) -> list[str]:
    """Return the result of :func:`check_part` as lines of text."""
    text = []
    for promise, held in checked.promises.items():
        words = CONTRACTS[section].PROMISES[promise]
        text.append(f"{'kept  ' if held else 'BROKEN'}  {promise:<8} {words}")
        for violation in checked.violations:
            if violation.promise == promise:
                text += [f"{'':10}{line}" for line in violation.lines()]
    return text + _measured(checked)


def _measured(checked: Checked) -> list[str]:
    answer = checked.seconds_per_answer
    if answer is None:
        return checked.permits  # of a device; no environment
    shown = ", ".join(
        f"{one.position_m * 1e3:g} mm: "
        + ("no answer" if one.force_n is None else f"{one.force_n:.4g} N")
        for one in checked.at_rest
    )
    tried = ", ".join(map(str, checked.axes))
    text = [f"numbers of axes tried: {tried}", f"at rest, on the first axis: {shown}"]
    if "resists" not in checked.promises:
        words = "positive resists motion in the positive direction"
        text.append(f"no press along an axis met a force, at rest, that resists it ({words})")
    if checked.left_out:
        known = checked.questions + checked.left_out
        text.append(f"{checked.questions} of {known} queries, since answers are slow")
    if answer.median is not None and answer.max is not None:
        text.append(
            f"one answer takes {answer.median * 1e6:.1f} us (longest of {answer.answers}:"
            f" {answer.max * 1e6:.0f} us); at 1 kHz a tick has 1000 us"
        )
    return text


def _tick_times(model: DeviceModel) -> TickTimes | None:
    """Times of a device that gets no force; None: it failed, which its contract judges."""
    with suppress(Exception), closing(model.open(None, HOLD_LIMIT)) as device:
        return time_ticks(device, time.monotonic_ns, CALLS, TIMING)
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
        force = float(environment.force(HAND, (position, *still[1:]), still, 1.0)[0])
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
            environment.force(HAND, position, (0.1,) * axes, 1.0)
        except (Exception, SystemExit):  # reported by the contract
            return []
        times.append(time.perf_counter() - began)
    return times
