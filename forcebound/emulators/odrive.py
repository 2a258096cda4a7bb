"""The emulated ODrive: its board on simulated knobs."""

from collections.abc import Mapping
from typing import Any

from forcebound.devices.knob import Knob
from forcebound.emulators.emulation import Emulated
from forcebound.emulators.mechanism import Mechanism
from forcebound.emulators.odrive_board import ODriveBoard
from forcebound.emulators.values import restored
from forcebound.operators import Operator


def assemble(values: Mapping[str, Any], operator: Operator | None) -> Emulated:
    """Return board and mechanism; see :data:`forcebound.emulators.EMULATORS`.

    Args:
        values: Parameters of a ``Knob``; others are passed over.
        operator: The hand; None: nobody holds it. It begins at 0 m, where the encoders count from.
    """
    model = restored(Knob, values)
    return Emulated(ODriveBoard(model.joints), Mechanism(model, operator, (0.0,) * model.joints))
