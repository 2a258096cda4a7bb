"""Broken promises as data, and the checks that the contracts of all rooms share.

A contract is a table of promises and a function ``check`` that asks a part, at random and at its
limits, and returns a :class:`Report`. ``forcebound check`` runs it on a user's file, the
repository's own tests on every part that ships.
"""

import dataclasses
import numbers
import pickle
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

SHOWN = 3  # violations of one promise in a report; the others are alike


@dataclass(frozen=True)
class Fault:
    """What is wrong with an answer."""

    expected: str
    got: str

    def __str__(self) -> str:
        return f"expected {self.expected}; got {self.got}"


@dataclass(frozen=True)
class Violation:
    """One promise that was broken."""

    promise: str
    expected: str
    got: str
    where: str  # the question, or what else was done


@dataclass(frozen=True)
class Report:
    """What a check found.

    Attributes:
        promises: In words, by name; only those that were looked at.
        violations: At most ``SHOWN`` of each promise.
        questions: How many were asked.
        left_out: How many were not, to be done in time.
    """

    promises: Mapping[str, str]
    violations: tuple[Violation, ...]
    questions: int
    left_out: int = 0

    @property
    def held(self) -> dict[str, bool]:
        """Whether each promise was kept."""
        broken = {violation.promise for violation in self.violations}
        return {promise: promise not in broken for promise in self.promises}


def first_of_each(found: Iterable[Violation]) -> tuple[Violation, ...]:
    """Return at most ``SHOWN`` violations of each promise."""
    counts: dict[str, int] = {}
    kept = []
    for violation in found:
        counts[violation.promise] = counts.get(violation.promise, 0) + 1
        if counts[violation.promise] <= SHOWN:
            kept.append(violation)
    return tuple(kept)


def vector_fault(answer: object, axes: int, unit: str) -> Fault | None:
    """Return what is wrong with the form of a vector; None if nothing.

    Args:
        answer: Of a user's code.
        axes: How many entries it must have.
        unit: Of the entries.
    """
    tolist = getattr(answer, "tolist", None)  # of an array
    entries: object = answer if tolist is None else tolist()
    expected = f"a tuple with {axes} number{'s' * (axes > 1)} in {unit}, one per axis"
    if isinstance(entries, str | bytes) or not isinstance(entries, Sequence):
        return Fault(expected, shown(answer))
    if len(entries) != axes:
        return Fault(expected, f"{len(entries)} entries: {shown(answer)}")
    for entry in entries:
        if isinstance(entry, bool) or not isinstance(entry, numbers.Real):
            return Fault(expected, f"an entry {shown(entry)}")
    return None


def value_faults(model: Any) -> Iterator[Violation]:
    """Find what keeps a model from being a value: a frozen dataclass, copied and pickled."""
    parameters = getattr(model, "__dataclass_params__", None)
    if parameters is None or not parameters.frozen:
        kind = type(model).__name__
        yield Violation("value", "@dataclass(frozen=True)", f"class {kind} without it", kind)
        return
    done: dict[str, Callable[[], Any]] = {
        "dataclasses.replace": lambda: dataclasses.replace(model),
        "pickle": lambda: pickle.loads(pickle.dumps(model)),
    }
    for what, make in done.items():
        try:
            made = make()
        except Exception as error:
            yield Violation("value", "an equal object", describe_raised(error), what)
            continue
        if made != model:
            yield Violation("value", f"an equal object, {model!r}", repr(made), what)


def copy_of(model: Any) -> Any:
    """Return a copy of a model; the model itself if it is no value (:func:`value_faults`)."""
    try:
        return dataclasses.replace(model)
    except Exception:
        return model


def describe_raised(error: BaseException) -> str:
    """Return what was raised, and the innermost line."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} (raised in {last.filename}:{last.lineno})"


def shown(value: object) -> str:
    """Return a value and its type, shortened."""
    text = f"{value!r} of type {type(value).__name__}" if value is not None else "None"
    return text if len(text) <= 120 else text[:117] + "..."
