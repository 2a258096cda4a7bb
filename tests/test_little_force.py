"""Why a hand felt little stiffness: the first cause, and whether its remedy gives what it names."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import pytest
from builders import MS, telemetry_packet
from launch_texts import written

from forcebound.graph.loader import load
from forcebound.graph.resolved import to_document
from forcebound.messages.control import BounderReport
from forcebound.messages.events import BOUNDER_REPORTED, EventLog
from forcebound.messages.packets import Telemetry
from forcebound.messages.topology import flat
from forcebound.observe.page.feed import RECENT
from forcebound.observe.page.reason import REST, Reason
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.samples import Samples
from forcebound.results.summary import summarize
from forcebound.results.tables import summary_rows
from forcebound.results.twin import Change, Twin
from forcebound.run.results import RunResult
from forcebound.run.simulation import LateTicks
from forcebound.run.virtual import VirtualGraph, run_virtual
from forcebound.testing import parts

DURATION = 1.5  # s; the hand rests in the wall after one
NEAR = 0.1  # of the stiffness that a remedy gives
MISSED = LateTicks(rate=50.0, shortest=1e-3, longest=2e-3)  # 5 % of the ticks
NO_WATCHDOG = "watchdog: none, watchdog_limit: 100 ms"
BOARD = "watchdog: silent, watchdog_tolerance: 0"


PRESSED = TelemetryColumns.from_packets(
    [telemetry_packet(k, commanded_force=(8.0,), applied_force=(1.5,)) for k in range(1000)]
)
DEVICE: dict[str, Any] = {"law": "certified", "rate": 1000.0, "hold_limit": "auto"}


class Case(NamedTuple):
    """A run, its first cause, and the same run with the remedy."""

    file: str
    cause: str
    device: str = ""  # numbers
    arguments: Sequence[str] = ()
    remedied: str | None = None  # numbers of the device; None: the same
    with_arguments: Sequence[str] | None = None  # likewise
    late: LateTicks | None = None


CASES = {
    "no_watchdog": Case(
        "five_bar_wall",
        "watchdog_limit",
        NO_WATCHDOG,
        remedied="watchdog: none, watchdog_limit: 30 ms, allowance: 15 mJ",
    ),
    "no_watchdog_and_missed_ticks": Case(
        "five_bar_wall",
        "watchdog_limit",
        NO_WATCHDOG,
        remedied="watchdog: none, watchdog_limit: 30 ms, allowance: 15 mJ",
        late=MISSED,
    ),
    "missed_ticks": Case("stiff_wall", "missed_ticks", BOARD, late=MISSED),
    "late_answers": Case("stiff_wall", "late_answers", "", ["delay:=5 ms"], None, []),
    "late_answers_of_an_arm": Case("five_bar_wall", "late_answers", "", ["delay:=5 ms"], None, []),
    "write_delay": Case(
        "stiff_wall",
        "write_delay",
        f"{BOARD}, write_delay: 0.4 ms",
        remedied=f"{BOARD}, write_delay: 0.2 ms",
    ),
    "lag": Case("stiff_wall", "lag", f"{BOARD}, lag: 1 ms", remedied=f"{BOARD}, lag: 0.5 ms"),
    "hold_limit": Case("stiff_wall", "hold_limit", "", ["hold_limit:=4"], None, []),
    "fading": Case("stiff_wall", "fading", "", ["law:=certified_fading"], None, []),
    "saturation": Case(
        "stiff_wall",
        "saturation",
        "saturation: 2 N",
        ["law:=none", "stiffness:=2 N/mm"],
        "saturation: 4 N",
    ),
    "engage_ramp": Case("stiff_wall", "engage_ramp", "engage_time: 3 s", ["stiffness:=1 N/mm"], ""),
    "slow_device": Case(
        "stiff_wall",
        "missed_ticks",
        f"{BOARD}, rate: 300 Hz, write_delay: 2 ms",
        remedied=f"{BOARD}, rate: 200 Hz, write_delay: 2 ms",
        late=LateTicks(rate=100.0, shortest=1e-3, longest=6e-3),
    ),
    "dissipation": Case(
        "stiff_wall",
        "dissipation",
        "hand_speed: null",
        [],
        "hand_speed: null, rate: 2 kHz",
    ),
    "attenuates": Case(
        "servo_wall",
        "attenuates",
        "attenuates: freely, gain_error: 0, presliding: 0 deg",
        remedied="attenuates: freely, gain_error: 0, presliding: 0 deg, least_share: 0.5",
    ),
    "knob": Case(
        "knob_wall",
        "watchdog_limit",
        f"{NO_WATCHDOG}, allowance: 1 mJ",
        remedied="watchdog: none, watchdog_limit: 30 ms, allowance: 15 mJ",
    ),
}


def ran(
    folder: Path, file: str, device: str, arguments: Sequence[str], late: LateTicks | None = None
) -> RunResult:
    """Return the run of a launch file with other numbers of its device."""
    path = folder / "case.yaml"
    path.write_text(f"forcebound: 1\ninclude: {file}.yaml\ndevice: {{ {device} }}\n")
    return run_virtual(load(str(path), arguments), DURATION, late_ticks=late)


@pytest.mark.parametrize("name", CASES)
def test_the_remedy_of_the_first_cause_gives_what_it_names(name: str, tmp_path: Path) -> None:
    case = CASES[name]
    run = ran(tmp_path, case.file, case.device, case.arguments, case.late)
    first = run.summary["little_force"][0]
    assert first["cause"] == case.cause
    late = None if case.cause == "missed_ticks" else case.late
    device = case.device if case.remedied is None else case.remedied
    arguments = case.arguments if case.with_arguments is None else case.with_arguments
    remedied = ran(tmp_path, case.file, device, arguments, late).summary
    assert remedied["displayed_stiffness_n_per_m"] == pytest.approx(
        first["data"]["gives"], rel=NEAR
    )


def test_nothing_is_named_where_nothing_is_lost_or_the_stiffness_is_not_known() -> None:
    for file in ("five_bar_wall", "membrane", "touch_sphere"):
        assert run_virtual(load(file), 1.0).summary["little_force"] == []


@pytest.mark.parametrize("law", ["none", "certified"])
@pytest.mark.parametrize("kind", ["wave_variables", "virtual_coupling"])
def test_a_controller_with_a_spring_of_its_own_is_the_cause_and_no_prompt_answer_helps(
    kind: str, law: str
) -> None:
    arguments = [f"controller:={kind}", f"law:={law}"]
    run = run_virtual(load("two_port_wall", arguments), DURATION)
    first, *others = run.summary["little_force"]
    felt = run.summary["stiffness_n_per_m"]
    assert first["cause"] == "soft_controller"
    assert first["data"]["takes"] == pytest.approx(felt["asked"] - felt["felt"], rel=0.1)
    assert "late_answers" not in {one["cause"] for one in others}
    direct = run_virtual(load("two_port_wall", ["controller:=direct", "delay:=0 ms"]), DURATION)
    assert not any(one["cause"] == "soft_controller" for one in direct.summary["little_force"])


def test_a_world_whose_force_has_the_opposite_sign_is_said_to_pull_deeper(tmp_path: Path) -> None:
    source = (
        Path(parts.__file__).read_text().replace("return (push, *still)", "return (-push, *still)")
    )
    written(tmp_path, source, "pad.py")
    case = "forcebound: 1\ninclude: stiff_wall.yaml\nenvironment: {kind: pad.py}\n"
    run = run_virtual(load(written(tmp_path, case)), 1.0)
    assert [cause["cause"] for cause in run.summary["little_force"]] == ["opposite_sign"]


def test_a_higher_rate_is_named_only_where_it_gives_more(tmp_path: Path) -> None:
    punctual = ["stiffness:=20 N/mm", "delay:=0 ms"]
    (cause,) = ran(tmp_path, "five_bar_wall", "", punctual).summary["little_force"]
    assert "rate" not in cause["advice"]
    faster = ran(tmp_path, "five_bar_wall", "rate: 2 kHz", punctual).summary
    assert faster["displayed_stiffness_n_per_m"] < cause["data"]["gives"]


def test_where_a_devices_own_reads_miss_ticks_that_is_said_with_a_rate_that_it_can(
    tmp_path: Path,
) -> None:
    case = CASES["slow_device"]
    run = ran(tmp_path, case.file, case.device, case.arguments, case.late)
    advice = run.summary["little_force"][0]["advice"]
    assert "own reads and writes take 4 ms of a period of 3.3 ms: device.rate: 200 Hz" in advice


def test_the_laws_share_of_a_loss_is_that_of_what_it_lacked(tmp_path: Path) -> None:
    run = ran(tmp_path, "five_bar_wall", NO_WATCHDOG, ["delay:=0 ms"])
    shares = run.summary["stiffness_n_per_m"]["shares"]
    assert shares["watchdog limit"] > 0.9
    assert "law" not in shares
    assert sum(shares.values()) == pytest.approx(1.0)


def test_the_twin_of_a_run_with_its_own_numbers_is_the_run(tmp_path: Path) -> None:
    for file, device in (("stiff_wall", ""), ("three_axes", ""), ("five_bar_wall", NO_WATCHDOG)):
        run = ran(tmp_path, file, device, [])
        twin = Twin(Samples(run.columns, run.document, run.events))
        assert twin.would_feel(Change()) == pytest.approx(twin.felt)
        assert twin.felt == pytest.approx(run.summary["displayed_stiffness_n_per_m"], rel=1e-3)


def test_the_page_names_one_cause_for_as_long_as_a_hand_is_at_rest(tmp_path: Path) -> None:
    path = tmp_path / "case.yaml"
    path.write_text(f"forcebound: 1\ninclude: five_bar_wall.yaml\ndevice: {{ {NO_WATCHDOG} }}\n")
    config, packets = load(str(path)), list[Telemetry]()
    graph = VirtualGraph(
        config, lambda one: packets.append(cast("Telemetry", one)), [Telemetry], MISSED
    )
    graph.run(8_000_000_000)
    reason, seen = Reason(), []
    document = flat(to_document(config))
    for end in range(REST, len(packets), REST):
        recent = packets[max(end - RECENT, 0) : end], ()
        seen.append(reason.look(recent, lambda columns: Samples(columns, document)))
    causes = [one.partition(" (")[0] for one in seen]
    assert causes[0] == ""  # it moves
    assert set(causes[2:]) == {"without a watchdog each force is planned for 100 ms"}


def test_the_report_of_the_bounder_is_in_the_summary() -> None:
    report = BounderReport(
        overruns=3,
        hold_limit=1.1e-3,
        longest_hold_limit=4e-3,
        refused_readings=2,
        late_writes=5,
        longest_write_delay=2e-4,
        largest_allowance=5e-4,
        allowance_repaid=True,
    )
    events = [EventLog("device").emit(9 * MS, BOUNDER_REPORTED, "", report.as_texts())]
    sources = {"damping": "measured", "friction": "measured", "lag": "assumed"}
    device = DEVICE | {"energy_cap": 0.02, "sources": sources}
    summary = summarize(PRESSED, {"device": device}, events)
    assert summary["hold_limit_overruns"] == 3
    assert summary["hold_limit_ms"] == pytest.approx({"mean": 1.1, "longest": 4.0})
    rows = dict(summary_rows(summary))
    assert rows["hold limit mean/longest"] == "1.10/4.00 ms"
    assert rows["refused readings"] == "2"
    late = "5, up to 0.2 ms after the reading: device.write_delay"
    assert rows["writes later than stated"] == late
    assert rows["largest allowance used"] == "0.500 mJ, repaid"
    assert rows["energy cap"] == "20.00 mJ"
    assert rows["numbers of the device"] == "1 assumed, 2 measured"


def test_a_run_without_a_report_says_nothing_of_it() -> None:
    summary = summarize(PRESSED, {"device": DEVICE})
    assert summary["refused_readings"] is None
    assert summary["hold_limit_ms"] == {"mean": None, "longest": None}
    assert "refused readings" not in dict(summary_rows(summary))


def test_a_punctual_run_reports_its_bounder() -> None:
    summary = run_virtual(load("stiff_wall"), 1.0).summary
    assert summary["hold_limit_overruns"] == 0
    assert summary["hold_limit_ms"] == pytest.approx({"mean": 1.02, "longest": 1.02})
