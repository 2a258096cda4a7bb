"""The guard around a device of the user's own."""

import math
from typing import Any

import pytest
from fakes import FakeDevice

from forcebound.devices.guard import GuardedDevice
from forcebound.errors import DeviceError
from forcebound.messages.packets import Vector


class Crank:
    """Kinematics of a crank with an arm of 0.1 m."""

    def position(self, angles: Vector) -> Vector:
        return (0.1 * math.sin(angles[0]),)

    def torque(self, angles: Vector, force: Vector) -> Vector:
        if abs(math.cos(angles[0])) < 0.1:
            raise ValueError("the crank is at its dead centre")
        return (0.1 * math.cos(angles[0]) * force[0],)


class Extended(FakeDevice):
    """A device with all optional members."""

    kinematics = Crank()
    hold_limit = 0.0
    report: object = (5, (0.1,))
    fresh: Vector | None = (0.3,)

    set_limit: Any = 1.5e-3

    def set_hold_limit(self, seconds: float) -> Any:
        self.hold_limit = seconds
        return self.set_limit

    def cut(self) -> Any:
        return self.report

    def stamps(self) -> tuple[int, int]:
        return 1, 2

    def fresh_reading(self) -> Vector | None:
        return self.fresh


def test_the_guard_passes_on_the_optional_members() -> None:
    device = Extended()
    guarded = GuardedDevice(device)
    assert guarded.set_hold_limit is not None
    assert guarded.cut is not None
    assert guarded.stamps is not None
    assert guarded.fresh_reading is not None
    assert guarded.kinematics is not None
    assert guarded.set_hold_limit(2e-3) == 1.5e-3
    assert device.hold_limit == 2e-3
    assert guarded.cut() == (5, (0.1,))
    assert guarded.stamps() == (1, 2)
    assert guarded.fresh_reading() == (0.3,)
    assert guarded.kinematics.position((0.0,)) == (0.0,)
    assert guarded.kinematics.torque((0.0,), (2.0,)) == (0.2,)


def test_the_guard_of_a_device_without_optional_members_has_none() -> None:
    guarded = GuardedDevice(FakeDevice())
    members = guarded.set_hold_limit, guarded.cut, guarded.stamps, guarded.fresh_reading
    assert (*members, guarded.kinematics) == (None,) * 5


@pytest.mark.parametrize("limit", [None, 0.0, math.nan, "2 ms"])
def test_the_guard_refuses_a_device_that_does_not_say_what_hold_limit_it_has_set(
    limit: object,
) -> None:
    device = Extended()
    device.set_limit = limit
    set_hold_limit = GuardedDevice(device).set_hold_limit
    assert set_hold_limit is not None
    with pytest.raises(DeviceError, match="failed in set_hold_limit"):
        set_hold_limit(2e-3)


@pytest.mark.parametrize("report", [(5,), (5, (0.1, 0.2)), (5, (math.nan,)), "soon"])
def test_the_guard_refuses_a_cut_without_a_time_and_a_reading(report: object) -> None:
    device = Extended()
    device.report = report
    cut = GuardedDevice(device).cut
    assert cut is not None
    with pytest.raises(DeviceError, match="failed in cut"):
        cut()


def test_the_guard_refuses_a_fresh_reading_that_is_no_number() -> None:
    device = Extended()
    fresh_reading = GuardedDevice(device).fresh_reading
    assert fresh_reading is not None
    device.fresh = None
    assert fresh_reading() is None
    device.fresh = (math.nan,)
    with pytest.raises(DeviceError, match="failed in fresh_reading"):
        fresh_reading()


def test_the_guard_reports_kinematics_that_fail() -> None:
    kinematics = GuardedDevice(Extended()).kinematics
    assert kinematics is not None
    with pytest.raises(DeviceError, match=r"failed in torque: .*dead centre"):
        kinematics.torque((math.pi / 2,), (1.0,))
