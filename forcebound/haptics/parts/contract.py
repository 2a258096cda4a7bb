"""Broken promises as data, and the checks that the contracts of all rooms share.

A contract is a table of promises and a function ``check`` that asks a part, at random and at its
limits, and returns a :class:`Report`. ``forcebound check`` runs it on a user's file, the
repository's tests on every part that ships.
"""

import dataclasses
import math
import numbers
import pickle
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from forcebound.haptics.parts.signals import SignalError
from forcebound.haptics.parts.user_module import describe_user_error

SIGNALS = {"signals": "publishes numbers, under the names that `signals` of its model declares"}
VALUE = {"value": "is a frozen dataclass that can be copied, changed and pickled"}
SHOWN = 3  # violations of one promise in a report; the others are alike


@dataclass(frozen=True)
class Violation:
    """One promise that was broken."""

    promise: str
    expected: str
    got: str
    where: str  # the question, or what else was done

    def lines(self) -> list[str]:
        """Return it as lines of text."""
        return [self.where, f"  expected {self.expected}", f"  got      {self.got}"]


@dataclass(frozen=True)
class Report:
    """Findings of a check."""

    promises: Mapping[str, str]  # in words, by name; only those that were looked at
    violations: tuple[Violation, ...]  # at most ``SHOWN`` of each promise
    questions: int  # how many were asked
    left_out: int = 0  # how many were not, to be done in time

    @property
    def held(self) -> dict[str, bool]:
        """Outcome of each promise by its name: True if it was kept."""
        broken = {violation.promise for violation in self.violations}
        return {promise: promise not in broken for promise in self.promises}


def vector_fault(answer: Any, axes: int, unit: str) -> tuple[str, str] | None:
    """Return what a vector in ``unit`` should be, and what came; None if its form is right."""
    entries = answer.tolist() if hasattr(answer, "tolist") else answer  # of an array
    expected = f"a tuple with {axes} number{'s' * (axes > 1)} in {unit}, one per axis"
    if isinstance(entries, str | bytes) or not isinstance(entries, Sequence):
        return expected, shown(answer)
    if len(entries) != axes:
        return expected, f"{len(entries)} entries: {shown(answer)}"
    for entry in entries:
        if isinstance(entry, bool) or not isinstance(entry, numbers.Real):
            return expected, f"an entry {shown(entry)}"
    return None


class Findings:
    """Broken promises that a check has found until now."""

    def __init__(self) -> None:
        self._found: dict[str, list[Violation]] = {}

    def add(self, promise: str, expected: str, got: str, where: str) -> None:
        """Note a broken promise, up to ``SHOWN`` times."""
        found = self._found.setdefault(promise, [])
        violation = Violation(promise, expected, got, where)
        if len(found) < SHOWN and violation not in found:
            found.append(violation)

    @contextmanager
    def noting(self, promise: str, expected: str, where: str) -> Iterator[None]:
        """Note what is raised within as a broken promise."""
        try:
            yield
        except (Exception, SystemExit) as error:
            promise = "signals" if isinstance(error, SignalError) else promise
            self.add(promise, expected, describe_user_error(error, anywhere=True), where)

    def check_value(self, model: Any) -> None:
        """Check that a model is a frozen dataclass that can be copied and pickled."""
        if not is_frozen(type(model)):
            kind = type(model).__name__
            self.add("value", "@dataclass(frozen=True)", f"class {kind} without it", kind)
            return
        copies: dict[str, Callable[[], Any]] = {
            "dataclasses.replace": lambda: dataclasses.replace(model),
            "pickle": lambda: pickle.loads(pickle.dumps(model)),
        }
        for what, make in copies.items():
            with self.noting("value", "an equal object", what):
                made = make()
                if made != model:
                    self.add("value", f"an equal object, {model!r}", repr(made), what)

    def check_number(self, promise: str, model: Any, name: str, unit: str) -> None:
        """Check an attribute: finite, and at least 0."""
        value = getattr(model, name)
        if not isinstance(value, int | float) or not 0.0 <= value < math.inf:
            self.add(promise, f">= 0 {unit}, finite", repr(value), name)

    def check_vector(
        self, answer: Any, axes: int, unit: str, where: str, finite: str = "finite"
    ) -> bool:
        """Return whether a vector has its form (promise "shape"); check that it is finite."""
        fault = vector_fault(answer, axes, unit)
        if fault is not None:
            self.add("shape", *fault, where)
        elif not all(map(math.isfinite, answer)):
            self.add(finite, "finite numbers", repr(answer), where)
        return fault is None

    def check_repeats(self, one: Sequence[Any], other: Sequence[Any], where: str) -> None:
        """Check that the answers of two runs are the same (promise "pure")."""
        for place, (before, after) in enumerate(zip(one, other, strict=True)):
            if before != after:
                self.add("pure", f"{before}, as before", str(after), f"{where}, answer {place}")
                return

    def is_broken(self, promise: str) -> bool:
        """Return whether a promise was broken until now."""
        return promise in self._found

    def report(
        self,
        promises: Mapping[str, str],
        questions: int,
        left_out: int = 0,
        unseen: Collection[str] = (),
    ) -> Report:
        """Return what was found; no promise in ``unseen`` is called kept."""
        violations = tuple(one for found in self._found.values() for one in found)
        named = {
            name: words
            for name, words in promises.items()
            if name not in unseen or self.is_broken(name)
        }
        return Report(named, violations, questions, left_out)


def is_frozen(kind: type) -> bool:
    """Return whether a class is a frozen dataclass itself, whatever it inherits."""
    parameters = vars(kind).get("__dataclass_params__")
    return parameters is not None and parameters.frozen


def is_unit(numbers: Sequence[float]) -> bool:
    """Return whether numbers are a vector, or quaternion, of length 1, to rounding."""
    return abs(math.hypot(*numbers) - 1.0) <= 1e-6


def copy_of(model: Any) -> Any:
    """Return a copy of a model; the model itself if it cannot be copied."""
    try:
        return dataclasses.replace(model)
    except Exception:
        return model


def shown(value: object) -> str:
    """Return a value and its type, shortened."""
    text = f"{value!r} of type {type(value).__name__}" if value is not None else "None"
    return text if len(text) <= 120 else text[:117] + "..."
