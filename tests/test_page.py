"""The files of the live page: all that they name is there, and nothing comes from elsewhere."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builders import MS, telemetry_packet

import forcebound.observe.page
from forcebound.messages.control import BounderReport
from forcebound.observe.page.controls import Controls

PAGE = Path(forcebound.observe.page.__file__).parent / "static"
TEXTS = {file.name: file.read_text() for file in PAGE.iterdir()}
SCRIPTS = {name: text for name, text in TEXTS.items() if name.endswith(".js")}
STYLE = TEXTS["style.css"]
LIGHT, DARK = (
    dict(re.findall(r"--([a-z]+): (#[0-9a-f]{3,6});", block))
    for block in re.findall(r":root \{(.*?)\}", STYLE, re.DOTALL)
)


def test_nothing_comes_from_elsewhere() -> None:
    for name, text in TEXTS.items():
        namespaces = text.replace("http://www.w3.org/2000/svg", "")
        assert not re.search(r"(https?|wss):|//[a-z]+\.[a-z]", namespaces), name


def test_scripts_use_elements_and_colours_that_there_are() -> None:
    made = "".join(SCRIPTS.values())
    known = set(re.findall(r'\bid="([a-z]+)"', TEXTS["index.html"] + TEXTS["study.html"]))
    for name in re.findall(r'(?:\$|getElementById)\("([a-z]+)"\)', made):
        assert name in known
    colours = re.findall(r'(?<!\w)colour\("([a-z]+)"\)|colour: "([a-z]+)"', made)
    assert len(colours) > 5
    for pair in colours:
        assert "".join(pair) in LIGHT


def luminance(colour: str) -> float:
    """Relative luminance of a colour; source: WCAG 2.2, W3C 2023."""
    digits = colour.lstrip("#")
    if len(digits) == 3:
        digits = "".join(digit * 2 for digit in digits)
    red, green, blue = (int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4))
    shares = [
        x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in (red, green, blue)
    ]
    return 0.2126 * shares[0] + 0.7152 * shares[1] + 0.0722 * shares[2]


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("scheme", [LIGHT, DARK], ids=["light", "dark"])
def test_text_and_lines_stand_out(scheme: dict[str, str]) -> None:
    for ground in ("ground", "panel"):
        for text in ("text", "soft", "fault"):
            assert contrast(scheme[text], scheme[ground]) >= 4.5  # WCAG 1.4.3
        for line in ("true", "commanded", "energy", "second"):
            assert contrast(scheme[line], scheme[ground]) >= 3.0  # WCAG 1.4.11


NODE = shutil.which("node")


def run(tmp_path: Path, script: str) -> Any:
    """What an expression of JavaScript gives, which uses modules of the page without a page."""
    for name in ("state.js", "scale.js", "shapes.js"):
        (tmp_path / name).write_text(SCRIPTS[name])
    (tmp_path / "package.json").write_text('{"type": "module"}')
    head = "import { State } from './state.js'; import * as scale from './scale.js';"
    head += "import { facesOf } from './shapes.js';"
    (tmp_path / "main.js").write_text(f"{head} console.log(JSON.stringify({script}));")
    words = [str(NODE), str(tmp_path / "main.js")]
    return json.loads(subprocess.run(words, capture_output=True, check=True, text=True).stdout)


@pytest.mark.skipif(NODE is None, reason="needs node")
@pytest.mark.parametrize("name", sorted(SCRIPTS))
def test_a_script_can_be_read(name: str) -> None:
    words = [str(NODE), "--check", "--input-type=module", "-"]
    done = subprocess.run(words, input=SCRIPTS[name], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


STATE = """(() => {
  const state = new State();
  Object.assign(state, { law, reason, holder });
  for (let i = 0; i <= 60; i += 1) {
    const time = 1 + i / 30, x = 0.012 + swing * Math.sin(20 * time), isIn = time <= 3 - away;
    state.take({ time: [time], position: [[x]], commanded: [[isIn ? 20 : 0]],
      applied: [[isIn ? applied : 0]],
      energy: [fall * (time - 1)], true_energy: [isTrue ? fall * (time - 1) : null],
      misses: Math.round(lost * 1e3 * time),
      delay: [delay], engagement, since: 1, limit: [8.5] });
  }
  state.broken = broken;
  const { kind, head, more } = state.words("wall");
  return [kind, /[\\d.]+ m?J/.exec(head)?.[0] ?? "", head, more];
})()"""
HEALTHY = {
    "law": "certified", "swing": 0.0, "applied": 20.0, "fall": 0.01, "lost": 0.0, "delay": 1e-3,
    "engagement": 1.0, "isTrue": True, "reason": "", "away": 0.0, "broken": "",
    "holder": "the hand",
}  # fmt: skip


def state_of(tmp_path: Path, change: dict[str, Any]) -> list[str]:
    """Kind, energy, head and explanation of the state after two seconds of frames."""
    known = "".join(f"const {k} = {json.dumps(v)};" for k, v in (HEALTHY | change).items())
    state: list[str] = run(tmp_path, f"(() => {{ {known} return {STATE}; }})()")
    return state


@pytest.mark.skipif(NODE is None, reason="needs node")
@pytest.mark.parametrize(
    ("change", "kind", "energy"),
    [
        ({}, "passive", ""),
        ({"swing": 5e-3}, "passive", ""),
        ({"law": "none"}, "off", ""),  # nothing has happened, and nothing guards
        ({"law": "none", "swing": 5e-3, "fall": -1.7}, "unstable", "3.4 J"),
        ({"fall": -0.01}, "unstable", "20 mJ"),  # whatever the law is called
        ({"lost": 0.1, "applied": 5.0}, "late", ""),
        ({"lost": 0.1}, "passive", ""),  # ticks are missed, and nobody feels it
        ({"applied": 5.0}, "passive", ""),
        ({"delay": None}, "off", ""),
        ({"engagement": 0.4}, "off", ""),
        ({"isTrue": False}, "passive", ""),
        ({"isTrue": False, "fall": -0.01}, "off", "20 mJ"),  # of the motor
        ({"broken": "3 of 4"}, "late", ""),  # not passive, whatever the energy is
        ({"broken": "3 of 4", "isTrue": False, "fall": -0.01}, "late", ""),
        ({"broken": "3 of 4", "fall": -0.01}, "unstable", "20 mJ"),
    ],
)
def test_the_state_in_words(tmp_path: Path, change: dict[str, Any], kind: str, energy: str) -> None:
    assert state_of(tmp_path, change)[:2] == [kind, energy]


@pytest.mark.skipif(NODE is None, reason="needs node")
@pytest.mark.parametrize(
    ("change", "words", "absent"),
    [
        ({}, "all 20 N", "ticks"),
        ({"applied": 5.0}, "5 N of the 20 N", "ticks"),
        ({"applied": 5.0, "reason": "too far: come nearer"}, "commands: too far.", "nearer"),
        ({"applied": 5.0, "reason": "too far", "law": "none"}, "5 N of the 20 N", "too far"),
        ({"lost": 0.015, "applied": 5.0}, "30 ticks were missed in this contact", "% of the ticks"),
        ({"lost": 0.005, "applied": 5.0}, "5 N of the 20 N", "press again"),  # too few to feel
        ({"lost": 0.015}, "all 20 N", "press again"),
        ({"lost": 0.1, "applied": 5.0}, "10 % of the ticks", "press again"),
        ({"law": "none", "swing": 5e-3, "fall": -1.7}, "none", "ticks"),
        ({"isTrue": False, "fall": -0.01}, "friction", "ticks"),
        ({"broken": "3 of 4"}, "3 of 4", "all 20 N"),
        ({"broken": "3 of 4", "fall": -0.01}, "3 of 4", "all 20 N"),
        ({"away": 0.2}, "all 20 N", "No contact"),  # a bounce
        ({"away": 0.3}, "No contact", "20 N"),
    ],
)
def test_what_explains_the_state(
    tmp_path: Path, change: dict[str, Any], words: str, absent: str
) -> None:
    *_, head, more = state_of(tmp_path, change)
    assert words in more
    assert absent not in more
    assert ("Late ticks" in head) == (change.get("lost") == 0.1)
    assert ("assive" in head) <= ("broken" not in change or change.get("fall") == -0.01)


@pytest.mark.parametrize(("law", "is_named"), [("certified", True), ("none", False)])
def test_the_page_gets_the_promise_that_a_device_breaks_now(law: str, is_named: bool) -> None:
    controls = Controls.__new__(Controls)  # without a graph
    device = {"law": law, "rate": 1000.0, "write_delay": 4e-4}
    report = BounderReport(hold_limit=1e-3, longest_hold_limit=1e-3, largest_allowance=1e-4)
    vars(controls).update(_devices=dict.fromkeys(("left", "right"), (device, report)))
    late, punctual = (
        [
            telemetry_packet(n, applied_force=(1.0,), read_ns=n * MS, write_ns=n * MS + delay)
            for n in range(9)
        ]
        for delay in (500_000, 400_000)
    )
    found = controls.broken({"left": (late, ()), "right": (punctual, ())})
    assert found["right"] == ""
    assert ("9 of 9 forces acted later than device.write_delay" in found["left"]) == is_named


@pytest.mark.skipif(NODE is None, reason="needs node")
def test_a_follower_that_nobody_holds_has_no_hand(tmp_path: Path) -> None:
    *_, head, _ = state_of(tmp_path, {"fall": -0.01, "holder": "what it meets"})
    assert "what it meets received" in head
    assert "hand" not in head


@pytest.mark.skipif(NODE is None, reason="needs node")
def test_scales_are_round_and_those_of_the_law_in_use(tmp_path: Path) -> None:
    bars = run(tmp_path, "[15000, 3333, 1e6].map((pixels) => scale.scaleBar(pixels, 160))")
    assert [bar["words"] for bar in bars] == ["10 mm", "20 mm", "0.1 mm"]
    assert bars[0]["pixels"] == pytest.approx(150.0)
    columns = "[{ at: 10, low: -14e3, high: 0 }, { at: 11, low: 0, high: 20 }]"
    assert run(tmp_path, f"scale.rangeOf({columns}, 10, 1)") == pytest.approx([0.0, 21.6])
    assert run(tmp_path, f"scale.rangeOf({columns}, 0, 1)")[0] < -14e3
    assert run(tmp_path, "scale.rangeOf([], 0, 1)")[1] >= 1.0


@pytest.mark.skipif(NODE is None, reason="needs node")
def test_large_triangles_of_a_mesh_are_cut_into_the_same_area(tmp_path: Path) -> None:
    small = [[[i, 0, 0], [i + 1, 0, 0], [i, 1, 0]] for i in range(40)]
    file = json.dumps({"corners": [*small, [[0, 0, 5], [30, 0, 5], [0, 40, 5]]]})
    faces = run(tmp_path, f"facesOf({{ shape: 'mesh' }}, {file}).map((face) => face.points)")
    corners = np.array([points for points in faces if points[0][2] == 5])
    edges = corners - np.roll(corners, 1, axis=1)
    assert np.linalg.norm(edges, axis=2).max() < 10.0
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    assert areas.sum() == pytest.approx(600.0)
    assert len(faces) == len(corners) + 40


@pytest.mark.skipif(NODE is None, reason="needs node")
def test_every_scale_has_at_least_two_ticks(tmp_path: Path) -> None:
    ranges = "[0.1, 0.7, 1.61, 2.49, 4.02, 99].flatMap((high) => [[-high, high], [0, high]])"
    for found in run(tmp_path, f"{ranges}.map(([low, high]) => scale.ticks(low, high, 3))"):
        assert 2 <= len(found) <= 6
        assert any(abs(tick) < 1e-9 for tick in found)
