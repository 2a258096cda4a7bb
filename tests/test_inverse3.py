"""The driver of the Haply Inverse3, against golden messages and a service that a test scripts."""

import json
import math
import os
import signal
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import numpy as np
import pytest
from click.testing import CliRunner
from scripted_service import Document, ScriptedService, golden, packed, scripted_service
from waiting import free_port, until
from websockets.frames import Frame

from forcebound import extras
from forcebound.cli import main
from forcebound.errors import ConfigError, DeviceError
from forcebound.hardware import inverse_service, ports
from forcebound.hardware.haply_inverse3 import HaplyInverse3, OpenInverse3
from forcebound.hardware.inverse_messages import framed, parse, parse_event, to_device
from forcebound.hardware.ports import SerialPort
from forcebound.observe import machine

HOLD = 0.00125  # s
ORIGIN = (0.0, -0.12, 0.15)
LIMIT = 4.0  # s, of the watchdog: a busy machine ends no test


@pytest.fixture
def service() -> Iterator[ScriptedService]:
    with scripted_service() as found:
        yield found


def model(service: ScriptedService, **numbers: Any) -> HaplyInverse3:
    stated = {"port": "auto", "watchdog_limit": LIMIT, "reply_within": 1.0, **numbers}
    return HaplyInverse3(service=f"127.0.0.1:{service.port}", **stated)


@contextmanager
def opened(service: ScriptedService, **numbers: Any) -> Iterator[OpenInverse3]:
    device = model(service, **numbers).open(None, HOLD)
    try:
        yield device
    finally:
        device.close()


def sent(frame: bytes) -> Any:
    """The message in a frame to the service."""
    from websockets.protocol import SERVER, Protocol

    protocol = Protocol(SERVER)
    protocol.receive_data(frame)
    (found,) = protocol.events_received()
    assert isinstance(found, Frame)
    return msgspec.json.decode(found.data)


# --- messages, as they are written down from the maker's documentation


def test_a_force_and_the_probe_of_a_grip_are_the_golden_messages() -> None:
    force = golden("to_service/force_vector.json")
    commands = {"set_cursor_force": {"vector": {"x": 0.0, "y": 0.0, "z": 1.5}}}
    assert sent(framed(to_device("049D", (), commands=commands))) == force
    grips = (("verse_grip", "61548"), ("wireless_verse_grip", "0"))
    probe = to_device("049D", grips, commands={"probe_position": {}})
    assert sent(framed(probe)) == golden("to_service/probe_grips.json")


def test_golden_inventories_and_states_are_read() -> None:
    inventory = parse(packed(golden("from_service/inventory.json")))
    (device,) = inventory.inverse3
    assert (inventory.session_id, device.device_id, device.lack) == (7, "049D", "")
    assert device.config["filters"]["force_gate"]["gain"] == 0.3
    state = parse(packed(golden("from_service/state.json")))
    assert not state.inverse3[0].config
    assert state.inverse3[0].state.cursor_position.y == -0.13648
    assert [group for group, _ in state.grips] == ["verse_grip", "wireless_verse_grip"]
    (older,) = parse(packed(golden("from_service/inventory_3_1.json"))).inverse3
    assert older.lack == "calibrated"
    assert not parse(packed(golden("from_service/state_without_device.json"))).inverse3


def test_an_event_is_read_and_what_is_none_has_no_name() -> None:
    event = parse_event(packed(golden("events/ebrake.json")))
    assert (event.name, event.level) == ("device-safety-triggered", "error")
    assert parse_event(b"[1]").name == ""


# --- the start


def test_filters_are_set_and_read_back_before_any_force(service: ScriptedService) -> None:
    with opened(service, force_gate=0.25, basis="XZY") as device:
        device.write(0, (1.0, 0.0, 0.0))
    first, second, *rest = service.messages
    profile = golden("to_service/first.json")["session"]
    assert first["session"] == profile
    assert first["inverse3"][0]["configure"] == {
        "basis": {"permutation": "XZY"},
        "damping": {"scalar": 0.0, "vector": {"x": 0.0, "y": 0.0, "z": 0.0}},
        "force_gate": {"gain": 0.25},
    }
    assert second == golden("to_service/full_state.json")
    assert all("configure" not in message["inverse3"][0] for message in rest)
    assert service.forces.index((-1.0, 0.0, 0.0)) == service.forces.count((0.0, 0.0, 0.0)) - 1


Change = Callable[[ScriptedService], object]


def of_device(*path: str, value: object) -> Change:
    def change(service: ScriptedService) -> None:
        found = service.device
        for name in path[:-1]:
            found = found[name]
        found[path[-1]] = value

    return change


def keeps(name: str, value: Document) -> Change:
    """The service keeps a filter as it is, whatever is set."""

    def change(service: ScriptedService) -> None:
        def script(_: int, state: Document) -> list[bytes]:
            if "config" in state["inverse3"][0]:
                state["inverse3"][0]["config"]["filters"][name] = value
            return [packed(state)]

        service.script = script

    return change


def with_another(service: ScriptedService) -> None:
    service.inventory["inverse3"].append({**service.device, "device_id": "04BA"})


REFUSED: list[tuple[Change, str]] = [
    (lambda s: setattr(s, "version", "3.1.1.0"), r"version 3\.1.*expected 3\.5.*update the"),
    (lambda s: setattr(s, "version", "4.0.0.0"), r"version 4\.0.*below 4: use an older"),
    (lambda s: setattr(s, "version", None), "refuses /version"),
    (lambda s: setattr(s, "force_scale", 1.5), r"every force by 1\.5.*set it to 1"),
    (lambda s: setattr(s, "force_scale", "much"), "devices/force_scale is 'much'"),
    (of_device("status", "in_use", value=True), "driven by another session.*end the other"),
    (of_device("state", "control_mode", value="force"), "driven by another session"),
    (of_device("status", "calibrated", value=False), "not calibrated.*calibrate it"),
    (of_device("status", "ready", value=False), "not ready"),
    (
        of_device("config", "gravity_compensation", "enabled", value=False),
        r"keeps gravity_compensation\.enabled at False, expected True",
    ),
    (of_device("config", "mount", "scale", "y", value=2.0), r"keeps mount\.scale\.y at 2\.0"),
    (
        keeps("force_gate", {"gain": 0.3}),
        r"keeps filters\.force_gate\.gain at 0\.3, expected 0\.0.*Hub",
    ),
    (keeps("damping", {"scalar": 5.0}), r"keeps filters\.damping\.scalar at 5\.0"),
    (
        keeps("damping", {"vector": {"x": 0, "y": 1, "z": 0}}),
        r"damping\.vector\.y at 1, expected",
    ),
    (with_another, "several Inverse3, 049D, 04BA: launch with device:=049D"),
    (lambda s: s.inventory.update(inverse3=[]), "has no Inverse3: plug it in"),
    (lambda s: s.inventory.update(inverse3="none"), "expected a state of the Haply service"),
]


@pytest.mark.parametrize(("change", "said"), REFUSED, ids=[said for _, said in REFUSED])
def test_a_service_or_a_device_that_is_not_as_stated_gets_no_force(
    service: ScriptedService, change: Change, said: str
) -> None:
    change(service)
    with pytest.raises(DeviceError, match=said):
        model(service).open(None, HOLD)
    assert not any(any(force) for force in service.forces)
    until(lambda: service.sessions == 0, "the end of the session")


def test_a_device_that_another_program_has_is_refused_before_it_gives_a_force(
    service: ScriptedService,
) -> None:
    with opened(service):
        sessions = service.sessions
        assert not service.device["status"]["in_use"]
        for use in (model(service).check_here, lambda: model(service).open(None, HOLD)):
            with pytest.raises(DeviceError, match="in use by another program of this machine"):
                use()
        until(lambda: service.sessions == sessions, "the end of the session")
    model(service).check_here()


def test_without_a_service_one_sentence_says_how_to_start_it() -> None:
    absent = HaplyInverse3(port="auto", service=f"127.0.0.1:{free_port()}")
    for use in (absent.check_here, lambda: absent.open(None, HOLD)):
        with pytest.raises(DeviceError, match=r"does not answer \(Connection refused\): start it"):
            use()
    with pytest.raises(DeviceError, match=r"correct device\.service"):
        HaplyInverse3(port="auto", service="here").check_here()
    with pytest.raises(DeviceError, match="expected the link of an emulator"):
        HaplyInverse3(port="/no/emulator").check_here()


def test_a_device_is_found_by_its_id_and_another_ones_numbers_are_refused(
    service: ScriptedService,
) -> None:
    with_another(service)
    found = model(service, port="04BA", serial_number="04BA")
    found.check_here()
    with opened(service, port="049D", serial_number="049D") as device:
        assert device.serial_number == "049D"
    with pytest.raises(DeviceError, match="numbers in the launch file are of the device 04BA"):
        model(service, port="049D", serial_number="04BA").open(None, HOLD)
    with pytest.raises(DeviceError, match="no Inverse3 1234; it has 049D, 04BA: launch with dev"):
        model(service, port="1234").check_here()


def test_what_outlives_the_session_is_put_back(
    service: ScriptedService, caplog: pytest.LogCaptureFixture
) -> None:
    service.device["config"]["torque_scaling"] = {"enabled": False}
    with opened(service):
        assert service.device["config"]["torque_scaling"] == {"enabled": True}
    path = "/inverse3/049D/config/torque_scaling"
    assert service.posts == [(path, {"enabled": True}), (path, {"enabled": False})]
    assert "belongs to the device, and outlives the session" in caplog.text


def test_what_is_assumed_is_said_until_it_is_measured(
    service: ScriptedService, caplog: pytest.LogCaptureFixture
) -> None:
    with opened(service):
        assert "assumed, not measured: damping, friction" in caplog.text
    caplog.clear()
    with opened(service, sources={"damping": "measured"}):
        assert "assumed" not in caplog.text


def test_a_missing_package_is_named_with_its_extra(
    service: ScriptedService, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"pip install 'forcebound\[inverse3\]'"):
        model(service).open(None, HOLD)


# --- the loop


def test_positions_are_those_of_the_cursor_and_a_force_resists(service: ScriptedService) -> None:
    service.device["state"]["cursor_position"] = {"x": 0.01, "y": -0.1, "z": 0.13}
    with opened(service) as device:
        assert device.read(0) == pytest.approx((0.01, 0.02, -0.02), abs=1e-12)
        assert device.write(0, (1.0, -2.0, 0.5)) == (1.0, -2.0, 0.5)
        assert service.forces[-1] == (-1.0, 2.0, -0.5)
        device.read(0)  # a command is applied once: a reading sends the force that is held again
        assert service.forces[-2:] == [(-1.0, 2.0, -0.5)] * 2
        assert device.fresh_reading() == pytest.approx((0.01, 0.02, -0.02), abs=1e-12)


def test_the_largest_force_keeps_its_direction_and_no_number_is_none(
    service: ScriptedService,
) -> None:
    with opened(service, saturation=2.0) as device:
        force = tuple(np.array([3.0, 0.0, 4.0]))  # as an identification writes
        assert math.hypot(*device.write(0, force)) == pytest.approx(2.0)
        assert service.forces[-1] == pytest.approx((-1.2, 0.0, -1.6))
        assert device.write(0, (1.0, math.nan, 0.0)) == (0.0, 0.0, 0.0)
        assert not any(service.forces[-1])


def test_the_ledger_gets_what_is_known_of_the_force(service: ScriptedService) -> None:
    service.force_scale = 0.5
    with opened(service, attenuates="freely") as device:
        assert device.write(0, (1.0, 0.0, 0.0)) == (0.5, 0.0, 0.0)

    def half(_: int, state: Document) -> list[bytes]:
        force = state["inverse3"][0]["state"]["current_cursor_force"]
        force["x"] *= 0.25
        return [packed(state)]

    service.script = half
    with opened(service, attenuates="never") as device:
        assert device.write(0, (1.0, 0.0, 0.0)) == (0.25, 0.0, 0.0)


def test_stamps_are_the_earliest_of_a_reading_and_the_latest_of_a_force(
    service: ScriptedService,
) -> None:
    with opened(service, cycle=1e-3) as device:
        device.read(0)
        jitter = device.latch_jitter()
        device.write(0, (0.1, 0.0, 0.0))
        read_ns, effect_ns = device.stamps()
        assert jitter >= 1_000_000
        assert effect_ns - read_ns > 2_000_000


def test_a_grip_gives_orientation_and_buttons(service: ScriptedService) -> None:
    service.inventory["verse_grip"][0]["status"]["ready"] = False
    grip = service.inventory["wireless_verse_grip"][0]["state"]
    grip["buttons"], grip["orientation"] = {"a": True, "b": False, "c": True}, {"w": 0.0, "z": 1.0}
    with opened(service) as device:
        assert (device.buttons(), device.orientation()) == (0b101, (0.0, 0.0, 0.0, 1.0))
        assert service.messages[-1]["wireless_verse_grip"][0]["device_id"] == "0"
    service.inventory.update(verse_grip=[], wireless_verse_grip=[])
    with opened(service) as device:
        assert (device.buttons(), device.orientation()) == (None, None)
        assert "wireless_verse_grip" not in service.messages[-1]


def test_a_reply_may_leave_out_its_session(service: ScriptedService) -> None:
    """As that of a real device does (tests/golden/inverse3/README.md)."""
    found = parse(packed(golden("from_service/state_of_a_device.json")))
    assert (found.session_id, found.inverse3[0].lack) == (None, "")
    with opened(service) as device:
        changed("session_id", value=None)(service)
        device.write(0, (1.0, 0.0, 0.0))
        assert service.forces[-1] == (-1.0, 0.0, 0.0)


def test_each_reply_is_used_and_counted(service: ScriptedService) -> None:
    with opened(service) as device:
        device.write(0, (1.0, 0.0, 0.0))
        device.read(0)
        assert device.exchanges.count == 2
        assert service.forces[-1] == (-1.0, 0.0, 0.0)


def spoiled(change: Callable[[Document], list[bytes]]) -> Change:
    def apply(service: ScriptedService) -> None:
        service.script = lambda _, state: change(state)

    return apply


def changed(*path: str | int, value: object) -> Change:
    def change(state: Document) -> list[bytes]:
        found: Any = state
        for name in path[:-1]:
            found = found[name]
        found[path[-1]] = value
        return [packed(state)]

    return spoiled(change)


def reports(name: str) -> Change:
    return lambda service: service.report(golden(f"events/{name}.json"))


FAULTS: list[tuple[Change, str]] = [
    (
        spoiled(lambda state: [packed(state)[:100]]),
        "expected a state of.*restart",
    ),
    (spoiled(lambda state: [b'{"inverse3":[{"device_id":5}]}']), "expected a state"),
    (spoiled(lambda state: [packed(state)] * 2), "two replies to one message"),
    (
        changed("inverse3", 0, "device_id", value="04BA"),
        "has not the .* 049D .it has 04BA.*unplugged",
    ),
    (changed("inverse3", value=[]), "has not the Inverse3 049D .it has none"),
    (changed("session_id", value=8), "reply is of session 8, this one is 7"),
    (changed("inverse3", 0, "status", "ready", value=False), "no longer ready"),
    (changed("inverse3", 0, "state", "cursor_position", "x", value=1e400), "no number|expected a"),
    (reports("ebrake"), "reports ebrake_triggered"),
    (reports("stall"), "reports stall_detected"),
    (reports("busy"), "reports device-busy"),
    (reports("disconnected"), "reports device-disconnected"),
    (lambda service: service.stop(), "has ended the session.*stopped or restarted"),
]


@pytest.mark.parametrize(("fault", "said"), FAULTS, ids=[said for _, said in FAULTS])
def test_what_goes_wrong_ends_in_zero_force_once(
    service: ScriptedService, fault: Change, said: str
) -> None:
    with opened(service) as device:
        device.write(0, (1.0, 0.0, 0.0))
        fault(service)

        def turns() -> None:
            while True:
                device.read(0)

        with pytest.raises(DeviceError, match=said):
            turns()
        with pytest.raises(DeviceError, match=said):
            device.write(0, (1.0, 0.0, 0.0))
    until(lambda: service.sessions == 0, "the end of the session")
    if "ended the session" not in said:
        assert service.forces[-1] == (0.0, 0.0, 0.0)


def test_a_silent_service_ends_the_force_after_half_of_the_limit(
    service: ScriptedService,
) -> None:
    with opened(service, watchdog_limit=1.0) as device:
        device.write(0, (1.0, 0.0, 0.0))
        service.script = lambda number, state: []
        with pytest.raises(DeviceError, match=r"no reply within 500 ms: is the Haply service"):
            device.read(0)
    assert service.forces[-1] == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    "event",
    [
        golden("events/ebrake_released.json"),
        golden("events/connected.json"),
        {**golden("events/ebrake.json"), "data": {"device_id": "04BA"}},
        {"name": "device-battery-low", "level": "warning", "data": {"device_id": "0"}},
        ["no event"],
    ],
)
def test_an_event_about_something_else_ends_nothing(service: ScriptedService, event: Any) -> None:
    with opened(service) as device:
        service.report(event)
        for _ in range(20):
            device.write(0, (1.0, 0.0, 0.0))
        assert service.forces[-1] == (-1.0, 0.0, 0.0)


def test_what_the_service_reports_of_forces_is_compared(
    service: ScriptedService, caplog: pytest.LogCaptureFixture
) -> None:
    with opened(service) as device:
        device.write(0, (1.0, 0.0, 0.0))
        for share in (0.5, 2.0):
            force = {"x": -share, "y": 0.0, "z": 0.0}
            changed("inverse3", 0, "state", "current_cursor_force", value=force)(service)
            device.read(0)
        service.script = None
    assert "1 were less than written, 1 more" in caplog.text


PROGRAM = """
import sys
from forcebound.hardware.haply_inverse3 import HaplyInverse3
device = HaplyInverse3(port="auto", service=sys.argv[1], watchdog_limit=0.4).open(None, 0.001)
device.write(0, (1.0, 0.0, 0.0))
print("on", flush=True)
sys.stdin.read() if sys.argv[2] == "hangs" else [device.read(0) for _ in iter(int, 1)]
"""


@pytest.mark.live
@pytest.mark.parametrize("end", ["killed", "stopped", "hangs"])
def test_the_guardian_ends_the_session_of_a_process_that_does_not(
    service: ScriptedService, end: str
) -> None:
    command = [sys.executable, "-c", textwrap.dedent(PROGRAM), f"127.0.0.1:{service.port}", end]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"on\n"
        if end != "hangs":
            os.kill(process.pid, signal.SIGKILL if end == "killed" else signal.SIGSTOP)
        until(lambda: service.sessions == 0, "the end of the session")
        assert service.forces[-1] == (0.0, 0.0, 0.0)
        assert (-1.0, 0.0, 0.0) in service.forces
        process.kill()


# --- looking for it


def test_the_service_and_its_devices_are_listed(
    service: ScriptedService, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = f"127.0.0.1:{service.port}"
    (found,) = inverse_service.listed(address)
    assert (found.path, found.serial_number, found.seems) == (
        str(address),
        "049D",
        "haply_inverse3",
    )
    assert found.description == "Inverse3 of the Haply service 3.5.0.0"
    assert inverse_service.listed(f"127.0.0.1:{free_port()}") == []
    monkeypatch.setattr(ports, "listed", list)
    monkeypatch.setattr(inverse_service, "listed", lambda: [found])
    shown = CliRunner().invoke(main, ["device", "list", "--json"])
    assert [one["serial_number"] for one in json.loads(shown.stdout)] == ["049D"]


INVERSE3 = SerialPort("/dev/null", "Inverse3", "1", "haply_inverse3")


def test_the_doctor_judges_the_service(service: ScriptedService) -> None:
    here, nowhere = f"127.0.0.1:{service.port}", f"127.0.0.1:{free_port()}"
    (found,) = machine.haply_service([], here)
    assert (found.severity, found.kind) == ("fine", "haply_service")
    assert "version 3.5.0.0, Inverse3: 049D" in found.seen
    service.bind_all_interfaces = True
    found, _ = machine.haply_service([], here)
    assert (found.severity, found.kind) == ("problem", "haply_open")
    assert "haply-inverse-service-config.json" in found.advice
    service.version = "3.1.1.0"
    assert list(machine.haply_service([], here)) == []
    for address, said in ((here, "of version 3.1.1.0"), (nowhere, "systemctl start")):
        (found,) = machine.haply_service([INVERSE3], address)
        assert (found.severity, found.kind) == ("problem", "no_haply_service")
        assert said in found.seen


def test_the_doctor_says_that_a_modem_manager_may_write_to_a_port(tmp_path: Any) -> None:
    processes, udev = tmp_path / "proc", tmp_path / "udev"
    assert machine.modem_manager(INVERSE3, processes, udev) is None
    (processes / "7").mkdir(parents=True)
    (processes / "7" / "comm").write_text("ModemManager\n")
    found = machine.modem_manager(INVERSE3, processes, udev)
    assert found is not None
    assert "ID_MM_DEVICE_IGNORE" in found.advice
    assert machine.modem_manager(SerialPort("/dev/null"), processes, udev) is None
    udev.mkdir()
    number = os.stat("/dev/null").st_rdev
    known = udev / f"c{os.major(number)}:{os.minor(number)}"
    known.write_text("E:ID_MM_DEVICE_IGNORE=1\n")
    assert machine.modem_manager(INVERSE3, processes, udev) is None
