"""What users test their own parts with: it passes what is right, and names what is wrong."""

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from launch_texts import written

from forcebound.errors import ConfigError, DeviceError
from forcebound.graph.loader import from_document, load
from forcebound.graph.resolved import to_document
from forcebound.haptics.environments import ENVIRONMENTS
from forcebound.haptics.hands.hands import PressingHand
from forcebound.haptics.laws import LAWS
from forcebound.run.virtual import run_virtual
from forcebound.testing import (
    HALF,
    AnsweredLine,
    Handle,
    OpenHandle,
    Pad,
    Passing,
    Scripted,
    check_controller,
    check_device,
    check_environment,
    check_law,
    check_operator,
    parts,
    scripted,
)

ROOT = Path(__file__).parent.parent
LAYERED = Pad(layers=(0.001, 0.002), damping=5.0, damps="always", reports_contact=False)
PULLING = Pad(stiffness=-1000.0)  # a range is checked where text comes in


# Contracts


@pytest.mark.parametrize(
    ("check", "part", "seen"),
    [
        (check_environment, Pad(), {"resists", "contact", "scene", "signals"}),
        (check_environment, LAYERED, {"resists"}),
        (check_device, Handle(), {"bounded", "reopens"}),
        (check_device, Handle(axes=2, start=(0.01, 0.0), has_stamps=True), {"stamps"}),
        (check_operator, PressingHand(), {"passive"}),
        (check_controller, Passing(), {"signals", "pure"}),
        (check_controller, Passing(answers="states", largest=2.0, counts=False), {"pure"}),
        (check_law, HALF, {"bounded"}),
        (check_law, "none", {"bounded"}),
    ],
)
def test_each_part_keeps_the_contract_of_its_kind(
    check: Callable[[Any], Any], part: Any, seen: set[str]
) -> None:
    held = check(part).held
    assert all(held.values())
    assert seen <= held.keys()
    assert LAWS.added == {}  # no other test meets a law that was checked


class Louder(OpenHandle):
    def write(self, time_ns: int, force: Any) -> Any:
        return tuple(f + 0.1 for f in super().write(time_ns, force))


class Loud(Handle):
    def open(self, operator: Any, hold_limit: float) -> Louder:
        return Louder(self)


class SilentHand(PressingHand):
    def target(self, elapsed: float) -> Any:
        raise ValueError("nowhere")


class Hasty(OpenHandle):
    def stamps(self) -> tuple[int, int]:
        return 0, self.written[-1][0]


class HastyHandle(Handle):
    def open(self, operator: Any, hold_limit: float) -> Hasty:
        return Hasty(self)


@pytest.mark.parametrize(
    ("check", "part", "named"),
    [
        (check_environment, PULLING, r"resists: .*\nforce\(.*\n  expected .*\n  got "),
        (check_device, Loud(), r"bounded: .*\n.*force \(0.0,\)\n  expected at most 0 N"),
        (check_device, HastyHandle(), r"stamps: .*\nstamps\(\) before the first write"),
        (check_operator, SilentHand(), r"answers: .*\ntarget\(0.0\)"),
        (check_controller, Passing(gains=(1.0, 1.0)), r"answers: .*\non_reply, axes: 1"),
        (check_law, replace(HALF, summary=""), "summary: has a summary of one line"),
    ],
)
def test_a_broken_promise_is_named_with_the_question_and_what_came(
    check: Callable[[Any], Any], part: Any, named: str
) -> None:
    with pytest.raises(AssertionError, match=named):
        check(part)
    assert LAWS.added == {}


def test_a_law_that_there_is_not_is_named() -> None:
    with pytest.raises(ConfigError, match="certified"):
        check_law("certfied")


def test_the_examples_of_the_page_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "examples/python")
    text = (ROOT / "docs/write-your-own.md").read_text(encoding="utf-8")
    page = text.partition("\n## Test your own parts\n")[2]
    for code in re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL):
        names: dict[str, Any] = {}
        exec(code, names)
        ran = [names[name]() for name in names if name.startswith("test_")]
        assert ran or names["run"].figures.true_energy_min >= 0.0
    for kind in LAWS.added:
        del LAWS[kind]
    for kind in ENVIRONMENTS.added:
        del ENVIRONMENTS[kind]


# One of everything, in a launch file

EVERYTHING = """\
forcebound: 1
seed: 1
duration: 0.1 s
device:
  kind: parts.py
  axes: 1
  damping: [0.27 N s/m]
  friction: [120 mN]
  largest_speed: 5 m/s
  watchdog: none
  watchdog_limit: 20 ms
  watchdog_tolerance: null
  start: [15 mm]
  has_stamps: true
  engage_time: 10 ms
  law: parts.py
operator: null
controller:
  kind: parts.py
  gain: 50 %
  gains: [2]
  largest: 20 N
  answers: states
  counts: false
environment:
  kind: parts.py
  position: 10 mm
  stiffness: 1 N/mm
  layers: [1 mm, 2 mm]
  damping: null
  damps: always
  reports_contact: false
"""


def test_a_launch_file_reads_every_kind_of_parameter_and_they_act(tmp_path: Any) -> None:
    with open(parts.__file__) as source:
        written(tmp_path, source.read(), "parts.py")
    config = load(written(tmp_path, EVERYTHING))
    assert from_document(to_document(config)) == config
    columns = run_virtual(config).columns
    force = 1000.0 * (0.005 + 0.004 + 0.003)  # three layers at 15 mm; 50 % of twice that
    assert columns.commanded_force.max() == pytest.approx(force)
    assert set(columns.position[:, 0]) == {0.015}
    for key, wrong in (("stiffness: 1 N/mm", "-1 N/mm"), ("damps: always", "damps: often")):
        with pytest.raises(ConfigError, match=key.split(":")[0]):
            load(written(tmp_path, EVERYTHING.replace(key, f"{key.split(':')[0]}: {wrong}")))


# The scripted transport


def one_exchange(line: Scripted) -> None:
    line.send(b"\x02\x05", has_force=False)
    assert line.read(1) == b"\x05"


def test_a_driver_that_sends_and_reads_what_is_expected_passes() -> None:
    with scripted((b"\x02\x05", b"\x05")) as line:
        one_exchange(line)


@pytest.mark.parametrize(
    ("exchanges", "named"),
    [
        ([(b"\x02\x06", b"\x05")], r"exchange 1 of 1: expected 02 06, .* sent 02 05"),
        ([(b"\x02", b"\x05")], "expected 02, but the driver sent 02 05"),
        ([(b"f 0\n", b"\x05")], r"expected 66 20 30 0a \(b'f 0\\n'\)"),
        ([], "exchange 1 of 0: expected no further message, but the driver sent 02 05"),
        ([(b"\x02\x05", b"\x05"), (b"\x01", None)], "1 of 2 exchanges .* did not send 01"),
        ([(b"\x02\x05", b"\x05\x06")], "did not read 06"),
        ([(b"\x02\x05", b"\x05"), (None, "late")], "did not read late"),
        ([({"a": 1}, b"\x05")], r'expected {"a": 1}, but the driver sent 02 05'),
    ],
)
def test_the_first_difference_is_named(exchanges: Any, named: str) -> None:
    with pytest.raises(AssertionError, match=named), scripted(*exchanges) as line:
        one_exchange(line)


def test_a_difference_that_the_driver_hides_is_named_all_the_same() -> None:
    def hidden(line: Scripted) -> None:
        try:
            line.send(b"\x01")
        except AssertionError as error:
            raise DeviceError("no reply") from error

    with pytest.raises(AssertionError, match="expected 02"), scripted((b"\x02", b"")) as line:
        hidden(line)
    caught = pytest.raises(AssertionError, match="expected 02")
    with caught, scripted((b"\x02", b"")) as line, suppress(DeviceError):
        hidden(line)


def test_texts_come_one_by_one_and_documents_are_compared_as_such() -> None:
    command = {"inverse3": [{"device_id": "049D", "x": 1.5}]}
    with scripted(
        (None, {"inverse3": []}), (command, '{"n": 1}'), (None, "event"), ("bye", None)
    ) as line:
        assert line.recv() == '{"inverse3": []}'
        with pytest.raises(TimeoutError):
            line.recv(timeout=0.0)
        line.send('{"inverse3":[{"x":1.5,"device_id":"049D"}]}')
        assert [line.recv(), line.recv()] == ['{"n": 1}', "event"]
        line.send("bye")


def test_a_message_in_a_frame_is_compared_without_it_and_read_as_a_whole() -> None:
    with scripted(({"n": 1}, {"n": 2}), decode=lambda frame: frame[2:]) as line:
        line.send(b"\x81\x07" + b'{"n":1}', has_force=True)
        assert line.read(0) == b'{"n": 2}'
    expected = r'expected {"n": 1}, but the driver sent 7b 7d \(b'
    line = Scripted([({"n": 1}, None)], lambda frame: frame[2:])
    with pytest.raises(AssertionError, match=expected):
        line.send(b"\x81\x02{}")


def test_a_line_fails_once_and_refuses_bytes_that_nobody_asked_for() -> None:
    line = AnsweredLine(lambda message: message + b"\x07")
    line.send(b"\x01")
    assert line.read(1) == b"\x01"
    with pytest.raises(DeviceError, match="unexpected bytes: 07"):
        line.send(b"\x01")
    line.fail(DeviceError("first"))
    line.fail(DeviceError("second"))
    with pytest.raises(DeviceError, match="first"):
        line.send(b"\x01")


def test_a_handle_is_where_a_test_moves_it_and_keeps_what_was_written() -> None:
    device = replace(Handle(), saturation=2.0).open(None, 1e-3)
    device.position = (0.003,)
    assert device.read(0) == (0.003,)
    assert device.write(1, (5.0,)) == (2.0,)
    assert device.written == [(1, (5.0,))]
