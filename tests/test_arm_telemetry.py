"""The recorded force of an arm is what its recorded torques give at the tip."""

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from forcebound.graph.document import shipped
from forcebound.graph.loader import load
from forcebound.messages.packets import Telemetry
from forcebound.recordings.recording import read
from forcebound.run.virtual import run_virtual

WEAKER = 0.2  # of the saturation: every run saturates
ARMS = ["desktop_arm", "five_bar_wall", "knob_wall", "serial_arm_wall"]


def shipped_arms() -> list[str]:
    """Shipped launch files whose device has joints, and lives in virtual time, too."""
    names = [name.removesuffix(".yaml") for name in shipped()]
    configs = {name: load(name) for name in names}
    models = {name: one.only.device for name, one in configs.items() if len(one.hands) == 1}
    return [
        name
        for name, model in models.items()
        if model.kinematics() is not None and model.simulated_in is None
    ]


def test_each_shipped_arm_is_run() -> None:
    assert shipped_arms() == ARMS


@pytest.mark.parametrize("law", ["none", "certified", "tdpa"])
@pytest.mark.parametrize("name", ARMS)
def test_the_applied_force_is_that_of_the_torques(name: str, law: str, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    config = load(name, [f"law:={law}"])
    given: Any = config.only.device
    model = replace(given, saturation=WEAKER * given.saturation)
    config = config.with_hand(device=model)
    run_virtual(config, 1.0, path)
    kinematics = model.kinematics()
    saturated = 0
    for packet in cast("list[Telemetry]", read(path).packets("telemetry")):
        assert packet.joints is not None
        assert packet.torques is not None
        torques = np.array(packet.torques)
        size = float(np.linalg.norm(torques))
        assert size <= model.saturation * (1.0 + 1e-9)
        saturated += size > 0.999 * model.saturation
        jacobian = np.array(kinematics.jacobian(packet.joints))
        np.testing.assert_allclose(jacobian.T @ packet.applied_force, torques, rtol=0, atol=1e-9)
    if law == "none":
        assert saturated > 10
