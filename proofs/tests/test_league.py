"""The league: its tables, a small one played by the command, and where the certified law loses."""

import json
import math
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from invoking import invoke

from forcebound.graph.loader import load
from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound.lab.engine import Row
from forcebound.lab.table import read_table
from forcebound_proofs.cases import NOISES, encode
from forcebound_proofs.league import contest, scores
from forcebound_proofs.league.methods import CERTIFIED, METHODS, OURS
from forcebound_proofs.league.page import TEXT
from forcebound_proofs.league.places import ATTACKER, NETWORKS, TABLES, Place, places

ROOT = Path(__file__).parent.parent.parent
HAND_ONLY = {"at_rest": True, "error": None, "share_left": 1.0}


class League:
    """A small league with the law of a page of the docs, and with a controller of a user's own."""

    def __init__(self, folder: Path) -> None:
        text = (ROOT / "docs" / "write-your-own.md").read_text(encoding="utf-8")
        law = re.search(r"```python\n(.*?)```", text, re.DOTALL)
        assert law is not None
        (folder / "my_law.py").write_text(law[1], encoding="utf-8")
        self.page_file, self.table_file = folder / "league.md", folder / "league.parquet"
        files = ("--method", folder / "my_law.py")
        self.words = ("--output", self.page_file, "--table", self.table_file, *files)
        self.done: Result = invoke("league", "--small", *self.words)
        self.page = self.page_file.read_text(encoding="utf-8")
        self.rows = read_table(self.table_file).rows

    def of(self, method: str, *kinds: str) -> list[Row]:
        return [row for row in self.rows if row["method"] == method and row["kind"] in kinds]


@pytest.fixture(scope="module")
def league(tmp_path_factory: pytest.TempPathFactory) -> League:
    return League(tmp_path_factory.mktemp("league"))


def test_a_league_has_at_most_200_places_of_methods() -> None:
    assert len(places()) * len(METHODS) <= 200
    assert {place.network for place in places()} == set(NETWORKS)
    assert {place.world for place in places()} == set(TABLES["worlds"])
    assert set(OURS) <= set(METHODS)


@pytest.mark.parametrize("name", METHODS)
def test_every_method_is_a_graph_in_every_place_with_every_hand_and_attack(name: str) -> None:
    method = METHODS[name]
    code = encode((NOISES - 1,), [0.999] * len(ATTACKER))
    for u in (0.0, 1.0):
        own = method.with_numbers({key: one.at(u) for key, one in method.numbers.items()})
        for place in places():
            played = [place.by_hand(hand) for hand in place.hands]
            for file, *words in (*played, place.by_attack(code)):
                config = load(file, [*own, *words])
                assert config.only.servo.age_limit == 1.0


def test_every_method_of_a_league_plays_tunes_and_is_attacked_alike(league: League) -> None:
    assert league.done.exit_code == 0, league.done.output
    methods = {**METHODS, "my_law": None}
    assert {row["method"] for row in league.rows} == set(methods)
    assert not [row["error"] for row in league.rows if row["error"]]
    for kind in (contest.CELL, "random", "search"):
        runs = {len(league.of(method, kind)) for method in methods}
        assert len(runs) == 1, kind
        assert min(runs) > 0
    for name, method in METHODS.items():
        evaluations = len(league.of(name, contest.TUNING))
        assert evaluations == (4 if method.numbers else 0)
    assert {row["hand"] for row in league.of(CERTIFIED, contest.CELL)} == set(TABLES["hands"])


def test_a_known_leak_is_found_and_a_certified_law_has_none(league: League) -> None:
    found = {one.method: one for one in scores.worst(league.rows)}
    assert found["none"].energy < -0.1
    assert found["tdpa"].energy < -1e-3
    for name in OURS:
        assert found[name].energy == 0.0
        assert 0.0 < found[name].share_left < 1.0


def test_a_users_law_is_in_every_table_of_the_page(league: League) -> None:
    headings = [line for line in league.page.splitlines() if line.startswith("### ")]
    assert len(headings) == len(places(is_small=True))
    assert league.page.count("| `my_law` |") == len(headings) + 3  # worst, over delay, methods
    assert "--method my_law.py" in league.page
    for picture in ("stiffness", "transparency", "energy"):
        assert f"(league_{picture}.png)" in league.page
        assert (league.page_file.parent / f"league_{picture}.png").stat().st_size > 10_000


def test_the_page_says_first_where_the_certified_law_loses(league: League) -> None:
    first = league.page.split("\n## ")[1]
    assert first.startswith("Where the certified laws lose")
    counted = re.search(r"In (\d+) comparisons" + r".*?\*\*(\d+)\*\*" * 3, first)
    assert counted is not None
    count, every, safer, passive = map(int, counted.groups())
    assert passive == len(list(scores.losses(league.rows, ENERGY_TOLERANCE)))
    assert every == len(list(scores.losses(league.rows, math.inf)))
    assert safer == len(list(scores.losses(league.rows, scores.LITTLE)))
    assert 0 < passive <= safer < every < count


@pytest.mark.parametrize("method", ["none", "tdpa"])
def test_the_command_of_a_row_repeats_its_energy(league: League, method: str) -> None:
    row = min(league.of(method, contest.CELL, "search"), key=lambda row: row["energy_j"])
    words = shlex.split(row["command"])[1:]
    done = json.loads(invoke(*words, "--json").stdout)
    assert done["true_energy_min_j"] == pytest.approx(row["energy_j"], rel=1e-6)


def test_a_league_that_is_done_is_read_and_other_methods_are_another_one(league: League) -> None:
    before = league.table_file.stat().st_mtime_ns
    league.page_file.unlink()
    assert invoke("league", "--small", *league.words).exit_code == 0
    assert league.page_file.read_text(encoding="utf-8") == league.page
    other = invoke("league", "--small", *league.words[:4])
    assert other.exit_code == 2
    assert str(league.table_file) in other.stderr
    assert league.table_file.stat().st_mtime_ns >= before


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("broken.py", "limit = (", "broken.py:1"),
        ("empty.py", "x = 1", "empty.py defines no part"),
        ("none.py", "x = 1", "'none'"),
        ("law.txt", "x = 1", "law.txt"),
    ],
)
def test_a_wrong_file_of_a_method_is_refused_before_the_work(
    tmp_path: Path, name: str, text: str, message: str
) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    words = ("--output", tmp_path / "league.md", "--table", tmp_path / "league.parquet")
    done = invoke("league", "--small", *words, "--method", tmp_path / name)
    assert done.exit_code == 2
    assert message in done.stderr
    assert not (tmp_path / "league.parquet.parts").exists()


def test_a_loss_counts_against_methods_without_a_leak_and_against_all() -> None:
    place = Place("PHANToM", "wall", "20 ms")

    def row(method: str, stiffness: float, energy: float, **others: Any) -> Row:
        felt = {"displayed_stiffness_n_per_m": stiffness, "energy_j": energy, "hand": "fast"}
        kind = {"kind": contest.CELL, "case": None, "command": ""}
        return {**place._asdict(), "method": method, **kind, **HAND_ONLY, **felt, **others}

    rows = [
        row(CERTIFIED, 1000.0, 0.0),
        row("leaky", 5000.0, -1e-3),
        row("kept", 1040.0, 0.0),  # 4 % more: no loss
        row("moving", 9000.0, 0.0, at_rest=False),
    ]
    assert list(scores.losses(rows, ENERGY_TOLERANCE)) == []
    (loss,) = scores.losses(rows, math.inf)
    assert (loss.method, loss.place, loss.ours, loss.theirs) == ("leaky", place, 1000.0, 5000.0)
    rows[2]["displayed_stiffness_n_per_m"] = 1060.0
    (loss,) = scores.losses(rows, ENERGY_TOLERANCE)
    assert loss.method == "kept"
    attack = row("kept", 0.0, -1e-6) | {"kind": "search"}  # and a leak that an attack finds counts
    assert list(scores.losses([*rows, attack], ENERGY_TOLERANCE)) == []


def test_energy_counts_until_the_hand_is_faster_than_stated() -> None:
    file, *words = Place("PHANToM", "wall", "20 ms").by_hand("fast")
    result, fastest = contest.played(file, ("law:=none", *words), 2.0)
    assert fastest == 3.0
    every, _ = contest.energies(result, np.inf)
    slower, _ = contest.energies(result, 0.5)
    assert every < slower <= 0.0
    assert contest.energies(result, 1e-9) == (0.0, 1.0)


def test_the_page_in_the_docs_is_made_of_its_text_and_has_every_method() -> None:
    page = (ROOT / "docs" / "league.md").read_text(encoding="utf-8")
    parts = re.split(r"{\w+}", TEXT.read_text(encoding="utf-8").rstrip())
    made = ".*".join(map(re.escape, parts))
    assert re.fullmatch(made, page.rstrip(), re.DOTALL), "run: make proofs"
    for name in METHODS:
        assert f"| `{name}` |" in page
