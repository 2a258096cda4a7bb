"""The worlds with a surface in launch files: runs in virtual time, parameters, bad input."""

from pathlib import Path

import numpy as np
import pytest

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.graph.model import always, restore
from forcebound.graph.parameters import change, parameters, with_values
from forcebound.graph.resolved import to_document
from forcebound.run.virtual import run_virtual

SURFACE = 'environment: { kind: solid, surface: { texture: "relief.npy" } }'


def _file(folder: Path, environment: str) -> Path:
    path = folder / "mine.yaml"
    path.write_text(f"forcebound: 1\ninclude: three_axes.yaml\n{environment}\n")
    return path


def test_a_hand_comes_to_rest_on_the_sphere_with_penetration_force_over_stiffness() -> None:
    result = run_virtual(load("touch_sphere"), 3.0)
    samples = result.columns
    assert samples.true_energy.min() >= 0.0
    assert result.summary["at_rest"]
    centre, radius, stiffness = np.array([0.05, 0.0, 0.0]), 0.04, 1000.0
    place, force = samples.position[-1], samples.applied_force[-1]
    out = (place - centre) / np.linalg.norm(place - centre)
    depth = radius - float(np.linalg.norm(place - centre))
    assert depth > 0.001
    # The encoder's steps of 0.03 mm are 0.03 N.
    assert force == pytest.approx(-stiffness * depth * out, abs=0.03)


def test_strokes_with_friction_are_passive_and_show_the_angle() -> None:
    result = run_virtual(load("sliding_friction", ["law:=certified"]), 4.0)
    samples = result.columns
    assert samples.true_energy.min() >= 0.0
    commanded = samples.commanded_force[1000:]
    slopes = np.hypot(commanded[:, 1], commanded[:, 2]) / commanded[:, 0]
    assert slopes.max() == pytest.approx(0.6, rel=0.03)  # the static cone, met within a tick
    assert np.median(slopes) == pytest.approx(0.4, rel=1e-6)


@pytest.mark.parametrize("name", ["touch_field", "touch_points"])
def test_strokes_over_a_grid_and_a_cloud_are_passive(name: str) -> None:
    result = run_virtual(load(name, ["friction:=0.3"]), 1.5)
    columns = result.columns
    assert columns.true_energy.min() >= 0.0
    model = result.document["environment"]
    assert model["kind"] in ("distance_field", "point_cloud")
    force = np.linalg.norm(columns.applied_force, axis=1)
    assert force.max() > 1.0  # N


def test_parameters_within_a_section_have_names_of_their_own() -> None:
    config = load("sliding_friction")
    known = parameters(config)
    assert known["environment.surface.friction"] == 0.4
    assert "environment.surface" not in known
    assert len(known["environment.shapes"]) == 1
    new = change(config, {"environment.surface.friction": 0.3, "environment.stiffness": "2 N/mm"})
    assert parameters(new)["environment.surface.friction"] == 0.3
    assert parameters(new)["environment.surface.static_friction"] == 0.6
    same = with_values(
        config, {"environment.surface.friction": 0.3, "environment.stiffness": 2000.0}
    )
    assert same == new
    assert restore(to_document(new), always) == new


def test_a_running_graph_takes_over_a_parameter_within_a_section(tmp_path: Path) -> None:
    slippery = "{ environment.surface.friction: 0, environment.surface.static_friction: 0 }"
    path = tmp_path / "mine.yaml"
    path.write_text(
        "forcebound: 1\ninclude: sliding_friction.yaml\nphases:\n"
        "  - { name: rough, duration: 1.2 s }\n"
        f"  - {{ name: slippery, duration: 0.5 s, set: {slippery} }}\n"
    )
    commanded = run_virtual(load(path)).columns.commanded_force
    across = np.hypot(commanded[:, 1], commanded[:, 2])
    assert across[1100] > 0.3 * commanded[1100, 0]
    assert commanded[1500, 0] > 1.0
    assert across[1250:].max() < 1e-12


def test_a_wrong_parameter_within_a_section_is_told() -> None:
    config = load("sliding_friction")
    with pytest.raises(ConfigError, match=r"static_friction must be at least friction, 0\.9"):
        change(config, {"environment.surface.friction": 0.9})
    with pytest.raises(ConfigError, match=r"did you mean 'environment\.surface\.friction'"):
        change(config, {"environment.surface.fricton": 0.9})


def test_a_texture_beside_the_launch_file_is_found_and_checked(tmp_path: Path) -> None:
    path = _file(tmp_path, SURFACE)
    with pytest.raises(ConfigError, match=r"mine\.yaml:3:\d+: cannot read the height map .*relief"):
        load(path)
    np.save(tmp_path / "relief.npy", np.zeros((4, 4)))
    config = load(path)
    assert parameters(config)["environment.surface.texture"] == str(tmp_path / "relief.npy")
    assert run_virtual(config, 0.1).summary["samples"] > 50


@pytest.mark.parametrize(
    ("environment", "words"),
    [
        ("{ kind: solid, shapes: [] }", r":3:\d+: shapes must list 1 to 64 shapes, got 0"),
        (
            "{ kind: solid, shapes: [{ shape: sphere, radius: 0 mm }] }",
            r":3:\d+: .*radius: must be > 0 m",
        ),
        (
            "{ kind: solid, shapes: [{ shape: sphere, radius: 1 mm, is_removed: true }] }",
            r":3:\d+: the first of the shapes is removed from nothing",
        ),
        (
            "{ kind: solid, surface: { friction: 0.5, static_friction: 0.4 } }",
            r":3:\d+: .*static_friction must be at least friction, 0\.5, got 0\.4",
        ),
        ("{ kind: solid, shapes: [{ shape: cube }] }", r":3:\d+: .*plane.*sphere"),
    ],
)
def test_what_makes_no_world_is_told_with_its_line(
    tmp_path: Path, environment: str, words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        load(_file(tmp_path, f"environment: {environment}"))
