"""``forcebound identify``: the file that it writes, its use in a launch file, its check."""

from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from ruamel.yaml import YAML

from forcebound.cli import main
from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.lab.identification import document
from forcebound.lab.identification.verdict import verdict

USE = "forcebound: 1\ninclude: {}\ndevice: {{ include: device.yaml, hand_speed: null }}\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the file of an identified device."""
    folder = tmp_path_factory.mktemp("identified")
    arguments = ["identify", "phantom_premium_1_5", "substep:=1 ms"]
    done = CliRunner().invoke(main, [*arguments, "-o", str(folder / "device.yaml")])
    assert done.exit_code == 0, done.output
    assert "what limits it most: damping" in done.output
    return folder


def written(folder: Path) -> Any:
    return YAML(typ="safe").load(folder / "device.yaml")


def load_with(folder: Path, launch_file: str) -> Any:
    path = folder / f"my_{launch_file}"
    path.write_text(USE.format(launch_file))
    return load(path).only.device


def test_the_file_holds_bounds_and_where_they_come_from(folder: Path) -> None:
    content = written(folder)
    device, numbers = content["device"], content["identified"]["numbers"]
    assert device["kind"] == "phantom_premium_1_5"
    assert device["sources"]["damping"] == "measured"
    assert 0.9 * 0.27 <= device["damping"] <= 0.27 <= 1.05 * numbers["damping"]["found"]
    assert 0.9 * 0.12 <= device["friction"] <= 0.12
    assert device["resolution"] == pytest.approx(3e-5)
    model = load_with(folder, "stiff_wall.yaml")
    assert model.damping == device["damping"]
    assert model.substep == 1e-3


def test_a_file_that_does_not_fit_is_refused_at_its_place(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="has a five_bar"):
        load_with(folder, "five_bar_wall.yaml")
    with pytest.raises(ConfigError, match=r"my_stiff_wall.yaml:3:"):
        load_with(tmp_path, "stiff_wall.yaml")
    (tmp_path / "device.yaml").write_text("forcebound: 1\n")
    with pytest.raises(ConfigError, match="a section device"):
        load_with(tmp_path, "stiff_wall.yaml")


def test_the_check_reports_what_has_changed(folder: Path) -> None:
    path, changed = folder / "device.yaml", folder / "changed.yaml"
    same = CliRunner().invoke(main, ["identify", "--check", str(path)])
    assert same.exit_code == 0, same.output
    numbers = written(folder)["identified"]["numbers"]
    stated, found = numbers["friction"]["stated"], numbers["damping"]["found"]
    text = path.read_text().replace(f"found: {found}", f"found: {1.4 * found:.4g}")
    changed.write_text(text.replace(f"stated: {stated}", f"stated: {1.3 * stated:.4g}"))
    other = CliRunner().invoke(main, ["identify", "--check", str(changed)])
    assert other.exit_code == 1
    assert "BROKEN  friction of axis 1" in other.output
    (line,) = [line for line in other.output.splitlines() if "damping of axis 1" in line]
    assert line.startswith("holds")
    assert line.endswith("changed")


def test_a_file_that_cannot_be_checked_is_refused_before_anything_moves(
    folder: Path, tmp_path: Path
) -> None:
    text = (folder / "device.yaml").read_text()
    stated = written(folder)["identified"]["numbers"]["friction"]["stated"]
    path = tmp_path / "device.yaml"
    for damaged, message in (
        (text.split("identified:")[0], "no section identified"),
        (text.replace("\ndevice:", "\ndevices:"), "a section device"),
        (text.replace("reach:", "reeach:"), "reach"),
        (text.replace(f"stated: {stated}", "stated: much"), "numbers.friction.stated"),
        (text.replace(f"stated: {stated}", f"stated: [{stated}, 1]"), "friction"),
        (text.replace("substep: 0.001", "substep: -1"), "substep"),
        (text.replace("serial_number: ''", "serial_number: '4711'"), "4711"),
    ):
        path.write_text(damaged)
        done = CliRunner().invoke(main, ["identify", "--check", str(path)])
        assert done.exit_code == 2, done.output
        assert message in done.output
        assert "at rest" not in done.output


def test_bad_input_is_refused_before_anything_moves() -> None:
    for words, named in (
        ("five_baar", "five_baar"),
        ("five_bar --reach far", "--reach"),
        ("five_bar --reach 30mm", "--reach"),
        ("five_bar --weight 100g", "--lever"),
        ("phantom_premium_1_5 --weight 0.1kg --lever 4cm", "--lever"),
        ("five_bar -o no/device.yaml", "no folder"),
        ("", "name a device"),
        ("five_bar --check device.yaml", "'five_bar'"),
    ):
        done = CliRunner().invoke(main, ["identify", *words.split()])
        assert done.exit_code == 2, done.output
        assert named in done.output


def test_bounds_are_rounded_to_the_careful_side() -> None:
    assert document.down(0.123456) == pytest.approx(0.1234, rel=1e-12)
    assert document.up(0.123412) == pytest.approx(0.1235, rel=1e-12)
    assert document.down(3e-5) == document.up(3e-5) == pytest.approx(3e-5, rel=1e-12)
    assert document.down(0.0) == document.up(0.0) == 0.0


def test_the_verdict_grows_with_the_damping(folder: Path) -> None:
    model = load_with(folder, "stiff_wall.yaml")
    judged = verdict(model, 1000.0, (0.0,))
    assert 500.0 < judged.stiffness < 1500.0
    assert judged.better[judged.limit] == judged.better["damping"] > 1.05 * judged.stiffness
    assert judged.better["saturation"] == pytest.approx(judged.stiffness)
