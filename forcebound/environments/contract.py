"""What every environment promises, and a check of it for one's own.

The check asks an environment some thousand times, at random and at its limits, and tells each
broken promise with the question that broke it. ``forcebound check environment`` runs it on a user's
file, the repository's own tests on every member of ``ENVIRONMENTS``.
"""

import dataclasses
import itertools
import math
import numbers
import pickle
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from random import Random
from typing import Any

from forcebound.environments import Environment
from forcebound.messages.packets import MAX_AXES, Vector

FAR = 1e6  # m, m/s: within it a force must be finite
LONG = 1e6  # s
FARTHEST = 1e300  # m, m/s: until here nothing may be raised
FEWEST = 4  # questions for each number of axes, however long an answer takes
SHOWN = 3  # violations of one promise that are told; the others are alike

PROMISES: dict[str, str] = {
    "answers": f"gives an answer at every position and velocity, however far (to {FARTHEST:g} m)",
    "shape": f"gives a tuple with one number per axis, for 1 to {MAX_AXES} axes",
    "finite": f"a force is finite within {FAR:g} m, {FAR:g} m/s and {LONG:g} s",
    "pure": "the same question has the same answer, whatever was asked before",
    "value": "is a frozen dataclass that can be copied, changed and pickled",
    "rest": "shows at rest the force that was stated",
}


@dataclass(frozen=True)
class Question:
    """What an environment is asked once."""

    position: Vector  # m
    velocity: Vector  # m/s
    elapsed: float  # s

    def __str__(self) -> str:
        return f"force({self.position}, {self.velocity}, {self.elapsed})"


@dataclass(frozen=True)
class Violation:
    """One promise that was broken."""

    promise: str  # one of PROMISES
    expected: str
    got: str
    where: str  # the question, or what else was done


@dataclass(frozen=True)
class Report:
    """What a check found.

    Attributes:
        questions: How many were asked.
        left_out: How many were not, to be done in time.
        promises: Names of those that were looked at: "rest" only if a force was stated.
        violations: At most ``SHOWN`` of each promise.
    """

    questions: int
    left_out: int
    promises: tuple[str, ...]
    violations: tuple[Violation, ...]

    @property
    def held(self) -> dict[str, bool]:
        """Whether each promise was kept."""
        broken = {violation.promise for violation in self.violations}
        return {promise: promise not in broken for promise in self.promises}


def check(
    environment: Environment,
    axes: Iterable[int] = range(1, MAX_AXES + 1),
    at_rest: Mapping[float, float] | None = None,
    seed: int = 1,
    rounds: int = 100,
    at_most: int | None = None,
    tell: Callable[[str, int, int], None] = lambda question, done, total: None,
) -> Report:
    """Return which of the ``PROMISES`` an environment keeps.

    Args:
        environment: With the parameters that matter: others may behave otherwise.
        axes: Numbers of axes that it is asked with.
        at_rest: Position on the first axis, in m, and the force there, in N, that is expected at
            rest: ``{0.0: 0.0}`` for a wall that leaves free what is before it.
        seed: Of the random questions; the same seed asks the same.
        rounds: Random questions for each number of axes and each scale.
        at_most: About how many questions to ask, each three times: some of all, drawn at random;
            at least ``FEWEST`` for each number of axes. None: all.
        tell: Called before each answer with the question, the answers until now and all.
    """
    axes = tuple(dict.fromkeys(axes))
    known = {
        count: list(_questions(environment, count, Random(seed * 100 + count), rounds))
        for count in axes
    }
    questions = [
        question
        for count in axes
        for question in _some(known[count], Random(seed * 100 + count), at_most, len(axes))
    ]
    given = itertools.count()

    def ask(environment: Environment, question: Question) -> tuple[Vector, Violation | None]:
        tell(str(question), next(given), 3 * len(questions))
        return _answer(environment, question)

    found: list[Violation] = list(_value_faults(environment))
    twin = _copy(environment)
    earlier: list[tuple[Question, str]] = []
    for question in questions:
        force, violation = ask(environment, question)
        if violation is None:
            violation = _finite_fault(force, question)
            earlier.append((question, repr(force)))
        if violation is not None:
            found.append(violation)
    for other in (environment, twin):  # in another order: what it was asked before must not matter
        for question, answer in reversed(earlier):
            force, violation = ask(other, question)
            if violation is None and repr(force) == answer:
                continue
            got = repr(force) if violation is None else violation.got
            found.append(Violation("pure", f"{answer}, as before", got, str(question)))
    for position, wanted in (at_rest or {}).items():
        found.extend(_rest_faults(environment, axes, position, wanted))
    promises = tuple(name for name in PROMISES if name != "rest" or at_rest)
    left_out = sum(map(len, known.values())) - len(questions)
    return Report(len(questions), left_out, promises, tuple(_first_of_each(found)))


def force_fault(force: object, axes: int) -> str | None:
    """Return what is wrong with the form of an answer, as "expected ..., got ..."; None if nothing.

    Args:
        force: What an environment answered.
        axes: How many entries it must have.
    """
    entries = force.tolist() if hasattr(force, "tolist") else force
    expected = f"expected a tuple with {axes} number{'s' * (axes > 1)} in N, one per axis"
    if isinstance(entries, str | bytes) or not isinstance(entries, Sequence):
        return f"{expected}; got {_shown(force)}"
    if len(entries) != axes:
        return f"{expected}; got {len(entries)} entries: {_shown(force)}"
    for entry in entries:
        if isinstance(entry, bool) or not isinstance(entry, numbers.Real):
            return f"{expected}; got an entry {_shown(entry)}"
    return None


def _questions(
    environment: Environment, axes: int, random: Random, rounds: int
) -> Iterator[Question]:
    """Random ones at several scales, dense where a parameter says that something begins."""
    still, elapsed = (0.0,) * axes, 1.0
    edges = [0.0, *_edges(environment)]
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


def _some(
    questions: Sequence[Question], random: Random, at_most: int | None, numbers_of_axes: int
) -> Sequence[Question]:
    if at_most is None:
        return questions
    wanted = min(len(questions), max(FEWEST, at_most // numbers_of_axes))
    return [questions[place] for place in sorted(random.sample(range(len(questions)), wanted))]


def _edges(environment: Environment) -> list[float]:
    """Parameters that may be positions, and the floats beside them."""
    if not dataclasses.is_dataclass(environment):
        return []
    values = [getattr(environment, field.name, None) for field in dataclasses.fields(environment)]
    lengths = [float(v) for v in values if isinstance(v, int | float) and abs(v) <= 1.0]
    beside = [(math.nextafter(v, -math.inf), v, math.nextafter(v, math.inf)) for v in lengths]
    return [edge for triple in beside for edge in triple]


def _answer(environment: Environment, question: Question) -> tuple[Vector, Violation | None]:
    """The answer as floats; empty, with the broken promise, if there is none."""
    axes = len(question.position)
    try:
        force = environment.force(question.position, question.velocity, question.elapsed)
        fault = force_fault(force, axes)
        if fault is None:
            return tuple(float(entry) for entry in force), None
    except (Exception, SystemExit) as error:
        return (), Violation("answers", "an answer", _raised(error), str(question))
    expected, _, got = fault.partition("; got ")
    return (), Violation("shape", expected.removeprefix("expected "), got, str(question))


def _finite_fault(force: Vector, question: Question) -> Violation | None:
    near = all(abs(x) <= FAR for x in (*question.position, *question.velocity))
    if not near or question.elapsed > LONG or all(math.isfinite(entry) for entry in force):
        return None
    return Violation("finite", "finite numbers", repr(force), str(question))


def _rest_faults(
    environment: Environment, axes: Iterable[int], position: float, wanted: float
) -> Iterator[Violation]:
    for count in axes:
        still = (0.0,) * count
        question = Question((position, *still[1:]), still, 1.0)
        force, violation = _answer(environment, question)
        expected = (wanted, *still[1:])
        if violation is not None or any(
            not math.isclose(f, e, rel_tol=1e-9, abs_tol=1e-12)
            for f, e in zip(force, expected, strict=True)
        ):
            got = repr(force) if violation is None else violation.got
            yield Violation("rest", f"{expected} N", got, str(question))


def _value_faults(environment: Any) -> Iterator[Violation]:
    parameters = getattr(environment, "__dataclass_params__", None)
    if parameters is None or not parameters.frozen:
        kind = type(environment).__name__
        yield Violation("value", "@dataclass(frozen=True)", f"class {kind} without it", kind)
        return
    done: dict[str, Callable[[], Any]] = {
        "dataclasses.replace": lambda: _copy(environment),
        "pickle": lambda: pickle.loads(pickle.dumps(environment)),
    }
    for what, make in done.items():
        try:
            made = make()
        except Exception as error:
            yield Violation("value", "an equal object", _raised(error), what)
            continue
        if made != environment:
            yield Violation("value", f"an equal object, {environment!r}", repr(made), what)


def _copy(environment: Any) -> Any:
    try:
        return dataclasses.replace(environment)
    except Exception:  # told by _value_faults
        return environment


def _first_of_each(found: Iterable[Violation]) -> Iterator[Violation]:
    told = dict.fromkeys(PROMISES, 0)
    for violation in found:
        told[violation.promise] += 1
        if told[violation.promise] <= SHOWN:
            yield violation


def _raised(error: BaseException) -> str:
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} (raised in {last.filename}:{last.lineno})"


def _shown(value: object) -> str:
    text = f"{value!r} of type {type(value).__name__}" if value is not None else "None"
    return text if len(text) <= 120 else text[:117] + "..."
