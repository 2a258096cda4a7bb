"""Buttons of the handle, and the hand that presses them."""

from dataclasses import dataclass
from typing import Annotated

from forcebound.errors import ConfigError
from forcebound.operators import Operator
from forcebound.quantities import NOT_NEGATIVE, Range, Time, check_ranges

MOST_BUTTONS = 8


@dataclass(frozen=True, kw_only=True)
class Press:
    """One press of a button.

    Attributes:
        button: Its number, from 0.
        start: When it goes down, since the force engaged.
        end: When it comes up.
    """

    button: Annotated[int, Range(at_least=0, below=MOST_BUTTONS)] = 0
    start: Annotated[Time, NOT_NEGATIVE]
    end: Annotated[Time, NOT_NEGATIVE]

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.end <= self.start:
            message = f"end must be after start, {self.start:g} s, got {self.end:g} s"
            raise ConfigError(message, field="end")


@dataclass(frozen=True, kw_only=True)
class PressingButtons(Operator):
    """Part of a hand that presses buttons.

    Attributes:
        presses: Of the buttons, each with a start and an end; a device has buttons if there are
            any.
    """

    presses: tuple[Press, ...] = ()

    def buttons(self, elapsed: float) -> int | None:
        """Return which buttons are down; see :class:`forcebound.operators.Operator`."""
        if not self.presses:
            return None
        down = 0
        for press in self.presses:
            if press.start <= elapsed < press.end:
                down |= 1 << press.button
        return down
