"""The drivers of servo buses: their bytes, and their answers to emulated servos and to faults."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from servo_buses import MS, STEP, Rig, dynamixels, feetechs

from forcebound.errors import ConfigError, DeviceError
from forcebound.hardware import dynamixel_frames as dxl
from forcebound.hardware import feetech_frames as sts
from forcebound.hardware.dynamixel import Dynamixel, OpenDynamixels
from forcebound.hardware.feetech import Feetech, OpenFeetechs
from forcebound.hardware.serial_device import FIRST_EXCHANGES
from forcebound.hardware.servo_bus import OpenServos, ServoBus
from forcebound.messages.packets import Vector
from forcebound.testing import AnsweredLine, scripted

NAMES = ("base", "elbow")
ARM = Dynamixel(joints=NAMES, servos=(1, 2), torque_constant=0.35, cycle=0.0)
STS_ARM = Feetech(joints=NAMES, servos=(1, 2), torque_per_volt=0.25, largest_supply=8.0, cycle=0.0)


class RigLine(AnsweredLine):
    """A line to emulated servos, whose time passes while the driver waits."""

    def __init__(self, rig: Rig, rest: bytes) -> None:
        super().__init__(lambda message: rig.send(message))
        self.rig, self._at_rest = rig, rest
        self.forces: list[bool] = []

    def send(self, message: bytes | str, has_force: bool = False) -> None:
        super().send(message, has_force)
        self.forces.append(has_force)

    def read_until(
        self, missing: Callable[[bytes], int] | None = None, deadline_ns: int = 0
    ) -> bytes:
        assert missing is not None
        while missing(self._bytes) and self.rig.time_ns < deadline_ns:
            self.wait(100_000)
        return super().read_until()

    def wait(self, duration_ns: int) -> None:
        """Let time pass; what comes then is there to be read."""
        self.receive(self.rig.wait(duration_ns))

    def fail(self, failure: DeviceError) -> None:
        super().fail(failure)
        self.write(self._at_rest)
        self.wait(5 * MS)


def opened(rig: Rig, model: ServoBus = ARM) -> tuple[OpenServos, RigLine]:
    kind: Any = OpenDynamixels if isinstance(model, Dynamixel) else OpenFeetechs
    line = RigLine(rig, kind.rest(model)[0])
    return kind(model, line, lambda: rig.time_ns), line


def tick(device: OpenServos, line: RigLine, force: Vector) -> Vector:
    """One tick; the order has arrived at its end."""
    device.read(0)
    held = device.write(0, force)
    line.wait(MS // 2)
    return held


def driven(device: OpenServos, line: RigLine, force: Vector) -> Vector:
    tick(device, line, force)  # switches the motors on
    return tick(device, line, force)


def ticks(device: OpenServos, line: RigLine, count: int) -> None:
    for number in range(count):
        tick(device, line, (0.1 + 0.02 * (number % 2), 0.1))


def test_a_dynamixel_gets_these_bytes_and_no_others() -> None:
    def answer(*values: int) -> bytes:
        return dxl.packet(1, dxl.STATUS, bytes((0, *values)))

    def number(address: int, value: bytes) -> tuple[bytes, bytes]:
        return dxl.read(1, address, len(value)), answer(*value)

    def setting(address: int, value: int) -> bytes:
        return dxl.sync_write({1: bytes((value,))}, address)

    zero = dxl.sync_write({1: bytes(2)}, 102)
    at_rest = zero + setting(64, 0) + setting(98, 0) + dxl.read(1, 64, 1)
    poll = dxl.sync_read(b"\1", 126, 10)
    # Minus one unit of speed before a position whose first byte is fd: the status is stuffed.
    there = dxl.packet(1, dxl.STATUS, bytes.fromhex("00 f6ff ffffffff fd080000"))
    assert len(there) == 22
    model = Dynamixel(joints=("base",), servos=(1,), torque_constant=0.35, watchdog_limit=0.04)
    goal = dxl.sync_write({1: (-285).to_bytes(2, "little", signed=True)}, 102)
    with scripted(
        (at_rest, answer(0)),
        (dxl.packet(1, dxl.PING), answer(0xB0, 0x04, 45)),
        number(38, b"\xd6\x06"),
        number(70, b"\0"),
        number(9, b"\xfa"),
        (dxl.write(1, 9, b"\0"), answer()),
        number(9, b"\0"),
        number(11, b"\3"),
        (bytes.fromhex("ff ff fd 00 01 06 00 03 0b 00 00 42 e3"), answer()),
        number(11, b"\0"),
        *[(poll, there)] * (FIRST_EXCHANGES + 1),
        (setting(98, 0) + zero + setting(98, 2) + setting(64, 1) + zero + dxl.read(1, 98, 6), None),
        (None, answer(2, 0, 0, 0, 0, 0)),
        (poll, there),
        (goal + dxl.read(1, 98, 6), answer(2, 0, 0, 0, *(-285).to_bytes(2, "little", signed=True))),
    ) as line:
        device = OpenDynamixels(model, line)
        assert device.read(0) == ((0x08FD - 2048) * STEP,)
        assert device.write(0, (0.1,)) == (0.0,)
        device.read(0)
        assert device.write(0, (0.1,))[0] == pytest.approx(285 * 0.35e-3)
        device._take_look()
    assert device.published.numbers["current_1"] == -0.01


def test_a_feetech_gets_these_bytes_and_no_others() -> None:
    def number(address: int, value: bytes) -> tuple[bytes, bytes]:
        return sts.read(1, address, len(value)), sts.packet(1, 0, value)

    def setting(address: int, value: int) -> tuple[bytes, bytes]:
        return sts.write(1, address, bytes((value,))), sts.packet(1, 0)

    off = sts.sync_write({1: b"\0"}, 40)
    poll = sts.sync_read(b"\1", 56, 7), sts.packet(1, 0, bytes.fromhex("ff 07 05 80 00 00 4a"))
    on = sts.sync_write({1: b"\1"}, 40)
    ask, has = sts.read(1, 40, 6), sts.packet(1, 0, b"\1\0\0\0\x31\x04")
    model = Feetech(joints=("base",), servos=(1,), torque_per_volt=0.25, largest_supply=8.0)
    with scripted(
        (
            bytes(256) + sts.sync_write({1: bytes(2)}, 44) + off + sts.read(1, 40, 1),
            sts.packet(1, 0, b"\0"),
        ),
        number(3, b"\x09\x03"),
        number(7, b"\xfa"),
        setting(55, 0),
        setting(7, 0),
        setting(55, 1),
        number(7, b"\0"),
        number(33, b"\2"),
        *[poll] * (FIRST_EXCHANGES + 1),
        (on + sts.sync_write({1: bytes(2)}, 44) + ask, sts.packet(1, 0, b"\1" + bytes(5))),
        poll,
        (sts.sync_write({1: b"\x31\x04"}, 44) + ask, has),
    ) as line:
        device = OpenFeetechs(model, line)
        assert device.read(0) == (-STEP,)
        assert device.write(0, (0.0999,)) == (0.0,)
        device.read(0)
        assert device.write(0, (0.0999,))[0] == pytest.approx(0.098)  # 49 of 1000, of 2 N m
        device._take_look()


@pytest.mark.parametrize(
    ("model", "make", "step"),
    [(ARM, dynamixels, 0.35e-3), (STS_ARM, feetechs, 2e-3)],
    ids=["dynamixel", "feetech"],
)
@pytest.mark.parametrize("direction", [1, -1])
def test_what_is_held_is_what_the_servos_give_rounded_towards_zero(
    tmp_path: Path, model: Any, make: Any, step: float, direction: int
) -> None:
    rig = make(tmp_path, direction=direction)
    device, line = opened(rig, replace(model, direction=float(direction)))
    whole = 0.1 // step * step
    assert driven(device, line, (0.1, -0.1)) == pytest.approx((whole, -whole))
    held = tick(device, line, (0.1, -0.1))
    assert rig.bus.torque == pytest.approx([-one for one in held])
    assert line.forces[-1]
    tick(device, line, (0.0, 0.0))
    assert not any(rig.bus.torque)
    assert not line.forces[-1]


@pytest.mark.parametrize("cycle", [0.0, 2.5e-4, 5e-3])
def test_a_reading_is_stamped_after_the_goal_that_came_first_if_the_servo_has_had_time_for_it(
    tmp_path: Path, cycle: float
) -> None:
    rig = dynamixels(tmp_path)
    device, line = opened(rig, replace(ARM, cycle=cycle))
    for _ in range(3):
        device.read(0)
        device.write(0, (0.1, 0.1))
        written_ns = rig.time_ns
        _, effect_ns = device.stamps()
        line.wait(MS)
        asked_ns = rig.time_ns
        device.read(0)
        read_ns, _ = device.stamps()
        latest_ns = read_ns + device.latch_jitter()
        assert written_ns + cycle * 1e9 < effect_ns < written_ns + cycle * 1e9 + MS
        assert latest_ns >= asked_ns - MS // 10
        if cycle < 1e-3:
            assert effect_ns <= read_ns
        else:  # the answer has come too soon after the goal
            assert read_ns == pytest.approx(asked_ns - 1e9 * cycle, abs=MS)
            assert latest_ns < effect_ns


def test_limits_of_joints_and_the_saturation_hold(tmp_path: Path) -> None:
    rig = dynamixels(tmp_path)
    device, line = opened(rig, replace(ARM, torque_limit=(0.05, 0.3), upper=(1.0, -1.0)))
    first, second = driven(device, line, (0.2, -0.2))
    assert first == pytest.approx(0.05, abs=0.35e-3)
    assert first <= 0.05
    assert second == 0.0  # it would push the joint further beyond its largest position
    assert driven(device, line, (0.2, 0.2))[1] > 0.19


def test_servos_are_set_up_as_the_driver_needs_them(tmp_path: Path) -> None:
    rig = dynamixels(tmp_path)
    device, line = opened(rig)
    driven(device, line, (0.1, 0.0))
    servo = rig.bus.servos[1]
    assert [servo.get(register) for register in (9, 11, 64, 98)] == [0, 0, 1, 5]
    rig = feetechs(tmp_path)
    device, line = opened(rig, STS_ARM)
    driven(device, line, (0.1, 0.0))
    assert [rig.bus.servos[2].get(register) for register in (7, 33, 40, 55)] == [0, 2, 1, 1]


FAULTS = [
    (ARM, "silent,servo=2", "servo 2 (elbow)"),
    (ARM, "checksum,servo=1", "servo 1 (base)"),
    (ARM, "lost", "servo"),
    (ARM, "overload,servo=2", "overload"),
    (ARM, "voltage", "input voltage"),
    (ARM, "watchdog,servo=2", "servo 2 (elbow) is off: its bus watchdog"),
    (ARM, "cut,servo=2", "servo 2 (elbow)"),
    (ARM, "reset", "it was reset"),
    (STS_ARM, "silent,servo=1", "servo 1 (base)"),
    (STS_ARM, "checksum,servo=2", "servo 2 (elbow)"),
    (STS_ARM, "lost", "servo"),
    (STS_ARM, "noise", "servo"),
    (STS_ARM, "overload,servo=2", "servo 2 (elbow) reports the error"),
    (STS_ARM, "voltage", "voltage"),
    (STS_ARM, "cut,servo=2", "servo 2 (elbow)"),
    (STS_ARM, "reset", "it was reset"),
]


@pytest.mark.parametrize(
    ("model", "fault", "named"), FAULTS, ids=[f"{m.board}-{fault}" for m, fault, _ in FAULTS]
)
def test_a_fault_ends_the_force_of_all_servos_once_and_names_its_own(
    tmp_path: Path, model: ServoBus, fault: str, named: str
) -> None:
    name, *rest = fault.split(",")
    make: Any = dynamixels if isinstance(model, Dynamixel) else feetechs
    rig = make(tmp_path, ",".join([f"{name}:at=0.3", *rest]))
    device, line = opened(rig, model)
    line.wait(10 * MS)
    driven(device, line, (0.1, 0.1))
    assert any(rig.bus.torque)
    with pytest.raises(DeviceError) as raised:
        ticks(device, line, 500)
    assert named in str(raised.value)
    assert not any(rig.bus.torque)
    with pytest.raises(DeviceError) as again:
        device.read(0)
    assert again.value is raised.value
    assert device.write(0, (0.0, 0.0)) == (0.0, 0.0)


def test_a_watchdog_that_fires_while_there_is_no_force_is_no_fault(tmp_path: Path) -> None:
    rig = dynamixels(tmp_path)
    device, line = opened(rig)
    driven(device, line, (0.1, 0.1))
    tick(device, line, (0.0, 0.0))
    line.wait(200 * MS)
    assert rig.bus.servos[1].get(98) == 0xFF
    for _ in range(6):
        held = tick(device, line, (0.1, 0.1))
    assert held == pytest.approx((0.1, 0.1), abs=0.35e-3)
    assert rig.bus.torque == pytest.approx([-one for one in held])


def test_a_supply_above_the_largest_one_ends_the_run(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match="largest_supply"):
        opened(feetechs(tmp_path), replace(STS_ARM, largest_supply=7.9))


@pytest.mark.parametrize(
    ("registers", "model", "named"),
    [
        ({0: b"\x24\x04"}, ARM, "xl430-w250"),  # 1060
        ({0: b"\x24\x04"}, ARM, "no current mode"),
        ({0: b"\xfc\x03"}, ARM, "xm430-w350"),
        ({38: b"\x64\x00"}, ARM, "0.035 N m at most"),
        ({70: b"\x20"}, ARM, "overload"),
        ({6: b"\x25"}, Dynamixel(joints=NAMES, servos=(1, 2), models="xc330-t288"), "firmware 37"),
    ],
)
def test_a_servo_that_cannot_give_the_force_is_refused(
    tmp_path: Path, registers: dict[int, bytes], model: Dynamixel, named: str
) -> None:
    name = model.named_models[0]
    rig = dynamixels(tmp_path, models=(name, name))
    for address, value in registers.items():
        rig.bus.servos[2].registers[address : address + len(value)] = value
    with pytest.raises(DeviceError, match="servo 2 \\(elbow\\)") as raised:
        opened(rig, model)
    assert named in str(raised.value)


def test_a_servo_that_is_not_there_is_named(tmp_path: Path) -> None:
    model = Dynamixel(joints=("base", "elbow", "wrist"), servos=(1, 2, 7))
    with pytest.raises(DeviceError, match="servo 7 \\(wrist\\)"):
        opened(dynamixels(tmp_path), model)


def test_an_hls_is_read_and_gives_no_force(tmp_path: Path) -> None:
    rig = feetechs(tmp_path, models=("hls3625", "sts3215"))
    model = Feetech(joints=NAMES, servos=(1, 2), models=("hls3625", "sts3215"))
    device, line = opened(rig, model)
    before = bytes(rig.bus.servos[1].registers[:56])
    assert driven(device, line, (0.1, 0.1))[0] == 0.0
    assert bytes(rig.bus.servos[1].registers[:56]) == before
    assert rig.bus.torque[1] < -0.09


def test_a_joint_that_turns_past_the_end_of_its_encoder_goes_on(tmp_path: Path) -> None:
    rig = feetechs(tmp_path)
    device, line = opened(rig, replace(STS_ARM, zero=(4000.0, 100.0), saturation=2.0))
    angles = [device.read(0)]
    for _ in range(900):
        tick(device, line, (-1.4, 1.4))
        angles.append(device.read(0))
    first, second = zip(*angles, strict=True)
    assert (first[0], second[0]) == pytest.approx((-1952 * STEP, 1948 * STEP))
    assert first[-1] > 0.5  # the counts begin again at 0.15 rad
    assert second[-1] < -0.5
    for one in (first, second):
        assert max(abs(b - a) for a, b in pairwise(one)) < 0.1


@pytest.mark.parametrize(
    ("kind", "numbers", "field"),
    [
        (Dynamixel, {"models": "xl430-w250"}, "models"),
        (Dynamixel, {"models": "xl999"}, "models"),
        (Dynamixel, {"models": ("xl330-m288",)}, "models"),
        (Dynamixel, {"servos": (1, 1)}, "servos"),
        (Dynamixel, {"servos": (1, 2, 3)}, "servos"),
        (Dynamixel, {"direction": 0.5}, "direction"),
        (Dynamixel, {"watchdog_limit": 0.01}, "watchdog_limit"),
        (Dynamixel, {"watchdog_limit": 0.03}, "watchdog_limit"),
        (Dynamixel, {"watchdog_limit": 2.56}, "watchdog_limit"),
        (Dynamixel, {"torque_constant": (1.0, 1.0, 1.0)}, "torque_constant"),
        (Feetech, {"saturation": 4.0}, "saturation"),
        (Feetech, {"largest_supply": 0.0}, "largest_supply"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(
    kind: Any, numbers: dict[str, Any], field: str
) -> None:
    with pytest.raises(ConfigError) as raised:
        kind(**{"joints": NAMES, "servos": (1, 2), **numbers})
    assert raised.value.field == field


def test_a_watchdog_in_steps_has_the_next_whole_one() -> None:
    limits = [Dynamixel().possible_limit(limit) for limit in (0.001, 0.02, 0.03, 0.0401)]
    assert limits == pytest.approx([0.02, 0.02, 0.04, 0.06])
    assert Feetech().possible_limit(0.03) == 0.03
