"""The files of the live page: all that they name is there, and nothing comes from elsewhere."""

import re
from pathlib import Path

import pytest

import forcebound.observe.page

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
    known = set(re.findall(r'\bid="([a-z]+)"', TEXTS["index.html"]))
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
