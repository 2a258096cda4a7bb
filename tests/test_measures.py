"""Measures of a sweep: functions of a finished run, kept in a file, drawn."""

import contextlib
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

import forcebound as fb
from forcebound.lab.table import read_table

SURFACE = 0.010  # m, of stiff_wall


def contacts(run: fb.Run) -> int:
    inside = run.telemetry["true_position"][:, 0] > SURFACE
    return int((inside[1:] & ~inside[:-1]).sum())


def is_deep(run: fb.Run) -> np.bool_:
    return np.bool_(run.telemetry["true_position"].max() > 0.011)


def forces(run: fb.Run) -> np.ndarray:
    return run.telemetry["applied_force"][:3, 0]


def entries(run: fb.Run) -> list[float]:
    return [*run.telemetry["time"][: contacts(run)]]


def peak(run: fb.Run) -> fb.Quantity:
    return run.figures.peak_force


@pytest.mark.parametrize(
    ("file", "engine", "workers"), [("stiff_wall", "kernel", 0), ("knob_wall", "graph", 2)]
)
def test_a_measure_is_a_column_of_what_it_says_of_each_run(
    file: str, engine: str, workers: int
) -> None:
    laws = ["none", "certified"]
    measures = {"law_again": lambda run: run.label, "forces": forces, "peak": peak, "a": contacts}
    if engine == "kernel":
        measures |= {"contacts": contacts, "is_deep": is_deep, "entries": entries}
    seeds = [*range(1, 5)]
    runs = fb.sweep(file, law=laws, seed=seeds, duration="1 s", workers=workers, measures=measures)
    assert runs.errors == []
    assert {row["engine"] for row in runs.rows} == {engine}
    assert runs["law_again"].tolist() == runs["law"].tolist()
    assert runs["peak"].tolist() == runs["peak_force"].tolist()
    assert runs["forces"].shape == (8, 3)
    alone = fb.simulate(file, law="certified", seed=4, duration="1 s")
    assert runs["forces"][-1].tolist() == forces(alone).tolist()
    if engine == "kernel":
        assert runs["contacts"][-1] == contacts(alone) > 0
        assert runs["is_deep"][-1] == is_deep(alone)


def test_lists_of_several_lengths_are_an_array_each() -> None:
    runs = fb.sweep(
        "stiff_wall", stiffness=["1 N/mm", "30 N/mm"], law="none", measures={"entries": entries}
    )
    assert [one.size for one in runs["entries"]] == [1, 110]


def calm(run: fb.Run) -> int:
    if contacts(run) > 50:
        raise ValueError("it oscillates")
    return 1


def test_a_measure_that_raises_is_an_error_of_its_run_alone() -> None:
    runs = fb.sweep(
        "stiff_wall",
        law="none",
        stiffness=["1 N/mm", "30 N/mm"],
        measures={"calm": calm, "contacts": contacts},
    )
    (error,) = runs.errors
    assert all(word in error for word in ("'calm'", "case 1", "30000", "oscillates"))
    assert np.isnan(runs["calm"]).tolist() == [False, True]
    assert runs["contacts"].tolist() == [1.0, 110.0]
    with pytest.raises(fb.errors.RunError, match="'calm'"):
        fb.sweep("stiff_wall", law="none", stiffness="30 N/mm", measures={"calm": calm})


@pytest.mark.parametrize(
    ("name", "measure"),
    [
        ("contacts", 3),
        ("peak_force", contacts),
        ("peak_force_n", contacts),
        ("delay", contacts),  # an argument of the file
        ("law", contacts),
        ("error", contacts),
        ("two words", contacts),
        ("contacts", lambda run: {"a": 1}),
        ("contacts", lambda run: [[1.0]]),
        ("contacts", lambda run: [1, [2]]),
        ("contacts", lambda run: run),
        ("contacts", lambda run: ["text"]),
        ("contacts", lambda run: 1j),
    ],
)
def test_a_wrong_measure_is_refused_before_the_runs(name: str, measure: Any) -> None:
    with pytest.raises(fb.errors.ConfigError, match=name):
        fb.sweep("stiff_wall", measures={name: measure}, duration="0.1 s")


def interrupting(at: int) -> Callable[[str, float], Any]:
    @contextlib.contextmanager
    def progress(name: str, after: float) -> Iterator[Callable[[int, int], None]]:
        def show(done: int, total: int) -> None:
            if done >= at:
                raise KeyboardInterrupt

        yield show

    return progress


def test_an_interrupted_sweep_goes_on_and_a_finished_one_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[float] = []

    def noted(run: fb.Run) -> list[float]:
        calls.append(run.figures.peak_force)
        return [1.0, 2.0]

    def sweep(**more: Any) -> fb.Runs:
        calls.clear()
        laws, seeds = ["none", "tdpa"], [*range(1, 6)]
        path = tmp_path / "runs.parquet"
        measures = {"noted": measure}
        duration = "0.2 s"
        return fb.sweep(
            "stiff_wall", law=laws, seed=seeds, workers=0, duration=duration, measures=measures,
            result=path, **more,
        )  # fmt: skip

    measure: Callable[[fb.Run], Any] = noted
    with monkeypatch.context() as patched:
        patched.setattr("forcebound.lab.sweeps.progress_bar", interrupting(4))
        with pytest.raises(KeyboardInterrupt) as caught:
            sweep()
    assert "runs.parquet.parts" in "".join(caught.value.__notes__)
    assert len(calls) == 1 + 4  # the first run is tried
    whole = sweep()
    assert len(calls) == 1 + 6
    assert whole["noted"].tolist() == [[1.0, 2.0]] * 10
    assert sweep().rows == whole.rows
    assert len(calls) == 1
    sweep(restart=True)
    assert len(calls) == 1 + 10
    measure = contacts
    with pytest.raises(fb.errors.ConfigError, match="overwrite=True"):
        sweep()
    assert sweep(overwrite=True)["noted"].shape == (10,)
    assert read_table(tmp_path / "runs.parquet").about["map"] == {"value": "noted"}
    again = fb.Runs.read(tmp_path / "runs.parquet")
    assert again.varied == ("law", "seed")
    assert again["noted"].tolist() == sweep()["noted"].tolist()


def test_any_column_is_drawn(tmp_path: Path) -> None:
    mpl.use("Agg")
    runs = fb.sweep(
        "stiff_wall", law=["none", "tdpa"], stiffness=fb.geomspace("1 N/mm", "4 N/mm", 3),
        delay=["0 ms", "2 ms"], duration="0.3 s", measures={"contacts": contacts, "forces": forces},
        workers=0,
    )  # fmt: skip
    picture = tmp_path / "map.png"
    figure = runs.plot("contacts", x="delay", y="stiffness", per="law", output=picture)
    assert [axes.get_title() for axes in figure.axes[:2]] == ["none", "tdpa"]
    assert figure.axes[0].get_xlabel() == "delay, each way (ms)"
    assert figure.axes[-1].get_ylabel() == "contacts"
    assert picture.read_bytes().startswith(b"\x89PNG")
    curves = runs.plot("peak_force", x="stiffness", scale="log")
    assert curves.axes[0].get_yscale() == "log"
    assert len(curves.axes) == 2  # delays
    for wrong in ("forces", "contact", "law"):
        with pytest.raises(fb.errors.ConfigError, match=wrong):
            runs.plot(wrong)
    for what in ({"x": "stifness"}, {"scale": "logarithmic"}):
        with pytest.raises(fb.errors.ConfigError, match=next(iter(what.values()))):
            runs.plot("contacts", **what)


def test_geomspace_keeps_unit_and_ratio() -> None:
    assert fb.geomspace("1 N/mm", "4 N/mm", 3) == ["1.0 N/mm", "2.0 N/mm", "4.0 N/mm"]
    for wrong in (("0 ms", "1 ms", 2), ("1 ms", "1 s", 2), ("1 ms", "2 ms", 1)):
        with pytest.raises(fb.errors.ConfigError):
            fb.geomspace(*wrong)


SCRIPT = """
import forcebound as fb
SURFACE = 0.010
class Deepest:
    def __init__(self, surface): self.surface = surface
    def __call__(self, run): return depth(run).max()
def depth(run): return run.telemetry["true_position"][:, 0] - SURFACE
measures = {"deepest": Deepest(SURFACE)}
seeds = list(range(1, 9))
given = dict(seed=seeds, duration="0.3 s", workers=1)
runs = fb.sweep("stiff_wall", measures=measures, result="a.parquet", **given)
print(runs["deepest"].shape, runs["deepest"].min() > 0.0)
"""


@pytest.mark.parametrize("how", ["script", "-"])
def test_functions_of_a_script_or_a_session_run_in_processes(tmp_path: Path, how: str) -> None:
    command = [sys.executable, how]
    for more in ("", "\nunused = 1  # and a comment"):  # the second time it is read
        program = SCRIPT + more
        (tmp_path / "script").write_text(program)
        done = subprocess.run(command, input=program, cwd=tmp_path, capture_output=True, text=True)
        assert (done.stdout, done.stderr) == ("(8,) True\n", "")
