"""The engine of campaigns: parts, resuming, results; cases and views."""

import linecache
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from forcebound.errors import ConfigError
from forcebound.lab.cases import grid
from forcebound.lab.digest import digest_of, sources
from forcebound.lab.engine import Campaign, Row, run
from forcebound.lab.table import read_about, read_table
from forcebound.lab.views import groups, table
from forcebound.lab.workers import local_executor
from forcebound.units import energy_in_words as energy


def squares(cases: Sequence[int]) -> list[Row]:
    return [{"x": x, "square": float(x * x), "is_even": x % 2 == 0} for x in cases]


def twice(cases: Sequence[int]) -> list[Row]:
    return [{"x": x, "square": 2.0 * x, "is_even": x % 2 == 0} for x in cases]


def powers(exponent: int, cases: Sequence[int]) -> list[Row]:
    return [{"power": x**exponent} for x in cases]


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
    assert list(table(("x", "y"), [(1, "2")])) == ["| x | y |", "|---|---|", "| 1 | 2 |"]
    assert grid(a=[1, 2], b="xy")[1] == {"a": 1, "b": "y"}
    shown = [energy(one) for one in (None, 1e-12, -2e-3, 1.5, -1234.0)]
    assert shown == ["–", "0", "-2 mJ", "1.5 J", "-1,234 J"]


class Plain:
    """A case of a class without a repr: as text it would have its address."""

    def __init__(self, x: object) -> None:
        self.x = x


@dataclass(frozen=True)
class Fields:
    x: object


def digest(*cases: object, **settings: Any) -> str:
    return Campaign("a", cases, squares, **settings).digest


@pytest.mark.parametrize(
    "make",
    [
        Plain,
        Fields,
        lambda x: np.array([x]),
        lambda x: Path(str(x)),
        lambda x: {x},
        lambda x: b"%d" % x,
    ],
)
def test_the_digest_of_a_case_is_that_of_its_content_whatever_its_class(
    make: Callable[[int], object],
) -> None:
    assert digest(make(1)) == digest(make(1))
    assert digest(make(1)) != digest(make(2))
    assert digest(make(1)) != digest(Weighed(1))


def test_a_case_without_a_stable_form_is_refused() -> None:
    circle = Plain(None)
    circle.x = circle
    for case in (threading.Lock(), (one for one in "ab"), circle):
        with pytest.raises(ConfigError, match="same in each process"):
            _ = digest(Plain(case))


def test_other_parts_and_arguments_of_the_function_are_another_campaign() -> None:
    assert digest(1, 2, part=1) != digest(1, 2, part=2)
    works = [partial(powers, exponent) for exponent in (2, 2, 3)]
    digests = [Campaign("a", [1], work).digest for work in works]
    assert digests[0] == digests[1] != digests[2]


def typed_in(text: str) -> Any:
    """Return `measure` of a text that has no file, as of the cell of a notebook."""
    names = {"__name__": "no_such_module"}
    exec(text, names)
    return names["measure"]


def test_a_changed_function_of_a_notebook_has_another_digest() -> None:
    text = (
        "FACTOR = 2\ndef twice(x): return FACTOR * x if x else measure(x)\n"
        "def measure(run): return twice(run.x)\n"
    )
    texts = [text, f"other = 1\n{text}", text.replace("= 2", "= 3"), text.replace("* x", "+ x")]
    digests = [digest_of(typed_in(one)) for one in texts]
    assert digests[0] == digests[1]
    assert len({*digests}) == 3


CLASS = """
class Measure:
    factor = 2
    @property
    def twice(self): return 2 * self.factor
    @staticmethod
    def half(x): return x / 2
    def __call__(self, run): return self.twice
measure = Measure()
"""


def test_a_changed_class_of_a_notebook_has_another_digest() -> None:
    texts = [CLASS, CLASS, CLASS.replace("factor = 2", "factor = 3"), CLASS.replace("/ 2", "/ 3")]
    texts += [CLASS.replace("2 * self", "3 * self"), CLASS.replace("n self.twice", "n self.factor")]
    digests = [digest_of(typed_in(text)) for text in texts]
    assert len({*digests}) == len(texts) - 1


def test_the_digest_knows_the_sources_of_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = digest(1)
    (tmp_path / "__init__.py").write_text("")
    (tmp_path / "law.py").write_text("x = 1\n")
    monkeypatch.setattr("forcebound.__file__", str(tmp_path / "__init__.py"))
    digests = []
    for text in ("x = 1\n", "x = 1\n", "x = 2\n"):
        (tmp_path / "law.py").write_text(text)
        sources.cache_clear()
        digests.append(digest(1))
    sources.cache_clear()
    assert digests[0] == digests[1] != digests[2]
    assert before not in digests


def lists(cases: Sequence[int]) -> list[Row]:
    return [{"x": x, "whole": [*range(x)], "mixed": [x, 0.5], "failed": None} for x in cases]


def test_rows_hold_lists_and_a_result_that_is_there_is_read(tmp_path: Path) -> None:
    result = tmp_path / "lists.parquet"
    made = Campaign("lists", range(3), lists, 1)
    first = run(made, result=result)
    assert first.resumed == 0
    columns = read_table(result).columns
    assert columns["whole"] == [[], [0], [0, 1]]
    assert columns["mixed"] == [[0.0, 0.5], [1.0, 0.5], [2.0, 0.5]]
    content = result.read_bytes()
    again = run(made, result=result)
    assert (again.rows, again.resumed) == (first.rows, 3)
    assert result.read_bytes() == content
    assert run(made, result=result, restart=True).resumed == 0


def test_a_function_of_the_main_program_is_sent_by_value() -> None:
    text = "FACTOR = 2\ndef measure(cases): return [{'x': FACTOR * x} for x in cases]\n"
    names = vars(sys.modules["__main__"])
    try:
        exec(text, names)
        measure = names["measure"]
        with local_executor(1) as executor:
            rows = run(Campaign("typed", [1, 2], measure, 1), executor).rows
            with pytest.raises(ConfigError, match="workers=0"):
                run(Campaign("lock", [threading.Lock()], measure), executor)
    finally:
        del names["measure"], names["FACTOR"]
    assert rows == [{"x": 2}, {"x": 4}]
