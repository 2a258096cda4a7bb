"""The kinds of emulators: board and mechanism of each, made of plain JSON."""

import math
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import msgspec

from forcebound.errors import ConfigError
from forcebound.graph.fields import fields_of
from forcebound.haptics.devices.five_bar import FiveBar
from forcebound.haptics.devices.knob import Knob
from forcebound.haptics.devices.true_values import true_axes
from forcebound.haptics.hands import OPERATORS, Operator
from forcebound.hardware.emulators.emulation import Emulated
from forcebound.hardware.emulators.haply_board import HaplyBoard
from forcebound.hardware.emulators.mechanism import Mechanism
from forcebound.hardware.emulators.odrive_board import ODriveBoard

#: Angles of the motors in which a Haply is held while the board is set up, in rad.
HOME = (math.radians(12.0), math.radians(168.0))

Model = TypeVar("Model")


def haply_2diy(values: Mapping[str, Any], operator: Operator | None) -> Emulated:
    """Return a Haply board on a simulated five-bar.

    The values are those of a ``FiveBar``, ``home`` (rad) and the ``senses`` of the ports.
    """
    model = restored(FiveBar, values)
    home = model.kinematics().position(tuple(values.get("home", HOME)))
    board = HaplyBoard(true_axes(model, "resolution"), values.get("senses", (1, 1)))
    return Emulated(board, Mechanism(model, operator, home))


def odrive(values: Mapping[str, Any], operator: Operator | None) -> Emulated:
    """Return an ODrive on simulated knobs; the hand begins at 0 m, where the encoders count from.

    The values are those of a ``Knob``.
    """
    model = restored(Knob, values)
    return Emulated(ODriveBoard(model.joints), Mechanism(model, operator, (0.0,) * model.joints))


#: By the kind of device that is emulated: the function that makes board and mechanism of plain
#: values, of which those that it does not know are passed over, and a hand, or None.
EMULATORS: Mapping[str, Callable[[Mapping[str, Any], Operator | None], Emulated]] = {
    "haply_2diy": haply_2diy,
    "odrive": odrive,
}


def restored(kind: Callable[..., Model], values: Mapping[str, Any]) -> Model:
    """Return a model, a dataclass, with those of the values that it knows, and its defaults."""
    assert isinstance(kind, type)
    try:
        given = {
            name: msgspec.convert(values[name], field.hint, dec_hook=_made)
            for name, field in fields_of(kind).items()
            if name in values
        }
    except msgspec.ValidationError as error:
        raise ConfigError(f"the emulator's {kind.__name__}: {error}") from error
    model: Model = kind(**given)
    return model


def restored_operator(values: Mapping[str, Any] | None) -> Operator | None:
    """Return the operator of a document with its kind and parameters; None without one."""
    return None if values is None else restored(OPERATORS[values["kind"]], values)


def _made(kind: type, value: Any) -> Any:  # a path is the only type here that JSON does not have
    return kind(value)
