"""Sweeps: plan files, results, interruption and continuation."""

import re
from pathlib import Path

import pytest
from click.testing import CliRunner
from sweep_files import SMALL, written

from forcebound.cli import main
from forcebound.errors import ConfigError
from forcebound.graph.loader import build
from forcebound.haptics.laws import LAWS
from forcebound.lab.sweep.plan import SHIPPED, load_sweep, shipped
from forcebound.lab.sweep.runner import run_file, run_sweep
from forcebound.lab.table import read_table


@pytest.mark.parametrize(
    ("over", "expected"),
    [
        (
            "law: [certified, none]\n"
            "  stiffness: { from: 1 N/mm, to: 4 N/mm, count: 3, scale: log }",
            [(law, f"{k} N/mm") for law in ("certified", "none") for k in ("1.0", "2.0", "4.0")],
        ),
        (
            "seed: { repeat: 2, from: 7 }\n  stiffness: { from: 0 N/m, to: 3 N/m, count: 4 }",
            [(seed, f"{k}.0 N/m") for seed in ("7", "8") for k in range(4)],
        ),
        ("law: { all: laws }\n  stiffness: 3", [(law, "3") for law in LAWS.usual]),
    ],
)
def test_a_grid_has_every_combination_the_last_argument_fastest(
    tmp_path: Path, over: str, expected: list[tuple[str, str]]
) -> None:
    head = SMALL.partition("  law:")[0]
    sweep = load_sweep(written(tmp_path, f"{head}  {over}\n"))
    assert list(sweep.cases) == expected
    names = [f"{name}:={value}" for name, value in zip(sweep.columns, expected[0], strict=True)]
    assert sweep.overrides(sweep.cases[0]) == ["approach_speed:=100 mm/s", *names]


def test_random_draws_are_the_same_for_all_combinations_and_every_time(tmp_path: Path) -> None:
    text = SMALL + "random: { count: 5, seed: 3, over: { delay: { from: 0 ms, to: 5 ms } } }\n"
    sweep = load_sweep(written(tmp_path, text))
    assert len(sweep.cases) == 30
    draws = [case[2] for case in sweep.cases]
    assert draws[:5] * 6 == draws
    assert len(set(draws)) == 5
    assert load_sweep(tmp_path / "small.yaml").cases == sweep.cases


def test_any_value_of_the_launch_file_varies_by_its_path(tmp_path: Path) -> None:
    head = SMALL.partition("  law:")[0]
    over = "  environment.stiffness: [1 N/mm, 4 N/mm]\n"
    done = run_file(
        str(written(tmp_path, head + over)), ["device.rate:=2 kHz"], tmp_path / "r.parquet"
    )
    assert (done["cases"], done["failed"]) == (2, 0)
    columns = read_table(tmp_path / "r.parquet").columns
    assert list(columns["environment.stiffness"]) == [1_000.0, 4_000.0]
    assert set(columns["device.rate"]) == {2_000.0}
    with pytest.raises(ConfigError, match="did you mean 'stiffness'"):
        run_file(str(written(tmp_path, head + over.replace("stiffness", "stifness"))))


def test_an_argument_on_the_command_line_no_longer_varies(tmp_path: Path) -> None:
    sweep = load_sweep(written(tmp_path, SMALL), ["law:=aol"])
    assert sweep.columns == ("stiffness",)
    assert "law:=aol" in sweep.overrides(sweep.cases[0])


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("law: [", "lwa: [", 8, "did you mean 'law'?"),
        ("count: 3", "cuont: 3", 9, "did you mean 'count'?"),
        ("scale: log", "scale: lgo", 9, "expected 'linear' or 'log'"),
        ("to: 4 N/mm", "to: 4 N/m", 9, "one unit"),
        ("from: 1 N/mm", "from: 0 N/mm", 9, "a log range needs values > 0"),
        ("from: 1 N/mm", "from: soft", 9, "expected a number"),
        ("[certified, none]", "[]", 8, "no case"),
        ("[certified, none]", "{ all: lows }", 8, "expected 'laws'"),
        ("duration: 50 ms", "duration: 5 mm", 5, "duration"),
        ("x: stiffness", "x: stifness", 10, "did you mean 'stiffness'?"),
        ("launch: stiff_wall", "launch: stif_wall", 4, "no launch file"),
        ("x: stiffness", "limits: [encodr], x: stiffness", 10, "did you mean 'encoder'?"),
        ("x: stiffness", "limits: encoder, x: stiffness", 10, "limits: expected a list"),
        ("set: {", "set: { stiffness: 1 N/mm,", 6, "also varies"),
        ("forcebound: 1", "forcebound: 2", 2, "expected 1"),
        ("[certified, none]", "{ repeat: 1999999 }", 9, "2000000 cases"),
    ],
)
def test_a_mistake_in_a_sweep_file_is_shown_at_its_place(
    tmp_path: Path, old: str, new: str, line: int, words: str
) -> None:
    with pytest.raises(ConfigError) as error:
        load_sweep(written(tmp_path, SMALL.replace(old, new)))
    assert words in str(error.value)
    assert f"small.yaml:{line}:" in str(error.value)


@pytest.mark.parametrize("name", shipped())
def test_a_shipped_sweep_can_be_built_case_by_case(name: str) -> None:
    sweep = load_sweep(SHIPPED / name)
    assert sweep.drawing
    for case in range(0, len(sweep.cases), 97):
        build(sweep.template, sweep.overrides(sweep.cases[case]))


def test_a_row_has_parameters_figures_and_engine(tmp_path: Path) -> None:
    result = tmp_path / "small.parquet"
    document = run_sweep(load_sweep(written(tmp_path, SMALL)), result)
    assert document["cases"] == 6
    assert document["failed"] == 0
    assert document["kernel"] == 6
    table = read_table(result).columns
    assert table["over.law"] == ["certified"] * 3 + ["none"] * 3
    assert table["over.stiffness"][:3] == [1000.0, 2000.0, 4000.0]
    assert table["environment.stiffness"] == table["over.stiffness"]
    assert table["device.friction"] == [0.12] * 6
    assert table["duration"] == [0.05] * 6
    assert table["error"] == [None] * 6
    assert all(samples > 0 for samples in table["samples"])
    assert not list(tmp_path.glob("*.parts"))


def test_a_case_that_is_too_long_for_the_memory_fails_at_once(tmp_path: Path) -> None:
    sweep = load_sweep(written(tmp_path, SMALL.replace("50 ms", "86400 s")))
    document = run_sweep(sweep, tmp_path / "a.parquet")
    assert document["failed"] == document["cases"]
    assert "1000000 ticks" in document["first_error"]


@pytest.mark.parametrize(
    ("text", "arguments", "words"),
    [
        (SMALL.replace("none]", "nnoe]"), (), "did you mean 'none'?"),
        (SMALL.replace("none]", "none]\n  delay: [1 ms, 2 mm]"), (), "which is a length"),
        (SMALL, ("stiffness:=1 N/mm",), "'stiffness' for x: is constant here"),
    ],
)
def test_what_no_case_can_repair_is_refused_before_anything_runs(
    tmp_path: Path, text: str, arguments: tuple[str, ...], words: str
) -> None:
    result = tmp_path / "small.parquet"
    with pytest.raises(ConfigError, match=re.escape(words)):
        run_file(str(written(tmp_path, text)), arguments, result, plot=True)
    assert not list(tmp_path.glob("*.parquet*"))


def test_a_failed_case_is_a_row_with_its_error(tmp_path: Path) -> None:
    text = SMALL.replace("[certified, none]", "[certified, certfied]")
    result = tmp_path / "small.parquet"
    document = run_sweep(load_sweep(written(tmp_path, text)), result)
    assert document["failed"] == 3
    table = read_table(result).columns
    assert table["error"][:3] == [None] * 3
    assert "did you mean 'certified'" in table["error"][3]
    assert table["engine"] == ["kernel"] * 3 + [None] * 3
    assert table["over.law"][3] == "certfied"


def test_a_file_that_is_no_result_is_not_replaced(tmp_path: Path) -> None:
    file = written(tmp_path, SMALL)
    done = CliRunner().invoke(main, ["sweep", str(file), "-o", str(file)])
    assert done.exit_code == 2
    assert "--overwrite" in done.stderr
    assert file.read_text() == SMALL
