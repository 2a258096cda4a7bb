"""Emulators: boards of real devices, as programs on a pseudo-terminal, and a service.

A :class:`forcebound.hardware.emulators.emulation.Board` is the firmware, byte by byte, without a
clock or a port. It turns the motors of a
:class:`forcebound.hardware.emulators.mechanism.Mechanism`, a simulated device in a simulated hand;
:class:`forcebound.hardware.emulators.emulation.Emulation` lets both go on in time.
:mod:`forcebound.hardware.emulators.pty` gives that a port and the real time, ``forcebound emulate``
a terminal. :mod:`forcebound.hardware.emulators.service` does so for the service of an Inverse3.

To add a board: write ``my_board.py``, and a function in
:mod:`forcebound.hardware.emulators.program`.
"""
