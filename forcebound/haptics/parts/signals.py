"""Signals: named numbers and events that a part publishes beside its forces.

The model declares the numbers in its class, ``signals = (Signal("damage", "1", "damage of the
skin"),)``, or by a method ``declared``; the open part sets them with :meth:`Publisher.signal`. The
packets of its node carry them (:mod:`forcebound.nodes.publishing`), recordings, plots and pages
show them.
"""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from typing import Any, ClassVar

from forcebound.errors import ConfigError
from forcebound.files import printable
from forcebound.messages.packets import MAX_SIGNALS, SIGNAL_NAME

MAX_LABEL = 60  # characters


@dataclass(frozen=True)
class Signal:
    """A number that a part publishes.

    Attributes:
        name: A letter, then letters, digits and ``_``; at most 32.
        unit: SI, such as "N" or "m/s"; "1" or empty: it has none.
        label: What it is, for people; empty: its name.

    Raises:
        ConfigError: If the name is no such name, or a text cannot be printed on one line.
    """

    name: str
    unit: str = ""
    label: str = ""

    def __post_init__(self) -> None:
        if not re.fullmatch(SIGNAL_NAME, self.name):
            expected = "a letter, then letters, digits and _, at most 32"
            raise ConfigError(f"name of a signal: expected {expected}, got {self.name!r}")
        for text in (self.unit, self.label):
            if text != printable(text, MAX_LABEL):
                expected = f"unit and label of at most {MAX_LABEL} printable characters"
                raise ConfigError(f"signal {self.name}: expected {expected}, got {text!r}")


class Publishing:
    """A model whose open part publishes signals.

    Attributes:
        signals: The numbers; their names differ.
    """

    signals: ClassVar[Collection[Signal]] = ()

    def declared(self) -> Collection[Signal]:
        """Return the numbers of this model: ``signals``, unless they depend on its parameters."""
        return self.signals

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        names = [each.name for each in cls.signals if isinstance(each, Signal)]
        if not len(set(names)) == len(cls.signals) <= MAX_SIGNALS:
            expected = f"at most {MAX_SIGNALS} Signal objects with different names"
            twice = ", ".join(sorted({name for name in names if names.count(name) > 1}))
            got = f"two named {twice}" if twice else f"{len(cls.signals)} entries"
            raise ConfigError(f"class {cls.__name__}: signals: expected {expected}, got {got}")


class SignalError(ConfigError):
    """A part has published a number that its model does not declare, or what is no number."""


class PublishedSignals:
    """Numbers and events that an open part has published."""

    def __init__(self) -> None:
        self.numbers: dict[str, float] = {}  # that hold now, all finite
        self.events: list[tuple[str, str, bool]] = []  # not sent yet: kind, message, is it a fault
        self._names: frozenset[str] | None = None  # of the numbers that it takes; None: any

    def declare(self, signals: Collection[Signal]) -> None:
        """Take no other numbers than these; SignalError if there is another one already."""
        self._names = frozenset(signal.name for signal in signals)
        for name, value in self.numbers.items():
            self.take(name, value)

    def take(self, name: str, value: float) -> None:
        """Take a number; SignalError if it is not declared, or no number."""
        if self._names is not None and name not in self._names:
            known = ", ".join(sorted(self._names)) or "none"
            raise SignalError(f"expected a signal that `signals` declares ({known}), got {name!r}")
        try:
            is_finite = isfinite(value)
        except Exception:  # of any kind, by a value of any type
            raise SignalError(f"signal {name!r}: expected a number, got {value!r}") from None
        if is_finite:
            self.numbers[name] = float(value)
        else:
            self.numbers.pop(name, None)


class Publisher:
    """An open part that may publish signals."""

    @cached_property
    def published(self) -> PublishedSignals:
        """The signals that the node sends. A wrapper shares those of the part inside."""
        return PublishedSignals()

    def signal(self, name: str, value: float) -> None:
        """Publish a number that the model declares; it holds until the next one, NaN ends it.

        SignalError if it is not declared, or no number.
        """
        self.published.take(name, value)

    def signal_all(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Publish many finite numbers that the model declares, without a check of each."""
        self.published.numbers.update(zip(names, values, strict=True))

    def event(self, event: str, message: str = "", *, is_fault: bool = False) -> None:
        """Publish an event of the run: its kind, in a word or two, and a message for people."""
        self.published.events.append((event, message, is_fault))
