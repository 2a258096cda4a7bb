"""Contract of every controller, and its check."""

import math
from collections.abc import Iterable, Iterator
from random import Random
from typing import Any

from forcebound.haptics.controllers import Controller, ControllerModel
from forcebound.haptics.parts.contract import SIGNALS, VALUE, Findings, Report, copy_of
from forcebound.messages.packets import MAX_AXES, Contact, DeviceState, EnvironmentReply, Vector

PROMISES: dict[str, str] = {
    "opens": f"opens for 1 to {MAX_AXES} axes, and closes",
    "answers": "takes every state and reply, with and without contact, buttons, or a reply at all",
    "shape": "queries and forces are tuples with one number per axis, or there is no force",
    "finite": "queries and forces are finite",
    **SIGNALS,
    "pure": "the same calls, in the same order from open on, return the same",
    **VALUE,
}
OF_ANSWERS = ("shape", "finite", "pure")  # promises that only an answer shows


def check(
    model: ControllerModel,
    axes: Iterable[int] = range(1, MAX_AXES + 1),
    seed: int = 1,
    states: int = 300,
) -> Report:
    """Return which of the ``PROMISES`` a controller keeps.

    Args:
        model: With the parameters that matter.
        axes: Numbers of axes that it is opened for.
        seed: Of the random states and replies.
        states: For each number of axes.
    """
    found = Findings()
    found.check_value(model)
    questions = 0
    for count in axes:
        runs = []
        for one in (model, copy_of(model)):
            questions += states
            runs += _answers(one, count, Random(seed), states, found)
        if len(runs) == 2:
            found.check_repeats(runs[0], runs[1], f"axes: {count}")
    fails = found.is_broken("opens") or found.is_broken("answers")
    return found.report(PROMISES, questions, unseen=OF_ANSWERS if fails else ())


def ask_once(model: ControllerModel, axes: int, found: Findings) -> None:
    """Give a new instance a state and, as the case may be, a reply."""
    _answers(model, axes, Random(1), 1, found)


def _answers(
    model: ControllerModel, axes: int, random: Random, states: int, found: Findings
) -> list[list[str]]:
    """The answers of a new instance; none if it does not open or close."""
    with found.noting("opens", "an instance that closes", f"axes: {axes}"):
        controller = model.open(axes)
        answers = list(_drive(controller, axes, random, states, found))
        found.check_signals(controller, model.signals)
        controller.close()
        return [answers]
    return []


def _drive(
    controller: Controller, axes: int, random: Random, states: int, found: Findings
) -> Iterator[str]:
    """What it returns to states, and to replies of which some are missing."""

    def call(method: Any, *arguments: Any, units: tuple[str, ...]) -> str:
        where = f"{method.__name__}, axes: {axes}"
        with found.noting("answers", "an answer", where):
            answer = method(*arguments)
            vectors = (answer,) if len(units) == 1 else tuple(answer)
            for vector, unit in zip(vectors, units, strict=True):
                if vector is not None or unit != "N":
                    found.check_vector(vector, axes, unit, where)
            return repr(answer)
        return "no answer"

    for seq in range(states):
        time_ns = seq * 1_000_000
        position = tuple(random.uniform(-0.05, 0.05) for _ in range(axes))
        velocity = tuple(random.uniform(-0.5, 0.5) for _ in range(axes))
        buttons = None if axes == 1 else random.getrandbits(2)  # not every device has any
        zero = (0.0,) * axes
        elapsed = time_ns * 1e-9
        state = DeviceState(seq, time_ns, elapsed, position, velocity, zero, None, buttons)
        yield call(controller.on_state, state, time_ns, units=("N",))
        yield call(controller.query, state, units=("m", "m/s"))
        if random.random() < 0.7:
            force = tuple(random.uniform(-10.0, 10.0) for _ in range(axes))
            told = _contact(position, random) if random.random() < 0.5 else (None, None)
            reply = EnvironmentReply(seq, time_ns, seq, time_ns, seq, time_ns, force, "one", *told)
            yield call(controller.on_reply, reply, time_ns + 400_000, units=("N",))


def _contact(position: Vector, random: Random) -> Contact:
    """A contact near a position, its normal in any direction."""
    direction = [random.gauss(0.0, 1.0) for _ in position]
    length = math.hypot(*direction)
    normal = tuple(entry / length for entry in direction)
    depth = random.uniform(0.0, 1e-3)
    return Contact(tuple(x + depth * n for x, n in zip(position, normal, strict=True)), normal)
