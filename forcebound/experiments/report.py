"""Report of the experiments: one HTML page with text, numbers, pictures and commands."""

import base64
import html
import platform
from collections.abc import Mapping
from importlib.metadata import version

from forcebound.experiments.outcome import Number, Outcome, label
from forcebound.experiments.setup import HAND, PAPER_SURFACE, SPEEDS, SURFACE
from forcebound.experiments.table1 import COLUMNS, WORDS, Row

STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, sans-serif; color: #1b1b1b; background: #fff;
  max-width: 70rem; margin: 2rem auto; padding: 0 1.5rem; }
h1 { line-height: 1.2; margin-bottom: .3rem; }
h2 { margin-top: 3rem; border-top: 1px solid #ccc; padding-top: 1.2rem; line-height: 1.25; }
p, li { max-width: 48rem; }
nav ol { columns: 2 22rem; padding-left: 1.4rem; font-size: .93rem; }
img { width: 100%; height: auto; margin: .6rem 0; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .9rem; margin: .8rem 0; }
th, td { padding: .22rem .8rem .22rem 0; text-align: left; border-bottom: 1px solid #e4e4e4; }
th { font-weight: 600; }
th, td { vertical-align: top; }
.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
.quiet { color: #5a5a5a; }
code, pre { font: .85rem/1.45 ui-monospace, monospace; }
pre { background: #f6f6f6; padding: .7rem .9rem; overflow-x: auto; }
summary { cursor: pointer; color: #5a5a5a; font-size: .9rem; }
dt { font-weight: 600; float: left; clear: left; width: 5.5rem; }
dd { margin: 0 0 .3rem 5.5rem; max-width: 44rem; }
@media print { details > pre { display: none; } h2 { break-after: avoid; } }
"""

PARAMETERS = (
    (
        "device",
        "PHANToM Premium 1.5, y axis, simulated: mass 0.075 kg (data sheet), damping "
        "0.27 N s/m, Coulomb friction 0.12 N, resolution 0.03 mm, largest force 8.5 N (paper 4.1)",
    ),
    ("loop", "1 kHz, no delay between reading and writing, steady clock: T_max = T"),
    (
        "wall",
        "10 N/mm behind 10 mm, unless stated otherwise (paper 4.1), "
        f"{(PAPER_SURFACE - SURFACE) * 1e6:.1f} µm before a step of the encoder",
    ),
)


def report(outcomes: Mapping[str, Outcome], pictures: Mapping[str, bytes], command: str) -> str:
    """Return the page.

    Args:
        outcomes: The experiments by name, in their order.
        pictures: PNG of each.
        command: Command that made the page.
    """
    parts = [_head(outcomes, command)]
    for name, outcome in outcomes.items():
        parts.append(_section(name, outcome, pictures[name]))
    parts.append("</body>\n</html>\n")
    return "\n".join(parts)


def _text(text: object) -> str:
    return html.escape(str(text))


def _head(outcomes: Mapping[str, Outcome], command: str) -> str:
    contents = "\n".join(
        f'<li><a href="#{name}">{_text(label(name))}: {_text(outcome.title)}</a></li>'
        for name, outcome in outcomes.items()
    )
    rows = [*PARAMETERS, ("hand", f"{HAND} (not Fig. 19)")]
    rows += [
        (
            f"{name} speed",
            f"the hand's target moves at {approach.speed * 1e3:g} mm/s, {approach.way * 1e3:g} mm "
            f"to the wall, to {approach.target * 1e3:g} mm behind its surface",
        )
        for name, approach in SPEEDS.items()
    ]
    parameters = "\n".join(
        f"<tr><th>{_text(name)}</th><td>{_text(value)}</td></tr>" for name, value in rows
    )
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>forcebound: reproduction of the paper</title>
<style>{STYLE}</style>
</head>
<body>
<h1>Reproduction of the paper</h1>
<p class="quiet"><cite>An enhanced force bounding approach for stable haptic interaction
by including friction</cite>, International Journal of Precision Engineering and Manufacturing
18(6), 2017.</p>
<p>Every experiment below is a simulated run, in virtual time, of the same nodes and launch files
that drive a live system. The paper's numbers are given for comparison. The laws
<code>certified</code> and <code>certified_memoryless</code> are this project's own, not the
paper's: every comparison includes them. The energy is the ground truth of the simulation;
below zero, the hand received more than it put in. With a quantised encoder no law of the paper
excludes this; the certified laws do.</p>
<pre>{_text(command)}</pre>
<p class="quiet">forcebound {_text(version("forcebound"))}, Python
{_text(platform.python_version())}, numpy {_text(version("numpy"))}, numba
{_text(version("numba"))}. The same command and version give the same numbers.</p>
<div class="wide"><table>
{parameters}
</table></div>
<nav><ol>
{contents}
</ol></nav>"""


def _section(name: str, outcome: Outcome, picture: bytes) -> str:
    heading = f"{_text(label(name))}: {_text(outcome.title)}"
    image = base64.b64encode(picture).decode("ascii")
    commands = "\n".join(outcome.commands)
    table = outcome.document.get("table1")
    numbers = (
        _numbers(outcome)
        if table is None
        else _table1([Row(**row) for row in [*table, *outcome.document["table1_certified"]]])
    )
    return f"""<section id="{name}">
<h2>{heading}</h2>
<dl><dt>Paper</dt><dd>{_text(outcome.paper)}</dd><dt>Here</dt><dd>{_text(outcome.finding)}</dd></dl>
<img src="data:image/png;base64,{image}" alt="{heading}">
<div class="wide">{numbers}</div>
<details><summary>Commands</summary>
<pre>forcebound reproduce {name}
{_text(commands)}</pre></details>
</section>"""


def _numbers(outcome: Outcome) -> str:
    rows = "\n".join(
        f"<tr><td>{_text(number.quantity)}</td><td><code>{_text(number.law)}</code></td>"
        f'<td class="number">{show(number.ours)}</td>'
        f'<td class="number">{show(number.paper)}</td><td>{_unit(number)}</td></tr>'
        for number in outcome.numbers
    )
    return (
        '<table><tr><th>quantity</th><th>law</th><th class="number">ours</th>'
        f'<th class="number">paper</th><th>unit</th></tr>\n{rows}\n</table>'
    )


def _table1(rows: list[Row]) -> str:
    head = "".join(
        f'<th class="number">{_text(WORDS[quantity])},<br>{_text(speed)} speed</th>'
        for quantity, speed in COLUMNS
    )
    lines = []
    for law in dict.fromkeys(row.law for row in rows):
        cells = {(row.quantity, row.speed): row for row in rows if row.law == law}
        lines.append(
            f"<tr><td><code>{_text(law)}</code></td>"
            + "".join(_cell(cells[column]) for column in COLUMNS)
            + "</tr>"
        )
    return (
        f"<table><tr><th>law</th>{head}</tr>\n"
        + "\n".join(lines)
        + '</table><p class="quiet">N/mm, ours / paper. The hand was fitted to all cells of the '
        "paper.</p>"
    )


def _cell(row: Row) -> str:
    paper = "" if row.paper is None else f" / {row.paper:.2f}"
    return f'<td class="number">{row.ours:.2f}{paper}</td>'


def _unit(number: Number) -> str:
    return "" if number.unit == "1" else _text(number.unit)


def show(value: float | None) -> str:
    """Return a number with three significant digits, or a dash."""
    if value is None:
        return "–"
    if value == 0.0:
        return "0"
    if abs(value) < 1e-3 or abs(value) >= 1e5:
        return f"{value:.1e}"
    return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"
