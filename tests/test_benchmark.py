import importlib
import json
import math
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from click.testing import CliRunner

from benchmarks import __main__ as command
from benchmarks import delay, harness, page
from benchmarks.harness import BareLoop, Figure, Measured, Result, beyond, compare
from forcebound.errors import DeviceError, RunError
from forcebound.observe.measure import SHARES, Round, Timing, apart, percentile, plan, serving
from forcebound.realtime import Settings

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
ORDINARY = Settings(policy="other")


def measured(*rounds: list[int], label: str = "one") -> Measured:
    return Measured(label, [Round(times_ns, 1, 10, 100) for times_ns in rounds])


def test_a_percentile_is_the_smallest_value_that_so_many_do_not_exceed() -> None:
    both = [Round(range(51, 101)), Round(range(1, 51))]
    found = {name: percentile(both, name) for name in SHARES}
    assert found == {"p50": 50, "p99": 99, "p99_9": 100, "max": 100}
    with pytest.raises(RunError):
        percentile([Round([])], "p50")


def test_the_ratio_is_of_all_rounds_and_the_spread_of_neighbours() -> None:
    ours, limit = measured([100], [300], label="ours"), measured([100], [100], label="limit")
    compared = compare(ours, limit, "max", 2.0)
    assert (compared.value, compared.lowest, compared.highest) == (3.0, 1.0, 3.0)
    assert not compared.reached


def test_what_is_beyond_is_counted_from_the_median_of_the_baseline() -> None:
    ours = measured([5000, 9000, 9000], [6000, 7000, 8000], label="ours")
    own = measured([1000, 2000, 9000], [3000, 3000, 3000], label="own")
    found = beyond(ours, own, "max", 6.0)
    assert (found.value, found.lowest, found.highest, found.reached) == (6.0, 5.0, 7.0, True)


@pytest.mark.parametrize(
    ("duration", "contestants", "expected"),
    [(30.0, 3, (10, 1000)), (4.0, 4, (1, 1000)), (7.5, 3, (2, 1250)), (0.01, 2, (1, 20))],
)
def test_a_duration_is_shared_out_in_rounds_of_about_a_second(
    duration: float, contestants: int, expected: tuple[int, int]
) -> None:
    rounds, timing = plan(duration, contestants, rate=1000.0)
    assert (rounds, timing) == (expected[0], (1_000_000, expected[1]))


@pytest.mark.parametrize("name", [name for name in delay.LINKS if "ms" in name])
def test_the_watched_link_knows_what_it_adds(name: str) -> None:
    link = delay.WatchedLink(delay.LINKS[name])
    sender = delay.SenderNode(1_000_000)
    assert sender.wake_ns is not None
    (packet,) = sender.step(sender.wake_ns, ())
    link.accept(packet.time_ns, packet)
    due_ns = link.next_due_ns
    assert due_ns is not None
    assert link.added_ns[packet.seq] == due_ns - packet.time_ns


def test_conditions_name_date_commit_and_machine() -> None:
    found = harness.conditions()
    assert {"date", "commit", "processor", "kernel", "load average"} <= set(found)
    assert all(found.values())


def fail(_: object) -> Round:
    raise ValueError


@pytest.mark.live
def test_a_contestant_that_fails_is_named(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RunError, match="fail"):
        apart(fail, (1, 1))
    assert "ValueError" in capfd.readouterr().err


def wait_for_ever(folder: Path) -> None:
    import os
    import time

    (folder / "new").write_text(str(os.getpid()))
    (folder / "new").rename(folder / "pid")
    time.sleep(1000.0)


@pytest.mark.live
def test_a_process_ends_with_what_needs_it_even_if_that_fails(tmp_path: Path) -> None:
    def failing() -> Iterator[None]:
        with serving(wait_for_ever, tmp_path):
            yield
            raise RuntimeError

    body = failing()
    next(body)
    while not (tmp_path / "pid").exists():
        pass
    pid = (tmp_path / "pid").read_text()
    with pytest.raises(RuntimeError):
        next(body)
    assert not Path(f"/proc/{pid}").exists()


def test_why_a_benchmark_did_not_run_has_no_path_of_this_machine_and_one_line(
    tmp_path: Path,
) -> None:
    with pytest.raises(OSError, match="No such file") as raised:
        (tmp_path / "haply.truth").read_text()
    shown = command.reason(RunError(f"no emulator, {tmp_path}/a.truth: {raised.value}\nTraceback"))
    assert str(tmp_path) not in shown
    assert "\n" not in shown
    assert "No such file" in shown
    assert "3 N/mm" in command.reason(RunError("3 N/mm is too stiff"))


def steady(*means: float, label: str = "one") -> Measured:
    """A contestant between whose rounds the bare loop took these times, in us; the median is 20."""
    loops = [BareLoop(1e3 * mean, 20e3) for mean in means]
    return Measured(label, [Round([1000], 1, 10, 100)] * (len(means) - 1), loops)


@pytest.mark.parametrize(
    ("means", "counts"),
    [
        ((20.0, 21.0, 25.9), True),
        ((20.0, 27.0, 20.0), False),  # busy for a while
        ((40.0, 40.0, 40.0), False),  # busy all the time, so each mean is far from the median
    ],
)
def test_numbers_count_if_the_bare_loop_stays_within_its_limit(
    means: tuple[float, ...], counts: bool
) -> None:
    refused = page.refusal("servo", ([steady(20.0, 20.0), steady(*means)], []))
    if counts:
        assert refused is None
    else:
        assert refused is not None
        assert refused.startswith("servo: ")
        assert f"{max(means) / 20.0:.2f}" in refused


def test_a_loop_that_is_faster_later_shows_that_it_was_slow_before() -> None:
    slow, fast = BareLoop(30e3, 29e3), BareLoop(20e3, 19e3)
    assert page.refusal("loop", ([Measured("one", [], [slow, fast])], [])) is not None


@pytest.mark.live
def test_the_bare_loop_is_measured_before_and_after_each_round_and_moves_nobody() -> None:
    cores = os.sched_getaffinity(0)
    found: list[set[int]] = []

    def contestant(_: Timing) -> Round:
        found.append(os.sched_getaffinity(0))
        return Round([1])

    one, other = harness.alternate(0.1, 1000.0, {"one": contestant, "other": contestant}, 2)
    assert found == [cores] * 4
    assert len(one.loops) == len(other.loops) == 3
    assert all(0.0 < loop.median_ns < math.inf and loop.mean_ns > 0.0 for loop in one.loops)
    assert os.sched_getaffinity(0) == cores


FIGURES = [
    Figure("tick, p99", 61.0, "us", 60.0, shown="(p99)"),
    Figure("tick / C", 2.5, "", shown="a loop in C"),
    Figure("speed", 4321.0, "", 3000.0, True),
]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Run the command with made-up benchmarks, each of a result or an error."""

    def run(*arguments: str, **benchmarks: Result | Exception) -> Any:
        monkeypatch.setattr(command, "NAMES", tuple(benchmarks))
        for name, outcome in benchmarks.items():
            module = ModuleType(name)
            vars(module).update(ASKED=f"what {name} asks", DURATION=1.0)

            def measure(*_: float, outcome: Result | Exception = outcome) -> Result:
                if isinstance(outcome, Exception):
                    raise outcome
                return outcome

            vars(module)["run"] = measure
            monkeypatch.setitem(sys.modules, f"benchmarks.{name}", module)
        return CliRunner().invoke(command.main, arguments)

    return run


GOOD: Result = ([steady(20.0, 21.0)], FIGURES[1:])


def test_the_page_has_a_row_for_each_benchmark_and_the_rounds_are_beside_it(
    bench: Callable[..., Any], tmp_path: Path
) -> None:
    file = tmp_path / "page.md"
    other: Result = ([steady(20.0, 22.0)], FIGURES[1:])
    assert bench("--page", str(file), one=GOOD, other=other).exit_code == 0
    text = file.read_text(encoding="utf-8")
    assert "| what one asks | 2.5 times a loop in C | `one` |" in text
    assert "speed" not in text  # not a figure of the page
    assert "within 1.10." in text
    assert f"| commit | {harness.conditions()['commit']} |" in text
    found = json.loads(file.with_suffix(".json").read_text())
    assert list(found["benchmarks"]) == ["one", "other"]
    (contestant,) = found["benchmarks"]["other"]["contestants"]
    assert contestant["rounds"] == [
        {"times_ns": [1000], "missed": 1, "processor_ns": 10, "elapsed_ns": 100}
    ]
    assert [loop["mean_ns"] for loop in contestant["bare_loop"]] == [20e3, 22e3]


def test_a_missed_target_is_named_and_the_page_is_written(
    bench: Callable[..., Any], tmp_path: Path
) -> None:
    file = tmp_path / "page.md"
    ended = bench("--page", str(file), one=([steady(20.0, 21.0)], FIGURES))
    assert ended.exit_code == 1
    assert ended.stderr.splitlines() == ["one: tick, p99: 61 us, target at most 60 us"]
    assert "| what one asks | 61 us (p99), 2.5 times a loop in C | `one` |" in file.read_text()


@pytest.mark.parametrize(
    "outcome",
    [([steady(20.0, 30.0)], FIGURES), DeviceError("no emulator"), ValueError("a mistake")],
)
def test_nothing_is_written_if_a_benchmark_failed_or_was_disturbed(
    bench: Callable[..., Any], tmp_path: Path, outcome: Any
) -> None:
    ended = bench("--page", str(tmp_path / "page.md"), good=GOOD, bad=outcome, more=GOOD)
    assert ended.exit_code == 2
    (line,) = ended.stderr.splitlines()  # no missed target: on such a machine it says nothing
    assert line.startswith("bad: ")
    assert ("1.50" if isinstance(outcome, tuple) else type(outcome).__name__) in line
    assert list(tmp_path.iterdir()) == []


def test_without_a_page_the_others_still_run(bench: Callable[..., Any]) -> None:
    ended = bench("--json", bad=DeviceError("no emulator"), good=GOOD)
    assert ended.exit_code == 2
    assert list(json.loads(ended.stdout)["benchmarks"]) == ["good"]


def test_a_page_is_of_all_benchmarks(bench: Callable[..., Any], tmp_path: Path) -> None:
    assert bench("one", "--page", str(tmp_path / "page.md"), one=GOOD).exit_code == 2
    assert list(tmp_path.iterdir()) == []


def test_the_published_page_has_the_row_of_each_benchmark() -> None:
    text = (Path(__file__).parent.parent / "docs/benchmarks.md").read_text(encoding="utf-8")
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if line.endswith("` |")]
    modules = {name: importlib.import_module(f"benchmarks.{name}") for name in command.NAMES}
    assert [(row[0], row[-1]) for row in rows] == [
        (module.ASKED, f"`{name}`") for name, module in modules.items()
    ]


@pytest.mark.live
@needs_compiler
@pytest.mark.parametrize("name", [name for name in command.NAMES if name not in command.SLOW])
def test_a_short_run_gives_every_figure(name: str) -> None:
    module = importlib.import_module(f"benchmarks.{name}")
    contestants, figures = module.run(0.3, 1000.0)
    for one in contestants:
        times = [one.at(share) for share in SHARES]
        assert times == sorted(times), one.label
    assert figures
    assert all(math.isfinite(one.value) for one in figures)
    assert all(len(one.loops) == len(one.rounds) + 1 for one in contestants if one.rounds)
    row = page.page({}, {name: (module.ASKED, (contestants, figures))})
    assert f"| {module.ASKED} | " in row
    assert f" | `{name}` |" in row
    assert any(one.shown for one in figures)
