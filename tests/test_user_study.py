"""User studies: the file, the order, the session, its data, simulated observers, the analysis."""

import csv
import errno
import math
import os
import re
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from random import Random
from statistics import NormalDist, fmean
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import CliRunner

from forcebound.cli import main
from forcebound.errors import ConfigError
from forcebound.graph.loader import read_template
from forcebound.graph.problems import Problems
from forcebound.lab.study import analysis
from forcebound.lab.study.analysis import Data
from forcebound.lab.study.data import COLUMNS
from forcebound.lab.study.markers import Markers, find_lsl
from forcebound.lab.study.measures import Measures, measure
from forcebound.lab.study.observers import Observer
from forcebound.lab.study.order import blocks_of, next_trial, staircase, total
from forcebound.lab.study.plan import SHIPPED, Staircase, Study, load_study, read_study
from forcebound.lab.study.psychometric import JND75, fit
from forcebound.lab.study.report import write_report
from forcebound.lab.study.session import Session
from forcebound.run.virtual import run_virtual

IN_BAND = {"slow": 0.035, "fast": 0.2}  # m/s
TEXT = (SHIPPED / "friction.yaml").read_text()
SHORT = TEXT.replace("repetitions: 30", "repetitions: 2").replace(
    "repetitions: 3 }", "repetitions: 1 }"
)
STAIRCASE = (
    "method: {kind: staircase, argument: stiffness, standard: 1 N/mm,"
    " start: 2 N/mm, step: 0.2 N/mm}"
)
CONSTANT = (
    "method: {kind: constant_stimuli, argument: stiffness, standard: 1 N/mm,"
    " levels: [0.7 N/mm, 1.0 N/mm, 1.3 N/mm], repetitions: 4}"
)


def with_method(method: str) -> str:
    text = re.sub(r"method:.*?\n\n", f"{method}\n\n", TEXT, flags=re.DOTALL)
    text = re.sub(r"  viscous:.*\n", "", text)
    text = re.sub(r"  fast:.*?\n\n", "\n", text, count=1, flags=re.DOTALL)
    return re.sub(r"  fast:.*\n", "", text)


def study_of(text: str, folder: Path) -> Study:
    (folder / "own.yaml").write_text(text)
    return load_study(folder / "own.yaml")


def advance(session: Session, answers: int = 10_000, choice: Any = 1) -> None:
    """Answer so many questions, with touches in the band."""
    while (step := session.step).kind != "finished":
        if step.kind == "touch":
            assert step.trial is not None
            session.begin()
            session.touched(Measures(IN_BAND.get(step.trial.block), 0.001, 1.0, 1000.0))
        elif step.kind == "question":
            session.answer(choice)
            answers -= 1
            if answers == 0:
                return
        else:
            session.go_on()


def rows_in(folder: Path) -> list[dict[str, str]]:
    with (folder / "trials.csv").open(newline="") as file:
        return list(csv.DictReader(file))


# The file


def test_the_papers_study_has_the_papers_numbers() -> None:
    study = load_study("friction")
    main_touches = 2 * (total(study) or 0) - 2 * len(study.blocks) * study.training.repetitions
    assert main_touches == 120
    assert study.blocks["slow"].band == (0.02, 0.05)
    assert study.blocks["fast"].band == (0.15, 0.25)


@pytest.mark.parametrize(
    ("old", "new", "place", "word"),
    [
        ("viscous]]", "viscos]]", "20:10", "'viscous'"),
        ("[20 mm/s, 50 mm/s]", "[50 mm/s, 20 mm/s]", "25:11", "band"),
        ("[20 mm/s, 50 mm/s]", "[60 m/s, 80 m/s]", "25:11", "5 m/s"),
        ("[20 mm/s, 50 mm/s]", "[20 N, 50 N]", "25:12", "speed"),
        ("repetitions: 30", "repetitions: 0", "21:16", "1 to 1000"),
        ("{ law: more_conservative }", "{ lw: more_conservative }", "15:22", "'law'"),
        ("law: more_conservative }", "law: more_conservativ }", "15:13", "'more_conservative'"),
        ("launch: paper_wall", "launch: paper_wal", "12:9", "paper_wall"),
        ("launch: paper_wall", "launch: push_mass", "15:13", "flat wall"),
        ("noise: white", "noise: blue", "39:8", "pink"),
        ("line: 10 mm", "line: 10 N", "33:9", "length"),
        ("question:", "quest:", "31:1", "'question'"),
        ("kind: forced_choice", "kind: force", "19:3", "staircase"),
        ("  slow: { people", "  slw: { people", "43:3", "'slow'"),
    ],
)
def test_a_wrong_study_file_is_refused_at_its_place(
    old: str, new: str, place: str, word: str, tmp_path: Path
) -> None:
    assert old in TEXT
    with pytest.raises(ConfigError, match=re.escape(word)) as caught:
        study_of(TEXT.replace(old, new), tmp_path)
    assert f"own.yaml:{place}:" in str(caught.value)


def test_a_launch_file_of_many_conditions_is_read_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[Path] = []

    def counted(file: Path) -> Any:
        read.append(file)
        return read_template(file)

    monkeypatch.setattr("forcebound.lab.study.plan.read_template", counted)
    study = study_of(TEXT.replace("  viscous:", "  third: {}\n  viscous:"), tmp_path)
    assert len(study.conditions) == 3
    assert len(read) == 1


def test_levels_have_the_unit_of_the_standard(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"own.yaml:17:9: .*'1 N/mm'"):
        study_of(with_method(STAIRCASE.replace("2 N/mm", "2 kN/m")), tmp_path)


def test_a_level_reaches_the_graph(tmp_path: Path) -> None:
    study = study_of(with_method(CONSTANT), tmp_path)
    models: list[Any] = [study.config(counted).environment.model for counted, _ in study.pairs]
    assert [model.stiffness for model in models] == pytest.approx([700.0, 1000.0, 1300.0])


# The order


def test_each_block_is_first_and_follows_each_other_equally_often(tmp_path: Path) -> None:
    text = TEXT.replace("blocks:\n", "blocks:\n  a: {}\n", 1)
    for extra in ("", "  b: {}\n"):
        study = study_of(text.replace("  a: {}\n", f"  a: {{}}\n{extra}"), tmp_path)
        count = len(study.blocks)
        orders = [blocks_of(study, number) for number in range(2 * count)]
        for place in range(count):
            assert set(Counter(order[place] for order in orders).values()) == {2}
        follows = Counter(pair for order in orders for pair in pairwise(order))
        assert len(follows) == count * (count - 1)
        assert set(follows.values()) == {2}


def all_trials(study: Study, number: int) -> list[Any]:
    trials, rows = [], list[dict[str, str]]()
    while (trial := next_trial(study, number, rows)) is not None:
        trials.append(trial)
        rows.append({"block": trial.block})
    return trials


def test_the_order_is_drawn_from_seed_and_number_and_balanced() -> None:
    study = load_study("friction")
    trials = all_trials(study, 0)
    assert trials == all_trials(study, 0)
    assert trials != all_trials(study, 2)  # same blocks, other trials
    assert len({trial.seed for trial in trials}) == len(trials) == total(study) == 66
    mains = [trial for trial in trials if trial.phase == "main"]
    firsts = Counter((trial.block, trial.counted_first) for trial in mains)
    assert set(firsts.values()) == {15}
    assert [trial.phase for trial in trials[:4]] == ["training"] * 3 + ["main"]


def test_a_staircase_halves_its_step_and_stays_above_the_standard() -> None:
    method = Staircase(
        kind="staircase", argument="k", standard="1", start="1.4", step="0.2", coarse=1
    )
    assert staircase(method, [True])[0] == pytest.approx(1.4)
    level, none = staircase(method, [True, True])
    assert level == pytest.approx(1.2)
    assert none == []
    level, reversals = staircase(method, [True, True, False])
    assert level == pytest.approx(1.3)
    assert reversals == pytest.approx([1.2])
    assert staircase(method, [True] * 20)[0] == pytest.approx(1.1)


def test_a_staircase_converges_to_71_percent_of_a_known_observer() -> None:
    sigma, rng = 0.5, Random(3)
    method = Staircase(
        kind="staircase",
        argument="k",
        standard="1 N/mm",
        start="3 N/mm",
        step="0.1 N/mm",
        reversals=100,
        most=1000,
    )
    answers: list[bool] = []
    for _ in range(800):
        level, _ = staircase(method, answers)
        answers.append(rng.random() < NormalDist().cdf((level - 1.0) / sigma))
    expected = 1.0 + sigma * NormalDist().inv_cdf(math.sqrt(0.5))
    assert fmean(staircase(method, answers)[1][10:]) == pytest.approx(expected, abs=0.06)


# The session and its data


def test_a_session_leads_through_instruction_touches_question_feedback_and_breaks(
    tmp_path: Path,
) -> None:
    study = study_of(SHORT.replace("every: 15", "every: 2"), tmp_path)
    seen = []
    with Session(study, tmp_path / "data", "p1") as session:
        while (step := session.step).kind != "finished":
            assert session.step == step  # asking changes nothing
            seen.append(step.kind)
            if step.kind == "touch":
                assert step.trial is not None
                assert session.touched(Measures(IN_BAND[step.trial.block]))
            elif step.kind == "question":
                session.answer(2, 0.7)
            else:
                session.go_on()
        assert session.progress == (6, 6)
    trial = ["touch", "touch", "question"]
    first_block = ["instruction", *trial, "feedback", *trial, "break", *trial]
    second = ["instruction", *trial, "feedback", "break", *trial, *trial]
    assert seen == first_block + second
    rows = rows_in(tmp_path / "data/p1")
    assert [row["trial"] for row in rows] == list("123456")
    assert {row["response_time"] for row in rows} == {"0.7"}
    assert tuple(rows[0]) == COLUMNS


@pytest.mark.parametrize(("repeat", "left"), [("touch", 1), ("trial", 2), ("nothing", 0)])
def test_a_touch_out_of_the_band_is_repeated_as_the_file_says(
    repeat: str, left: int, tmp_path: Path
) -> None:
    study = study_of(SHORT.replace("repeat: touch", f"repeat: {repeat}"), tmp_path)
    with Session(study, tmp_path / "data", "p1") as session:
        session.go_on()
        assert session.touched(Measures(0.035))
        refused = session.step.config
        assert refused is not None
        assert session.touched(Measures(0.2)) is (repeat == "nothing")
        touches = 0
        while (step := session.step).kind == "touch":
            assert step.config is not None
            assert step.config.seed != refused.seed  # another trial of chance, not the same again
            session.touched(Measures(0.035))
            touches += 1
        assert touches == left


def test_a_session_goes_on_after_its_process_was_killed(tmp_path: Path) -> None:
    """The process kills itself at the worst moments: while a row is written, and in a trial."""
    study, data = study_of(SHORT, tmp_path), tmp_path / "data"
    program = f"""
import os, signal, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from pathlib import Path
from test_user_study import *
study = load_study(Path({str(tmp_path / "own.yaml")!r}))
with Session(study, Path({str(data)!r}), "p1") as session:
    advance(session, 2)
    if sys.argv[1] == "in_row":
        with (session.folder / "trials.csv").open("ab") as file:
            file.write(b"3,slow,main,per")
    else:
        session.go_on(); session.touched(Measures(0.035))
    os.kill(os.getpid(), signal.SIGKILL)
"""
    for moment, answered in (("in_row", 2), ("in_trial", 4)):
        done = subprocess.run(
            [sys.executable, "-c", program, moment], capture_output=True, text=True
        )
        assert done.returncode == -signal.SIGKILL, done.stderr
        with Session(study, data, "p1") as session:
            assert session.progress == (answered, 6)
    with Session(study, data, "p1") as session:
        advance(session)
    rows = rows_in(data / "p1")
    assert [row["trial"] for row in rows] == list("123456")  # none lost, none twice
    with Session(study, tmp_path / "whole", "p1") as session:
        advance(session)
    ignored = {"started", "answered"}
    for ours, whole in zip(rows, rows_in(tmp_path / "whole/p1"), strict=True):
        assert {k: v for k, v in ours.items() if k not in ignored} == {
            k: v for k, v in whole.items() if k not in ignored
        }


def test_a_participant_has_one_session_at_a_time(tmp_path: Path) -> None:
    study = study_of(SHORT, tmp_path)
    with Session(study, tmp_path / "data", "p1") as session:
        advance(session, 1)
        with pytest.raises(ConfigError, match="another session"):
            Session(study, tmp_path / "data", "p1")
        advance(session, 1)
    assert len(rows_in(tmp_path / "data/p1")) == 2


def test_data_of_another_study_or_kind_are_kept_apart(tmp_path: Path) -> None:
    study, data = study_of(SHORT, tmp_path), tmp_path / "data"
    with Session(study, data, "p1") as session:
        advance(session, 1)
    before = (data / "p1/trials.csv").read_bytes()
    with pytest.raises(ConfigError, match="another version"):
        Session(study_of(SHORT.replace("white", "pink"), tmp_path), data, "p1")
    with pytest.raises(ConfigError, match="another version"):
        Session(study_of(SHORT.replace("white", "pink"), tmp_path), data, "p2")
    for name in ("p1", "p2"):
        with pytest.raises(ConfigError, match="another kind"):
            Session(study, data, name, "rehearsal")
    Observer(1).session(study, tmp_path / "simulated", "s1").__exit__()
    with pytest.raises(ConfigError, match="another observer"):
        Observer(1, weber=0.5).session(study, tmp_path / "simulated", "s1")
    assert (data / "p1/trials.csv").read_bytes() == before
    Session(study, data, "p1").__exit__()  # a refused session has left no lock


@pytest.mark.parametrize("name", ["", "Jane Doe", "../p1", "a" * 33, "simulated:3"])
def test_an_identifier_is_no_name_and_no_path(name: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="identifier"):
        Session(load_study("friction"), tmp_path / "data", name)
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize(("first", "second"), [("007", "7"), ("p07", "P7"), ("Lab-a1", "lab-A01")])
def test_two_ways_to_write_an_identifier_are_no_two_people(
    tmp_path: Path, first: str, second: str
) -> None:
    study = study_of(SHORT, tmp_path)
    with Session(study, tmp_path / "data", first):
        pass
    with pytest.raises(ConfigError, match=f"data of {first}: {second} "):
        Session(study, tmp_path / "data", second)
    assert not (tmp_path / "data" / second).exists()
    for another in (first, "70", "p70", "a7"):
        with Session(study, tmp_path / "data", another):
            pass


def test_a_full_disk_is_met_before_the_first_trial(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = SimpleNamespace(free=100_000_000)  # bytes: no room for recordings
    monkeypatch.setattr("forcebound.lab.study.session.shutil.disk_usage", lambda path: usage)
    with pytest.raises(ConfigError, match="MB"):
        Session(load_study("friction"), tmp_path / "data", "p1")
    Session(load_study("friction"), tmp_path / "data", "s1", "simulated").__exit__()


def test_a_disk_that_becomes_full_leaves_whole_rows_and_the_question_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    study = study_of(SHORT, tmp_path)
    with Session(study, tmp_path / "data", "p1") as session:
        advance(session, 1)
        with monkeypatch.context() as patched:
            patched.setattr(os, "fsync", full)
            with pytest.raises(OSError, match="space"):
                advance(session, 1)
        assert session.step.kind == "question"
        assert len(rows_in(tmp_path / "data/p1")) == 1
        session.answer(1)
    assert len(rows_in(tmp_path / "data/p1")) == 2


def test_the_folder_says_what_was_run_and_who_never(tmp_path: Path) -> None:
    study = study_of(SHORT, tmp_path)
    for name in ("p1", "p2"):
        with Session(study, tmp_path / "data", name) as session:
            assert session.number == int(name[1]) - 1
    folder = tmp_path / "data/p1"
    assert (folder / "study.yaml").read_text() == SHORT
    assert '"more_conservative_viscous"' in (folder / "launch.json").read_text()
    assert {"versions", "machine", "digest"} <= set(
        re.findall(r'"(\w+)":', (folder / "participant.json").read_text())
    )


def test_trial_events_go_to_the_graph_and_out_as_markers(tmp_path: Path) -> None:
    pushed: list[str] = []
    lsl = SimpleNamespace(
        IRREGULAR_RATE=0.0,
        StreamInfo=lambda *about: about,
        StreamOutlet=lambda about: SimpleNamespace(
            push_sample=lambda sample: pushed.extend([about[0], *sample])
        ),
    )
    events: list[tuple[str, Mapping[str, str]]] = []
    study = study_of(SHORT, tmp_path)
    mark = Markers(lambda kind, message, data: events.append((kind, data)), lsl)
    with Session(study, tmp_path / "data", "p1", mark=mark) as session:
        session.go_on()
        session.begin()
        assert not session.touched(Measures(5.0))  # to be repeated
        advance(session, 1)
    kinds = [kind for kind, _ in events]
    touch = ["touch_begins", "touch_ends"]
    assert kinds == ["trial_begins", *touch, *touch, *touch, "trial_ends"]
    assert events[1][1]["law"].startswith("more_conservative")
    assert events[4][1]["speed"] in ("0.035", "0.2")
    assert events[-1][1]["answer"] == "1"
    assert pushed[::2] == ["forcebound"] * 8
    assert '"event": "trial_begins"' in pushed[1]


def test_markers_without_pylsl_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pylsl", None)
    with pytest.raises(ConfigError, match="pylsl"):
        find_lsl("machine")


def test_markers_are_found_on_this_machine_alone_unless_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    contents: list[str] = []
    monkeypatch.setitem(sys.modules, "pylsl", SimpleNamespace(set_config_content=contents.append))
    find_lsl("machine")
    assert "ResolveScope = machine" in contents[0]


# Measures and simulated observers


def test_the_measures_of_a_touch_are_those_of_physics() -> None:
    """A slow steady hand on a soft wall: penetration = force / stiffness; the speed of the hand."""
    from forcebound.graph.loader import load

    settings = ["law:=none", "stiffness:=1 N/mm", "approach_speed:=40 mm/s"]
    found = measure(run_virtual(load("stiff_wall", settings)), line=0.010, touch_time=2.0)
    assert found.speed == pytest.approx(0.040, rel=0.1)
    assert found.stiffness == pytest.approx(1000.0, rel=0.02)
    assert found.penetration is not None
    assert found.force == pytest.approx(1000.0 * found.penetration, rel=0.02)
    late = measure(run_virtual(load("stiff_wall", settings)), line=0.030, touch_time=2.0)
    assert late.speed is None  # the hand began after the line


@pytest.fixture(scope="module")
def simulated_study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    text = SHORT.replace("repetitions: 2", "repetitions: 4")
    return study_of(text, tmp_path_factory.mktemp("study"))


@pytest.fixture(scope="module")
def simulated(simulated_study: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulated")
    for name in ("a", "b"):
        Observer(1).take_part(simulated_study, folder / "data", name)
    return folder


def test_simulated_observers_keep_to_the_band_and_say_that_they_are_simulated(
    simulated_study: Study, simulated: Path
) -> None:
    rows = rows_in(simulated / "data/a")
    assert {row["kind"] for row in rows} == {"simulated"}
    for row in rows:
        for place in (1, 2):
            assert simulated_study.blocks[row["block"]].holds(float(row[f"speed_{place}"]))
    seeds = [
        row[f"seed_{n}"] for one in "ab" for row in rows_in(simulated / "data" / one) for n in "12"
    ]
    assert len(set(seeds)) == len(seeds) == 40
    viscous = analysis.touches(rows, "viscous", "stiffness")
    assert viscous == pytest.approx([540.0] * len(viscous), rel=0.03)  # 2B, whatever the hand


def test_a_simulated_study_is_repeated_to_the_bit_also_after_a_break(
    simulated_study: Study, simulated: Path
) -> None:
    ignored, again = ("started", "answered"), simulated / "again"
    whole = [[row[k] for k in COLUMNS if k not in ignored] for row in rows_in(simulated / "data/a")]
    again.joinpath("a").mkdir(parents=True)
    lines = (simulated / "data/a/trials.csv").read_text().splitlines(keepends=True)
    (again / "a/trials.csv").write_text("".join(lines[:7]))  # header, and 6 of 10 trials
    Observer(1).take_part(simulated_study, again, "a")
    assert [[row[k] for k in COLUMNS if k not in ignored] for row in rows_in(again / "a")] == whole


def test_an_observer_without_noise_chooses_the_stiffer_and_a_lapsing_one_guesses(
    simulated: Path,
) -> None:
    rows = [row for row in rows_in(simulated / "data/b") if row["phase"] == "main"]
    assert analysis.expected_share(rows, 1e-6, 0.0) == 1.0
    assert analysis.expected_share(rows, 1e-6, 1.0) == 0.5
    shares = [analysis.expected_share(rows, weber, 0.02) for weber in (0.1, 0.23, 0.5, 1.0)]
    assert shares == sorted(shares, reverse=True)


def test_the_report_has_the_published_beside_ours(simulated: Path) -> None:
    text = write_report(simulated / "data").read_text()
    assert "83.67 (13.56)" in text
    assert "Participants: 2 (**simulated**). Answered trials: 16" in text
    assert (simulated / "data/report.png").stat().st_size > 10_000


def test_the_command_runs_the_whole_study(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(SHORT)
    folder = str(tmp_path / "data")
    run = ["study", "run", str(tmp_path / "own.yaml"), "-o", folder, "--workers", "0"]
    for arguments, word in (
        (["study", "check", str(tmp_path / "own.yaml")], "6 with training"),
        ([*run, "--participant", "simulated:1", "--weber", "0.5"], "data"),
        (["study", "analyse", folder], "report"),
        (["study", "new", str(tmp_path / "mine")], "mine.yaml"),
        (["study", "check", str(tmp_path / "mine.yaml")], "66 with training"),
    ):
        result = CliRunner().invoke(main, arguments)
        assert result.exit_code == 0, result.output
        assert word in result.output
    assert CliRunner().invoke(main, [*run, "--participant", "A Name"]).exit_code == 2
    assert CliRunner().invoke(main, ["study", "new", str(tmp_path / "mine")]).exit_code == 2
    assert CliRunner().invoke(main, ["study", "analyse", str(tmp_path / "none")]).exit_code == 2


# The analysis


def data_of(answers: Mapping[str, Sequence[int]], level: str = "") -> Data:
    study = load_study("friction")
    rows = [
        {
            **dict.fromkeys(COLUMNS, ""),
            "participant": name,
            "block": "slow",
            "counted": "friction",
            "other": "viscous",
            "chose_counted": str(one),
            "answer": "1",
            "counted_interval": "1",
            "counted_level": level,
            "touches_1": "1",
            "touches_2": "2",
        }
        for name, own in answers.items()
        for one in own
    ]
    return Data(study, "made up", "person", rows)


def test_percentages_spread_and_tests_are_those_by_hand() -> None:
    data = data_of({"a": [1, 1, 1, 0], "b": [1, 0, 1, 0], "c": [1, 1, 1, 1]})
    found = analysis.shares(data.rows)
    assert found.mean == pytest.approx(0.75)
    assert found.sd == pytest.approx(0.25)
    assert found.standard_error == pytest.approx(0.25 / math.sqrt(3))
    assert (found.chosen, found.trials) == (9, 12)
    assert found.p == pytest.approx(0.2254, abs=1e-4)  # t = sqrt(3) with 2 degrees of freedom
    reach = 4.3027 * 0.25 / math.sqrt(3)
    assert found.interval == pytest.approx((0.75 - reach, 0.75 + reach), abs=1e-4)
    assert analysis.d_prime(50, 100) == pytest.approx(0.0)
    each = [math.sqrt(2) * NormalDist().inv_cdf(n / 5) for n in (3.5, 2.5, 4.5)]
    assert found.sensitivity == pytest.approx(fmean(each))
    alone = analysis.shares(data_of({"a": [1, 1, 1, 1]}).rows)
    assert alone.p == pytest.approx(2 / 2**4)  # exact: one participant
    assert alone.interval == pytest.approx((0.025 ** (1 / 4), 1.0))
    checks = analysis.checks(data)
    assert checks["touches repeated for their speed"].startswith("12,")
    assert {"speed, slow, friction", "speed, slow, viscous"} <= checks.keys()


def test_blocks_are_compared_by_participant() -> None:
    first = data_of({"a": [1, 1, 1, 1], "b": [1, 1, 1, 0], "c": [1, 1, 1, 1]})
    second = data_of({"a": [1, 1, 0, 0], "b": [1, 0, 0, 0], "c": [1, 0, 1, 1]})
    rows = [*first.rows, *({**row, "block": "fast"} for row in second.rows)]
    [(name, mean, low, high, p)] = analysis.contrasts(Data(first.study, "made up", "person", rows))
    assert name == "friction, slow less fast"
    assert mean == pytest.approx(fmean((0.5, 0.5, 0.25)))
    reach = 4.3027 * math.sqrt(1 / 48) / math.sqrt(3)
    assert (low, high) == pytest.approx((mean - reach, mean + reach), abs=1e-4)
    assert p == pytest.approx(0.0377, abs=1e-4)  # t = 5 with 2 degrees of freedom
    assert list(analysis.contrasts(data_of({"a": [1], "b": [0]}))) == []
    assert math.isnan(analysis.t_test([0.5, 0.5], 0.5)[2])


def test_the_mixed_model_finds_a_known_effect() -> None:
    rng = Random(5)
    people = {}
    for number in range(20):
        chance = 1 / (1 + math.exp(-(1.0 + rng.gauss(0, 0.5))))
        people[f"p{number}"] = [int(rng.random() < chance) for _ in range(100)]
    [(name, mean, sd)] = analysis.mixed_model(data_of(people))
    assert name == "slow: friction against viscous"
    assert mean == pytest.approx(1.0, abs=0.4)
    assert 0.0 < sd < 0.4
    assert analysis.mixed_model(data_of({"a": [1, 0]})) == []
    assert analysis.mixed_model(data_of({"a": [1, 1], "b": [1]})) == []


def test_a_fit_recovers_a_known_psychometric_function(tmp_path: Path) -> None:
    rng = Random(7)
    levels = (0.6, 0.75, 0.9, 1.05, 1.2, 1.35, 1.5)
    rows = []
    for level in levels:
        share = 0.01 + 0.98 * NormalDist(1.05, 0.2).cdf(level)
        answers = {"a": [int(rng.random() < share) for _ in range(150)]}
        rows += data_of(answers, level=f"{level} N/mm").rows
    (tmp_path / "own.yaml").write_text(with_method(CONSTANT))
    file = read_study(tmp_path / "own.yaml", Problems())[0]
    found = analysis.psychometric(file, rows)
    assert found.pse == pytest.approx(1.05, abs=0.04)
    assert found.pse_interval[0] < 1.05 < found.pse_interval[1]
    assert found.sigma == pytest.approx(0.2, abs=0.05)


def test_a_fit_is_that_of_psignifit() -> None:
    """The values are of psignifit 4.3; its prior of sigma differs, which a tenth of it covers."""
    levels, chosen = [0.6, 0.75, 0.9, 1.05, 1.2, 1.35, 1.5], [1, 4, 14, 29, 46, 57, 58]
    found = fit(levels, chosen, [60] * 7, is_difference=False)
    assert found.pse == pytest.approx(1.0517, abs=0.02)
    assert found.pse_interval == pytest.approx((1.0085, 1.0862), abs=0.02)
    assert found.sigma == pytest.approx(0.193, rel=0.1)


def test_a_fit_of_few_answers_has_a_wide_interval() -> None:
    for levels, chosen, trials in (
        ([1.0], [3], [4]),
        ([0.0], [0], [1]),
        ([1.0, 2.0], [1, 1], [1, 1]),
    ):
        low, high = fit(levels, chosen, trials, is_difference=False).pse_interval
        assert high - low > 0.5 * (max(levels) - min(levels) or max(levels))
    low, high = fit([1.0], [3], [4], is_difference=True).sigma_interval
    assert high > 3.0 * low > 0.0


def climbed(study: Study, observer: Observer) -> list[dict[str, str]]:
    """The trials of a simulated observer who feels the commanded stiffness."""
    rows = list[dict[str, str]]()
    while (trial := next_trial(study, 0, rows)) is not None:
        felt = [Measures(stiffness=1e3 * float(one.level.split()[0])) for one in trial.stimuli]
        answer = str(observer._choice(felt, Random(f"{observer.seed}/{trial.seed}")))
        right = str(int(answer == trial.columns["counted_interval"]))
        rows.append({**trial.columns, "participant": "a", "chose_counted": right})
    return [row for row in rows if row["phase"] == "main"]


def test_the_threshold_of_a_simulated_observer_on_a_staircase_is_found(tmp_path: Path) -> None:
    study = study_of(with_method(STAIRCASE.replace("step: 0.2", "step: 0.1")), tmp_path)
    assert isinstance(study.method, Staircase)
    truth = 0.155  # 75 % right answers: the noise is 0.23 of the mean square of both levels
    for _ in range(20):
        truth = NormalDist().inv_cdf(0.75) * 0.23 * math.sqrt(0.5 + 0.5 * (1.0 + truth) ** 2)
    found = [analysis.psychometric(study, climbed(study, Observer(seed))) for seed in range(20)]
    intervals = [(JND75 * one.sigma_interval[0], JND75 * one.sigma_interval[1]) for one in found]
    assert all(low > 0.0 for low, _ in intervals)
    assert sum(low < truth < high for low, high in intervals) >= 17
    assert fmean(JND75 * one.sigma for one in found) == pytest.approx(truth, rel=0.15)


def test_one_who_feels_nothing_on_a_staircase_has_a_threshold_beyond_its_levels() -> None:
    levels = [0.1, 0.2, 0.3, 0.4]
    found = fit(levels, [50, 51, 49, 50], [100] * 4, is_difference=True)
    assert (found.pse, found.pse_interval) == (0.0, (0.0, 0.0))
    assert found.sigma_interval[1] > max(levels)


def test_a_simulated_staircase_ends_and_its_threshold_is_found(tmp_path: Path) -> None:
    text = with_method(STAIRCASE.replace("}", ", reversals: 8, most: 30}"))
    text = text.replace("paper_wall #", "stiff_wall #").replace(
        "law: more_conservative }", "law: none }"
    )
    study = study_of(text.replace("touch_time: 2 s", "touch_time: 500 ms"), tmp_path)
    Observer(2).take_part(study, tmp_path / "data", "a")
    rows = [row for row in rows_in(tmp_path / "data/a") if row["phase"] == "main"]
    answers = [row["chose_counted"] == "1" for row in rows]
    assert isinstance(study.method, Staircase)
    assert len(staircase(study.method, answers)[1]) >= 8 or len(rows) == 30
    own = [{**row, "participant": "a"} for row in rows]
    (mean,) = analysis.reversal_means(study, own).values()
    assert 0.1 <= mean < 1.0
    assert {float(row["other_level"]) for row in rows} == {1000.0}  # N/m
    assert "Thresholds" in write_report(tmp_path / "data").read_text()
