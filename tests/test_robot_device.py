"""A robot by a plain class, a device in a program: calls, units, limits, failures, times."""

import json
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import zmq
from builders import MS
from fakes import DISSIPATION, answer
from waiting import TIMEOUT

from forcebound.errors import ConfigError, DeviceError
from forcebound.graph.loader import load
from forcebound.graph.resolved import to_document
from forcebound.graph.servo import ServoSettings, stated_delay
from forcebound.haptics.devices import Device
from forcebound.hardware.program import Program
from forcebound.hardware.robot import Robot
from forcebound.messages.packets import DeviceState, Event, Packet, Telemetry, Vector
from forcebound.nodes.device import DeviceNode
from forcebound.run.bus import described, reads_once, time_ticks
from forcebound.run.check import check_part
from forcebound.run.virtual import run_virtual
from forcebound.testing import Handle, OpenHandle

HEADER = Path(__file__).parent.parent / "examples/cpp"

ROBOT = """\
from log_beside import LOG
import time

class MyRobot:
    def __init__(self, port="", fails="", how="raise ValueError('the cable')"):
        self.port, self.fails, self.how = port, fails, how
        self.at, self.calls = [10.0, -20.0], 0
        LOG.append("connected")

    def get_positions(self):
        self.calls += 1
        if self.fails == "get_positions" and self.calls > 15:
            exec(self.how)
            return self.at
        return self.at

    def set_torques(self, torques):
        LOG.append(list(torques))
        if self.fails == "set_torques" and any(torques):
            exec(self.how)

    def get_velocities(self):
        return [90.0, 0.0]

    def stop(self):
        LOG.append("stopped")
"""

LAUNCH = """\
forcebound: 1
seed: 1
duration: 1 s
device:
  kind: robot
  class: my_robot.py:MyRobot
  arguments: {{ port: fake }}
  joints: [shoulder, elbow]
  positions: deg
  watchdog_limit: 100 ms
{more}
environment: {{ kind: wall, stiffness: 1 N m/rad, position: 3 deg }}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    (tmp_path / "my_robot.py").write_text(ROBOT)
    (tmp_path / "log_beside.py").write_text("LOG = []\n")
    yield tmp_path
    sys.modules.pop("log_beside", None)


def log() -> list[Any]:
    """What the robot has been asked, in order."""
    found: list[Any] = sys.modules["log_beside"].LOG
    return found


def robot(folder: Path, **numbers: Any) -> Robot:
    usual = {"class_": folder / "my_robot.py:MyRobot", "joints": ("shoulder", "elbow")}
    return Robot(**{**usual, "positions": "deg", "watchdog_limit": 0.1, **numbers})


def use(device: Device, ticks: int) -> None:
    for _ in range(ticks):
        device.read(0)
        device.write(0, (0.1, 0.1))


# The calls of a robot


def test_a_robot_is_read_in_its_unit_and_written_so_that_a_positive_torque_resists(
    folder: Path,
) -> None:
    device = robot(folder).open(None, 1e-3)
    assert device.read(0) == pytest.approx((0.1745329, -0.3490659))
    assert device.published.numbers["velocity_1"] == pytest.approx(1.5707963)
    assert device.write(0, (0.25, -0.5)) == (0.25, -0.5)
    assert log()[-1] == [-0.25, 0.5]  # a motor's own torque accelerates
    device.close()
    assert log()[-2:] == [[0.0, 0.0], "stopped"]


@pytest.mark.parametrize(
    ("numbers", "command", "held"),
    [
        ({"gear": 2.0}, [-0.2, 0.1], (0.4, -0.2)),
        (
            {"gear": 2.0, "commands": "current", "torque_constant": (0.5, 0.1)},
            [-0.4, 1.0],
            (0.4, -0.2),
        ),
        (
            {"commands": "counts", "torque_constant": 2.0, "counts_per_ampere": 15.0},
            [-3, 1],  # 3.0 and 1.5, towards zero
            (0.4, -2.0 / 15.0),
        ),
        ({"torque_limit": (0.3, 0.1)}, [-0.3, 0.1], (0.3, -0.1)),
        ({"upper": (0.1, 1.0)}, [-0.4, 0.2], (0.4, -0.2)),  # back from beyond it: still
        ({"lower": 0.0}, [-0.4, 0.2], (0.4, -0.2)),
        ({"lower": (0.2, -1.0)}, [0.0, 0.2], (0.0, -0.2)),  # further down from below it: not
        ({"upper": (1.0, -1.0)}, [-0.4, 0.0], (0.4, 0.0)),
        ({"saturation": 0.2}, [-0.17888544, 0.08944272], (0.17888544, -0.08944272)),
    ],
)
def test_commands_are_in_the_robots_unit_and_what_is_held_is_what_they_give(
    folder: Path, numbers: dict[str, Any], command: list[float], held: Vector
) -> None:
    device = robot(folder, **numbers).open(None, 1e-3)
    device.read(0)
    assert device.write(0, (0.4, -0.2)) == pytest.approx(held)
    assert log()[-1] == pytest.approx(command)
    device.close()


def test_stamps_are_in_order_and_a_slow_call_makes_its_reading_uncertain(folder: Path) -> None:
    device = robot(folder, write_latency=1.0).open(None, 1e-3)
    before_ns = time.monotonic_ns()
    device.read(0)
    device.write(0, (0.0, 0.0))
    read_ns, effect_ns = device.stamps()
    assert before_ns <= read_ns <= time.monotonic_ns()
    assert effect_ns >= read_ns + 1_000_000_000
    assert device.latch_jitter() >= 0
    device.close()


@pytest.mark.parametrize(
    ("fails", "how", "words"),
    [
        ("get_positions", "raise ValueError('the cable')", "ValueError: the cable"),
        ("get_positions", "exit(3)", "SystemExit: 3"),
        ("get_positions", "self.at = [1.0]", "expected 2 finite numbers"),
        ("get_positions", "self.at = None", "expected 2 finite numbers"),
        ("get_positions", "self.at = [1.0, float('nan')]", "expected 2 finite numbers"),
        ("set_torques", "raise OSError('no power')", "OSError: no power"),
    ],
)
def test_a_call_that_fails_is_said_with_its_line_and_the_robot_is_stopped(
    folder: Path, fails: str, how: str, words: str
) -> None:
    arguments = {"fails": fails, "how": how}
    device = robot(folder, arguments=arguments).open(None, 1e-3)
    with pytest.raises(DeviceError, match=words) as error:
        use(device, 10)
    assert f"MyRobot.{fails}: " in str(error.value)
    if "expected" not in words:
        place = ROBOT.splitlines().index("            exec(self.how)") + 1
        assert fails != "get_positions" or f"my_robot.py:{place}" in str(error.value)
    device.close()
    assert log()[-2:] == [[0.0, 0.0], "stopped"]


def test_a_call_that_hangs_ends_the_run_and_stop_is_called_all_the_same(folder: Path) -> None:
    arguments = {"fails": "get_positions", "how": "time.sleep(3.0)"}
    device = robot(folder, arguments=arguments, timeout=0.05).open(None, 1e-3)
    with pytest.raises(DeviceError, match=r"get_positions has not returned for 50 ms"):
        use(device, 10)
    with pytest.raises(DeviceError, match="cannot be called"):
        device.write(0, (0.0, 0.0))
    device.close()
    assert log()[-1] == "stopped"


def test_a_robot_that_does_not_connect_is_an_error_with_the_line(folder: Path) -> None:
    with pytest.raises(DeviceError, match=r"MyRobot\(speed=3\): TypeError: .*speed"):
        robot(folder, arguments={"speed": 3}).open(None, 1e-3)


# Launch files


def written(folder: Path, more: str = "") -> Path:
    path = folder / "arm.yaml"
    path.write_text(LAUNCH.format(more=more))
    return path


def test_a_launch_file_names_class_arguments_and_joints_and_is_written_again(folder: Path) -> None:
    path = written(folder, "  lower: [-90 deg, -1 rad]\n  torque_limit: 0.5 N m")
    config = load(path)
    device: Any = config.only.device
    assert device.class_ == folder / "my_robot.py:MyRobot"
    assert device.arguments == {"port": "fake"}
    assert device.lower == pytest.approx((-1.5707963, -1.0))
    assert [axis.name for axis in device.named_axes] == ["shoulder", "elbow"]
    assert to_document(config)["hands"]["hand"]["device"]["class"] == str(device.class_)
    (folder / "again.yaml").write_text(config.yaml())
    assert load(folder / "again.yaml").only.device == device


@pytest.mark.parametrize(
    ("line", "changed", "key"),
    [
        ("class: my_robot.py:MyRobot", "class: my_robot.py:Missing", "class"),
        ("class: my_robot.py:MyRobot", "class: my_robot.yaml", "class"),
        ("class: my_robot.py:MyRobot", "class: absent.py:MyRobot", "class"),
        ("joints: [shoulder, elbow]", "joints: [shoulder, elbow]\n  gear: [1, 2, 3]", "gear"),
        ("joints: [shoulder, elbow]", "joints: [shoulder, elbow]\n  upper: [1, 2, 3]", "upper"),
        (
            "joints: [shoulder, elbow]",
            "joints: [shoulder, elbow]\n  readings_per_tick: 1",
            "write_delay",
        ),
    ],
)
def test_what_is_wrong_is_said_at_its_line(folder: Path, line: str, changed: str, key: str) -> None:
    path = written(folder)
    path.write_text(path.read_text().replace(line, changed))
    with pytest.raises(ConfigError) as error:
        load(path)
    assert key in str(error.value)
    assert f"{path}:" in str(error.value)


def test_the_class_of_a_robot_is_checked_where_the_launch_file_is(folder: Path) -> None:
    (folder / "my_robot.py").write_text("class MyRobot:\n    def read(self): ...\n")
    with pytest.raises(ConfigError, match="get_positions"):
        load(written(folder))


# Files beside a user's file


def test_each_file_imports_the_file_of_its_own_folder_also_later(tmp_path: Path) -> None:
    robots = []
    for name in ("one", "other"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "log_beside.py").write_text(f"LOG = ['{name}']\n")
        (folder / f"late_{name}.py").write_text("raise RuntimeError('late')\n")
        text = ROBOT.replace("self.at, self", f"import late_{name}\n        self.at, self")
        (folder / "my_robot.py").write_text(text)
        robots.append(robot(folder))
    for name, model in zip(("one", "other"), robots, strict=True):
        with pytest.raises(DeviceError) as error:
            model.open(None, 1e-3)
        assert f"late_{name}.py:1: raise" in str(error.value)  # the line beside, not the import
    assert log() == ["other"]
    sys.modules.pop("log_beside")


# One reading in a tick


class SlowDevice(OpenHandle):
    """A fake whose reads and writes take time of its own clock."""

    def __init__(self, read: float, write: float) -> None:
        super().__init__(Handle())
        self.now_ns, self.reads = MS, 0
        self._read_ns, self._write_ns = round(1e9 * read), round(1e9 * write)

    def clock(self) -> int:
        return self.now_ns

    def read(self, time_ns: int) -> Vector:
        self.reads += 1
        self.now_ns += self._read_ns
        return self.position

    def write(self, time_ns: int, force: Vector) -> Vector:
        self.now_ns += self._write_ns
        return super().write(time_ns, force)


def slow_node(device: SlowDevice, *, once: bool, **settings: Any) -> DeviceNode:
    servo = ServoSettings(**{"law": "none", "engage_time": 0.0, **settings})
    stated = replace(DISSIPATION, write_delay=1e-3)
    return DeviceNode(device, stated, servo, device.clock, reads_once=once)


def run(node: DeviceNode, device: SlowDevice, seconds: float) -> list[Packet]:
    """Run a node on the clock of its device, each state answered at once."""
    packets: list[Packet] = []
    received: list[Packet] = []
    end_ns = device.now_ns + round(1e9 * seconds)
    while device.now_ns < end_ns:
        device.now_ns = max(device.now_ns, node.wake_ns)
        sent = node.step(device.now_ns, received)
        received = [answer(one, (0.1,)) for one in sent if isinstance(one, DeviceState)]
        packets += sent
    return packets


def test_a_tick_that_is_late_reads_again_before_a_force_acts_later_than_stated() -> None:
    device = SlowDevice(read=2e-4, write=1e-4)
    servo = ServoSettings(law="none", engage_time=0.0)
    stated = replace(DISSIPATION, write_delay=6e-4)
    node = DeviceNode(device, stated, servo, device.clock, reads_once=True)
    node.engage()
    run(node, device, 0.02)
    while not node.needs_packets:
        run(node, device, 1e-9)
    device.now_ns += 5_000_000  # something else has the processor, between state and write
    run(node, device, 0.02)
    assert node.status().bounder.late_writes == 0
    assert node.status().bounder.longest_write_delay == pytest.approx(5e-4)


@pytest.mark.parametrize("once", [True, False])
def test_the_reading_of_the_state_serves_the_bounder_with_its_own_time(once: bool) -> None:
    device = SlowDevice(read=2e-4, write=1e-4)
    node = slow_node(device, once=once)
    node.engage()
    packets = run(node, device, 0.02)
    ticks = [one for one in packets if isinstance(one, Telemetry)]
    states = sum(isinstance(one, DeviceState) for one in packets)
    assert device.reads == 1 + states + (0 if once else len(ticks))  # one at the start
    for one in ticks[1:]:
        assert one.read_ns is not None
        assert one.write_ns is not None
        delay = one.write_ns - one.read_ns
        assert delay == (500_000 if once else 300_000)  # 0.4 ms and the write; a read and the write


@pytest.mark.parametrize(
    ("read", "write", "rate", "asked", "once"),
    [
        (2e-3, 1e-4, 300.0, "auto", True),
        (2e-3, 1e-4, 200.0, "auto", False),
        (2e-3, 1e-4, 200.0, 1, True),
        (2e-3, 1e-4, 300.0, 2, False),
    ],
)
def test_a_tick_has_one_reading_where_two_do_not_fit(
    read: float, write: float, rate: float, asked: Any, once: bool
) -> None:
    device = SlowDevice(read, write)
    servo = ServoSettings(rate=rate, reply_wait=0.8, readings_per_tick=asked)
    model = Robot(class_=Path("r.py:R"), joints=("a",), watchdog_limit=0.1, write_delay=5e-3)
    assert reads_once(device, model, servo, device.clock) is once


@pytest.mark.parametrize(
    ("read", "write_delay", "field"), [(2e-3, 2.7e-3, "write_delay"), (4e-3, 0.01, "rate")]
)
def test_a_bus_for_which_one_reading_needs_more_is_refused(
    read: float, write_delay: float, field: str
) -> None:
    device = SlowDevice(read, 1e-4)
    servo = ServoSettings(rate=300.0, reply_wait=0.8)
    model = Robot(class_=Path("r.py:R"), joints=("a",), watchdog_limit=0.1, write_delay=write_delay)
    with pytest.raises(ConfigError) as error:
        reads_once(device, model, servo, device.clock)
    assert error.value.field == field


def test_one_reading_is_passive_with_the_delay_that_it_needs_and_costs_stiffness() -> None:
    def pressed(*more: str) -> Any:
        device = ["watchdog:=reporting", "write_delay:=0.5 ms", *more]
        return run_virtual(load("stiff_wall", [f"device.{one}" for one in device]), duration=2.0)

    once, twice = (pressed(f"readings_per_tick:={count}") for count in (1, 2))
    for one in (once, twice):
        assert one.columns.true_energy.min() >= -1e-9
        assert one.summary["late_writes"] == 0
    assert once.columns.applied_force.max() > 0.5
    late = once.columns.write_ns - once.columns.read_ns
    assert (late[1:] == 500_000).all()  # 0.4 of the period, and what is left of the delay


# Missed ticks


def missed(device: SlowDevice, stall_ns: int = 0) -> list[Event]:
    node = slow_node(device, once=False)
    node.engage()
    packets = run(node, device, 1.0)
    if stall_ns:
        for _ in range(50):
            device.now_ns += stall_ns  # something else has the processor
            packets += run(node, device, 0.02)
    packets += run(node, device, 1.1)
    return [one for one in packets if isinstance(one, Event) and one.event == "ticks_missed"]


def test_a_device_that_is_too_slow_is_named_as_the_cause_of_missed_ticks() -> None:
    events = missed(SlowDevice(read=7e-4, write=1e-4))
    assert [one.data["cause"] for one in events] == ["device"]
    assert "1.5 ms of a period of 1 ms" in events[0].message


def test_a_busy_machine_is_named_where_the_device_is_quick() -> None:
    events = missed(SlowDevice(read=1e-5, write=1e-5), stall_ns=5_000_000)
    assert [one.data["cause"] for one in events] == ["machine"]


# forcebound check device


def test_check_device_takes_a_launch_file_and_says_what_its_bus_permits(folder: Path) -> None:
    path = written(folder, "  rate: 100 Hz")
    checked = check_part("device", str(path), is_child=True)
    assert checked.violations == []
    assert checked.seconds_per_tick is not None
    assert checked.seconds_per_tick.reads == 2
    assert any("write_delay" in line for line in checked.permits)


def test_joints_beyond_one_turn_in_rad_lead_to_the_question_of_the_unit(folder: Path) -> None:
    text = written(folder, "  rate: 100 Hz").read_text(encoding="utf-8")
    for unit, is_asked in (("deg", False), ("rad", True)):
        path = folder / f"{unit}.yaml"
        path.write_text(text.replace("positions: deg", f"positions: {unit}"), encoding="utf-8")
        said = check_part("device", str(path), is_child=True).permits
        assert any("positions: deg" in line for line in said) is is_asked


def test_a_rate_that_does_not_fit_is_said_as_the_launch_says_it(folder: Path) -> None:
    device = SlowDevice(read=3.8e-3, write=1e-4)
    times = time_ticks(device, device.clock, 20)
    assert times is not None
    asked, stated = (ServoSettings(rate=one, reply_wait=0.8) for one in (300.0, 250.0))
    model = Robot(class_=Path("r.py:R"), joints=("a",), watchdog_limit=0.1, write_delay=0.01)
    with pytest.raises(ConfigError, match="250 Hz") as error:
        reads_once(device, model, asked, device.clock)
    assert error.value.field == "rate"
    delay = f"write_delay: {stated_delay(times.delay(stated)):g} ms"
    assert "device.rate: 250 Hz" in [*described(times, asked)][-1]
    assert delay in [*described(times, asked)][-1]
    assert reads_once(device, model, stated, device.clock)


# A device in a program


class Server:
    """The end of a program, as the test says."""

    def __init__(self, endpoint: str, reply: Callable[[bytes], bytes | None]) -> None:
        self.seen: list[bytes] = []
        self._context, self._endpoint = zmq.Context(), endpoint
        self._socket = self._context.socket(zmq.REP)
        self._socket.bind(endpoint)
        self._reply = reply
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        while (message := self._socket.recv()) != b"end":
            self.seen.append(message)
            found = self._reply(message)
            if found is None:
                break
            self._socket.send(found)

    def end(self) -> None:
        if self._thread.is_alive():
            with zmq.Context() as context, context.socket(zmq.REQ) as last:
                last.linger = 0
                last.connect(self._endpoint)
                last.send(b"end")
                self._thread.join()
        self._socket.close(linger=0)
        self._context.destroy(linger=0)


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        (b"FBD1fail" + b"the arm is off", "the arm is off"),
        (b"HTTP/1.1 400", "no program of a device"),
        (b"FBD1okay" + bytes(8), "expected 2 finite numbers"),
        (None, "no answer to read for 100 ms"),
    ],
)
def test_a_program_that_fails_ends_the_device_in_one_sentence(
    tmp_path: Path, reply: bytes | None, words: str
) -> None:
    endpoint = f"ipc://{tmp_path}/s"
    server = Server(endpoint, lambda sent: reply if b"read" in sent else b"FBD1okay")
    model = Program(
        address=endpoint,
        joints=("x", "y"),
        damping=1.0,
        friction=0.0,
        resolution=1e-5,
        saturation=1.0,
        watchdog_limit=0.1,
        timeout=0.1,
    )
    with pytest.raises(DeviceError, match=words):
        model.open(None, 1e-3)
    server.end()
    assert reply is None or server.seen[-1].startswith(b"FBD1stop")


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    built = tmp_path_factory.mktemp("cpp") / "device"
    compiler = shutil.which("c++")
    if compiler is None:
        pytest.skip("there is no C++ compiler")
    command = [compiler, "-std=c++17", "-Wall", "-Wextra", "-Werror", "-o", str(built)]
    made = subprocess.run([*command, str(HEADER / "device.cpp"), "-lzmq"], capture_output=True)
    if b"zmq.h" in made.stderr and b"No such file" in made.stderr:
        pytest.skip("libzmq has no header here")
    assert made.returncode == 0, made.stderr.decode()
    return built


def rails(program: Path, **numbers: Any) -> Program:
    stated = {"damping": 0.5, "friction": 0.0, "resolution": 1e-6, "saturation": 5.0}
    joints = ("x", "y")
    return Program(
        **{"joints": joints, "prismatic": joints, "program": program, **stated, **numbers}
    )


@pytest.mark.live
def test_a_program_in_cpp_moves_by_the_forces_that_it_gets(program: Path) -> None:
    device = rails(program, watchdog_limit=60.0).open(None, 1e-3)
    assert device.write(0, (-2.0, 0.0)) == (-2.0, 0.0)  # which accelerates along x
    begin = device.read(0)
    time.sleep(0.1)
    end = device.read(0)
    assert end[0] - begin[0] > 0.01
    device.close()
    with pytest.raises(DeviceError):
        device.read(0)


@pytest.mark.live
def test_the_watchdog_of_the_header_ends_a_force_and_the_run(program: Path) -> None:
    device = rails(program, watchdog_limit=0.2).open(None, 1e-3)
    device.write(0, (0.0, 0.0))
    time.sleep(0.3)
    device.read(0)  # without a force, silence is no fault
    device.write(0, (1.0, 0.0))
    time.sleep(0.3)
    with pytest.raises(DeviceError, match="zero force was written"):
        device.read(0)
    device.close()


@pytest.mark.live
def test_a_program_of_other_axes_and_one_that_does_not_start_are_refused(program: Path) -> None:
    with pytest.raises(DeviceError, match="this device has 2 axes"):
        rails(program, joints=("x",), prismatic=("x",), watchdog_limit=1.0).open(None, 1e-3)
    with pytest.raises(DeviceError, match="ended at its start"):
        rails(Path("/bin/false"), watchdog_limit=1.0).open(None, 1e-3)


@pytest.mark.examples
@pytest.mark.live
@pytest.mark.xdist_group("processes")
def test_the_program_of_the_example_presses_into_the_wall_of_its_launch_file() -> None:
    """``make examples`` builds it; it is skipped where it is not built."""
    if not (HEADER / "device").exists():
        pytest.skip("make -C examples/cpp has not built it")
    words = ["launch", str(HEADER / "device.yaml"), "--duration", "2s", "--json"]
    ran = subprocess.run(
        [sys.executable, "-m", "forcebound", *words], capture_output=True, timeout=TIMEOUT
    )
    assert ran.returncode == 0, ran.stderr.decode()
    summary = json.loads(ran.stdout)
    assert summary["samples"] > 100
    assert summary["peak_penetration_m"] > 0.0  # 0.3 N push it along x
    assert b"the rails rest" in ran.stderr
