"""The words of findings: units, parts that may be missing, and no code without words."""

import re

import pytest

from forcebound import realtime
from forcebound.monitor import wording
from forcebound.monitor.findings import Fact, Finding
from forcebound.monitor.texts import CAUSES, FINDINGS, NOTES, Text

TABLES = {**FINDINGS, **CAUSES, **NOTES}


def test_a_number_is_written_in_the_unit_that_its_text_names() -> None:
    data = {"delay": 0.01234, "room": 123_456_789}
    assert wording.render("{delay:.1f ms} and {room:.0f MB}", data) == "12.3 ms and 123 MB"
    assert wording.render("{delay:.1%}, {room}", data) == "1.2%, 123456789"


def test_a_part_without_its_values_is_left_out() -> None:
    template = "is late|; {restarts} restarts|; load {load:.1f}"
    assert wording.render(template, {"restarts": None, "load": 2.0}) == "is late; load 2.0"
    assert wording.render(template, {}) == "is late"
    with pytest.raises(KeyError, match="pid"):
        wording.render("process {pid}", {"pid": None})


def test_a_delay_is_not_said_to_be_exceeded_by_answers_that_all_have_it() -> None:
    said = wording.remedy(Fact("delay", {"p50": 4.4e-3}))
    assert said.startswith("half of the answers are 4.4 ms old or older: less delay")


def test_the_causes_of_a_finding_add_to_its_advice_and_commands() -> None:
    causes = (Fact("load", {"load": 3.0, "cores": 2}), Fact("unknown"))
    finding = Finding("note", "process_stopped", "a", {"node": "a", "state": "stopped"}, causes)
    first, load, unknown = wording.advice(finding).split("; ")
    assert first == "forcebound start a"
    assert load.startswith("the load is 3.0 on 2 cores")
    assert unknown.endswith(": forcebound doctor --measure")
    assert wording.commands(finding) == ["forcebound start a", "forcebound doctor --measure"]


@pytest.mark.parametrize("code", sorted(realtime.SENTENCES))
def test_each_fact_of_scheduling_can_be_a_cause(code: str) -> None:
    assert CAUSES[code].action == realtime.SENTENCES[code]


@pytest.mark.parametrize(("code", "text"), sorted(TABLES.items()))
def test_each_text_can_be_rendered(code: str, text: Text) -> None:
    for template in text:
        names = re.findall(r"{(\w+)", template)
        rendered = wording.render(template, dict.fromkeys(names, 1))
        assert not set("{}|") & set(rendered)
    assert any(text)
