"""Contract of every controller, and its check."""

import math
from collections.abc import Iterable, Iterator
from random import Random
from typing import Any

from forcebound.haptics.controllers import Controller, ControllerModel
from forcebound.haptics.parts.contract import SIGNALS, VALUE, Findings, Report, copy_of
from forcebound.messages.packets import MAX_AXES, DeviceState, EnvironmentReply, Vector

PROMISES: dict[str, str] = {
    "opens": f"opens for 1 to {MAX_AXES} axes, and closes",
    "answers": "takes every state and reply, with and without contact, buttons, or a reply at all",
    "shape": "queries and forces are tuples with one number per axis, or there is no force",
    "finite": "queries and forces are finite",
    **SIGNALS,
    "pure": "the same calls, in the same order from open on, return the same",
    **VALUE,
}
STATES = 300  # for each number of axes


def check(model: ControllerModel, axes: Iterable[int] = range(1, MAX_AXES + 1)) -> Report:
    """Return which of the ``PROMISES`` a controller keeps with these numbers of axes."""
    found, questions = Findings(), 0
    found.check_value(model)
    for count in axes:
        runs = [_answers(one, count, STATES, found) for one in (model, copy_of(model))]
        questions += len(runs) * STATES
        if all(runs):
            found.check_repeats(runs[0], runs[1], f"axes: {count}")
    fails = found.is_broken("opens") or found.is_broken("answers")
    return found.report(PROMISES, questions, unseen=("shape", "finite", "pure") if fails else ())


def ask_once(model: ControllerModel, axes: int, found: Findings) -> None:
    """Give a new instance a state and, as the case may be, a reply."""
    _answers(model, axes, 1, found)


def _answers(model: ControllerModel, axes: int, states: int, found: Findings) -> list[str]:
    """The answers of a new instance; none if it does not open or close."""
    with found.noting("opens", "an instance that closes", f"axes: {axes}"):
        controller = model.open(axes)
        controller.published.declare(model.declared())
        answers = list(_drive(controller, axes, states, found))
        controller.close()
        return answers
    return []


def _drive(controller: Controller, axes: int, states: int, found: Findings) -> Iterator[str]:
    """Yield its answers to states, and to replies of which some are missing."""
    random = Random(1)

    def call(method: Any, *arguments: Any, units: tuple[str, ...] = ("N",)) -> str:
        where = f"{method.__name__}, axes: {axes}"
        with found.noting("answers", "an answer", where):
            answer = method(*arguments)
            for vector, unit in zip(answer if units[1:] else (answer,), units, strict=True):
                if vector is not None or unit != "N":
                    found.check_vector(vector, axes, unit, where)
            return repr(answer)
        return "no answer"

    for seq in range(states):
        time_ns = seq * 1_000_000
        position, velocity, force = (_vector(random, axes, most) for most in (0.05, 0.5, 10.0))
        buttons = None if axes == 1 else random.getrandbits(2)  # not every device has any
        zero = (0.0,) * axes
        state = DeviceState(seq, time_ns, seq * 1e-3, position, velocity, zero, None, buttons)
        yield call(controller.on_state, state, time_ns)
        yield call(controller.query, state, units=("m", "m/s"))
        if random.random() < 0.7:
            direction = _vector(random, axes, 1.0)
            normal = tuple(entry / math.hypot(*direction) for entry in direction)
            reports = random.random() < 0.5
            contact = (position if reports else None, normal if reports else None)
            times = (seq, time_ns, seq, time_ns, seq, time_ns)
            reply = EnvironmentReply(*times, force, "one", *contact)
            yield call(controller.on_reply, reply, time_ns + 400_000)


def _vector(random: Random, axes: int, most: float) -> Vector:
    return tuple(random.uniform(-most, most) for _ in range(axes))
