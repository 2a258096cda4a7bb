"""Contract of environments, and its check.

The check opens an environment twice and asks both instances the same thousand questions, at random,
along strokes to what its scene shows, and at its limits; a violation names the question. Only the
first is asked for contacts and scenes, too: if that changed an answer, the second would show it.
"""

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from random import Random

from forcebound.environments import (
    Environment,
    EnvironmentModel,
    open_environment,
)
from forcebound.environments.strokes import strokes
from forcebound.messages.codec import decode, encode
from forcebound.messages.packets import MAX_AXES, MAX_LENGTH, Scene, SceneObject, Vector
from forcebound.parts import overridden
from forcebound.parts.contract import VALUE, Findings, Report, copy_of, is_unit, vector_fault

FAR = 1e6  # m, m/s: within it a force must be finite
LONG = 1e6  # s
FARTHEST = 1e300  # m, m/s: until here nothing may be raised
STROKES = 12  # towards what a scene shows, for each number of axes
FEWEST = 4  # questions for each number of axes, however long an answer takes

PROMISES: dict[str, str] = {
    "opens": "opens for every number of axes that was tried, and closes",
    "answers": f"gives an answer at every position and velocity, however far (to {FARTHEST:g} m)",
    "shape": "gives a tuple with one number per axis",
    "finite": f"a force is finite within {FAR:g} m, {FAR:g} m/s and {LONG:g} s",
    "contact": "reports a finite proxy and a unit normal, one entry per axis, or None",
    "scene": f"shows at most {MAX_LENGTH} objects with different names, all of them drawable",
    "pure": "the same questions, in the same order from open on, have the same answers",
    **VALUE,
    "rest": "shows at rest the force that was stated",
}


@dataclass(frozen=True)
class Question:
    """What an environment is asked once."""

    position: Vector  # m
    velocity: Vector  # m/s
    elapsed: float  # s

    def __str__(self) -> str:
        return f"force('', {self.position}, {self.velocity}, {self.elapsed})"


def check(
    model: EnvironmentModel,
    axes: Iterable[int] = range(1, MAX_AXES + 1),
    at_rest: Mapping[float, float] | None = None,
    seed: int = 1,
    rounds: int = 100,
    at_most: int | None = None,
    progress: Callable[[str, int, int], None] = lambda question, done, total: None,
) -> Report:
    """Return which of the ``PROMISES`` an environment keeps.

    Args:
        model: With the parameters that matter: others may behave otherwise.
        axes: Numbers of axes that it is asked with.
        at_rest: Position on the first axis, in m, and the force there, in N, that is expected at
            rest, as the first answer: ``{0.0: 0.0}`` for a wall with free motion before it.
        seed: Of the random questions; the same seed asks the same.
        rounds: Random questions for each number of axes and each scale.
        at_most: About how many questions to ask, each twice: some of all, drawn at random; at
            least ``FEWEST`` for each number of axes. None: all.
        progress: Called before each answer with the question, the answers until now and all.
    """
    axes = tuple(dict.fromkeys(axes))
    objects = _objects(model, max(axes, default=1))
    questions: dict[int, Sequence[Question]] = {}
    known = 0
    for count in axes:
        random = Random(seed * 100 + count)
        everything = list(_questions(model, count, random, rounds))
        everything += (
            Question(*tip) for one in strokes(objects, count, random, STROKES) for tip in one
        )
        everything.sort(key=_is_far)  # what lies beyond any hand comes last: it may spoil a state
        known += len(everything)
        questions[count] = _some(everything, Random(seed * 100 + count), at_most, len(axes))
    total = sum(map(len, questions.values()))
    found = Findings()
    found.check_value(model)
    numbers = itertools.count()
    has_answered = False
    seen: set[str] = set()

    def report(question: Question) -> None:
        progress(str(question), next(numbers), 2 * total)

    for count, asked in questions.items():
        before = _answers(model, count, asked, found, report, seen)
        after = _answers(copy_of(model), count, asked, Findings(), report)
        has_answered = has_answered or any(one is not None for one in before)
        for question, one, other in zip(asked, before, after, strict=False):  # none: not opened
            if one is not None and repr(one) != repr(other):
                found.add("pure", f"{one}, as before", repr(other), str(question))
    for (position, wanted), count in itertools.product((at_rest or {}).items(), axes):
        still = (0.0,) * (count - 1)
        question = Question((position, *still), (0.0, *still), 1.0)
        for force in _answers(model, count, [question], Findings()):
            expected = (wanted, *still)
            if force is None or not all(map(_is_close, force, expected)):
                found.add("rest", f"{expected} N", repr(force), str(question))
    promises = {name: words for name, words in PROMISES.items() if name != "rest" or at_rest}
    unseen = {"contact", "scene"} - seen
    if not has_answered:
        unseen |= {"answers", "shape", "finite", "pure"}
    return found.report(promises, total, known - total, unseen)


_is_close = functools.partial(math.isclose, rel_tol=1e-9, abs_tol=1e-12)


def _answers(
    model: EnvironmentModel,
    axes: int,
    questions: Sequence[Question],
    found: Findings,
    report: Callable[[Question], None] = lambda question: None,
    seen: set[str] | None = None,
) -> list[Vector | None]:
    """The answers of a new instance; None where there was none; empty if it does not open.

    With ``seen``, contacts and scenes are checked, too, and what the environment has is added.
    """
    answers: list[Vector | None] = []
    with found.noting("opens", "an instance that closes", f"open({axes}), close()"):
        environment = open_environment(model, axes)
        if seen is not None:
            seen |= overridden(environment, Environment)
            _check_scene(environment, f"scene() before the first query, {axes} axes", found)
        for question in questions:
            report(question)
            answers.append(_answer(environment, question, found))
            if seen is not None and answers[-1] is not None:
                _check_contact(environment, question, found)
        if seen is not None:
            _check_scene(environment, f"scene() after the last query, {axes} axes", found)
        environment.close()
    return answers


def _answer(environment: Environment, question: Question, found: Findings) -> Vector | None:
    where = str(question)
    with found.noting("answers", "an answer", where):
        force = environment.force("", question.position, question.velocity, question.elapsed)
        fault = vector_fault(force, len(question.position), "N")
        if fault is not None:
            found.add("shape", fault.expected, fault.got, where)
            return None
        entries = tuple(float(entry) for entry in force)
        if not _is_far(question) and not all(map(math.isfinite, entries)):
            found.add("finite", "finite numbers", repr(entries), where)
        return entries
    return None


def _check_contact(environment: Environment, question: Question, found: Findings) -> None:
    where = f"contact() after {question}"
    axes = len(question.position)
    with found.noting("contact", "a contact, or None", where):
        contact = environment.contact("")
        if contact is None:
            return
        proxy, normal = contact
        for vector, unit in ((proxy, "m"), (normal, "1")):
            fault = vector_fault(vector, axes, unit)
            if fault is not None:
                found.add("contact", fault.expected, fault.got, where)
                return
        if _is_far(question):
            return
        if not all(map(math.isfinite, (*proxy, *normal))):
            found.add("contact", "finite numbers", repr(contact), where)
        # Of fewer axes than three, it is the part of a unit normal along them.
        elif not is_unit(normal) and not (axes < 3 and math.hypot(*normal) <= 1.0):
            found.add("contact", "a normal of length 1", repr(normal), where)


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


def _is_far(question: Question) -> bool:
    largest = max(map(abs, (*question.position, *question.velocity)))
    return largest > FAR or question.elapsed > LONG


def _questions(
    model: EnvironmentModel, axes: int, random: Random, rounds: int
) -> Iterator[Question]:
    """Random ones at several scales, dense where a parameter says that something begins."""
    still, elapsed = (0.0,) * axes, 1.0
    edges = [0.0, *_edges(model)]
    extreme = (0.0, 1e-300, -1e-300, FAR, -FAR, 1e100, -1e100, FARTHEST, -FARTHEST)
    for one in (*edges, *extreme):
        along = (one,) + (0.0,) * (axes - 1)
        yield Question(along, still, 0.0)
        yield Question((one,) * axes, still, elapsed)
        yield Question(along, (one,) * axes, elapsed)
        yield Question(still, along, LONG)
    for reach, speed, _ in itertools.product((0.02, 1.0, FAR), (0.0, 0.5, FAR), range(rounds // 9)):
        position = tuple(random.uniform(-reach, reach) for _ in range(axes))
        velocity = tuple(random.uniform(-speed, speed) for _ in range(axes))
        yield Question(position, velocity, random.choice((0.0, random.uniform(0, 100.0), LONG)))
    for edge, _ in itertools.product(edges, range(rounds // 9)):
        position = tuple(edge + random.gauss(0.0, 1e-5) for _ in range(axes))
        velocity = tuple(random.gauss(0.0, 0.2) for _ in range(axes))
        yield Question(position, velocity, random.uniform(0, 10.0))


def _objects(model: EnvironmentModel, axes: int) -> tuple[SceneObject, ...]:
    """What a world shows before it is touched; nothing if it has no sound scene."""
    try:
        environment = open_environment(model, axes)
        try:
            objects = tuple(environment.scene() or ())
        finally:
            environment.close()
        decode(encode(Scene(0, 0, objects[:MAX_LENGTH])), Scene)
    except Exception:  # the promises say why
        return ()
    return objects


def _some(
    questions: Sequence[Question], random: Random, at_most: int | None, numbers_of_axes: int
) -> Sequence[Question]:
    if at_most is None:
        return questions
    wanted = min(len(questions), max(FEWEST, at_most // numbers_of_axes))
    return [questions[place] for place in sorted(random.sample(range(len(questions)), wanted))]


def _edges(model: EnvironmentModel) -> list[float]:
    """Parameters that may be positions, and the floats beside them."""
    if not dataclasses.is_dataclass(model):
        return []
    values = [getattr(model, field.name) for field in dataclasses.fields(model)]
    lengths = [float(v) for v in values if isinstance(v, int | float) and abs(v) <= 1.0]
    beside = [(math.nextafter(v, -math.inf), v, math.nextafter(v, math.inf)) for v in lengths]
    return [edge for triple in beside for edge in triple]
