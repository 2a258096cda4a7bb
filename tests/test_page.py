"""The files of the live page: all that they name is there, and nothing comes from elsewhere."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import forcebound.observe.page
from forcebound.units import EVERYDAY

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
UNITS = {si: (one.factor, one.unit) for si, one in EVERYDAY.items()}  # as the server sends them


def run(tmp_path: Path, script: str) -> Any:
    """What an expression of JavaScript gives, which uses modules of the page without a page."""
    for name in ("scale.js", "shapes.js", "samples.js"):
        (tmp_path / name).write_text(SCRIPTS[name])
    (tmp_path / "package.json").write_text('{"type": "module"}')
    head = "import * as scale from './scale.js'; import { facesOf } from './shapes.js';"
    head += "import { History, Window } from './samples.js';"
    head += f"Object.assign(scale.units, {json.dumps(UNITS)});"
    (tmp_path / "main.js").write_text(f"{head} console.log(JSON.stringify({script}));")
    words = [str(NODE), str(tmp_path / "main.js")]
    return json.loads(subprocess.run(words, capture_output=True, check=True, text=True).stdout)


@pytest.mark.skipif(NODE is None, reason="needs node")
@pytest.mark.parametrize("name", sorted(SCRIPTS))
def test_a_script_can_be_read(name: str) -> None:
    words = [str(NODE), "--check", "--input-type=module", "-"]
    done = subprocess.run(words, input=SCRIPTS[name], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


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


def test_the_whole_run_is_kept_in_bounded_memory_with_its_extremes(tmp_path: Path) -> None:
    made = """(() => {
      const all = new History(400);
      for (let from = 0; from < 200000; from += 40) { // as frames have them
        const at = [...Array(40).keys()].map((k) => from + k), column = (of) => at.map(of);
        all.take(column((i) => 5 + 1e-3 * i), { x: column((i) => Math.sin(i / 50)), spike: column((i) => (i === 77777 ? 9 : 0)), none: column(() => null) });
      }
      const kept = (name) => [...all.values.get(name)].slice(0, all.count);
      return [all.count, all.oldest, all.newest, Math.min(...kept("x")), Math.max(...kept("x")), Math.max(...kept("spike")), all.values.has("none")];
    })()"""  # noqa: E501
    count, oldest, newest, low, high, spike, has_none = run(tmp_path, made)
    assert 100 <= count <= 400
    assert oldest == 5.0
    assert newest > 200.0
    assert (low, high) == pytest.approx((-1.0, 1.0), abs=1e-3)
    assert spike == 9
    assert not has_none


def test_one_looks_back_at_a_run_that_goes_on(tmp_path: Path) -> None:
    made = """(() => {
      const shown = new Window(), found = [];
      shown.begin(["hand"]);
      const run = (from, to) => { for (let i = from; i < to; i += 1) shown.take("hand", [1 + 1e-3 * i], { p0: [Math.floor(i / 1000)] }); };
      run(0, 5000);
      shown.scrub(3);
      for (const end of [5000, 30000, 90000]) {
        run(found.length ? [5000, 30000][found.length - 1] : 0, end);
        found.push([shown.to, shown.past("hand")("p0"), shown.of("hand") instanceof History]);
      }
      shown.scrub(shown.latest);
      return [found, shown.isPaused, shown.past("hand"), shown.oldest];
    })()"""  # noqa: E501
    found, is_paused, past, oldest = run(tmp_path, made)
    assert [to for to, *_ in found] == [3.0, 3.0, 3.0]
    assert [is_history for *_, is_history in found] == [False, False, True]
    assert found[-1][1] in (1, 2)
    assert (is_paused, past) == (False, None)
    assert oldest == pytest.approx(1.0)
