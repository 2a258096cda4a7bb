"""Identification through the drivers of serial devices, on their emulators."""

import math
from pathlib import Path
from typing import Any

import pytest
from test_emulators_live import program
from waiting import until

from forcebound.devices import DEVICES
from forcebound.errors import DeviceError
from forcebound.hardware.haply_2diy import Haply2DIY
from forcebound.identification.clock import RealClock
from forcebound.identification.procedure import Plan, identify
from forcebound.identification.rig import Limits, Rig
from forcebound.identification.stalls import recover

pytestmark = pytest.mark.live

PATIENT = 20.0  # s, watchdog limit: a busy machine takes its time


@pytest.mark.parametrize("kind", ["haply_2diy", "odrive"])
def test_a_motor_of_the_wrong_sign_is_found_through_the_driver(kind: str, tmp_path: Path) -> None:
    link = tmp_path / "board"
    with program(link, "--no-hand", "--fault", "reversed:at=0s", kind=kind):
        until(link.is_symlink, "the port")
        emulated: Any = DEVICES[kind]
        model = emulated(port=str(link), watchdog_limit=PATIENT)
        device = model.open(None, 1.25e-3)
        try:
            with pytest.raises(DeviceError, match="the torque scale of axis 1 has the wrong sign"):
                identify(device, model, RealClock(), Plan(reach=0.35, force=0.05))
        finally:
            device.close()


def test_the_emulated_hand_brings_back_an_arm_that_was_thrown_away(tmp_path: Path) -> None:
    link = tmp_path / "board"
    with program(link, "--no-hand"):
        until(link.is_symlink, "the port")
        model = Haply2DIY(port=str(link), watchdog_limit=PATIENT)
        device = model.open(None, 1.25e-3)
        try:
            unlimited = Limits(0.05, math.inf, math.inf)
            rig = Rig(device, RealClock(), 1e-3, unlimited, True, device.hand_over)
            thrown = rig.run(
                10.0,
                lambda elapsed, angles: (-0.05, 0.05),
                lambda angles: angles[0] > rig.first[0] + 0.3,
                math.inf,
            )
            assert thrown.readings[-1][0] > rig.first[0] + 0.3
            rig.limits = Limits(0.05, math.inf, 0.1)
            assert recover(rig) == pytest.approx(rig.first, abs=1e-2)
        finally:
            device.close()
