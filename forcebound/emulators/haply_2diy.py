"""The emulated Haply 2DIY: its board on a simulated five-bar."""

import math
from collections.abc import Mapping
from typing import Any

from forcebound.devices.five_bar import FiveBar
from forcebound.devices.true_values import true_axes
from forcebound.emulators.emulation import Emulated
from forcebound.emulators.haply_board import HaplyBoard
from forcebound.emulators.mechanism import Mechanism
from forcebound.emulators.values import restored
from forcebound.operators import Operator

#: Angles of the motors at ports 1 and 2 in which the arm is held while the board is set up, in rad.
HOME = (math.radians(12.0), math.radians(168.0))
SENSES = (1, 1)


def assemble(values: Mapping[str, Any], operator: Operator | None) -> Emulated:
    """Return board and mechanism; see :data:`forcebound.emulators.EMULATORS`.

    Args:
        values: Parameters of a ``FiveBar``, ``home`` in rad and the ``senses`` of the ports (see
            :class:`HaplyBoard`); others are passed over.
        operator: The hand; None: nobody holds it.
    """
    model = restored(FiveBar, values)
    kinematics = model.kinematics()
    home = tuple(values.get("home", HOME))
    mechanism = Mechanism(model, operator, kinematics.position(home))
    board = HaplyBoard(true_axes(model, "resolution"), values.get("senses", SENSES))
    return Emulated(board, mechanism)
