"""The guard around a device of the user's own."""

import math
from typing import Any

import pytest

from forcebound.errors import DeviceError
from forcebound.haptics.devices.guard import GuardedDevice
from forcebound.messages.packets import Vector
from forcebound.testing import Handle, OpenHandle


class Crank:
    """Kinematics of a crank with an arm of 0.1 m."""

    def position(self, angles: Vector) -> Vector:
        return (0.1 * math.sin(angles[0]),)

    def torque(self, angles: Vector, force: Vector) -> Vector:
        if abs(math.cos(angles[0])) < 0.1:
            raise ValueError("the crank is at its dead centre")
        return (0.1 * math.cos(angles[0]) * force[0],)


class Extended(OpenHandle):
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


def test_the_guard_passes_on_what_a_device_has() -> None:
    device = Extended(Handle())
    device.is_exchange = True
    guard = GuardedDevice(device)
    assert guard.set_hold_limit(2e-3) == 1.5e-3
    assert device.hold_limit == 2e-3
    assert guard.cut() == (5, (0.1,))
    assert guard.stamps() == (1, 2)
    assert guard.fresh_reading() == (0.3,)
    assert guard.is_exchange
    assert guard.kinematics is not None
    assert guard.kinematics.position((0.0,)) == (0.0,)
    assert guard.kinematics.torque((0.0,), (2.0,)) == (0.2,)


def test_the_guard_of_a_device_with_the_defaults_has_none() -> None:
    guard = GuardedDevice(OpenHandle(Handle()))
    answers = guard.set_hold_limit(1e-3), guard.cut(), guard.stamps(), guard.fresh_reading()
    assert (*answers, guard.latch_jitter(), guard.kinematics) == (None,) * 6


@pytest.mark.parametrize(
    ("method", "attribute", "answer"),
    [
        *(("set_hold_limit", "set_limit", limit) for limit in (0.0, math.nan, "2 ms")),
        *(
            ("cut", "report", report)
            for report in ((5,), (5, (0.1, 0.2)), (5, (math.nan,)), "soon")
        ),
        ("fresh_reading", "fresh", (math.nan,)),
        ("read", "position", (0.0, 1.0)),
        ("read", "position", (math.inf,)),
        ("read", "position", None),
    ],
)
def test_the_guard_names_the_method_whose_answer_is_wrong(
    method: str, attribute: str, answer: object
) -> None:
    device = Extended(Handle())
    setattr(device, attribute, answer)
    arguments = {"set_hold_limit": (2e-3,), "read": (0,)}.get(method, ())
    with pytest.raises(DeviceError, match=f"failed in {method}"):
        getattr(GuardedDevice(device), method)(*arguments)


def test_the_guard_reports_kinematics_that_fail() -> None:
    kinematics = GuardedDevice(Extended(Handle())).kinematics
    assert kinematics is not None
    with pytest.raises(DeviceError, match=r"failed in torque: .*dead centre"):
        kinematics.torque((math.pi / 2,), (1.0,))
