"""Contract of environments, and its check.

The check opens an environment twice and asks both instances the same questions: those of a table,
and along strokes to what its scene shows; a violation names the question. Only the first is asked
for contacts and scenes, too: if that changed an answer, the second would show it. Presses, each on
a new instance, look for a force of the opposite sign.
"""

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import fields, is_dataclass
from random import Random

from forcebound.errors import ConfigError
from forcebound.haptics.environments import (
    FAR,
    Environment,
    EnvironmentModel,
    open_environment,
)
from forcebound.haptics.environments.pulling import check_press
from forcebound.haptics.environments.strokes import Question, presses, strokes
from forcebound.haptics.parts import overridden
from forcebound.haptics.parts.contract import (
    SIGNALS,
    VALUE,
    Findings,
    Report,
    copy_of,
    is_unit,
    vector_fault,
)
from forcebound.messages.codec import decode, encode
from forcebound.messages.packets import MAX_AXES, MAX_LENGTH, Scene, SceneObject, Vector
from forcebound.messages.topology import HAND

LONG = 1e4  # s: beyond any run
PLACES = (0.001, -0.001, 0.02, -0.02, 1.0, -1.0, FAR, -FAR)  # m
SCATTERED = 30  # questions at random for each reach, and about each parameter
STROKES = 12  # towards what a scene shows, for each number of axes
PRESSES = 6  # towards what a scene shows, with about three axes
FEWEST = 4  # questions for each number of axes, however long an answer takes

PROMISES: dict[str, str] = {
    "opens": "opens for every number of axes that was tried, and closes",
    "answers": f"gives an answer at every position and velocity within {FAR:g} m and m/s",
    "shape": "gives a tuple with one number per axis",
    "finite": "a force is finite",
    "contact": "reports a finite proxy and a unit normal, one entry per axis, or None",
    "scene": f"shows at most {MAX_LENGTH} objects with different names, all of them drawable",
    "pure": "the same questions, in the same order from open on, have the same answers",
    "resists": "resists a press into it: positive resists motion in the positive direction",
    "users": "answers a second hand, takes readings, and lets a hand leave",
    **SIGNALS,
    **VALUE,
    "rest": "shows at rest the force that was stated",
}

Asked = Callable[[Question], None]


def check(
    model: EnvironmentModel,
    axes: Iterable[int] = range(1, MAX_AXES + 1),
    at_rest: Mapping[float, float] | None = None,
    at_most: int | None = None,
    progress: Callable[[str, int, int], None] = lambda question, done, total: None,
) -> Report:
    """Return which of the ``PROMISES`` an environment keeps, with each number of ``axes``.

    ``at_rest`` has positions on the first axis, in m, and the force there, in N, that is expected
    as the first answer: ``{0.0: 0.0}`` for a wall with free motion before it. About ``at_most``
    questions are asked, each twice, evenly out of all; ``progress`` is called before each answer
    with the question, the answers until now and all.
    """
    axes = tuple(dict.fromkeys(axes))
    objects = _objects(model, max(axes, default=1))
    known = {count: _questions(model, objects, count) for count in axes}
    share = math.inf if at_most is None else max(FEWEST, at_most // len(axes))
    asked = {count: all_[:: math.ceil(len(all_) / share) or 1] for count, all_ in known.items()}
    space = min(axes, key=lambda count: abs(count - 3), default=1)
    possible = presses(objects, space, PRESSES)
    pressed = possible if at_most is None else possible[: at_most // 2 // len(possible[0])]
    total = sum(map(len, asked.values()))
    numbers = itertools.count()
    found = Findings()
    found.check_value(model)
    answered: list[Vector | None] = []
    members: set[str] = set()

    def report(question: Question) -> None:
        progress(str(question), next(numbers), 2 * total + sum(map(len, pressed)))

    for count, questions in asked.items():
        before = _answers(model, count, questions, found, report, members)
        after = _answers(copy_of(model), count, questions, Findings(), report)
        answered += before
        for question, one, other in zip(questions, before, after, strict=False):  # none: not opened
            if one is not None and repr(one) != repr(other):
                found.add("pure", f"{one}, as before", repr(other), str(question))
        for position, force in (at_rest or {}).items():
            _check_rest(model, count, position, force, found)
    promises = {name: words for name, words in PROMISES.items() if name != "rest" or at_rest}
    unseen = {"contact", "scene"} - members
    decided = [check_press(model, press, found, report) for press in pressed]
    if not any(decided):
        unseen.add("resists")
    if not any(answered):
        unseen |= {"answers", "shape", "finite", "pure"}
    total += sum(map(len, pressed))
    every = sum(map(len, [*known.values(), *possible]))
    return found.report(promises, total, every - total, unseen)


def _check_rest(
    model: EnvironmentModel, axes: int, position: float, force: float, found: Findings
) -> None:
    is_close = functools.partial(math.isclose, rel_tol=1e-9, abs_tol=1e-12)
    still = (0.0,) * (axes - 1)
    question, expected = Question((position, *still), (0.0, *still), 1.0), (force, *still)
    for answer in _answers(model, axes, [question], Findings()):
        if answer is None or not all(map(is_close, answer, expected)):
            found.add("rest", f"{expected} N", repr(answer), str(question))


def ask_once(model: EnvironmentModel, axes: int, found: Findings) -> None:
    """Ask a new instance for a force at rest, a contact and its scene."""
    still = (0.0,) * axes
    _answers(model, axes, [Question(still, still, 0.0)], found, members=set())


def _answers(
    model: EnvironmentModel,
    axes: int,
    questions: Sequence[Question],
    found: Findings,
    report: Asked = lambda question: None,
    members: set[str] | None = None,
) -> list[Vector | None]:
    """The answers of a new instance; None where there was none; empty if it does not open.

    With ``members``, contacts and scenes are checked, too, and the methods that it has are added.
    """
    answers: list[Vector | None] = []
    with found.noting("opens", "an instance that closes", f"open({axes}), close()"):
        environment = open_environment(model, axes, (HAND,))
        if members is not None:
            members |= overridden(environment, Environment)
            _check_scene(environment, f"scene() before the first query, {axes} axes", found)
        for question in questions:
            report(question)
            answers.append(_answer(environment, question, found))
            if members is not None and answers[-1] is not None:
                _check_contact(environment, question, found)
        if members is not None:
            _check_scene(environment, f"scene() after the last query, {axes} axes", found)
            if len(questions) > 1:  # a launch file asks only once, at rest
                _check_users(environment, axes, found)
        environment.close()
    return answers


def _answer(environment: Environment, question: Question, found: Findings) -> Vector | None:
    where = str(question)
    with found.noting("answers", "an answer", where):
        force = environment.force(HAND, *question)
        if found.check_vector(force, len(question.position), "N", where):
            return tuple(float(entry) for entry in force)
    return None


def _check_contact(environment: Environment, question: Question, found: Findings) -> None:
    where = f"contact() after {question}"
    axes = len(question.position)
    with found.noting("contact", "a contact, or None", where):
        contact = environment.contact(HAND)
        if contact is None:
            return
        proxy, normal = contact
        for vector, unit in ((proxy, "m"), (normal, "1")):
            fault = vector_fault(vector, axes, unit)
            if fault is not None:
                found.add("contact", *fault, where)
                return
        if not all(map(math.isfinite, (*proxy, *normal))):
            found.add("contact", "finite numbers", repr(contact), where)
        # Of fewer axes than three, it is the part of a unit normal along them.
        elif not is_unit(normal) and not (axes < 3 and math.hypot(*normal) <= 1.0):
            found.add("contact", "a normal of length 1", repr(normal), where)


def _check_users(environment: Environment, axes: int, found: Findings) -> None:
    question = Question((0.0,) * axes, (0.0,) * axes, LONG)
    where = f"{question} of a second hand"
    with found.noting("users", "an answer to a second hand", where):
        environment.take_readings("second", 1, question.velocity)
        with suppress(ConfigError):  # a world may refuse a second hand
            found.check_vector(environment.force("second", *question), axes, "N", where)
        environment.leave("second")
        environment.scene()


def _check_scene(environment: Environment, where: str, found: Findings) -> None:
    with found.noting("scene", "a tuple of SceneObject", where):
        objects = tuple(environment.scene() or ())
        decode(encode(Scene(0, 0, objects)), Scene)
        names = [each.name for each in objects]
        for each in objects:
            if names.count(each.name) > 1:
                found.add("scene", "a name of its own for each object", repr(each.name), where)
            if not is_unit(each.orientation):
                found.add("scene", "an orientation of length 1", repr(each.orientation), where)


def _questions(
    model: EnvironmentModel, objects: Sequence[SceneObject], axes: int
) -> list[Question]:
    """The table for a number of axes: dense where a parameter may be the place of a surface."""
    still, random = (0.0,) * axes, Random(axes)
    edges = [0.0]
    names: list[str] = [one.name for one in fields(model)] if is_dataclass(model) else []
    for value in (getattr(model, name) for name in names):
        if isinstance(value, int | float) and abs(value) <= 1.0:
            edges += [math.nextafter(value, -1e9), float(value), math.nextafter(value, 1e9)]
    table = []
    for one in (*edges, *PLACES):
        along = (one, *still[1:])
        table += [Question(along, still, 0.0), Question((one,) * axes, still, 1.0)]
        table += [Question(along, (1.0,) * axes, 1.0), Question(still, along, LONG)]
    scattered = [(0.0, reach, 0.5) for reach in (0.02, 1.0)] + [(edge, 1e-5, 0.2) for edge in edges]
    for middle, reach, speed in scattered:
        for _ in range(SCATTERED):
            position = tuple(middle + random.uniform(-reach, reach) for _ in range(axes))
            velocity = tuple(random.uniform(-speed, speed) for _ in range(axes))
            table.append(Question(position, velocity, random.uniform(0.0, 100.0)))
    return [*table, *itertools.chain(*strokes(objects, axes, STROKES))]


def _objects(model: EnvironmentModel, axes: int) -> tuple[SceneObject, ...]:
    """Return the scene of a world before it is touched; nothing if it has no sound scene."""
    with suppress(Exception):  # the promises say why
        environment = open_environment(model, axes)
        with closing(environment):
            objects = tuple(environment.scene() or ())[:MAX_LENGTH]
        decode(encode(Scene(0, 0, objects)), Scene)
        return objects
    return ()
