"""Emulated buses of servos in virtual time, by the makers' own clients as well as byte by byte."""

import math
from collections.abc import Callable
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

import dynamixel_sdk
import pytest
import scservo_sdk
from servo_buses import MS, STEP, DynamixelPort, FeetechPort, Rig, dynamixels, feetechs

from forcebound.errors import ConfigError
from forcebound.haptics.devices.true_values import TrueServos
from forcebound.haptics.hands.hands import PressingHand, WallInPlace
from forcebound.hardware import dynamixel_frames, feetech_frames
from forcebound.hardware.emulators.faults import SERVO_KINDS, parse_fault

CURRENT, VELOCITY, POSITION = 126, 128, 132  # registers of a Dynamixel
GOAL, TORQUE, WATCHDOG, ERROR = 102, 64, 98, 70
REFUSED = {"range": 4, "length": 5, "limit": 6, "access": 7}
MILLIAMPERE = 0.35e-3  # N m, of these servos


class Client:
    """The maker's client of Dynamixels, at a rig whose servos answer without delay."""

    def __init__(self, rig: Rig) -> None:
        self.rig, self.port = rig, DynamixelPort(rig)
        self.packets: Any = dynamixel_sdk.PacketHandler(2.0)

    def write(self, address: int, value: int, size: int = 1, servo: int = 1) -> int:
        """Write a register; return the error of the status."""
        data = list(value.to_bytes(size, "little", signed=value < 0))
        result, error = self.packets.writeTxRx(self.port, servo, address, size, data)
        assert result == dynamixel_sdk.COMM_SUCCESS
        return int(error)

    def read(self, address: int, size: int = 1, servo: int = 1) -> int:
        data, result, _ = self.packets.readTxRx(self.port, servo, address, size)
        assert result == dynamixel_sdk.COMM_SUCCESS
        return int.from_bytes(bytes(data), "little", signed=size > 1)

    def start(self, *servos: int) -> "Client":
        """Switch to currents, with the torque on."""
        for servo in servos or (1, 2):
            orders = (self.write(a, v, servo=servo) for a, v in ((9, 0), (11, 0), (TORQUE, 1)))
            assert not any(orders)
        return self

    def sync_read(self, address: int, size: int, *servos: int) -> tuple[int, dict[int, int]]:
        group = dynamixel_sdk.GroupSyncRead(self.port, self.packets, address, size)
        for servo in servos or (1, 2):
            group.addParam(servo)
        result = group.txRxPacket()
        there = [servo for servo in servos or (1, 2) if group.isAvailable(servo, address, size)]
        return result, {servo: group.getData(servo, address, size) for servo in there}

    def sync_write(self, address: int, size: int, values: dict[int, int]) -> None:
        group = dynamixel_sdk.GroupSyncWrite(self.port, self.packets, address, size)
        for servo, value in values.items():
            group.addParam(servo, list(value.to_bytes(size, "little", signed=value < 0)))
        assert group.txPacket() == dynamixel_sdk.COMM_SUCCESS
        self.rig.wait(MS)


def test_the_makers_client_finds_the_servos_and_no_other(tmp_path: Path) -> None:
    client = Client(dynamixels(tmp_path))
    found, result = client.packets.broadcastPing(client.port)
    assert (found, result) == ({1: [1200, 45], 2: [1200, 45]}, dynamixel_sdk.COMM_SUCCESS)
    assert client.packets.ping(client.port, 2)[:2] == (1200, dynamixel_sdk.COMM_SUCCESS)
    assert client.packets.ping(client.port, 3)[1] == dynamixel_sdk.COMM_RX_TIMEOUT


def test_a_current_turns_a_joint_as_its_torque_constant_and_its_inertia_have_it(
    tmp_path: Path,
) -> None:
    client = Client(dynamixels(tmp_path, direction=-1)).start()
    client.sync_write(GOAL, 2, {1: 400, 2: -400})
    assert client.rig.bus.torque == pytest.approx((-400 * MILLIAMPERE, 400 * MILLIAMPERE))
    client.rig.wait(100 * MS)
    # (torque - friction) / damping at the end; inertia 3e-3: a time constant of 150 ms
    speed = (0.14 - 0.05) / 0.02 * (1.0 - math.exp(-0.101 / 0.15))
    _, speeds = client.sync_read(VELOCITY, 4)
    assert speeds[1] == pytest.approx(speed / (0.229 * math.tau / 60.0), rel=0.05)
    _, places = client.sync_read(POSITION, 4)
    angle = client.rig.mechanism.angles
    assert [places[1], places[2]] == pytest.approx([2048 - a / STEP for a in angle], abs=3)
    assert client.read(CURRENT, 2) == 400


def test_the_true_torque_constant_may_be_another_than_the_stated_one(tmp_path: Path) -> None:
    turned = []
    for gain in (1.0, 0.5):
        folder = tmp_path / str(gain)
        folder.mkdir()
        client = Client(dynamixels(folder, truth=TrueServos(gain=gain))).start()
        client.sync_write(GOAL, 2, {1: 400, 2: 0})
        client.rig.wait(100 * MS)
        turned.append(client.rig.mechanism.angles[0])
    assert turned[1] / turned[0] == pytest.approx((0.07 - 0.05) / (0.14 - 0.05), rel=0.05)


@pytest.mark.parametrize(
    ("address", "value", "size", "kind"),
    [
        (11, 3, 1, "access"),  # of the EEPROM, while the torque is on
        (120, 1, 2, "access"),  # read-only
        (300, 1, 1, "access"),
        (GOAL, 1751, 2, "limit"),
        (GOAL, 3000, 2, "range"),
        (WATCHDOG, 128, 1, "range"),
        (GOAL, 1, 1, "length"),
    ],
)
def test_what_must_not_be_written_is_refused_and_changes_nothing(
    tmp_path: Path, address: int, value: int, size: int, kind: str
) -> None:
    client = Client(dynamixels(tmp_path)).start()
    client.sync_write(GOAL, 2, {1: 50, 2: 0})
    before = bytes(client.rig.bus.servos[1].registers[:120])
    assert client.write(address, value, size) == REFUSED[kind]
    assert bytes(client.rig.bus.servos[1].registers[:120]) == before
    assert client.packets.read1ByteTxRx(client.port, 1, 400)[2] == REFUSED["access"]


def test_the_levels_of_return_decide_who_answers(tmp_path: Path) -> None:
    client = Client(dynamixels(tmp_path)).start()
    client.packets.write1ByteTxOnly(client.port, 1, 68, 1)
    client.rig.wait(5 * MS)
    client.packets.write1ByteTxOnly(client.port, 1, 65, 1)
    assert client.rig.wait(5 * MS) == b""
    assert client.read(65) == 1
    client.packets.write1ByteTxOnly(client.port, 1, 68, 0)
    client.rig.wait(5 * MS)
    assert client.packets.read1ByteTxRx(client.port, 1, 65)[1] == dynamixel_sdk.COMM_RX_TIMEOUT
    assert client.packets.ping(client.port, 1)[1] == dynamixel_sdk.COMM_SUCCESS


def test_the_bus_watchdog_fires_without_instructions_and_only_while_the_torque_is_on(
    tmp_path: Path,
) -> None:
    client = Client(dynamixels(tmp_path)).start(1)
    client.write(9, 0, servo=2)
    assert [client.write(WATCHDOG, 2, servo=servo) for servo in (1, 2)] == [0, 0]
    client.sync_write(GOAL, 2, {1: 100})
    for _ in range(8):
        client.rig.wait(30 * MS)
        client.packets.ping(client.port, 2)  # any instruction feeds it, also another's
    assert client.rig.bus.torque[0] > 0.0
    client.rig.wait(45 * MS)
    assert client.rig.bus.torque[0] == 0.0
    assert [client.read(WATCHDOG, servo=servo) for servo in (1, 2)] == [255, 2]
    assert client.write(GOAL, 100, 2) == REFUSED["range"]
    client.sync_write(GOAL, 2, {1: 100})
    assert client.rig.bus.torque[0] == 0.0
    assert client.write(WATCHDOG, 0) == 0
    assert client.write(GOAL, 100, 2) == 0
    assert client.rig.bus.torque[0] > 0.0


def test_an_overload_switches_the_torque_off_until_the_servo_restarts(tmp_path: Path) -> None:
    client = Client(dynamixels(tmp_path, "overload:at=100ms,servo=1")).start()
    client.sync_write(GOAL, 2, {1: 100, 2: 100})
    client.rig.wait(100 * MS)
    assert client.rig.bus.torque == pytest.approx((0.0, 100 * MILLIAMPERE))
    assert client.write(TORQUE, 1) == 0x80
    assert client.rig.bus.torque[0] == 0.0
    assert client.read(ERROR) == 0x20
    assert client.packets.reboot(client.port, 1)[0] == dynamixel_sdk.COMM_SUCCESS
    assert client.read(ERROR) == 0
    assert client.read(11) == 0  # the EEPROM is kept
    assert client.start(1).write(GOAL, 100, 2) == 0
    assert client.rig.bus.torque[0] > 0.0


def test_a_brown_out_is_an_error_and_drives_less_current(tmp_path: Path) -> None:
    models = ("xm430-w350", "xl330-m288")  # the shutdown of the other knows the voltage, too
    client = Client(dynamixels(tmp_path, "voltage:at=100ms", models=models)).start()
    client.sync_write(GOAL, 2, {1: 700, 2: 700})
    client.rig.wait(100 * MS)
    assert client.read(144, 2) == 22
    assert client.rig.bus.torque == pytest.approx((0.35 * 2.3 * 0.45, 0.0))
    assert client.read(ERROR) == 1
    assert client.write(65, 1) == 0x80


@pytest.mark.parametrize(("baud", "expected_ns"), [(1_000_000, 1_660_000), (2_000_000, 830_000)])
def test_a_tick_takes_as_long_as_its_bytes(tmp_path: Path, baud: int, expected_ns: int) -> None:
    rig = dynamixels(tmp_path, models=("xl330-m288",) * 6, baud=baud)
    servos = bytes(range(1, 7))
    for order in (((9, b"\0")), (11, b"\0"), (TORQUE, b"\1")):
        rig.exchange(dynamixel_frames.sync_write(dict.fromkeys(servos, order[1]), order[0]))
    begin_ns = rig.time_ns
    asked = dynamixel_frames.sync_read(servos, VELOCITY, 8)
    assert len(rig.exchange(asked)) == 6 * 19
    # 20 bytes, then 6 times 19, ten bits each; the answers come one after the other
    times = [at_ns - begin_ns for at_ns, _ in rig.replies]
    byte_ns = 10_000_000_000 // baud
    assert times == [(20 + 19 * 6) * byte_ns]
    goals = dynamixel_frames.sync_write(dict.fromkeys(servos, b"\x10\0"), GOAL)
    begin_ns = rig.time_ns
    rig.send(goals)
    rig.wait(len(goals) * byte_ns - 1)
    assert not any(rig.bus.torque)  # an order acts when its last byte has come
    rig.wait(1)
    assert all(rig.bus.torque)
    assert times[-1] + len(goals) * byte_ns == expected_ns


def test_return_delay_and_the_converters_latency_add_to_the_time_of_an_answer(
    tmp_path: Path,
) -> None:
    rig = dynamixels(tmp_path, truth=TrueServos(latency=0.001))
    begin_ns = rig.time_ns
    rig.exchange(dynamixel_frames.packet(1, dynamixel_frames.PING))
    # 10 and 14 bytes, 250 times 2 us, 1 ms
    assert [at_ns - begin_ns for at_ns, _ in rig.replies] == [240_000 + 500_000 + MS]


@pytest.mark.parametrize(
    "spoil",
    [lambda data: data[1:], lambda data: data[:-1], lambda data: data[:-1] + b"\0", bytes.title],
)
def test_a_spoiled_message_is_passed_over_and_the_next_one_understood(
    tmp_path: Path, spoil: Callable[[bytes], bytes]
) -> None:
    rig = dynamixels(tmp_path)
    ping = dynamixel_frames.packet(1, dynamixel_frames.PING)
    spoiled = spoil(dynamixel_frames.packet(2, 0x61))
    assert len(rig.exchange(spoiled + ping)) == 14
    rig.exchange(spoil(ping)[:5])
    rig.wait(200 * MS)
    assert len(rig.exchange(ping)) == 14


@pytest.mark.parametrize("kind", ["dynamixel", "feetech"])
@pytest.mark.parametrize(
    ("fault", "lengths"),
    [
        ("silent:at=0s,servo=2", (1.0, 0.0, 1.0)),
        ("cut:at=0s,servo=2", (1.0, 0.5, 0.0)),
        ("checksum:at=0s,servo=2", (1.0, 1.0, 1.0)),
    ],
)
def test_a_fault_of_one_servo_is_its_own(
    tmp_path: Path, kind: str, fault: str, lengths: tuple[float, ...]
) -> None:
    if kind == "dynamixel":
        rig = dynamixels(tmp_path, fault, models=("xl330-m288",) * 3)
        frames: Any = dynamixel_frames
        orders, (address, size) = (
            ((9, b"\0"), (11, b"\0"), (TORQUE, b"\1"), (GOAL, b"\x10\0")),
            (132, 4),
        )
    else:
        rig = feetechs(tmp_path, fault, models=("sts3215",) * 3)
        frames = feetech_frames
        orders, (address, size) = ((7, b"\0"), (33, b"\2"), (40, b"\1"), (44, b"\x10\0")), (56, 2)
    servos = b"\1\2\3"
    for place, value in orders:
        rig.exchange(frames.sync_write(dict.fromkeys(servos, value), place))
    torque = rig.bus.torque
    assert all(torque)
    rig.exchange(frames.packet(1, frames.PING))  # from the first answer on, faults are on
    rig.replies.clear()
    rig.exchange(frames.sync_read(servos, address, size))
    whole = len(frames.packet(1, 0, bytes(size + (kind == "dynamixel"))))
    expected = [math.floor(share * whole) for share in lengths if share]
    ((_, came),) = rig.replies
    assert len(came) == sum(expected)
    ends = list(accumulate(expected, initial=0))
    is_off = fault.startswith("cut")
    assert rig.bus.torque == ((torque[0], 0.0, 0.0) if is_off else torque)
    sound = [_is_sound(frames, came[begin:end]) for begin, end in pairwise(ends)]
    assert sound.count(False) == (not fault.startswith("silent"))


def _is_sound(frames: Any, data: bytes) -> bool:
    try:
        return bool(frames.parse(data))
    except Exception:  # of the frames' own kind
        return False


@pytest.mark.parametrize("text", ["voltage:servo=1", "silent:servo=x", "silent:servo=1,servo=2"])
def test_a_fault_of_no_servo_is_refused(text: str) -> None:
    with pytest.raises(ConfigError):
        parse_fault(text, SERVO_KINDS)


def test_a_fault_of_a_servo_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="7"):
        dynamixels(tmp_path, "silent:servo=7")


class DutyClient:
    """The maker's client of STS, at a rig whose servos take a duty cycle."""

    def __init__(self, rig: Rig) -> None:
        self.rig, self.port = rig, FeetechPort(rig)
        self.packets: Any = scservo_sdk.PacketHandler(0)
        for servo in rig.bus.servos:
            for address, value in ((7, 0), (33, 2), (40, 1)):
                self.write(address, value, servo=servo)

    def write(self, address: int, value: int, size: int = 1, servo: int = 1) -> int:
        data = list(value.to_bytes(size, "little"))
        result, error = self.packets.writeTxRx(self.port, servo, address, size, data)
        assert result == scservo_sdk.COMM_SUCCESS
        return int(error)

    def read(self, address: int, servo: int = 1) -> int:
        """Return a register of two bytes, with its sign."""
        data, result, _ = self.packets.readTxRx(self.port, servo, address, 2)
        assert result == scservo_sdk.COMM_SUCCESS
        return feetech_frames.decoded(address, bytes(data))

    def drive(self, duty: int, servo: int = 1) -> int:
        return self.write(44, abs(duty) | (duty < 0) << 10, 2, servo)


def test_the_makers_client_of_feetech_finds_reads_and_drives_servos(tmp_path: Path) -> None:
    client = DutyClient(feetechs(tmp_path, direction=-1))
    assert client.packets.ping(client.port, 1)[:2] == (777, scservo_sdk.COMM_SUCCESS)
    assert client.packets.ping(client.port, 3)[1] == scservo_sdk.COMM_RX_TIMEOUT
    assert client.drive(-250) == 0
    assert client.rig.bus.torque == pytest.approx((0.5, 0.0))
    client.rig.wait(500 * MS)
    # (duty - friction) over the plant's damping and the back-EMF of 2 N m / 8 V * 7.4 V / 4.7 rad/s
    braking = 2.0 / 8.0 * 7.4 / 4.7
    speed = (0.5 - 0.05) / (0.02 + braking)
    assert client.read(58) == pytest.approx(-speed / STEP, rel=0.02)
    group = scservo_sdk.GroupSyncRead(client.port, client.packets, 56, 7)
    group.addParam(1)
    group.addParam(2)
    assert group.txRxPacket() == scservo_sdk.COMM_SUCCESS
    counts = (2048 - client.rig.mechanism.angles[0] / STEP) % 4096
    assert group.getData(1, 56, 2) == pytest.approx(counts, abs=10)
    assert [group.getData(servo, 62, 1) for servo in (1, 2)] == [80, 80]


def test_a_duty_stays_for_ever_when_nobody_writes(tmp_path: Path) -> None:
    client = DutyClient(feetechs(tmp_path))
    client.drive(100)
    client.rig.wait(3_000 * MS)
    assert client.rig.bus.torque == pytest.approx((0.2, 0.0))
    assert client.rig.emulation.longest_hold > 2.9


def test_a_supply_that_sags_takes_torque_and_never_adds_any(tmp_path: Path) -> None:
    truth = TrueServos(supply=7.0, sag=0.4)
    client = DutyClient(feetechs(tmp_path, truth=truth))
    client.drive(500)
    client.rig.wait(2 * MS)
    current = 0.5 * 7.0 / (7.4 / 2.5)  # at rest, before the sag
    torque = 2.0 / 8.0 * 0.5 * (7.0 - 0.4 * current)
    assert client.rig.bus.torque[0] == pytest.approx(torque, rel=0.1)
    assert client.rig.bus.torque[0] < 2.0 * 0.5


def test_a_lasting_large_duty_is_an_overload_until_the_torque_is_switched(tmp_path: Path) -> None:
    client = DutyClient(feetechs(tmp_path))
    client.drive(900)
    client.rig.wait(1_900 * MS)
    assert client.rig.bus.torque[0] > 0.0
    client.rig.wait(200 * MS)
    assert client.rig.bus.torque[0] == 0.0
    assert client.packets.ping(client.port, 1)[2] == 0x20
    assert client.write(40, 1) == 0x20
    assert client.rig.bus.torque[0] == 0.0
    assert client.write(40, 0) == 0
    assert client.write(40, 1) == 0
    assert client.rig.bus.torque[0] > 0.0


def test_a_restart_takes_the_torque_and_keeps_the_eeprom(tmp_path: Path) -> None:
    client = DutyClient(feetechs(tmp_path, "reset:at=100ms"))
    before = client.read(56)
    client.write(31, 100 | 1 << 11, 2)  # a homing offset of -100
    assert client.read(56) == before + 100
    client.drive(100)
    client.rig.wait(200 * MS)
    assert client.rig.bus.torque == (0.0, 0.0)
    servo = client.rig.bus.servos[1]
    assert [servo.get(33), servo.get(40), servo.get(31, 2)] == [2, 0, 100 | 1 << 11]


def test_a_servo_of_the_hls_answers_and_never_moves(tmp_path: Path) -> None:
    client = DutyClient(feetechs(tmp_path, models=("hls3625", "sts3215")))
    for servo in (1, 2):
        client.drive(200, servo)
    assert client.rig.bus.torque == pytest.approx((0.0, 0.4))
    assert client.read(56) == 2048


def test_a_follower_is_free_up_to_the_wall_that_it_meets(tmp_path: Path) -> None:
    wall = WallInPlace(stiffness=50.0, damping=0.1, gap=0.1)
    client = DutyClient(feetechs(tmp_path, operator=wall))
    client.drive(-100)  # 0.2 N m, 0.05 of them against friction
    client.rig.wait(1_000 * MS)
    speed = (0.2 - 0.05) / (0.02 + 2.0 / 8.0 * 7.4 / 4.7)
    assert client.rig.mechanism.angles[0] == pytest.approx(-speed, rel=0.05)
    client.drive(100)
    client.rig.wait(3_000 * MS)
    assert client.rig.mechanism.angles[0] == pytest.approx(0.1 + 0.15 / 50.0, abs=1e-3)


def test_what_a_motor_does_to_a_hand_is_seen_in_the_energy_and_braking_only_takes(
    tmp_path: Path,
) -> None:
    hand = PressingHand(mass=0.002, stiffness=2.0, damping=0.02, approach_speed=0.5)
    client = DutyClient(feetechs(tmp_path, operator=hand))
    client.rig.truth.engage(client.rig.time_ns)
    client.rig.wait(1_500 * MS)  # without a duty, through all of what the hand does
    assert client.rig.emulation.lowest_energy == 0.0
    assert client.rig.emulation.longest_hold == 0.0
    for k in range(20):
        client.drive(300 * (-1) ** k)
        client.rig.wait(50 * MS)
    assert client.rig.emulation.lowest_energy < -1e-3
