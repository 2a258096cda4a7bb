"""Maps of sweeps, and what a damaged result may not do to them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure
from matplotlib.text import Text
from sweep_files import SMALL, written

from forcebound.cli import main
from forcebound.errors import ConfigError
from forcebound.haptics.laws import LAWS
from forcebound.lab.cases import grid
from forcebound.lab.engine import Campaign, run
from forcebound.lab.sweep.limits import LABELS
from forcebound.lab.sweep.map_data import drawing_of
from forcebound.lab.sweep.maps import draw, figure_of
from forcebound.lab.sweep.plan import load_sweep
from forcebound.lab.sweep.runner import run_sweep
from forcebound.lab.table import read_table
from forcebound.results.colours import LAW_COLOURS
from forcebound.results.panels import in_figure


@pytest.mark.parametrize("y", ["", "y: stiffness, "])
def test_a_map_is_drawn(tmp_path: Path, y: str) -> None:
    limits = "limits: [diolaiti, abbott_okamura, colgate_schenkel]"
    x = "x: delay, " if y else "x: stiffness, "
    text = SMALL.replace("x: stiffness, value: peak_force_n", f"{x}{y}value: true_energy_min_j")
    text = text.replace("per: law }", f"per: law, {limits} }}")
    text = text.replace("map:", "  delay: { from: 0 ms, to: 1 ms, count: 2 }\nmap:")
    result, picture = tmp_path / "small.parquet", tmp_path / "small.png"
    run_sweep(load_sweep(written(tmp_path, text)), result)
    draw(result, picture)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_law_has_the_same_colour_as_in_any_other_figure(tmp_path: Path) -> None:
    result, picture = tmp_path / "small.parquet", tmp_path / "small.svg"
    run_sweep(load_sweep(written(tmp_path, SMALL)), result)
    draw(result, picture)
    text = picture.read_text().upper()
    assert all(LAW_COLOURS[law] in text for law in ("certified", "none"))
    assert set(LAW_COLOURS) == set(LAWS)
    assert len(set(LAW_COLOURS.values())) == len(LAWS)


GRID = """
forcebound: 1
description: a map
launch: released_hand
duration: 500 ms
over:
  law: [none, certified]
  delay: { from: 0 ms, to: 4 ms, count: 3 }
  stiffness: { from: 0.02 N/mm, to: 5 N/mm, count: 4, scale: log }
map: { x: delay, y: stiffness, value: displayed_stiffness_n_per_m, scale: log, per: law }
"""


def texts(figure: Figure) -> set[str]:
    return {text.get_text() for legend in figure.legends for text in legend.get_texts()}


def test_a_map_of_stiffness_shows_leaks_rest_and_where_a_wall_feels_softer(tmp_path: Path) -> None:
    shown = "leaks: true_energy_min_j, limits: [colgate_schenkel, encoder], per: law }"
    result = tmp_path / "map.parquet"
    run_sweep(load_sweep(written(tmp_path, GRID.replace("per: law }", shown))), result)
    table = read_table(result)
    figure = figure_of(table)
    panels = [axes for axes in figure.axes if axes.get_title()]
    assert [axes.get_title() for axes in panels] == ["none", "certified"]
    red = [np.ma.count(np.ma.asarray(axes.collections[1].get_array())) for axes in panels]
    assert red[0] > 0  # without a law the stiff and late walls leak
    assert red[1] == 0
    assert {"no rest", "encoder: 2 f_c / resolution"} <= texts(figure)
    hatched = [each for axes in panels for each in axes.collections if each.get_hatch()]
    assert any(np.ma.getmaskarray(np.ma.asarray(each.get_array())).any() for each in hatched)
    assert any("softer" in text for text in texts(figure))
    (line,) = (line for legend in figure.legends for line in legend.get_lines()[-1:])
    assert line.get_color() == "white"
    assert line.get_path_effects(), "a white line on a white page needs an edge"
    figure.draw_without_rendering()
    numbers = [text.get_text() for axes in figure.axes for text in axes.get_yticklabels()]
    assert any(numbers)
    assert not any("$" in number for number in numbers), "plain numbers, no powers of ten"
    bars = {axes.get_ylabel() for axes in figure.axes}
    assert {"displayed stiffness (N/mm)", "energy given to the hand (mJ)"} <= bars


def test_a_cell_without_stiffness_is_counted_and_has_a_colour_of_its_own(tmp_path: Path) -> None:
    columns = {
        "over.stiffness": [1e3, 2e3, 1e3, 2e3],
        "over.delay": [0.0, 0.0, 1e-3, 1e-3],
        "peak_force_n": [1.0, 0.0, 2.0, 0.0],
    }
    shown = {"x": "delay", "y": "stiffness", "value": "peak_force_n"}
    for scale, found in (("log", {"0: below the scale (cells: 2)"}), ("linear", set())):
        path = hostile(tmp_path / "a.parquet", columns, {"map": {**shown, "scale": scale}})
        figure = figure_of(read_table(path))
        assert texts(figure) == found
        grey = [each for each in figure.axes[0].collections[2:] if not each.get_hatch()]
        assert [np.ma.count(np.ma.asarray(each.get_array())) for each in grey] == [2] * len(found)


def test_a_map_of_energy_for_one_law_has_one_panel_and_one_scale(tmp_path: Path) -> None:
    text = GRID.replace("displayed_stiffness_n_per_m, scale: log", "true_energy_min_j")
    result = tmp_path / "map.parquet"
    run_sweep(load_sweep(written(tmp_path, text), ["law:=certified"]), result)
    figure = figure_of(read_table(result))
    assert "no energy given" in texts(figure)
    assert len(figure.axes) == 2
    draw(result, tmp_path / "map.svg")


def hostile(path: Path, columns: dict[str, Any], about: object) -> Path:
    content = {b"forcebound": json.dumps(about).encode()}
    pq.write_table(pa.table(columns).replace_schema_metadata(content), path, compression="zstd")
    return path


@pytest.mark.parametrize("drawing", [{}, {"y": "delay"}])
def test_names_in_a_result_are_drawn_as_they_are(tmp_path: Path, drawing: dict[str, str]) -> None:
    name = r"$\frac{$ [/bold]"
    columns = {
        "over.stiffness": [1.0, 2.0],
        "over.delay": [0.0, 1e-3],
        "over.law": [name, name],
        "at_rest": [True, True],
        "peak_force_n": [1.0, 2.0],
    }
    shown = {"x": "stiffness", "value": "peak_force_n", "per": "law", "title": name, **drawing}
    path = hostile(tmp_path / "a.parquet", columns, {"map": shown})
    figure = figure_of(read_table(path))
    texts = [text.get_text() for text in figure.findobj(Text)]
    assert texts.count(in_figure(name)) >= 1
    draw(path, tmp_path / "x.png")


@pytest.mark.parametrize(
    "about", [[], {"map": [1]}, {"map": {"x": 1, "value": "stiffness"}}, {"map": {"x": "nothing"}}]
)
def test_a_description_of_no_sweep_is_refused(tmp_path: Path, about: object) -> None:
    result = hostile(tmp_path / "a.parquet", {"over.stiffness": [1.0]}, about)
    with pytest.raises(ConfigError):
        draw(result, tmp_path / "x.png")


def test_a_long_text_is_read_once_for_all_rows_that_have_it(tmp_path: Path) -> None:
    result = hostile(tmp_path / "a.parquet", {"error": ["x" * 20_000] * 1000}, {})
    assert result.stat().st_size < 10_000
    texts = read_table(result).columns["error"]
    assert len(texts) == 1000
    assert len({id(text) for text in texts}) == 1


def test_a_result_with_too_many_rows_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("forcebound.lab.table.MAX_ROWS", 999)
    result = hostile(tmp_path / "a.parquet", {"over.delay": [1.0] * 1000}, {"map": {}})
    with pytest.raises(ConfigError, match="999"):
        draw(result, tmp_path / "x.png")


def test_a_file_that_is_no_result_is_refused(tmp_path: Path) -> None:
    nested = hostile(tmp_path / "a.parquet", {"x": [[[1.0]] * 9]}, {})
    for path in (nested, written(tmp_path, SMALL)):
        with pytest.raises(ConfigError, match="not a result of a sweep"):
            draw(path, tmp_path / "x.png")


def made_in_python(path: Path, drawing: dict[str, str], **more: Any) -> Path:
    """A result of a campaign in Python, whose rows have no more than its function gave."""
    cases = grid(law=["none", "tdpa"], stiffness=[1e3, 2e3, 4e3], delay=[0.0, 1e-3])
    rows = [{**case, "contacts": i, **more} for i, case in enumerate(cases)]
    run(Campaign("contacts", rows, list, about={"map": drawing}), result=path)
    return path


def test_a_campaign_in_python_has_a_map_of_two_arguments(tmp_path: Path) -> None:
    drawing = {"x": "delay", "y": "stiffness", "value": "contacts", "per": "law"}
    result = made_in_python(tmp_path / "a.parquet", drawing)
    figure = figure_of(read_table(result))
    assert [axes.get_title() for axes in figure.axes][:2] == ["none", "tdpa"]
    draw(result, tmp_path / "a.png")
    figure = figure_of(read_table(result), limits=["colgate_schenkel"])  # no device, no limit
    assert not any(axes.lines for axes in figure.axes)
    assert any("Schenkel" in text and "without" in text for text in texts(figure))


#: Limits in a map of a launch file, and those of them that are drawn.
DRAWN = {
    "stiff_wall": ("colgate_schenkel", "with_hand", "encoder", "abbott_okamura", "diolaiti", "gil"),
    "three_axes": ("colgate_schenkel", "with_hand", "encoder", "abbott_okamura", "diolaiti", "gil"),
    "damped_wall": ("colgate_schenkel", "with_hand", "encoder", "gil"),  # the wall has damping
    "cart_pendulum": (),  # no wall
    "five_bar_wall": (),  # an arm: the damping of its joints is not that of the tip
    "servo_wall": (),
}


@pytest.mark.parametrize("launch", DRAWN)
def test_a_limit_is_drawn_where_it_applies_and_else_the_legend_says_what_it_needs(
    tmp_path: Path, launch: str
) -> None:
    text = f"forcebound: 1\nlaunch: {launch}\nduration: 100 ms\nover: {{stiffness: [100, 200]}}\n"
    shown = "{ x: stiffness, y: stiffness, value: peak_force_n }"
    result = tmp_path / "a.parquet"
    run_sweep(load_sweep(written(tmp_path, f"{text}map: {shown}")), result)
    (axes,) = (
        axes
        for axes in figure_of(
            read_table(result), limits=["encoder"], x="stiffness", y="stiffness"
        ).axes
        if axes.get_xlabel()
    )
    assert axes.get_xlim() == pytest.approx((0.05, 0.25)), "the cells at the ends are whole"
    for name, label in LABELS.items():
        figure = figure_of(read_table(result), limits=[name], x="stiffness", y="stiffness")
        lines = [line for axes in figure.axes for line in axes.lines]
        assert len(lines) == (name in DRAWN[launch]), name
        absent = [text for text in texts(figure) if "not drawn" in text]
        assert len(absent) == (name not in DRAWN[launch])
        assert all(label.split()[-1] in text for text in absent)


def test_limits_that_are_one_line_are_drawn_once(tmp_path: Path) -> None:
    result = tmp_path / "map.parquet"
    run_sweep(load_sweep(written(tmp_path, GRID)), result)  # neither hand nor wall has damping
    names = ["colgate_schenkel", "with_hand", "gil"]
    figure = figure_of(read_table(result), limits=names)
    assert [len(axes.lines) for axes in figure.axes if axes.get_title()] == [1, 1]


def test_any_column_is_drawn_but_no_list(tmp_path: Path) -> None:
    result = made_in_python(tmp_path / "a.parquet", {}, depths=[1.0, 2.0], peak_force_n=2.0)
    for value in ("contacts", "peak_force", "peak_force_n"):
        figure = figure_of(read_table(result), value=value, x="delay", y="stiffness", per="law")
        assert len([axes for axes in figure.axes if axes.get_title()]) == 2
    for wrong in ("depths", "law", "contact"):
        with pytest.raises(ConfigError, match=wrong):
            draw(result, tmp_path / "x.png", value=wrong, x="delay")


def test_axes_that_are_not_named_are_the_varied_arguments(tmp_path: Path) -> None:
    result = tmp_path / "map.parquet"
    run_sweep(load_sweep(written(tmp_path, GRID.partition("map:")[0])), result)
    with pytest.raises(ConfigError, match="column"):
        draw(result, tmp_path / "x.png")
    arguments = ["map", str(result), "--value", "contact_bounces", "-o", str(tmp_path / "x.png")]
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 0, done.output
    table = read_table(result)
    drawing = drawing_of(table, value="contact_bounces")
    assert drawing == {"value": "contact_bounces", "x": "stiffness", "y": "delay", "per": "law"}
    curves = figure_of(table, value="contact_bounces", x="stiffness")
    assert len(curves.axes) == 3  # delays
    assert [text.get_text() for text in curves.legends[0].get_texts()][:2] == ["none", "certified"]


def test_a_result_with_too_many_entries_in_lists_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("forcebound.lab.table.MAX_VALUES", 999)
    result = hostile(tmp_path / "a.parquet", {"x": [[1.0] * 1000]}, {})
    with pytest.raises(ConfigError, match="999"):
        read_table(result)
