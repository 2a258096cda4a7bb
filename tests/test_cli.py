"""The command line: results, messages, exit status."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from invoking import invoke
from launch_texts import written
from waiting import TIMEOUT, until

from forcebound.cli import main
from forcebound.results.figures import FIGURES
from forcebound.results.printing import print_rows
from forcebound.run.results import RunResult

QUICK = ("--duration", "200 ms")


def test_help_names_every_command_and_imports_nothing_heavy() -> None:
    program = (
        "import sys; from forcebound.cli import main\n"
        "try: main(['--help'])\n"
        "finally: print(sorted({'numpy','numba','zmq','matplotlib','tqdm','tabulate'} "
        "& set(sys.modules)))"
    )
    out = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout
    for command in main.commands:
        assert f"\n  {command} " in out
    assert "...\n" not in out.partition("Options:")[2], "a description that is cut"
    assert out.splitlines()[-1] == "[]"


def test_help_of_no_command_imports_what_only_its_work_needs() -> None:
    program = (
        "import sys; from forcebound.cli import main\n"
        "for name in main.commands: main([name, '--help'], standalone_mode=False)\n"
        "print(sorted({'numpy','zmq','msgspec','tqdm','tabulate','asyncio','forcebound.graph',"
        "'forcebound.messages','forcebound.run'} & set(sys.modules)))"
    )
    out = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout
    assert out.count("Usage: ") == len(main.commands)
    assert out.splitlines()[-1] == "[]"


@pytest.mark.parametrize("words", [["schema"], ["--help"]])
def test_output_that_cannot_be_written_is_told_in_one_line(words: list[str]) -> None:
    command = [sys.executable, "-m", "forcebound", *words]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == "forcebound: cannot write: No space left on device\n"


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_figures_are_printed_whatever_the_terminal_can_show(encoding: str) -> None:
    command = [sys.executable, "-m", "forcebound", "simulate", "stiff_wall", "--all", *QUICK]
    variables = os.environ | {"PYTHONIOENCODING": encoding}
    done = subprocess.run(command, capture_output=True, env=variables, check=False)
    assert done.returncode == 0
    assert b"Traceback" not in done.stderr
    lines = done.stdout.decode(encoding, "replace").splitlines()
    assert sum(line.startswith("peak force") for line in lines) == 1


def test_a_file_whose_name_is_not_utf8_is_said_before_a_launch(tmp_path: Path) -> None:
    name = os.fsdecode(os.fsencode(tmp_path) + b"/r\xe4.mcap")
    command = [sys.executable, "-m", "forcebound", "launch", "stiff_wall", *QUICK, "--record", name]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "is not UTF-8: rename it" in done.stderr
    assert "Traceback" not in done.stderr


def test_simulate_prints_one_document_with_the_promised_keys() -> None:
    result = invoke("simulate", "stiff_wall.yaml", "--json", *QUICK)
    assert result.exit_code == 0
    document = json.loads(result.stdout)
    assert document["law"] == "certified"
    assert document["samples"] == pytest.approx(200, abs=2)
    assert set(document) >= {figure.key for figure in FIGURES}
    assert set(document["loop_delay_ms"]) == {"p50", "p99", "max"}


def test_the_same_seed_writes_identical_recordings(tmp_path: Path) -> None:
    files = [tmp_path / f"{k}.mcap" for k in range(3)]
    arguments = ("delayed_wall.yaml", "delay:=2 ms")
    for file, seed in zip(files, ("1", "1", "2"), strict=True):
        result = invoke("simulate", *arguments, "--record", str(file), "--seed", seed, *QUICK)
        assert result.exit_code == 0
    first, again, other = (file.read_bytes() for file in files)
    assert first == again
    assert first != other


def test_two_recordings_are_compared_with_what_a_hand_feels(tmp_path: Path) -> None:
    runs = [str(tmp_path / "stiff.mcap"), str(tmp_path / "soft.mcap")]
    Path(runs[0]).write_text("of no use")
    for run, stiffness in zip(runs, ("2 N/mm", "0.5 N/mm"), strict=True):
        words = ("simulate", "stiff_wall", f"stiffness:={stiffness}", "--record", run)
        assert invoke(*words, "--overwrite", *QUICK).exit_code == 0
    text = invoke("plot", *runs, "-o", str(tmp_path / "two.png")).stdout
    assert re.search(r"displayed stiffness -\d\d%; a hand was not at rest", text)
    assert re.search(r"peak force -\d\d%; a hand feels it \(from 7%", text)
    assert (tmp_path / "two.png").stat().st_size > 10_000
    document = json.loads(invoke("plot", *runs, "-o", str(tmp_path / "2.svg"), "--json").stdout)
    assert (tmp_path / "2.svg").read_text().startswith("<?xml")
    assert len(document["runs"]) == 2
    ((stiffness, _),) = document["differences"]
    assert stiffness["is_perceptible"] is None


@pytest.mark.parametrize("command", ["simulate", "launch"])
def test_a_recording_that_is_there_is_kept(tmp_path: Path, command: str) -> None:
    run = tmp_path / "run.mcap"
    run.write_text("dear to somebody")
    result = invoke(command, "stiff_wall.yaml", "--record", str(run))
    assert result.exit_code == 2
    assert "run.mcap exists: choose another name, or add --overwrite" in result.stderr
    assert run.read_text() == "dear to somebody"


def test_a_simulation_that_is_interrupted_gives_the_result_until_then(tmp_path: Path) -> None:
    run = tmp_path / "run.mcap"
    command = [
        sys.executable,
        "-m",
        "forcebound",
        "simulate",
        "delayed_wall",
        "--duration",
        "9999 s",
    ]
    with subprocess.Popen(
        [*command, "--record", str(run), "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as simulation:
        until(lambda: run.exists() and run.stat().st_size > 100_000, "some samples")
        simulation.send_signal(signal.SIGINT)
        out, said = simulation.communicate(timeout=TIMEOUT)
    assert simulation.returncode == 0, said
    assert "interrupted; result up to here" in said
    summary = json.loads(out)
    assert summary["interrupted"]
    assert summary["links"]["environment_query"]["sent"] > 0
    assert RunResult.from_recording(run).summary["samples"] == summary["samples"]


def test_a_link_that_loses_everything_is_refused_by_a_live_run_only(tmp_path: Path) -> None:
    lossy = "include: stiff_wall.yaml\nlinks: {force_command: {loss: 100 %}}\n"
    path = str(written(tmp_path, lossy))
    for words in (["launch", path], ["launch", path, "--check"]):
        done = invoke(*words)
        assert done.exit_code == 2
        assert "links.force_command: no packet gets through in the first 180 s" in done.stderr
    assert invoke("simulate", path, "--check").exit_code == 0


def test_check_and_show_args_start_nothing() -> None:
    assert "correct" in invoke("launch", "stiff_wall.yaml", "--check").stdout
    document = json.loads(invoke("launch", "stiff_wall.yaml", "--check", "--json").stdout)
    assert document["environment"]["stiffness"] == 10_000.0
    shown = invoke("launch", "stiff_wall.yaml", "--show-args").stdout
    for name in ("law", "stiffness", "approach_speed", "delay", "compute_delay", "seed"):
        assert f"{name}:=" in shown
    assert invoke("simulate", "stiff_wall.yaml", "--show-args").stdout == shown
    checked = invoke("simulate", "stiff_wall.yaml", "--check", "--seed", "7", "--json")
    assert json.loads(checked.stdout) == {**document, "seed": 7}
    assert "local:=false " in invoke("launch", "remote_wall", "--show-args").stdout


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("simulate", "stiff_wall.yaml", "law:=certifed"), "did you mean 'certified'"),
        (("simulate", "haply_2diy"), "forcebound simulate five_bar_wall"),
        (("emulate", "haply_2diy", "--fault", "fire"), "short, noise, nan, lost, reset, stall"),
        (("simulate", "nowhere.yaml"), "there is no launch file 'nowhere.yaml'"),
        (("launch",), "\n  stiff_wall                A hand presses into a wall of 10 N/mm.\n"),
        (("simulate", "--check"), "\n  touch_sphere              A hand presses on a sphere"),
        (("sweep", "stability_ma"), "did you mean 'stability_map.yaml'?"),
        (("simulate", "stiff_wall.yaml", "--duration", "3 N"), "expected a time in s"),
        (("plot", "nothing.mcap"), "nothing.mcap"),
        (("launch", "stiff_wall.yaml", "--record", "/nowhere/run.mcap"), "no folder /nowhere"),
        (("simulate", "stiff_wall.yaml", "--record", "/nowhere/run.bag"), "must end in .mcap,"),
        (("simulate", "stiff_wall", "--record", "/proc/run.mcap"), "cannot write the recording"),
        (("bridge", "rviz"), "unknown command 'rviz'; known: foxglove, plotjuggler"),
        (("lunch",), "unknown command 'lunch'; did you mean 'launch'?"),
        (("sweep", "z_width", "-o", f"{__file__}/map.parquet"), "Not a directory"),
        (("check", "environment", "no.py"), "forcebound: environment: "),
        (("sweep", "stability_map", "delay:=3 N"), "which is a force"),
    ],
)
def test_wrong_input_ends_with_a_message_and_status_2(words: tuple[str, ...], message: str) -> None:
    result = invoke(*words)
    assert result.exit_code == 2
    assert message in result.stderr
    assert "Traceback" not in result.stderr
    assert "left:" not in result.stderr, "no progress of what does not begin"
    assert "environment: environment" not in result.stderr


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("device: {rate: 10 kHz}", "a live run keeps 10 Hz to 5000 Hz, got 10000 Hz"),
        ("device: {damping: 0}", "damping must be > 0"),
        ("device: {truth: {mas: 60 g}}", "truth has no key 'mas'"),
        ("duration: 1 us", "the run ended before its first sample"),
    ],
)
def test_what_would_not_start_is_not_called_correct(
    tmp_path: Path, line: str, message: str
) -> None:
    path = written(tmp_path, f"include: stiff_wall.yaml\n{line}\n")
    result = invoke("launch", str(path), "--check")
    assert result.exit_code == 2
    assert message in result.stderr
    assert "correct" not in result.stdout


def test_a_map_of_a_figure_that_is_none_is_refused_before_the_sweep(tmp_path: Path) -> None:
    text = "forcebound: 1\nlaunch: stiff_wall\nduration: 20 ms\nover: {law: [none, certified]}\n"
    path = written(tmp_path, text + "map: {x: law, value: peak_force}\n", "sweep.yaml")
    result = invoke("sweep", str(path), "-o", str(tmp_path / "out.parquet"))
    assert result.exit_code == 2
    assert "unknown figure for value: 'peak_force'; did you mean 'peak_force_n'" in result.stderr
    assert [one.name for one in tmp_path.iterdir()] == ["sweep.yaml"]


def test_a_table_that_is_wider_than_the_terminal_keeps_its_numbers_whole(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    numbers = ("135.4/247.1/249.4", "0.000123456789", "1000000.0/20000000.0", "8.50 N")
    print_rows(("phase", *"abcd"), [("nothing comes through", *numbers)])
    shown = capsys.readouterr().out
    assert [number for number in numbers if number in shown] == list(numbers)


def test_a_picture_that_cannot_be_written_is_refused_before_the_work(tmp_path: Path) -> None:
    picture = str(tmp_path / "none" / "run.png")
    result = invoke("plot", str(tmp_path / "none.mcap"), "-o", picture)
    assert result.exit_code == 2
    assert "cannot write the picture" in result.stderr
    assert not result.stdout


def test_a_reader_that_goes_away_is_no_damaged_recording(tmp_path: Path) -> None:
    recording = tmp_path / "run.mcap"
    invoke("simulate", "stiff_wall", *QUICK, "--record", str(recording))
    reader, writer = os.pipe()
    os.close(reader)
    try:
        result = subprocess.run(
            [sys.executable, "-m", "forcebound", "plot", str(recording)],
            stdout=writer,
            stderr=subprocess.PIPE,
            check=False,
        )
    finally:
        os.close(writer)
    assert result.returncode == 1
    assert result.stderr == b""
    assert recording.with_suffix(".png").exists()


def test_keys_are_made_listed_and_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCEBOUND_KEYS", str(tmp_path / "keys"))
    assert "no keys in" in invoke("keys", "list").stderr
    made = json.loads(invoke("keys", "new", "lab", "--json").stdout)
    assert invoke("keys", "show", "lab").stdout.strip() == made["public"]
    assert json.loads(invoke("keys", "show", "lab", "--json").stdout)["public"] == made["public"]
    assert made["public"] in invoke("keys", "new", "other").stdout + invoke("keys", "list").stdout
    (first, second) = json.loads(invoke("keys", "list", "--json").stdout)
    assert (first["name"], second["name"]) == ("lab", "other")
    secret = (tmp_path / "keys" / "lab.key_secret").read_text().split('"')[-2]
    for words in (("list",), ("list", "--json"), ("show", "lab")):
        assert secret not in invoke("keys", *words).output
    again = invoke("keys", "new", "lab")
    assert again.exit_code == 2
    assert "not overwritten" in again.stderr
    assert invoke("keys", "show", "nobody").exit_code == 2


def test_only_an_environment_is_run_by_itself() -> None:
    result = invoke("node", "controller", "stiff_wall")
    assert result.exit_code == 2
    assert "controller" in result.stderr
