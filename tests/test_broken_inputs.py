"""What is said of broken inputs: of a table of them, and of shipped files with a fault each."""

from pathlib import Path

import broken_inputs
import pytest
from broken_inputs import MUTATIONS, SAID, SHIPPED, Case, brief

HOW = "python tests/broken_inputs.py --write, and explain the difference"
SLOW = ("hold_arm", "push_boxes")  # each reading compiles a scene
SAMPLE = 4  # one fault of so many is tried here; all are by `python tests/broken_inputs.py`


@pytest.fixture(scope="module")
def said_of_table() -> dict[str, str]:
    return broken_inputs.stored(SAID)


@pytest.fixture(scope="module")
def said_of_mutations() -> dict[str, str]:
    return broken_inputs.stored(MUTATIONS)


def differing(before: dict[str, str], now: dict[str, str]) -> str:
    """The cases with other places or other first words, as text."""
    return "".join(
        f"\n## {name}\nbefore:\n{before.get(name, 'no such case')}\nnow:\n{words}\n"
        for name, words in now.items()
        if brief(before.get(name, "")) != brief(words)
    )


@pytest.mark.parametrize("route", broken_inputs.ROUTES)
def test_each_broken_input_is_refused_at_its_place(
    route: str, tmp_path: Path, said_of_table: dict[str, str]
) -> None:
    now: dict[str, str] = {}
    for number, case in enumerate(broken_inputs.table()):
        if case.route == route:
            folder = tmp_path / f"{number}"
            folder.mkdir()
            now[case.name] = broken_inputs.said_of(case, folder)
    assert len(now) > 10
    found = differing(said_of_table, now)
    assert not found, f"{found}\n{HOW}"


def test_the_stored_table_has_the_cases_and_no_others(said_of_table: dict[str, str]) -> None:
    assert list(said_of_table) == [case.name for case in broken_inputs.table()]


def test_no_input_raises_anything_but_an_error_of_forcebound(
    said_of_table: dict[str, str], said_of_mutations: dict[str, str]
) -> None:
    raised = [n for n, words in (said_of_table | said_of_mutations).items() if "RAISED" in words]
    assert not raised


@pytest.mark.parametrize("file", sorted(SHIPPED.glob("*.yaml")), ids=lambda file: file.stem)
def test_a_fault_in_a_shipped_file_is_found_at_its_place(
    file: Path, tmp_path: Path, said_of_mutations: dict[str, str]
) -> None:
    names = [name for name, _ in broken_inputs.mutations(file)]
    assert names == [name for name in said_of_mutations if name.startswith(f"{file.stem}/")], HOW
    broken_inputs.prepare(tmp_path)
    part = SAMPLE * 5 if file.stem in SLOW else SAMPLE
    now = dict(broken_inputs.said_of_mutations(file, tmp_path, part))
    found = differing(said_of_mutations, now)
    assert not found, f"{found}\n{HOW}"


def test_another_place_or_another_kind_is_a_difference(tmp_path: Path) -> None:
    (case,) = (case for case in broken_inputs.table() if case.name == "one 'seed: 1' -> 'sed: 1'")
    said = broken_inputs.said_of(case, tmp_path)
    assert not differing({case.name: said}, {case.name: said})
    assert differing({case.name: said}, {case.name: said.replace(":6:1:", ":6:2:")})
    assert differing({case.name: said}, {case.name: said.replace("unknown key", "a key")})
    sound = Case("", {"graph.yaml": "forcebound: 1\ninclude: stiff_wall.yaml\n"})
    assert broken_inputs.said_of(sound, tmp_path) == broken_inputs.SOUND
