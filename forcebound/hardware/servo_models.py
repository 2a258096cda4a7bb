"""Numbers of the servos at a bus, from data sheets; nobody has measured them here.

Sources: the maker's e-manual and lerobot, ``motors/dynamixel/tables.py``; of Feetech, data sheets
and ``motors/feetech/tables.py``. A stall torque over its current is a torque constant with the
gear's loss in it; projects that use these servos state constants up to three times apart.
"""

from typing import NamedTuple

COUNTS = 4096  # of a turn


class DynamixelModel(NamedTuple):
    """A Dynamixel of the X series: stall values, its current unit in A.

    Attributes:
        number: What it answers to a ping.
        current_limit: Largest value of register 38, in current units.
        stall: Torque, in N m, and current, in A; zero: it has no current mode.
        has_watchdog: In every firmware; others from 38 on.
    """

    number: int
    current_unit: float
    current_limit: int
    stall: tuple[float, float]
    has_watchdog: bool = False

    @property
    def torque_constant(self) -> float:
        """Of the joint, in N m/A: assumed."""
        torque, current = self.stall
        return torque / current


NO_CURRENT = (0.0, 1.0)
DYNAMIXELS = {
    "xl330-m077": DynamixelModel(1190, 1.0e-3, 1750, (0.215, 1.47), has_watchdog=True),
    "xl330-m288": DynamixelModel(1200, 1.0e-3, 1750, (0.52, 1.47), has_watchdog=True),
    "xc330-m288": DynamixelModel(1240, 1.0e-3, 1800, (0.93, 1.80)),
    "xc330-t288": DynamixelModel(1220, 1.0e-3, 910, (0.92, 0.80)),
    "xm430-w210": DynamixelModel(1030, 2.69e-3, 1193, (3.0, 2.3)),
    "xm430-w350": DynamixelModel(1020, 2.69e-3, 1193, (4.1, 2.3)),
    "xm540-w270": DynamixelModel(1120, 2.69e-3, 2047, (10.6, 4.4)),
    "xl430-w250": DynamixelModel(1060, 0.0, 0, NO_CURRENT),
    "xc430-w150": DynamixelModel(1070, 0.0, 0, NO_CURRENT),
}


class FeetechModel(NamedTuple):
    """A Feetech STS or HLS at its stated voltage.

    Attributes:
        number: Its register 3; None: unknown.
        voltage: At which the others hold, in V.
        stall_torque: With full duty, in N m.
        free_speed: Without load, in rad/s; for the emulator's back-EMF.
        has_duty: A duty cycle can be written: mode 2 of the STS.
    """

    number: int | None
    voltage: float
    stall_torque: float
    free_speed: float
    has_duty: bool = True


FEETECHS = {
    "sts3215": FeetechModel(777, 7.4, 1.91, 4.7),
    "sts3250": FeetechModel(2825, 12.0, 4.9, 7.8),
    "hls3625": FeetechModel(None, 12.0, 2.9, 5.0, has_duty=False),
}
DUTY = 1000  # of register 44, with the full supply
FEETECH_CURRENT = 6.5e-3  # A, unit of register 69
FEETECH_VOLT = 0.1  # V, unit of register 62
