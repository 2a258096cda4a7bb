"""Laws, devices, operators and controllers of the user's own, as the pages show them."""

import ast
import dataclasses
import importlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from live_graph import live_graph

from forcebound.errors import ConfigError, DeviceError
from forcebound.graph.loader import load, load_tried
from forcebound.graph.model import always, restore
from forcebound.graph.resolved import to_document
from forcebound.graph.servo import ServoSettings
from forcebound.haptics.parts import user_module
from forcebound.messages.packets import EnvironmentQuery, EnvironmentReply
from forcebound.network.impairment import Impairment
from forcebound.nodes.environment import EnvironmentNode
from forcebound.run.bus import TickTimes, described
from forcebound.run.check import check_part
from forcebound.run.results import RunResult, run_metadata
from forcebound.run.virtual import run_virtual

DOCS = Path(__file__).parent.parent / "docs"
PAGES = ("law", "controller", "device")

HAND = """\
from dataclasses import dataclass

from forcebound.haptics.hands import Operator

from forcebound.messages.packets import Vector


@dataclass(frozen=True)
class StillHand(Operator):
    mass: float = 0.3
    stiffness: float = 500.0
    damping: float = 3.0

    def target(self, elapsed: float) -> Vector:
        return (0.012,)
"""


def block(page: str, language: str) -> str:
    """The first block of code in this language on a page."""
    own = DOCS / f"write-your-own-{page}.md"
    text = (own if own.exists() else DOCS / "write-your-own.md").read_text(encoding="utf-8")
    text = text.partition(f"\n## A {page}\n")[2] or text
    found = re.search(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    assert found is not None
    return found[1]


def write_page(page: str, folder: Path) -> Path:
    """The files of a page, as written there; the path of the launch file."""
    (folder / f"my_{page}.py").write_text(block(page, "python"), encoding="utf-8")
    path = folder / f"my_{page}.yaml"
    path.write_text(block(page, "yaml"), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files of all pages, as written there."""
    folder = tmp_path_factory.mktemp("pages")
    for page in PAGES:
        write_page(page, folder)
    return folder


def simulate_page(page: str, folder: Path, seconds: float = 1.0) -> RunResult:
    return run_virtual(load(folder / f"my_{page}.yaml"), duration=seconds)


@pytest.mark.parametrize("page", PAGES)
def test_the_page_runs_in_virtual_time_twice_the_same(page: str, pages: Path) -> None:
    one, other = (simulate_page(page, pages) for _ in range(2))
    assert (one.columns.position == other.columns.position).all()
    assert (one.columns.applied_force == other.columns.applied_force).all()


def test_the_law_of_the_page_lets_less_through_than_the_exact_bound(pages: Path) -> None:
    reserved = simulate_page("law", pages).summary["peak_force_n"]
    exact = run_virtual(load("stiff_wall", ["law:=aol"]), duration=1.0).summary["peak_force_n"]
    assert 0.0 < reserved < exact


def test_a_law_that_does_not_compile_is_reported_in_one_line(tmp_path: Path) -> None:
    path = write_page("law", tmp_path)
    (law,) = tmp_path.glob("*.py")
    law.write_text(law.read_text().replace("sample.distance", "sample.distanse"))
    with pytest.raises(ConfigError) as error:
        load_tried(path)
    first = str(error.value).splitlines()[0]
    assert ": law: TypingError: Unknown attribute 'distanse'" in first
    assert f"{law.name}:" in first
    assert "nopython" not in str(error.value)


def test_the_controller_of_the_page_holds_the_hand_at_the_wall(pages: Path) -> None:
    summary = simulate_page("controller", pages, seconds=2.0)
    assert summary.columns.commanded_force[-1, 0] > 0.5
    assert summary.columns.position[-1, 0] > 0.010  # the coupling is soft, the proxy at the wall


def test_the_device_of_the_page_slides_to_rest(tmp_path: Path) -> None:
    path = write_page("device", tmp_path)
    path.write_text(path.read_text() + "environment: {position: 1 m}\n")
    columns = run_virtual(load(path), duration=3.0).columns
    assert columns.position[-1, 0] == pytest.approx(0.2 * 0.2 / 0.5, rel=0.01)  # m v / b


def test_numbers_for_other_axes_than_a_device_has_are_refused_where_they_stand(
    tmp_path: Path,
) -> None:
    path = write_page("device", tmp_path)
    text = path.read_text().replace("  push:", "  weight: [0.1 N, 0.1 N]\n  push:")
    path.write_text(text)
    line = text.splitlines().index("  weight: [0.1 N, 0.1 N]") + 1
    with pytest.raises(ConfigError, match=rf"my_device.yaml:{line}:\d+: .*weight .* got 2"):
        load(path)


@pytest.mark.parametrize("page", PAGES)
def test_a_recording_holds_the_text_of_the_file_and_processes_restore_it(
    page: str, tmp_path: Path
) -> None:
    config = load(write_page(page, tmp_path))
    assert run_metadata(config)[f"{page}_source"] == block(page, "python")
    document = json.loads(json.dumps(to_document(config)))
    assert restore(document, always) == config


def test_a_hand_of_ones_own_holds_the_device(tmp_path: Path) -> None:
    (tmp_path / "my_hand.py").write_text(HAND)
    path = tmp_path / "graph.yaml"
    launch = "forcebound: 1\ninclude: stiff_wall.yaml\noperator: {kind: my_hand.py, mass: 0.2}\n"
    path.write_text(launch)
    config = load(path)
    assert config.only.operator is not None
    assert config.only.operator.mass == 0.2
    result = run_virtual(config, duration=1.0)
    assert result.summary["peak_force_n"] > 0.0


@pytest.mark.parametrize(("page", "part"), [("law", "law"), ("device", "device")])
def test_what_is_not_certified_is_logged(
    page: str, part: str, pages: Path, caplog: pytest.LogCaptureFixture
) -> None:
    load_tried(pages / f"my_{page}.yaml")
    (message,) = [r.getMessage() for r in caplog.records if "not certified" in r.getMessage()]
    assert message.startswith(f"{part} {pages}/my_{page}.py:")


@pytest.mark.parametrize("page", PAGES)
def test_what_the_page_shows_passes_its_check(page: str, pages: Path) -> None:
    assert check_part(page, str(pages / f"my_{page}.py"), is_child=True).violations == []


def test_the_check_times_a_tick_of_two_readings_or_of_one_that_a_write_brings(
    tmp_path: Path,
) -> None:
    text = block("device", "python")
    fresh = "    def fresh_reading(self) -> Vector:\n        return (self.x,)\n\n"
    for reads, written in (
        (2, text),
        (1, text.replace("    def close(", f"{fresh}    def close(")),
    ):
        path = tmp_path / f"my_device_{reads}.py"
        path.write_text(written)
        times = check_part("device", str(path), is_child=True).seconds_per_tick
        assert times is not None
        assert times.reads == reads
        assert times.read > 0.0
        assert times.write > 0.0


def test_times_of_a_tick_say_which_rates_they_permit_and_which_write_delay_to_state() -> None:
    times = TickTimes(read=0.002, write=0.001, reads=2, longest=0.0035)
    rates, delay = described(times, None)
    assert "200 Hz" in rates  # two reads of 2 ms and a write of 1 ms
    assert "330 Hz" in rates  # one
    assert "write_delay: 3.9 ms" in delay  # and a tenth, in tenths of a ms, upwards
    at_300_hz = ServoSettings(rate=300.0, reply_wait=0.8)
    assert "write_delay: 4.6 ms" in [*described(times, at_300_hz)][-1]  # 0.8 / 300 Hz + 1.5 ms
    at_100_hz = ServoSettings(rate=100.0, reply_wait=0.8)
    assert [*described(times, at_100_hz)] == [rates, delay]


# Environments with state


def of_the_page(name: str) -> str:
    """The program of the page on environments that has a class."""
    text = (DOCS / "write-your-own-environment.md").read_text(encoding="utf-8")
    blocks: list[str] = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    (program,) = [block for block in blocks if f"class {name}" in block]
    return program


@pytest.mark.parametrize("name", ["Ball", "SprungMass", "Gel"])
def test_an_environment_of_the_page_passes_its_check(name: str, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(of_the_page(name))
    assert check_part("environment", str(tmp_path / "mine.py"), is_child=True).violations == []


def test_the_ball_of_the_page_is_the_one_that_new_writes() -> None:
    written = (DOCS.parent / "examples" / "python" / "my_environment.py").read_text()
    code = ast.parse(written), ast.parse(of_the_page("Ball"))
    for tree in code:
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(
                node
            ):
                del node.body[0]
    assert ast.dump(code[0]) == ast.dump(code[1])


def sprung_mass(folder: Path) -> Path:
    (folder / "my_mass.py").write_text(of_the_page("SprungMass"))
    path = folder / "graph.yaml"
    launch = "forcebound: 1\ninclude: stiff_wall.yaml\nenvironment: {kind: my_mass.py}\n"
    path.write_text(launch)
    return path


def test_the_mass_of_the_page_gives_way_where_a_wall_would_not(tmp_path: Path) -> None:
    config = load(sprung_mass(tmp_path))
    one, other = (run_virtual(config, duration=2.0).columns for _ in range(2))
    assert (one.position == other.position).all()
    assert one.position[-1, 0] == pytest.approx(0.0136, abs=0.0003)
    assert one.commanded_force[-1, 0] > 0.4


def answer_of(node: EnvironmentNode, position: float, elapsed: float) -> float:
    query = EnvironmentQuery(0, 0, 0, 0, elapsed, (position,), (0.0,), None)
    (reply,) = [p for p in node.step(0, [query]) if isinstance(p, EnvironmentReply)]
    return reply.force[0]


@pytest.mark.parametrize("has_change", [True, False])
def test_a_change_of_parameters_keeps_the_state_or_opens_again(
    has_change: bool, tmp_path: Path
) -> None:
    path = sprung_mass(tmp_path)
    if not has_change:
        source = tmp_path / "my_mass.py"
        source.write_text(source.read_text().replace("def change", "def another"))
    model: Any = load(path).environment.model
    node = EnvironmentNode(model)
    first = answer_of(node, 0.02, 0.0)
    moved = [answer_of(node, 0.02, 0.01 * k) for k in range(1, 201)][-1]
    assert moved < first
    node.set(model, Impairment(delay=0.0))  # another computation time: the same instance
    assert answer_of(node, 0.02, 2.0) == pytest.approx(moved, rel=1e-3)
    node.set(dataclasses.replace(model, damping=5.0), Impairment())
    after = answer_of(node, 0.02, 2.0)
    assert (after < 0.9 * first) == has_change


# Devices that fail, and nobody at the device


def failing_device(folder: Path, method: str, code: str) -> Path:
    """The launch file of the page's device, one method of which begins with ``code``."""
    path = write_page("device", folder)
    source = folder / "my_device.py"
    text, count = re.subn(
        rf'(    def {method}\(self.*?\n        """.*?"""\n)',
        rf"\1        {code}\n",
        source.read_text(),
        count=1,
        flags=re.DOTALL,
    )
    assert count == 1
    source.write_text(text)
    return path


@pytest.mark.parametrize(
    ("method", "code", "message"),
    [
        ("read", "if time_ns > 5_000_000: raise DeviceError('unplugged')", "in read: unplugged"),
        ("read", "if time_ns > 5_000_000: return (float('nan'),)", "expected 1 finite numbers"),
        ("read", "if time_ns > 5_000_000: return ()", "expected 1 finite numbers in m, got"),
        ("write", "if time_ns > 5_000_000: return 1 / 0", "in write: ZeroDivisionError"),
        ("engage", "self.nothing", "in engage: AttributeError"),
    ],
)
def test_a_device_that_fails_ends_the_simulation_with_one_sentence_and_is_closed(
    method: str, code: str, message: str, tmp_path: Path
) -> None:
    path = failing_device(tmp_path, method, code)
    log = tmp_path / "closed"
    source = tmp_path / "my_device.py"
    source.write_text(
        source.read_text().replace(
            'zero."""\n        self.force = 0.0',
            f'zero."""\n        with open({str(log)!r}, "a") as log: log.write("closed ")',
        )
    )
    with pytest.raises(DeviceError, match=message):
        run_virtual(load(path), duration=0.1)
    assert log.read_text() == "closed "


@pytest.mark.live
def test_a_device_that_fails_ends_a_live_graph_in_order(tmp_path: Path) -> None:
    path = failing_device(tmp_path, "write", "if force[0] != 0.0: raise DeviceError('unplugged')")
    path.write_text(
        path.read_text() + "environment: {kind: damper, damping: 5 N s/m}\n", encoding="utf-8"
    )
    words = [sys.executable, "-m", "forcebound", "launch", str(path), "--duration", "20 s"]
    out = subprocess.run(words, capture_output=True, text=True, timeout=120)
    assert out.returncode == 1, out.stderr
    assert "the device failed in write: unplugged" in out.stderr
    assert "Traceback" not in out.stderr


@pytest.mark.live
def test_the_controller_of_the_page_runs_live(tmp_path: Path) -> None:
    path = write_page("controller", tmp_path)
    with live_graph(str(path), is_alone=False) as graph:
        graph.wait_until_forced()
        ended = graph.end()
    assert ended.exit_status == 0, ended.log
    assert ended.columns.commanded_force.any()


# Packages of other people


def package(folder: Path, section: str, entry: str, source: str) -> dict[str, str]:
    """An installed package with one entry point; the environment variables that find it."""
    (folder / "lab_parts.py").write_text(source)
    info = folder / "lab_parts-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lab-parts\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[forcebound.{section}]\n{entry}\n")
    path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    return {**os.environ, "PYTHONPATH": path}


def run_python(code: str, environ: dict[str, str]) -> str:
    words = [sys.executable, "-c", code]
    out = subprocess.run(words, capture_output=True, text=True, env=environ, timeout=120)
    assert out.returncode == 0, out.stderr
    return out.stdout.strip()


RUN = """
from forcebound.graph.loader import load
from forcebound.run.virtual import run_virtual
print(run_virtual(load({path!r}), duration=0.3).summary["samples"])
"""


def test_a_package_offers_a_law_through_an_entry_point(tmp_path: Path) -> None:
    environ = package(tmp_path, "laws", "reserved = lab_parts:RESERVED", block("law", "python"))
    path = tmp_path / "graph.yaml"
    path.write_text("forcebound: 1\ninclude: stiff_wall.yaml\ndevice: {law: reserved}\n")
    assert int(run_python(RUN.format(path=str(path)), environ)) > 0


def test_a_package_that_cannot_be_imported_is_named_and_breaks_nothing_else(
    tmp_path: Path,
) -> None:
    environ = package(tmp_path, "environments", "sand = lab_parts:Sand", "import nonsense\n")
    code = """
from forcebound.haptics.environments import ENVIRONMENTS
from forcebound.errors import ConfigError
print("sand" in ENVIRONMENTS, "sand" in ENVIRONMENTS.usable(), "wall" in ENVIRONMENTS.usable())
try:
    ENVIRONMENTS["sand"]
except ConfigError as error:
    print(error)
"""
    told, error = run_python(code, environ).splitlines()
    assert told == "True False True"
    assert error.startswith("cannot import 'sand' of the package lab-parts")
    assert "No module named 'nonsense'" in error


def test_a_module_that_the_program_had_before_stays_when_a_file_of_its_name_is_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "had_before.py").write_text("VALUE = 1\n")
    monkeypatch.syspath_prepend(tmp_path / "first")
    had = importlib.import_module("had_before")
    for name in ("first", "second"):
        user_module._load(tmp_path / name / "had_before.py")
    assert sys.modules.pop("had_before") is had
