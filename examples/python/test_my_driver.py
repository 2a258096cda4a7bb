"""Tests of the messages of my driver, without board and port: `pytest` in this folder runs them.

docs/write-your-own-device.md explains more.
"""

import pytest
from my_driver import Motor, OpenMotor

from forcebound.errors import DeviceError
from forcebound.testing import scripted

ZERO = bytes.fromhex("54 00 00 00 00 38 8d")  # no torque
PUSH = bytes.fromhex("54 cd cc 4c bd 5b 6a")  # a torque of -0.05 N m
REPLY = bytes.fromhex("41 00 00 80 3e 30 66")  # an angle of 0.25 rad
NO_NUMBER = bytes.fromhex("41 00 00 c0 7f 19 33")


def test_a_force_at_the_hand_is_the_opposite_torque_on_the_wire() -> None:
    with scripted((ZERO, REPLY), (ZERO, REPLY), (PUSH, REPLY)) as line:
        device = OpenMotor(Motor(), line)
        assert device.read(0) == (0.0125,)  # m, at a lever of 50 mm
        assert device.write(0, (1.0,)) == (1.0,)  # N


@pytest.mark.parametrize("reply", [None, REPLY[:6], REPLY[:-1] + b"\x67", NO_NUMBER])
def test_a_reply_that_is_none_is_the_end(reply: bytes | None) -> None:
    with scripted((ZERO, REPLY), (PUSH, reply)) as line:
        device = OpenMotor(Motor(), line)
        with pytest.raises(DeviceError, match="from the board"):
            device.write(0, (1.0,))
        with pytest.raises(DeviceError, match="from the board"):
            device.read(0)  # no message follows
        device.close()
    assert line.is_closed
