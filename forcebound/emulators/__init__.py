"""Emulators: boards of real devices, as programs on a pseudo-terminal.

A :class:`forcebound.emulators.board.Board` is the firmware, byte by byte, without a clock or a
port. It turns the motors of a :class:`forcebound.emulators.mechanism.Mechanism`, a simulated device
in a simulated hand; :class:`forcebound.emulators.emulation.Emulation` lets both go on in time.
:mod:`forcebound.emulators.pty` gives that a port and the real time, ``forcebound emulate`` a
terminal.

To add one: write ``my_board.py``, ``my_device.py`` with a function ``assemble``, and a line in
``EMULATORS``.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

__all__ = ["EMULATORS", "assembler"]

#: ``"module:assemble"`` of each kind of device that can be emulated; the function takes plain
#: values of the mechanism and the operator (or None), and returns an ``Emulated``.
EMULATORS = {
    "haply_2diy": "forcebound.emulators.haply_2diy:assemble",
    "odrive": "forcebound.emulators.odrive:assemble",
}


def assembler(kind: str) -> Callable[[Mapping[str, Any], Any], Any]:
    """Return the function that makes board and mechanism of a kind, a key of ``EMULATORS``."""
    module, _, name = EMULATORS[kind].partition(":")
    found: Callable[[Mapping[str, Any], Any], Any] = getattr(import_module(module), name)
    return found
