"""Findings, causes and notes in words: their texts with the data filled in."""

from collections.abc import Iterator, Mapping
from string import Formatter
from typing import Any

from forcebound.monitor.findings import Fact, Finding
from forcebound.monitor.texts import CAUSES, FINDINGS, NOTES, Text

# One of these units is so many times smaller than the SI unit.
_UNITS = {"ms": 1e3, "mJ": 1e3, "us": 1e6, "min": 1 / 60, "KiB": 1 / 1024, "MB": 1e-6, "GB": 1e-9}
_UNITS["MB/s"] = _UNITS["MB"]


def seen(finding: Finding) -> str:
    """Return what a finding is, in one sentence with figures."""
    return render(FINDINGS[finding.kind].seen, finding.data)


def advice(finding: Finding) -> str:
    """Return what to do about a finding, the commands included; empty if there is nothing to do."""
    steps = (_join(text.action, text.command) for text in _advising(finding))
    return "; ".join(filter(None, steps))


def commands(finding: Finding) -> list[str]:
    """Return the shell commands that help with a finding."""
    return [text.command for text in _advising(finding) if text.command]


def note(fact: Fact) -> str:
    """Return a note on a change of parameters in words."""
    return _join(*_rendered(NOTES[fact.code], fact.data))


def remedy(cause: Fact) -> str:
    """Return what to do about a cause, the command included."""
    text = _rendered(CAUSES[cause.code], cause.data)
    return _join(text.action, text.command)


def render(template: str, data: Mapping[str, Any]) -> str:
    """Return a text with its values, without the further parts of which a value is not known."""
    known = {name: value for name, value in data.items() if value is not None}
    first, *further = template.split("|")
    parts = [first, *(part for part in further if _names(part) <= known.keys())]
    return "".join(_FORMATTER.vformat(part, (), known) for part in parts)


def _advising(finding: Finding) -> Iterator[Text]:
    yield _rendered(FINDINGS[finding.kind], finding.data)
    yield from (_rendered(CAUSES[cause.code], cause.data) for cause in finding.causes)


def _rendered(text: Text, data: Mapping[str, Any]) -> Text:
    return Text(*(render(template, data) for template in text))


def _join(*parts: str) -> str:
    return ": ".join(filter(None, parts))


def _names(template: str) -> set[str]:
    return {name for _, name, _, _ in _FORMATTER.parse(template) if name}


class _UnitFormatter(Formatter):
    def format_field(self, value: Any, format_spec: str) -> str:
        number, _, unit = format_spec.partition(" ")
        return f"{value * _UNITS[unit]:{number}} {unit}" if unit else format(value, number)


_FORMATTER = _UnitFormatter()
