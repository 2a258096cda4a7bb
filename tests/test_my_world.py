"""The example of a world of one's own: exact forces, the proxy, and a run."""

import math
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from forcebound.cli import main
from forcebound.graph.loader import load
from forcebound.graph.parts import member_of
from forcebound.haptics.environments import open_environment
from forcebound.messages.packets import SceneObject
from forcebound.run.virtual import run_virtual

FOLDER = Path(__file__).parent.parent / "examples" / "python"
STIFFNESS, RADIUS, CENTRE = 2000.0, 0.010, (0.020, 0.0, 0.0)
STILL = (0.0, 0.0, 0.0)


@pytest.fixture
def ball() -> Any:
    return open_environment(member_of("environment", str(FOLDER / "my_world.py"), []), 3)


@pytest.mark.parametrize("direction", [(-1.0, 0.0, 0.0), (0.0, 0.6, -0.8), (-0.36, 0.48, 0.8)])
def test_the_ball_pushes_out_along_its_normal(ball: Any, direction: tuple[float, ...]) -> None:
    depth = 0.002
    tip = tuple(c + (RADIUS - depth) * d for c, d in zip(CENTRE, direction, strict=True))
    force = ball.force("", tip, STILL, 0.0)
    assert force == pytest.approx([-STIFFNESS * depth * d for d in direction])
    proxy, normal = ball.contact("")
    assert normal == pytest.approx(direction)
    assert math.dist(proxy, CENTRE) == pytest.approx(RADIUS)
    assert ball.scene() == (SceneObject("ball", "sphere", CENTRE, size=(RADIUS,)),)


def test_a_push_beyond_the_centre_does_not_pop_through(ball: Any) -> None:
    for millimetres in range(5, 60):
        force = ball.force("", (millimetres * 1e-3, 0.0, 0.0), STILL, 0.0)
    assert force == pytest.approx((STIFFNESS * 0.049, 0.0, 0.0))
    assert ball.contact("").proxy == pytest.approx((0.010, 0.0, 0.0))
    assert ball.force("", (0.009, 0.0, 0.0), STILL, 0.0) == STILL
    assert ball.contact("") is None


def test_the_example_keeps_the_contract_and_its_launch_file_runs() -> None:
    file = str(FOLDER / "my_world.py")
    result = CliRunner().invoke(main, ["check", "environment", file], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert "BROKEN" not in result.output
    assert "kept    contact" in result.output
    ran = run_virtual(load(FOLDER / "my_world.yaml"), duration=2.0)
    assert ran.summary["true_energy_min_j"] >= -1e-9
    assert ran.summary["displayed_stiffness_n_per_m"] == pytest.approx(STIFFNESS, rel=0.01)
