"""Identification through the drivers of serial devices, on their emulators."""

from pathlib import Path
from typing import Any

import pytest
from test_emulators_live import program
from waiting import until

from forcebound.errors import DeviceError
from forcebound.haptics.devices import DEVICES
from forcebound.lab.identification.procedure import Plan, identify
from forcebound.lab.identification.rig import Clock

pytestmark = pytest.mark.live

WATCHDOG_LIMIT = 20.0  # s: a busy machine takes its time
TRIES = 20  # a late tick of a busy machine ends an identification, and says so


@pytest.mark.parametrize("kind", ["haply_2diy", "odrive"])
def test_a_motor_of_the_wrong_sign_is_found_through_the_driver(kind: str, tmp_path: Path) -> None:
    link = tmp_path / "board"
    with program(link, "--no-hand", "--fault", "reversed:at=0s", kind=kind):
        until(link.is_symlink, "the port")
        emulated: Any = DEVICES[kind]
        model = emulated(port=str(link), watchdog_limit=WATCHDOG_LIMIT)
        for _ in range(TRIES):
            device = model.open(None, 1.25e-3)
            try:
                with pytest.raises(DeviceError) as raised:
                    identify(device, model, Clock(), Plan(reach=0.35, force=0.05))
            finally:
                device.close()
            if "this machine was late" not in str(raised.value):
                break
        assert raised.match("axis 1 has the wrong sign")
