import math
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks import __main__ as page
from benchmarks import delay, harness
from benchmarks.harness import Figure, Measured, beyond, compare
from forcebound.errors import RunError
from forcebound.observe.measure import SHARES, Round, apart, percentile, plan, serving
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


def test_a_target_that_a_busy_machine_missed_is_not_called_missed() -> None:
    missed, reached = Figure("tick", 3.0, "us", 2.0), Figure("tick", 1.0, "us", 2.0)
    assert [page.figure_row(missed, is_busy)[-1] for is_busy in (False, True)] == ["no", "busy"]
    assert page.figure_row(reached, True)[-1] == "yes"


def test_why_a_benchmark_did_not_run_has_no_path_of_this_machine_and_one_line(
    tmp_path: Path,
) -> None:
    with pytest.raises(OSError, match="No such file") as raised:
        (tmp_path / "haply.truth").read_text()
    shown = page.reason(RunError(f"no emulator, {tmp_path}/a.truth: {raised.value}\nTraceback"))
    assert str(tmp_path) not in shown
    assert "\n" not in shown
    assert "No such file" in shown
    assert "3 N/mm" in page.reason(RunError("3 N/mm is too stiff"))


def test_the_published_page_states_the_load_and_no_temporary_path() -> None:
    text = (Path(__file__).parent.parent / "docs/benchmarks.md").read_text(encoding="utf-8")
    assert "| load average | " in text
    assert "/tmp/" not in text
    assert "Traceback" not in text


@pytest.mark.live
@needs_compiler
@pytest.mark.parametrize("name", [name for name in page.NAMES if name not in page.SLOW])
def test_a_short_run_gives_every_figure(name: str) -> None:
    import importlib

    contestants, figures = importlib.import_module(f"benchmarks.{name}").run(0.3, 1000.0)
    for one in contestants:
        times = [one.at(share) for share in SHARES]
        assert times == sorted(times), one.label
    assert figures
    assert all(math.isfinite(one.value) for one in figures)
    text = page.section(name, (contestants, figures))
    assert all(f"| {one.what} |" in text for one in figures)
    assert all(f"| {one.label} |" in text for one in contestants)
