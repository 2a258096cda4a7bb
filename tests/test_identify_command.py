"""``forcebound identify``: the file that it writes, its use in a launch file, its check."""

from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from forcebound.cli import main
from forcebound.config.loader import load
from forcebound.errors import ConfigError
from forcebound.identification import document
from forcebound.identification.verdict import verdict

USE = "forcebound: 1\ninclude: {}\ndevice: {{ include: device.yaml }}\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the file of an identified device."""
    folder = tmp_path_factory.mktemp("identified")
    arguments = ["identify", "phantom_premium_1_5", "substep:=0.25 ms"]
    done = CliRunner().invoke(main, [*arguments, "-o", str(folder / "device.yaml")])
    assert done.exit_code == 0, done.output
    assert "what limits it most: damping" in done.output
    return folder


def load_with(folder: Path, launch_file: str) -> Any:
    path = folder / f"my_{launch_file}"
    path.write_text(USE.format(launch_file))
    return load(path).device.model


def test_the_file_holds_bounds_and_where_they_come_from(folder: Path) -> None:
    content = document.read(folder / "device.yaml")
    device, identified = content["device"], content["identified"]
    assert device["kind"] == "phantom_premium_1_5"
    assert device["sources"]["damping"] == "measured"
    assert (
        0.9 * 0.27 <= device["damping"] <= 0.27 <= 1.05 * identified["numbers"]["damping"]["found"]
    )
    assert 0.9 * 0.12 <= device["friction"] <= 0.12
    assert device["resolution"] == pytest.approx(3e-5)
    assert (folder / "device.png").stat().st_size > 10_000


def test_a_launch_file_uses_it(folder: Path) -> None:
    device = document.read(folder / "device.yaml")["device"]
    model = load_with(folder, "stiff_wall.yaml")
    assert model.damping == device["damping"]
    assert model.substep == 2.5e-4


def test_the_file_of_another_device_is_refused(folder: Path) -> None:
    with pytest.raises(ConfigError, match="this launch file is for 'five_bar'"):
        load_with(folder, "five_bar_wall.yaml")


def test_a_file_that_is_none_is_said_at_its_place(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"my_stiff_wall.yaml:3:.*cannot read the file of the"):
        load_with(tmp_path, "stiff_wall.yaml")
    (tmp_path / "device.yaml").write_text("forcebound: 1\n")
    with pytest.raises(ConfigError, match="has no section device: with a kind"):
        load_with(tmp_path, "stiff_wall.yaml")
    with pytest.raises(ConfigError, match="has no section identified"):
        document.read(tmp_path / "device.yaml")


def test_the_check_tells_a_device_that_has_changed(folder: Path) -> None:
    path = folder / "device.yaml"
    same = CliRunner().invoke(main, ["identify", "--check", str(path)])
    assert same.exit_code == 0, same.output
    changed = folder / "changed.yaml"
    stated = document.read(path)["identified"]["numbers"]["friction"]["stated"]
    text = path.read_text()
    changed.write_text(text.replace(f"stated: {stated}", f"stated: {1.3 * stated:.4g}"))
    other = CliRunner().invoke(main, ["identify", "--check", str(changed)])
    assert other.exit_code == 1
    assert "BROKEN  friction of axis 1" in other.output


def test_a_number_that_has_changed_and_still_holds_is_told(folder: Path) -> None:
    path = folder / "device.yaml"
    found = document.read(path)["identified"]["numbers"]["damping"]["found"]
    changed = folder / "was_more.yaml"
    changed.write_text(path.read_text().replace(f"found: {found}", f"found: {1.4 * found:.4g}"))
    done = CliRunner().invoke(main, ["identify", "--check", str(changed)])
    assert done.exit_code == 0, done.output
    assert "holds   damping of axis 1" in done.output
    assert ", but has changed" in done.output


def test_a_damaged_file_is_told_before_anything_moves(folder: Path, tmp_path: Path) -> None:
    text = (folder / "device.yaml").read_text()
    stated = document.read(folder / "device.yaml")["identified"]["numbers"]["friction"]["stated"]
    path = tmp_path / "device.yaml"
    for damaged, message in (
        (text[: len(text) // 3], "has no section identified"),
        (text.split("identified:")[0], "has no section identified"),
        (text.replace("\ndevice:", "\ndevices:"), "has no section device"),
        (text.replace("reach:", "reeach:"), "identified: plan: reach"),
        (text.replace(f"stated: {stated}", "stated: much"), "numbers: friction: stated"),
        (text.replace("phantom_premium_1_5", "five_bar"), "the device has no number"),
        (text.replace("substep: 0.00025", "substep: -1"), "substep"),
    ):
        path.write_text(damaged)
        done = CliRunner().invoke(main, ["identify", "--check", str(path)])
        assert done.exit_code == 2, done.output
        assert message in done.output
        assert "at rest" not in done.output


def test_the_file_of_another_board_is_refused_before_anything_moves(
    folder: Path, tmp_path: Path
) -> None:
    path = tmp_path / "device.yaml"
    text = (folder / "device.yaml").read_text()
    path.write_text(text.replace("serial_number: ''", "serial_number: '4711'"))
    done = CliRunner().invoke(main, ["identify", "--check", str(path)])
    assert done.exit_code == 2
    assert "of the device with the serial number 4711, this one has -" in done.output
    assert "at rest" not in done.output


def test_bad_input_is_said_before_anything_moves(tmp_path: Path) -> None:
    for words, message in (
        (["five_baar"], "five_baar"),
        (["five_bar", "--reach", "far"], "--reach: expected"),
        (["five_bar", "--reach", "30 mm"], "--reach: expected"),
        (["five_bar", "--weight", "100 g"], "needs --lever"),
        (["phantom_premium_1_5", "--weight", "0.1 kg", "--lever", "4 cm"], "is for joints"),
        (["five_bar", "-o", str(tmp_path / "no" / "device.yaml")], "there is no folder"),
        ([], "name a device"),
        (["five_bar", "--check", "device.yaml"], "leave out 'five_bar'"),
    ):
        done = CliRunner().invoke(main, ["identify", *words])
        assert done.exit_code == 2, (words, done.output)
        assert message in done.output


def test_bounds_are_rounded_to_the_careful_side() -> None:
    assert document.down(0.123456) == pytest.approx(0.1234, rel=1e-12)
    assert document.up(0.123412) == pytest.approx(0.1235, rel=1e-12)
    assert document.down(3e-5) == document.up(3e-5) == pytest.approx(3e-5, rel=1e-12)
    assert document.down(0.0) == document.up(0.0) == 0.0


def test_the_verdict_grows_with_the_damping(folder: Path) -> None:
    model = load_with(folder, "stiff_wall.yaml")
    judged = verdict(model, {"damping": 0.27}, 1000.0, (0.0,), None)
    assert 500.0 < judged.stiffness < 1500.0
    assert judged.gains["damping"]["built"] > judged.gains["damping"]["measured"] > 1.0
    assert judged.gains["saturation"]["built"] == pytest.approx(1.0)
