"""Sweeps: plan files, results, interruption and continuation."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure
from waiting import until

from forcebound.analysis.colours import LAW_COLOURS
from forcebound.bounding import LAWS
from forcebound.cli import main
from forcebound.config.loader import build
from forcebound.errors import ConfigError
from forcebound.sweep.command import run
from forcebound.sweep.maps import draw
from forcebound.sweep.parts import parts_of
from forcebound.sweep.plan import SHIPPED, load_sweep, shipped
from forcebound.sweep.runner import run_sweep
from forcebound.sweep.surfaces import draw_surfaces
from forcebound.sweep.table import read_table

SMALL = """
forcebound: 1
description: a small one
launch: stiff_wall
duration: 50 ms
set: { approach_speed: 100 mm/s }
over:
  law: [certified, none]
  stiffness: { from: 1 N/mm, to: 4 N/mm, count: 3, scale: log }
map: { x: stiffness, value: peak_force_n, per: law }
"""

LONG = SMALL.replace("count: 3", "count: 320")


class AtOnce(Executor):
    """Runs each task when it is submitted."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def interrupt_at(most: int) -> Callable[[int, int], None]:
    """Return a progress that presses Ctrl-C when so many cases are done."""

    def progress(done: int, cases: int) -> None:
        if done >= most:
            raise KeyboardInterrupt

    return progress


def written(folder: Path, text: str) -> Path:
    file = folder / "small.yaml"
    file.write_text(text)
    return file


def test_a_grid_has_every_combination_the_last_argument_fastest(tmp_path: Path) -> None:
    sweep = load_sweep(written(tmp_path, SMALL))
    assert sweep.columns == ("law", "stiffness")
    assert [case[0] for case in sweep.cases] == ["certified"] * 3 + ["none"] * 3
    assert [case[1] for case in sweep.cases[:3]] == ["1.0 N/mm", "2.0 N/mm", "4.0 N/mm"]
    assert sweep.overrides(0) == [
        "approach_speed:=100 mm/s",
        "law:=certified",
        "stiffness:=1.0 N/mm",
    ]


def test_repeated_seeds_and_linear_ranges(tmp_path: Path) -> None:
    over = "seed: { repeat: 2, from: 7 }\n  delay: { from: 0 ms, to: 3 ms, count: 4 }"
    text = SMALL.replace("law: [certified, none]", over).replace(", per: law", "")
    sweep = load_sweep(written(tmp_path, text))
    assert {case[0] for case in sweep.cases} == {"7", "8"}
    assert sorted({case[1] for case in sweep.cases}) == ["0.0 ms", "1.0 ms", "2.0 ms", "3.0 ms"]


def test_all_laws_need_no_list(tmp_path: Path) -> None:
    text = SMALL.replace("[certified, none]", "{ all: laws }")
    sweep = load_sweep(written(tmp_path, text))
    assert list(dict.fromkeys(case[0] for case in sweep.cases)) == list(LAWS)


def test_random_draws_are_the_same_for_all_combinations_and_every_time(tmp_path: Path) -> None:
    text = SMALL + "random: { count: 5, seed: 3, over: { delay: { from: 0 ms, to: 5 ms } } }\n"
    sweep = load_sweep(written(tmp_path, text))
    assert len(sweep.cases) == 30
    draws = [case[2] for case in sweep.cases]
    assert draws[:5] * 6 == draws
    assert len(set(draws)) == 5
    assert load_sweep(tmp_path / "small.yaml").cases == sweep.cases


def test_an_argument_on_the_command_line_no_longer_varies(tmp_path: Path) -> None:
    sweep = load_sweep(written(tmp_path, SMALL), ["law:=aol"])
    assert sweep.columns == ("stiffness",)
    assert "law:=aol" in sweep.overrides(0)


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
        ("[certified, none]", "{ all: lows }", 8, "did you mean 'laws'?"),
        ("duration: 50 ms", "duration: 5 mm", 5, "duration"),
        ("x: stiffness", "x: stifness", 10, "did you mean 'stiffness'?"),
        ("launch: stiff_wall", "launch: stif_wall", 4, "no launch file"),
        ("x: stiffness", "limits: [encodr], x: stiffness", 10, "did you mean 'encoder'?"),
        ("x: stiffness", "limits: encoder, x: stiffness", 10, "limits: expected a list"),
        ("set: {", "set: { stiffness: 1 N/mm,", 6, "also varies"),
        ("forcebound: 1", "forcebound: 2", 2, "version"),
    ],
)
def test_a_mistake_in_a_sweep_file_is_shown_at_its_place(
    tmp_path: Path, old: str, new: str, line: int, words: str
) -> None:
    with pytest.raises(ConfigError) as error:
        load_sweep(written(tmp_path, SMALL.replace(old, new)))
    assert words in str(error.value)
    assert f"small.yaml:{line}:" in str(error.value)


def test_an_unknown_sweep_file_names_those_that_come_with_the_package() -> None:
    with pytest.raises(ConfigError, match=r"z_width\.yaml"):
        load_sweep("z_wdith")


@pytest.mark.parametrize("name", shipped())
def test_a_shipped_sweep_can_be_built_case_by_case(name: str) -> None:
    sweep = load_sweep(SHIPPED / name)
    assert sweep.drawing
    for case in range(0, len(sweep.cases), 97):
        build(sweep.template, sweep.overrides(case))


def test_a_row_has_parameters_figures_and_engine(tmp_path: Path) -> None:
    result = tmp_path / "small.parquet"
    document = run_sweep(load_sweep(written(tmp_path, SMALL)), result, AtOnce())
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
    sweep = load_sweep(written(tmp_path, SMALL.replace("50 ms", "1e9 s")))
    document = run_sweep(sweep, tmp_path / "a.parquet", AtOnce())
    assert document["failed"] == document["cases"]
    assert "at most 1000000 ticks" in document["first_error"]


def test_too_many_cases_are_refused_before_they_are_made(tmp_path: Path) -> None:
    text = SMALL.replace("[certified, none]", "{ all: laws }").replace("count: 3", "count: 300000")
    with pytest.raises(ConfigError, match=r":9:.* more than 2000000 cases"):
        load_sweep(written(tmp_path, text))


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
        run(str(written(tmp_path, text)), arguments, result, plot=True)
    assert not list(tmp_path.glob("*.parquet*"))


def test_a_failed_case_is_a_row_with_its_error(tmp_path: Path) -> None:
    text = SMALL.replace("[certified, none]", "[certified, certfied]")
    result = tmp_path / "small.parquet"
    document = run_sweep(load_sweep(written(tmp_path, text)), result, AtOnce())
    assert document["failed"] == 3
    table = read_table(result).columns
    assert table["error"][:3] == [None] * 3
    assert "did you mean 'certified'" in table["error"][3]
    assert table["engine"] == ["kernel"] * 3 + [None] * 3
    assert table["over.law"][3] == "certfied"


def test_an_interrupted_sweep_goes_on_and_gives_the_same_bytes(tmp_path: Path) -> None:
    sweep = load_sweep(written(tmp_path, SMALL.replace("count: 3", "count: 60")))
    whole, cut = tmp_path / "whole.parquet", tmp_path / "cut.parquet"
    run_sweep(sweep, whole, AtOnce())
    with pytest.raises(KeyboardInterrupt):
        run_sweep(sweep, cut, AtOnce(), interrupt_at(64))
    assert not cut.exists()
    document = run_sweep(sweep, cut, AtOnce())
    assert 0 < document["resumed"] < 120
    assert cut.read_bytes() == whole.read_bytes()


def test_parts_of_another_sweep_are_refused_until_discarded(tmp_path: Path) -> None:
    result = tmp_path / "one.parquet"
    with pytest.raises(KeyboardInterrupt):
        run_sweep(load_sweep(written(tmp_path, SMALL)), result, AtOnce(), interrupt_at(0))
    other = load_sweep(tmp_path / "small.yaml", ["law:=aol"])
    with pytest.raises(ConfigError, match="another sweep"):
        run_sweep(other, result, AtOnce())
    assert run_sweep(other, result, AtOnce(), restart=True)["cases"] == 3


def test_the_result_of_another_sweep_is_replaced_only_if_that_is_wanted(tmp_path: Path) -> None:
    result = tmp_path / "one.parquet"
    sweep = load_sweep(written(tmp_path, SMALL))
    run_sweep(sweep, result, AtOnce())
    first = result.read_bytes()
    other = load_sweep(tmp_path / "small.yaml", ["law:=aol"])
    for restart in (False, True):
        with pytest.raises(ConfigError, match=r"not a result of this sweep.*--overwrite"):
            run_sweep(other, result, AtOnce(), restart=restart)
    assert result.read_bytes() == first
    run_sweep(sweep, result, AtOnce())
    assert result.read_bytes() == first
    assert run_sweep(other, result, AtOnce(), overwrite=True)["cases"] == 3


def test_a_file_that_is_no_result_is_not_replaced(tmp_path: Path) -> None:
    file = written(tmp_path, SMALL)
    done = CliRunner().invoke(main, ["sweep", str(file), "-o", str(file)])
    assert done.exit_code == 2
    assert "--overwrite" in done.stderr
    assert file.read_text() == SMALL


@pytest.mark.parametrize("cases", [1, 31, 32, 33, 5000, 100_000])
def test_parts_cover_every_case_once(cases: int) -> None:
    covered = [case for first, last in parts_of(cases) for case in range(first, last)]
    assert covered == list(range(cases))


@pytest.mark.parametrize("y", ["", "y: stiffness, "])
def test_a_map_is_drawn(tmp_path: Path, y: str) -> None:
    limits = "limits: [diolaiti, abbott_okamura, colgate_schenkel]"
    x = "x: delay, " if y else "x: stiffness, "
    text = SMALL.replace("x: stiffness, value: peak_force_n", f"{x}{y}value: true_energy_min_j")
    text = text.replace("per: law }", f"per: law, {limits} }}")
    text = text.replace("map:", "  delay: { from: 0 ms, to: 1 ms, count: 2 }\nmap:")
    result, picture = tmp_path / "small.parquet", tmp_path / "small.png"
    run_sweep(load_sweep(written(tmp_path, text)), result, AtOnce())
    draw(result, picture)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_law_has_the_same_colour_as_in_any_other_figure(tmp_path: Path) -> None:
    result, picture = tmp_path / "small.parquet", tmp_path / "small.svg"
    run_sweep(load_sweep(written(tmp_path, SMALL)), result, AtOnce())
    draw(result, picture)
    text = picture.read_text().upper()
    assert all(LAW_COLOURS[law] in text for law in ("certified", "none"))
    assert set(LAW_COLOURS) == set(LAWS)
    assert len(set(LAW_COLOURS.values())) == len(LAWS)


GRID = """
forcebound: 1
description: a map
launch: released_hand
duration: 500 ms
over:
  law: [none, certified]
  delay: { from: 0 ms, to: 4 ms, count: 3 }
  stiffness: { from: 0.02 N/mm, to: 5 N/mm, count: 4, scale: log }
map: { x: delay, y: stiffness, value: displayed_stiffness_n_per_m, scale: log, per: law }
"""


def texts(figure: Figure) -> set[str]:
    return {text.get_text() for legend in figure.legends for text in legend.get_texts()}


def test_a_map_of_stiffness_shows_leaks_rest_and_where_a_wall_feels_softer(tmp_path: Path) -> None:
    shown = "leaks: true_energy_min_j, limits: [colgate_schenkel, encoder], per: law }"
    result = tmp_path / "map.parquet"
    run_sweep(load_sweep(written(tmp_path, GRID.replace("per: law }", shown))), result, AtOnce())
    table = read_table(result)
    figure = draw_surfaces(table, table.about["map"])
    panels = [axes for axes in figure.axes if axes.get_title()]
    assert [axes.get_title() for axes in panels] == ["none", "certified"]
    red = [np.ma.count(np.ma.asarray(axes.collections[1].get_array())) for axes in panels]
    assert red[0] > 0  # without a law the stiff and late walls leak
    assert red[1] == 0
    assert {"no rest", "encoder: 2 f_c / resolution"} <= texts(figure)
    assert any("softer" in text for text in texts(figure))
    (line,) = (line for legend in figure.legends for line in legend.get_lines()[-1:])
    assert line.get_color() == "white"
    assert line.get_path_effects(), "a white line on a white page needs an edge"
    figure.draw_without_rendering()
    numbers = [text.get_text() for axes in figure.axes for text in axes.get_yticklabels()]
    assert any(numbers)
    assert not any("$" in number for number in numbers), "plain numbers, no powers of ten"
    bars = {axes.get_ylabel() for axes in figure.axes}
    assert {"displayed stiffness (N/mm)", "energy given to the hand (mJ)"} <= bars


def test_a_map_for_one_law_has_one_panel(tmp_path: Path) -> None:
    result, picture = tmp_path / "map.parquet", tmp_path / "map.svg"
    run_sweep(load_sweep(written(tmp_path, GRID), ["law:=certified"]), result, AtOnce())
    draw(result, picture)
    assert picture.read_text().startswith("<?xml")


def test_a_map_of_energy_has_one_scale(tmp_path: Path) -> None:
    text = GRID.replace("displayed_stiffness_n_per_m, scale: log", "true_energy_min_j")
    result = tmp_path / "map.parquet"
    run_sweep(load_sweep(written(tmp_path, text)), result, AtOnce())
    table = read_table(result)
    figure = draw_surfaces(table, table.about["map"])
    assert "no energy given" in texts(figure)
    assert sum(bool(axes.get_title()) for axes in figure.axes) == len(figure.axes) - 1


def hostile(path: Path, columns: dict[str, Any], about: object) -> Path:
    content = {b"forcebound": json.dumps(about).encode()}
    pq.write_table(pa.table(columns).replace_schema_metadata(content), path, compression="zstd")
    return path


@pytest.mark.parametrize("drawing", [{}, {"y": "delay"}])
def test_names_in_a_result_are_drawn_as_they_are(tmp_path: Path, drawing: dict[str, str]) -> None:
    name = r"$\frac{$ [/bold]"
    columns = {
        "over.stiffness": [1.0, 2.0],
        "over.delay": [0.0, 0.0],
        "over.law": [name, name],
        "at_rest": [True, True],
        "peak_force_n": [1.0, 2.0],
    }
    shown = {"x": "stiffness", "value": "peak_force_n", "per": "law", "title": name, **drawing}
    draw(hostile(tmp_path / "a.parquet", columns, {"map": shown}), tmp_path / "x.png")


@pytest.mark.parametrize(
    "about", [[], {"map": [1]}, {"map": {"x": 1, "value": "stiffness"}}, {"map": {"x": "nothing"}}]
)
def test_a_description_of_no_sweep_is_told(tmp_path: Path, about: object) -> None:
    result = hostile(tmp_path / "a.parquet", {"over.stiffness": [1.0]}, about)
    with pytest.raises(ConfigError):
        draw(result, tmp_path / "x.png")


def test_a_long_text_is_read_once_for_all_rows_that_have_it(tmp_path: Path) -> None:
    result = hostile(tmp_path / "a.parquet", {"error": ["x" * 20_000] * 1000}, {})
    assert result.stat().st_size < 10_000
    texts = read_table(result).columns["error"]
    assert len(texts) == 1000
    assert len({id(text) for text in texts}) == 1


def test_a_file_that_is_no_result_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="not a result of a sweep"):
        draw(written(tmp_path, SMALL), tmp_path / "x.png")


def command(file: Path, result: Path, *options: str) -> list[str]:
    return [sys.executable, "-m", "forcebound", "sweep", str(file), "-o", str(result), *options]


@contextlib.contextmanager
def started(file: Path, result: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """A sweep in a process of its own, of which two parts are done."""
    parts = result.with_name(result.name + ".parts")
    process = subprocess.Popen(
        command(file, result, *options), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        while len(list(parts.glob("0*.json"))) < 2:
            with contextlib.suppress(subprocess.TimeoutExpired):
                assert process.wait(0.005) is None, "it was done before it could be interrupted"
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.live
@pytest.mark.xdist_group("processes")
def test_a_sweep_killed_halfway_gives_the_same_file_as_one_that_was_not(tmp_path: Path) -> None:
    file = written(tmp_path, LONG)
    whole, cut = tmp_path / "whole.parquet", tmp_path / "cut.parquet"
    assert run(str(file), output=whole, workers=1)["cases"] == 640
    parts = cut.with_name("cut.parquet.parts")
    with started(file, cut, "--workers", "1") as process:
        process.send_signal(signal.SIGKILL)
    assert parts.exists()
    assert not cut.exists()
    again = subprocess.run(
        command(file, cut, "--workers", "1", "--json"), capture_output=True, text=True
    )
    document = json.loads(again.stdout)
    assert 0 < document["resumed"] < document["cases"]
    assert cut.read_bytes() == whole.read_bytes()
    assert not parts.exists()


@pytest.mark.live
@pytest.mark.xdist_group("processes")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_sweep_says_so_in_one_line(tmp_path: Path, number: signal.Signals) -> None:
    file = written(tmp_path, LONG.replace("count: 320", "count: 3200"))
    with started(file, tmp_path / "cut.parquet", "--workers", "2") as process:
        process.send_signal(number)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said.splitlines()[-1] == "forcebound: interrupted"
    assert "Traceback" not in said
    assert "leaked" not in said


@pytest.mark.live
@pytest.mark.xdist_group("processes")
def test_a_worker_that_is_killed_ends_the_sweep_with_one_line(tmp_path: Path) -> None:
    file = written(tmp_path, LONG.replace("count: 320", "count: 3200"))
    with started(file, tmp_path / "cut.parquet", "--workers", "1") as process:
        for worker in workers_of(process.pid):
            os.kill(worker, signal.SIGKILL)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 1
    assert said.splitlines()[-1].startswith("forcebound: a worker process ended")
    assert "Traceback" not in said


def workers_of(pid: int) -> list[int]:
    """Return the worker processes of a sweep, without multiprocessing's resource tracker."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [
        int(child)
        for child in children
        if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()
    ]


@contextlib.contextmanager
def dask_cluster(folder: Path, workers: int) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """A scheduler on this machine, with workers; its address and its process."""
    note = folder / "scheduler.json"
    common = ["--scheduler-file", str(note), "--host", "127.0.0.1", "--no-dashboard"]
    with contextlib.ExitStack() as running:

        def start(*arguments: str) -> subprocess.Popen[bytes]:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", *arguments, *common],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                cwd=folder,
                env={**os.environ, "TMPDIR": str(folder)},  # a killed one leaves its scratch space
            )
            running.callback(process.wait)
            running.callback(process.kill)
            return process

        scheduler = start("scheduler", "--port", "0")
        for _ in range(workers):
            start("worker", "--nthreads", "1", "--no-nanny")
        until(lambda: note.exists() and note.read_text().endswith("}"), "the scheduler")
        yield json.loads(note.read_text())["address"], scheduler


@pytest.mark.live
@pytest.mark.xdist_group("processes")
def test_a_dask_cluster_gives_the_same_file_as_this_machine(tmp_path: Path) -> None:
    file = written(tmp_path, SMALL.replace("count: 3", "count: 40"))
    here, there = tmp_path / "here.parquet", tmp_path / "there.parquet"
    run_sweep(load_sweep(file), here, AtOnce())
    with dask_cluster(tmp_path, workers=2) as (address, _):
        done = subprocess.run(
            command(file, there, "--cluster", address, "--json"), capture_output=True
        )
    assert done.returncode == 0, done.stderr.decode()
    assert json.loads(done.stdout)["cases"] == 80
    assert there.read_bytes() == here.read_bytes()


@pytest.mark.live
@pytest.mark.xdist_group("processes")
def test_a_cluster_that_ends_ends_the_sweep_with_one_line(tmp_path: Path) -> None:
    file = written(tmp_path, LONG.replace("count: 320", "count: 3200"))
    with (
        dask_cluster(tmp_path, workers=1) as (address, scheduler),
        started(file, tmp_path / "cut.parquet", "--cluster", address) as process,
    ):
        scheduler.kill()
        _, said = process.communicate(timeout=60)
    assert process.returncode == 1
    assert said.splitlines()[-1] == "forcebound: the cluster has ended, or has dropped the work"
    assert "Traceback" not in said
    assert "ERROR" not in said
