"""Recordings that earlier versions wrote are still of use; golden/recordings_of_before has them."""

import csv
import json
import lzma
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from invoking import invoke

import forcebound as fb

GOLDEN = Path(__file__).parent / "golden" / "recordings_of_before"
LATE = {"environment.stiffness": 5000.0, "links.environment_query.delay": 0.002}
LEADER, FOLLOWER = "leader", "follower"


@dataclass(frozen=True)
class Hand:
    """What is known of a hand: N, m, s."""

    peak_force: float
    farthest: float
    delay: float = 0.0  # of the queries
    law: str = "certified"
    is_passive: bool = True
    rows: int = 150  # of the telemetry
    energy_partner: str = ""


@dataclass(frozen=True)
class Before:
    """What is known of a recording."""

    hands: Mapping[str, Hand] = field(default_factory=dict)
    description: str = "A hand presses into a wall of 10 N/mm."
    environment: Mapping[str, Any] = field(
        default_factory=lambda: {"kind": "wall", "stiffness": 10_000.0, "position": 0.01}
    )
    phases: tuple[tuple[str, float, Mapping[str, Any]], ...] = ()
    refused: Mapping[str, str] = field(default_factory=dict)  # by command, with what words


DELAY = Before({"hand": Hand(2.6214630041100246, 0.01239, 0.002)})
PHASES = Before(
    {"hand": Hand(3.0639217565969368, 0.01188)},
    "A wall that a delay makes hard to hold.",
    phases=(("quiet", 0.1, {}), ("late", 0.05, LATE)),
)
OLD_LINK = {"replay": "'slot'"}  # a key that links had
NO_TIMES = "no telemetry with read_ns"

BEFORE = {
    "818d70d7-delay": Before(DELAY.hands, refused={**OLD_LINK, "replay --verify": NO_TIMES}),
    "08591040-phases": Before(
        PHASES.hands, PHASES.description, phases=PHASES.phases, refused=OLD_LINK
    ),
    "e666a49b-phases": PHASES,
    "e666a49b-delay": Before({"hand": Hand(2.910558310839071, 0.01233, 0.002)}),
    "e666a49b-spring": Before(
        {"hand": Hand(5.756035112023552, 0.00957)},
        "A spring of the user's own.",
        {"kind": "/tmp/wall/my_spring.py:MySpring", "stiffness": 2000.0, "rest": 0.0},
        refused={"replay": "my_spring.py"},
    ),
    "e666a49b-live": Before({"hand": Hand(2.8782103469606546, 0.01242, 0.002, rows=226)}),
    "ba0a9bc8-two": Before(
        {
            "left": Hand(3.0639217565969368, 0.01188),
            "right": Hand(8.245, 0.01176, 0.002, "none", is_passive=False),
        },
        "Two hands at one wall.",
        phases=(("quiet", 0.1, {}), ("late", 0.05, {"environment.stiffness": 5000.0})),
    ),
    "82f6be56-phases": PHASES,
    "82f6be56-two": Before(
        {
            LEADER: Hand(1.4322658002555948, 0.01254, energy_partner=FOLLOWER),
            FOLLOWER: Hand(0.5214689354087811, 0.01119, is_passive=False, energy_partner=LEADER),
        },
        "A leader and a follower whose bounders exchange energy, and a wall of 1 N/mm.",
        {"kind": "coupling", "leader": LEADER, "follower": FOLLOWER},
    ),
}


@pytest.fixture(scope="module", params=BEFORE)
def before(request: pytest.FixtureRequest) -> Before:
    return BEFORE[request.param]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("before")


def unpacked(name: str, folder: Path) -> Path:
    path = folder / f"{name}.mcap"
    if not path.exists():
        path.write_bytes(lzma.decompress((GOLDEN / f"{name}.mcap.xz").read_bytes()))
    return path


@pytest.fixture(scope="module")
def path(request: pytest.FixtureRequest, before: Before, folder: Path) -> Path:
    name = next(name for name, one in BEFORE.items() if one is before)
    return unpacked(name, folder)


def check(before: Before, path: Path, command: str, *words: object) -> str:
    """Run a command on a recording; return what it prints, unless it is refused as it should."""
    first, *more = command.split()
    result = invoke(first, path, *more, *words)
    if command in before.refused or (first in before.refused and not more):
        assert result.exit_code == 2, result.output
        assert before.refused[command] in result.stderr
        return ""
    assert result.exit_code == 0, result.output
    return result.stdout


def test_every_recording_that_is_stored_is_tested() -> None:
    stored = {path.name.removesuffix(".mcap.xz") for path in GOLDEN.glob("*.mcap.xz")}
    assert stored == {*BEFORE, *PARTLY}


def test_it_is_read_with_its_numbers(before: Before, path: Path) -> None:
    run = fb.read(path)
    assert set(run.hands) == set(before.hands)
    for name, known in before.hands.items():
        telemetry = run.hands[name].telemetry
        assert telemetry["time"].size == known.rows
        assert telemetry["time"][-1] == pytest.approx(0.148, abs=6e-3)
        assert telemetry["applied_force"].max() == known.peak_force  # to the bit
        assert telemetry["position"].max() == known.farthest


def test_its_configuration_is_that_of_its_launch_file(before: Before, path: Path) -> None:
    for name, one in fb.read(path).hands.items():
        document, known = one.document, before.hands[name]
        assert document["description"] == before.description
        assert document["seed"] == 1
        assert document["environment"].items() >= before.environment.items()
        assert document["device"]["law"] == known.law
        assert document["device"]["rate"] == 1000.0
        assert document["device"].get("energy_partner", "") == known.energy_partner
        assert document["links"]["environment_query"]["delay"] == known.delay
        phases = [(p["name"], p["duration"]) for p in document.get("phases", [])]
        assert phases == [(name, duration) for name, duration, _ in before.phases]
        for phase, (_, _, settings) in zip(document.get("phases", []), before.phases, strict=True):
            assert phase["set"].items() >= settings.items()


def test_its_units_are_those_of_its_launch_file(folder: Path) -> None:
    for name in ("82f6be56-phases", "82f6be56-two", "ba0a9bc8-two"):
        for one in fb.read(unpacked(name, folder)).hands.values():
            assert one.document["units"]["environment.stiffness"].startswith("N/m")
            assert one.document["units"]["device.rate"] == "kHz"


def test_its_verdict_is_said(before: Before, path: Path) -> None:
    for name, one in fb.read(path).hands.items():
        known = before.hands[name]
        assert known.law in one.label
        assert any(line.startswith("Passive") for line in one.verdict) == known.is_passive
        assert one.figures.peak_force >= known.peak_force


def test_it_is_drawn(before: Before, path: Path, tmp_path: Path) -> None:
    picture = tmp_path / "run.png"
    said = check(before, path, "plot", "-o", picture)
    assert "moves at" in said
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_it_is_written_as_tables(before: Before, path: Path, tmp_path: Path) -> None:
    check(before, path, "export", "--csv", tmp_path)
    for name, known in before.hands.items():
        with (tmp_path / (name if name != "hand" else "") / "telemetry.csv").open(
            newline=""
        ) as lines:
            rows = list(csv.DictReader(lines))
        assert len(rows) >= known.rows - 1
        assert max(float(row["applied_force[0]"]) for row in rows) == known.peak_force


def test_it_is_verified_to_the_bit(before: Before, path: Path) -> None:
    said = check(before, path, "replay --verify", "--json")
    if said:
        document = json.loads(said)
        for one in document.get("hands", {"hand": document}).values():
            assert one["is_same"]
            assert one["verified"] == one["ticks"] > 140


def test_it_runs_once_more(before: Before, path: Path) -> None:
    said = check(before, path, "replay", "--json")
    if said:
        document = json.loads(said)
        for name, one in fb.read(path).hands.items():
            recorded = abs(one.telemetry["applied_force"]).max()
            found = document.get("hands", {"hand": document})[name]["peak_force_n"]
            assert found == pytest.approx(recorded, rel=0.1)


#: Of which some things are refused: by command, with what words.
PARTLY = {
    "a21feced-delay": {
        "plot": "recorded by another version",
        "export": "recorded by another version",
        "replay --verify": NO_TIMES,
    },
    "bcb3921c-phases": {
        "plot": "of another version",
        "replay": "'slot'",
        "replay --verify": "watchdog_limit",
    },
}


@pytest.mark.parametrize(
    ("name", "command", "words"),
    [(name, command, words) for name, one in PARTLY.items() for command, words in one.items()],
)
def test_what_is_too_old_is_refused_with_the_reason(
    name: str, command: str, words: str, folder: Path, tmp_path: Path
) -> None:
    more = {"plot": ("-o", tmp_path / "run.png"), "export": ("--csv", tmp_path)}.get(command, ())
    check(Before(refused={command: words}), unpacked(name, folder), command, *more)


def test_the_delays_of_the_oldest_are_shown(folder: Path) -> None:
    for name in PARTLY:
        assert "unanswered" in check(Before(), unpacked(name, folder), "delay")
