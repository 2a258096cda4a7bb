"""The engine of campaigns: parts, resuming, results; cases and views."""

import linecache
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import pytest

from forcebound.errors import ConfigError
from forcebound.lab.cases import grid
from forcebound.lab.engine import Campaign, Row, run
from forcebound.lab.table import read_about, read_table
from forcebound.lab.views import groups, least, share, table, verdict
from forcebound.units import energy_in_words as energy


def squares(cases: Sequence[int]) -> list[Row]:
    return [{"x": x, "square": float(x * x), "is_even": x % 2 == 0} for x in cases]


def twice(cases: Sequence[int]) -> list[Row]:
    return [{"x": x, "square": 2.0 * x, "is_even": x % 2 == 0} for x in cases]


class Weighed(NamedTuple):
    """A case of several runs."""

    runs: int

    def rows(self) -> list[Row]:
        return []


def campaign(cases: int = 100, part: int = 7) -> Campaign:
    return Campaign("squares", range(cases), squares, part, about={"map": {"x": "x"}})


def interrupt_at(most: int) -> Callable[[int, int], None]:
    """Return a progress that presses Ctrl-C when so many cases are done."""

    def progress(done: int, cases: int) -> None:
        if done >= most:
            raise KeyboardInterrupt

    return progress


@pytest.mark.parametrize("cases", [1, 7, 5000])
def test_parts_cover_every_case_once_and_hold_as_many_runs_as_asked(cases: int) -> None:
    parts = campaign(cases).parts()
    assert [case for part in parts for case in part] == list(range(cases))
    assert all(len(part) == 7 for part in parts[:-1])
    weighed = Campaign("squares", [Weighed(x) for x in range(cases)], part=7)
    assert all(sum(part) >= 7 for part in weighed.parts()[:-1])


def test_an_interrupted_campaign_goes_on_and_gives_the_same_bytes(tmp_path: Path) -> None:
    whole, cut = tmp_path / "whole.parquet", tmp_path / "cut.parquet"
    done: list[tuple[int, int]] = []
    rows, _ = run(campaign(), None, lambda *one: done.append(one), whole)
    assert done[0] == (0, 100)
    assert done[-1] == (100, 100)
    with pytest.raises(KeyboardInterrupt):
        run(campaign(), progress=interrupt_at(50), result=cut)
    assert not cut.exists()
    again = run(campaign(), result=cut)
    assert again.resumed == 56
    assert again.rows == rows == run(campaign()).rows
    assert cut.read_bytes() == whole.read_bytes()
    assert read_table(cut).columns["square"] == [float(x * x) for x in range(100)]
    assert read_about(cut)["map"] == {"x": "x"}
    assert not list(tmp_path.glob("*.parts"))


def test_neither_parts_nor_result_of_another_campaign_are_taken_or_replaced(tmp_path: Path) -> None:
    result = tmp_path / "one.parquet"
    with pytest.raises(KeyboardInterrupt):
        run(campaign(), progress=interrupt_at(0), result=result)
    with pytest.raises(ConfigError, match="other cases"):
        run(campaign(99), result=result)
    with pytest.raises(ConfigError, match="other cases"):
        run(replace(campaign(), work=twice), result=result)
    run(campaign(99), result=result, restart=True)
    with pytest.raises(ConfigError, match="not a result of these cases"):
        run(campaign(), result=result)
    assert len(read_table(result).columns["x"]) == 99
    run(campaign(), result=result, overwrite=True)
    assert len(read_table(result).columns["x"]) == 100


SCRIPT = """
from typing import NamedTuple
class Case(NamedTuple):
    x: int
    def rows(self): return [{"y": FACTOR * self.x}]
def work(cases): return [{"y": FACTOR * x} for x in cases]
"""


def digests_of_script(folder: Path, factor: str, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Digests of two campaigns of a script: its function, and its cases that run themselves."""
    (folder / "script.py").write_text(SCRIPT.replace("FACTOR", factor))
    linecache.clearcache()
    monkeypatch.syspath_prepend(folder)
    monkeypatch.delitem(sys.modules, "script", raising=False)
    script = import_module("script")
    campaigns = Campaign("a", [1], partial(script.work)), Campaign("a", [script.Case(1)])
    return [one.digest for one in campaigns]


def test_a_changed_script_is_another_campaign(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    first, again, other = (digests_of_script(tmp_path, f, monkeypatch) for f in ("2", "2", "30"))
    assert first == again
    assert len({*first, *other}) == 4


def test_rows_are_grouped_counted_and_shown() -> None:
    rows = squares(range(5))
    assert groups(rows, "is_even") == {(True,): rows[::2], (False,): rows[1::2]}
    assert least(rows, "square") is rows[0]
    assert share(rows, "is_even") == 0.6
    assert list(table(("x", "y"), [(1, "2")])) == ["| x | y |", "|---|---|", "| 1 | 2 |"]
    assert grid(a=[1, 2], b="xy")[1] == {"a": 1, "b": "y"}
    shown = [energy(one) for one in (None, 1e-12, -2e-3, 1.5, -1234.0)]
    assert shown == ["–", "0", "-2 mJ", "1.5 J", "-1,234 J"]
    assert verdict(-1e-6) == "BROKEN"
    assert verdict(-1e-12) == "passive"
    assert verdict(-1.0, is_certified=False) == "leaks"
