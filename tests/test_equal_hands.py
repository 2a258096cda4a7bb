"""What hands share: `hands: {default: ...}`, and a file of a device that several include."""

from pathlib import Path

import pytest
from launch_texts import problems_of, written

from forcebound.graph.loader import arguments_of, load

PAIR = """\
forcebound: 1
include: leader_follower_transfer.yaml
arguments: { turn: 400 Hz }
hands:
  default: { device: { kind: serial_arm, include: arm.yaml } }
  leader: { device: { energy_partner: follower } }
  follower: { device: { energy_partner: leader, rate: 1 kHz } }
"""


@pytest.mark.parametrize("head", ["", "device:\n"], ids=["the keys alone", "a section device"])
def test_two_equal_arms_stand_once_in_a_file(head: str, tmp_path: Path) -> None:
    indent = "  " * bool(head)
    keys = f"{head}{indent}kind: serial_arm\n{indent}upper: 200 mm\n{indent}rate: $(arg turn)\n"
    written(tmp_path, keys, "arm.yaml")
    path = written(tmp_path, PAIR)
    hands = load(path, ["turn:=250 Hz"]).hands
    assert list(hands) == ["leader", "follower"]
    assert {hand.device.upper for hand in hands.values()} == {0.2}  # type: ignore[attr-defined]
    assert [hand.servo.rate for hand in hands.values()] == [250.0, 1000.0]
    assert [hand.servo.energy_partner for hand in hands.values()] == ["follower", "leader"]
    assert "turn" in [argument.name for argument in arguments_of(path)]


@pytest.mark.parametrize(
    ("old", "new", "file", "place", "named"),
    [
        ("arg turn", "arg trun", "arm.yaml", "2:7", "'turn'"),
        ("serial_arm", "knob", "arm.yaml", "", "write kind: knob"),
        ("kind:", "sort:", "arm.yaml", "", "its kind"),
        ("leader: {", "lead er: {", "graph.yaml", "6:3", "a word of letters"),
        ("serial_arm, ", "serial_arm, fraction: 1, ", "graph.yaml", "5:42", "'friction'"),
    ],
)
def test_a_problem_of_two_equal_arms_has_its_place(
    old: str, new: str, file: str, place: str, named: str, tmp_path: Path
) -> None:
    texts = {"graph.yaml": PAIR, "arm.yaml": "kind: serial_arm\nrate: $(arg turn)\n"}
    assert old in texts[file]
    texts[file] = texts[file].replace(old, new)
    for name, text in texts.items():
        written(tmp_path, text, name)
    said = problems_of(tmp_path / "graph.yaml")
    assert f"{tmp_path / file}:{place}: " in said or (not place and "graph.yaml:5:" in said)
    assert named in said


def test_a_default_lies_between_the_included_file_and_each_hand(tmp_path: Path) -> None:
    shared = "forcebound: 1\nseed: 1\nhands: { default: { include: stiff_wall.yaml } }\n"
    written(tmp_path, shared, "base.yaml")
    hands = """\
  default: { operator: { mass: 0.5 kg, stiffness: 700 N/m } }
  a:
  b: { operator: { mass: 0.7 kg } }
"""
    two = f"forcebound: 1\ninclude: base.yaml\nduration: 1 s\nhands:\n{hands}"
    written(tmp_path, f"{two}environment: {{ kind: wall }}\n", "two.yaml")
    top = "forcebound: 1\ninclude: two.yaml\nhands: { default: { operator: { mass: 0.9 kg } } }\n"
    found = {}
    for name in ("two.yaml", written(tmp_path, top).name):
        config = load(tmp_path / name)
        found[name] = [(h.operator.mass, h.operator.stiffness) for h in config.hands.values()]  # type: ignore[union-attr]
    assert found == {
        "two.yaml": [(0.5, 700.0), (0.7, 700.0)],
        "graph.yaml": [(0.9, 700.0), (0.9, 700.0)],
    }
    said = problems_of(tmp_path / "base.yaml")
    assert f"{tmp_path / 'base.yaml'}:3:10: hands: default " in said
