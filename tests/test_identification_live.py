"""Identification through the drivers of serial devices, on their emulators."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from test_emulators_live import program
from waiting import until

from forcebound.devices import DEVICES
from forcebound.errors import DeviceError
from forcebound.identification.clock import RealClock
from forcebound.identification.procedure import Plan, identify

pytestmark = pytest.mark.live

PATIENT = 2.0  # s, watchdog limit: a busy machine takes its time


@pytest.mark.parametrize("kind", ["haply_2diy", "odrive"])
def test_a_motor_of_the_wrong_sign_is_found_through_the_driver(kind: str, tmp_path: Path) -> None:
    link, values = tmp_path / "board", tmp_path / "values.json"
    model: Any = DEVICES[kind]()
    values.write_text(json.dumps({"mechanism": model.mechanism(), "operator": None}))
    words = ("--fault", "reversed:at=0s", "--values", str(values))
    with program(link, *words, kind=kind):
        until(link.is_symlink, "the port")
        device = replace(model, port=str(link), watchdog_limit=PATIENT).open(None, 1.25e-3)
        try:
            with pytest.raises(DeviceError, match="the torque scale of axis 1 has the wrong sign"):
                identify(device, model, RealClock(), Plan(reach=0.35, force=0.05))
        finally:
            device.close()
