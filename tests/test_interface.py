"""The Python interface: ``import forcebound as fb``."""

import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import matplotlib as mpl
import numpy as np
import pytest
from builders import MS

import forcebound as fb
from forcebound.haptics.environments import StatelessEnvironment
from forcebound.haptics.laws import BoundingLaw
from forcebound.messages.events import LAW_CHANGED
from forcebound.messages.packets import Event, Vector
from forcebound.observe.runs import running
from forcebound.testing import Pad


@pytest.fixture(autouse=True)
def no_part_stays() -> Iterator[None]:
    """The parts that a test makes are not known to other tests."""
    yield
    for table in (fb.laws, fb.environments):
        for kind in table.added:
            del table[kind]


def weak_hand(state: float, sample: object, device: object) -> tuple[float, float, float]:
    return state, 0.25, 0.0


def test_importing_it_imports_neither_numba_nor_zmq() -> None:
    words = "import sys, forcebound; print({'numba', 'zmq', 'numpy'} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True)
    assert done.stdout == "set()\n"


def test_all_public_names_are_there() -> None:
    assert [*dir(fb)] == fb.__all__
    assert len({id(getattr(fb, name)) for name in fb.__all__}) == len(fb.__all__)
    with pytest.raises(AttributeError):
        fb.nothing  # noqa: B018


def test_a_run_has_figures_with_units_and_telemetry() -> None:
    run = fb.simulate("stiff_wall", law="none", stiffness="1 N/mm", duration="1.5 s")
    felt = run.figures.displayed_stiffness
    assert (felt.unit, felt.label) == ("N/m", "displayed stiffness")
    assert float(felt) == run.figures["displayed_stiffness"] == pytest.approx(1000.0, rel=0.01)
    # At rest the motor's force is stiffness times penetration.
    depth = run.telemetry["position"][-1, 0] - 0.01
    assert run.telemetry["applied_force"][-1, 0] == pytest.approx(1000.0 * depth)
    assert np.isnan(run.figures.tangential_share)
    assert "one axis" in run.figures.tangential_share.reason
    assert run.hands["hand"] is run
    with pytest.raises(AttributeError, match="displayed_stiffness"):
        _ = run.figures.displayed_stifness
    with pytest.raises(KeyError, match="position"):
        run.telemetry["speed"]


def test_it_prints_what_the_command_prints(capsys: pytest.CaptureFixture[str]) -> None:
    run = fb.simulate("stiff_wall", law="none", duration=1.0)
    run.figures.table()
    command = (sys.executable, "-m", "forcebound", "simulate", "stiff_wall", "law:=none")
    options = ("--duration", "1s", "--all")
    shown = subprocess.run([*command, *options], capture_output=True, text=True).stdout
    table = capsys.readouterr().out.splitlines()
    lines = [line.rstrip() for line in shown.splitlines()]
    assert all(line.rstrip() in lines for line in table)
    assert shown.startswith(repr(run))


def test_a_launch_file_may_be_a_mapping() -> None:
    document = fb.simulate("stiff_wall", duration="0.5 s").document
    again = fb.simulate(document, duration="0.5 s")
    assert again.document == document
    with pytest.raises(fb.errors.ConfigError, match="include"):
        fb.simulate({"forcebound": 1, "include": "stiff_wall.yaml"})


def test_wrong_arguments_are_errors_with_the_nearest_name() -> None:
    with pytest.raises(fb.errors.ConfigError, match="delay"):
        fb.simulate("stiff_wall", dela="2 ms")
    with pytest.raises(fb.errors.ConfigError, match="xx"):
        fb.simulate("stiff_wall", delay="2 xx")
    with pytest.raises(fb.errors.ConfigError, match="one number or text"):
        fb.simulate("stiff_wall", delay=[1, 2])
    with pytest.raises(fb.errors.RunError):
        fb.simulate("stiff_wall", duration="0.1 ms")


def test_an_environment_and_a_law_of_a_cell_can_be_passed() -> None:
    own = fb.simulate("stiff_wall", environment=Pad(stiffness=1000.0), law="none", duration="1 s")
    shipped = fb.simulate("stiff_wall", stiffness=1000.0, law="none", duration="1 s")
    np.testing.assert_array_equal(
        own.telemetry["applied_force"], shipped.telemetry["applied_force"]
    )
    limited = fb.simulate("stiff_wall", law=BoundingLaw("0.25 N", weak_hand), duration="1 s")
    assert limited.figures.peak_force == 0.25
    with pytest.raises(fb.errors.ConfigError, match=r"\.mcap"):
        fb.simulate("stiff_wall", record="data.csv")
    with pytest.raises(fb.errors.ConfigError, match="BoundingLaw"):
        fb.simulate("stiff_wall", law=Pad())
    with pytest.raises(fb.errors.ConfigError, match="frozen dataclass"):
        fb.simulate("stiff_wall", environment=object())


def limit_of(force: float) -> BoundingLaw:
    def certified(state: float, sample: object, device: object) -> tuple[float, float, float]:
        return state, force, 0.0

    return BoundingLaw(f"{force} N", certified)


def test_a_law_of_a_cell_replaces_no_other_of_its_name() -> None:
    laws = [limit_of(0.25), limit_of(0.125)]
    runs = fb.sweep("stiff_wall", law=[*laws, "certified"], duration="0.5 s")
    assert runs["peak_force"].tolist()[:2] == [0.25, 0.125]
    assert runs["law"].tolist() == ["certified_2", "certified_3", "certified"]
    shipped = fb.simulate("stiff_wall", law="certified", duration="0.5 s")
    assert runs["peak_force"][2] == shipped.figures.peak_force > 1.0
    assert len(runs.where(law=laws[1])) == 1


def test_a_sweep_has_the_runs_that_one_by_one_give() -> None:
    delays = fb.linspace("0 ms", "4 ms", 3)
    runs = fb.sweep("stiff_wall", law=["none", "certified"], delay=delays, duration="1 s")
    assert runs.varied == ("law", "delay")
    assert len(runs) == 6
    certified = runs.where(law="certified")
    assert certified["delay"].tolist() == [0.0, 0.002, 0.004]
    alone = fb.simulate("stiff_wall", law="certified", delay="4 ms", duration="1 s")
    for name in ("displayed_stiffness", "true_energy_min", "peak_force"):
        assert certified[name][-1] == pytest.approx(alone.figures[name], nan_ok=True)
    with pytest.raises(KeyError, match="delay"):
        runs["dela"]
    with pytest.raises(KeyError, match="law"):
        runs.where(lav="none")
    with pytest.raises(KeyError, match="certified"):
        runs.where(law="certifed")
    with pytest.raises(fb.errors.ConfigError, match="delay"):
        fb.sweep("stiff_wall", dela=delays)


def test_a_sweep_over_parts_runs_in_processes_that_know_them() -> None:
    blocks = [Pad(stiffness=500.0), Pad(stiffness=1000.0)]
    stiffness = ["none", "certified", "aol", "tdpa"]
    runs = fb.sweep("stiff_wall", environment=blocks, law=stiffness, duration="100 ms", workers=2)
    assert runs.errors == []
    assert runs["environment.stiffness"].tolist() == [500.0] * 4 + [1000.0] * 4
    assert runs["environment"].tolist()[3:5] == [repr(blocks[0]), repr(blocks[1])]


def test_a_failed_run_of_a_sweep_has_an_error(caplog: pytest.LogCaptureFixture) -> None:
    runs = fb.sweep("stiff_wall", stiffness=["1 N/mm", "-1 N/mm"], duration="100 ms")
    assert len(runs.errors) == 1
    assert np.isnan(runs["peak_force"]).tolist() == [False, True]
    assert "1 of 2 runs failed" in caplog.text


def test_a_script_without_a_main_guard_can_sweep(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "from dataclasses import dataclass\n"
        "import forcebound as fb\n"
        "from forcebound.haptics.environments import StatelessEnvironment\n"
        "@dataclass(frozen=True)\n"
        "class Own(StatelessEnvironment):\n"
        "    stiffness: float\n"
        "    def force(self, user, position, velocity, elapsed):\n"
        "        return (self.stiffness * position[0],)\n"
        "worlds = [Own(100.0 * n) for n in range(8)]\n"
        "print(len(fb.sweep('stiff_wall', environment=worlds, duration='20 ms', workers=2)))\n"
    )
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("8\n", "")


def test_linspace_keeps_the_unit() -> None:
    assert fb.linspace("0 ms", "1 ms", 3) == ["0.0 ms", "0.5 ms", "1.0 ms"]
    assert fb.linspace(1, 2, 2) == ["1.0", "2.0"]
    for wrong in (("0 ms", "1 s", 2), ("0 ms", "1 ms", 1)):
        with pytest.raises(fb.errors.ConfigError):
            fb.linspace(*wrong)


def test_bound_is_the_law_of_the_device_node() -> None:
    run = fb.simulate("paper_wall", law="less_conservative", duration="1 s")
    engaged = run.telemetry["engagement"] == 1.0
    position, force = (run.telemetry[name] for name in ("position", "commanded_force"))
    first = int(np.argmax(engaged)) - 1
    assert first < 5  # the ledger of the run and of `bound` begin without motion
    applied = fb.bound(position, force, "less_conservative")
    np.testing.assert_array_equal(applied[engaged], run.telemetry["applied_force"][engaged])
    shape = (len(position),)
    assert fb.bound(position[:, 0], force[:, 0]).shape == shape
    with pytest.raises(fb.errors.ConfigError, match="period"):
        fb.bound(position, force, period=0)
    in_mm = (1e3 * position, force)
    for wrong in ((position, force[1:]), ([], []), ([0.0, np.nan], [0.0, 0.0]), in_mm):
        with pytest.raises(fb.errors.ConfigError):
            fb.bound(*wrong)
    half = fb.bound(position, force, BoundingLaw("0.25 N", weak_hand), period="1 ms")
    assert np.abs(half).max() == 0.25
    with pytest.raises(fb.errors.ConfigError, match="dampin"):
        fb.bound(position, force, dampin=1.0)


def test_a_recording_is_read_and_drawn(tmp_path: Path) -> None:
    mpl.use("Agg")
    file = tmp_path / "run.mcap"
    made = fb.simulate("stiff_wall", duration="1 s", record=file)
    read = fb.read(file)
    assert read.verdict == made.verdict
    axes = read.plot("position", "force")
    assert [one.get_ylabel() for one in axes] == ["position (mm)", "force (N)"]
    assert fb.plot(made, read).shape[1] == 2
    with pytest.raises(fb.errors.ConfigError, match="position"):
        read.plot("positon")


@pytest.mark.live
def test_a_live_graph_is_changed_and_ends_with_its_block() -> None:
    mpl.use("Agg")

    def live() -> fb.Run:
        with fb.launch("stiff_wall", duration="1 s") as graph:
            graph.wait("10 s")
            with pytest.raises(fb.errors.RunError, match="ended"):
                graph.set("links.environment_query.delay", 0)
        return graph.run

    assert live().plot("force").shape == (1,)  # its recording is still there
    with fb.launch("stiff_wall", law="certified") as graph:
        graph.set("links.environment_query.delay", "20 ms")
        graph.wait(1.0)
        assert graph.parameters["links.environment_query.delay"] == 0.02
        assert graph.figures().duration > 0.0
        with pytest.raises(fb.errors.ConfigError, match="delay"):
            graph.set("links.environment_query.dela", 1)
    assert not graph.is_running
    assert graph.run.figures.true_energy_min >= 0.0
    assert graph.run.telemetry["engagement"][-1] == 0.0
    with pytest.raises(fb.errors.ConfigError, match=r"my_file\.py"):
        fb.launch("stiff_wall", environment=Pad())
    with pytest.raises(fb.errors.ConfigError, match="delay"):
        fb.launch("stiff_wall", dela="2 ms")


@pytest.mark.live
def test_a_notebook_shows_the_page_of_a_live_graph_which_ends_with_it() -> None:
    with fb.launch("pointer_wall") as graph:
        page = graph.page(height=500)
        assert f'src="{page.address}"' in page._repr_html_()
        with urllib.request.urlopen(page.address) as answer:
            assert "frame-ancestors" not in answer.headers["Content-Security-Policy"]
        again = graph.page()  # in place of the one before
        with pytest.raises(urllib.error.URLError):
            urllib.request.urlopen(page.address)
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(again.address)
    with pytest.raises(fb.errors.RunError, match="ended"):
        graph.page()


@pytest.mark.live
def test_a_live_graph_ends_with_its_program(tmp_path: Path) -> None:
    """The launcher ends its graph when the pipe of a killed program closes."""
    file = tmp_path / "run.mcap"
    script = (
        "import forcebound as fb, os, signal\n"
        f"fb.launch('stiff_wall', record={str(file)!r}).wait(0.5)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == -9, done.stderr
    end = time.monotonic() + 60.0
    while any(str(file) in str(one) for one in running().values()) and time.monotonic() < end:
        time.sleep(0.1)
    assert fb.read(file).telemetry["engagement"][-1] == 0.0


@dataclass(frozen=True)
class Wrong(StatelessEnvironment):
    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        return 1.0  # type: ignore[return-value]


def test_a_world_whose_code_fails_says_so_in_a_run_and_in_a_sweep() -> None:
    with pytest.raises(fb.errors.ForceboundError, match="one number per axis"):
        fb.simulate("stiff_wall", environment=Wrong(), duration="0.2 s")
    with pytest.raises(fb.errors.ForceboundError, match="one number per axis"):
        fb.sweep("stiff_wall", environment=[Wrong()], duration="0.2 s")


def test_the_end_of_a_run_has_figures_of_its_own() -> None:
    run = fb.simulate("stress", duration="10 s")
    for seconds in (1.0, 8.0):
        last = run.last(seconds)
        assert last.figures.duration == pytest.approx(seconds, abs=2e-3)
        assert last.telemetry["seq"][-1] == run.telemetry["seq"][-1]
    with pytest.raises(fb.errors.ConfigError, match="last"):
        run.last(0)
    law_changed = Event(0, MS, "device", LAW_CHANGED, False, "", {"law": "none"})
    changed = replace(run._result, events=[law_changed])
    assert changed.last(1.0).label == "none"


def test_a_table_of_pandas_has_a_column_per_axis(monkeypatch: pytest.MonkeyPatch) -> None:
    class DataFrame(dict[str, np.ndarray]):
        def set_index(self, name: str) -> "DataFrame":
            assert name in self
            return self

    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=DataFrame))
    run = fb.simulate("touch_sphere", duration="50 ms")
    table = run.to_pandas()
    np.testing.assert_array_equal(table["position[2]"], run.telemetry["position"][:, 2])
    assert {"force_limit", "applied_force[0]", "velocity[0]"} < table.keys()
    runs = fb.sweep("stiff_wall", law=["none", "tdpa"], duration="50 ms").to_pandas()
    assert {"law", "peak_force"} < runs.keys()


def test_a_recording_that_lacks_its_end_says_so() -> None:
    result = fb.simulate("stiff_wall", duration="3 s")._result
    early = result.columns.slice(result.columns.time < 1.0)
    assert replace(result, columns=early).summary["faults"]["recording_incomplete"] == 1
    assert "recording_incomplete" not in result.summary["faults"]


def test_the_samples_of_a_run_have_its_contacts() -> None:
    run = fb.simulate("stiff_wall", law="none", delay="5 ms", duration="2 s")
    samples, figures = run.samples, run.figures
    inside = run.telemetry["position"][run.telemetry["engagement"] > 0.0, 0] > 0.010
    assert samples.entries == np.count_nonzero(np.diff(inside.astype(int)) > 0) > 1
    assert samples.first_contact == np.argmax(inside)
    assert float(samples.bounces) == float(figures.contact_bounces)
    assert samples.depth[samples.contact].max() == figures.peak_penetration
    assert samples.displayed_stiffness == figures.displayed_stiffness
    speed = np.diff(run.telemetry["true_position"][:, 0]).max() * samples.rate
    assert 0.0 < (samples.contact_speed or 0.0) <= speed
    assert samples.resting_depth is None  # it moves


def test_the_stiffness_of_means_and_the_mean_of_stiffnesses_differ_in_a_moving_hand() -> None:
    moving = fb.simulate("palpation", law="more_conservative", duration="2 s").samples
    assert moving.mean_stiffness != pytest.approx(moving.displayed_stiffness, rel=1e-3)
    force, depth = moving.normal_force[moving.contact], moving.depth[moving.contact]
    assert moving.mean_stiffness == pytest.approx(force.mean() / depth.mean())
    resting = fb.simulate("stiff_wall", duration="3 s").samples
    assert resting.is_at_rest
    assert resting.resting_depth == pytest.approx(resting.depth[-1], rel=0.05)
