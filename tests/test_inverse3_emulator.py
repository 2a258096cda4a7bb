"""The emulated service of the Inverse3 in virtual time, beside the golden messages."""

import json
import math
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from forcebound.errors import ConfigError
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.devices.truth_file import NOBODY, TruthFile
from forcebound.haptics.hands.hands import PressingHand
from forcebound.hardware.emulators.faults import SERVICE_KINDS, Faults, parse_fault
from forcebound.hardware.emulators.inverse3 import LINK, Inverse3, arm_of
from forcebound.hardware.emulators.inverse3_service import DEVICE_ID, Service

GOLDEN = Path(__file__).parent / "golden" / "inverse3"
MS = 1_000_000
IDLE = 0.05  # s
HAND = PressingHand(mass=0.1, stiffness=200.0, damping=2.0, start=(0.0, 0.0, 0.0), end=(0.02, 0, 0))
MODEL = PhantomPremium15(axes=3, friction=(0.12, 0.12, 0.12))


def golden(name: str) -> Any:
    return json.loads((GOLDEN / f"{name}.json").read_text())


def shape(value: Any) -> Any:
    """Return the keys and the kinds of values of a message, at every depth."""
    if isinstance(value, dict):
        return {key: shape(each) for key, each in value.items()}
    if isinstance(value, list):
        return [shape(each) for each in value]
    return float if isinstance(value, int | float) and not isinstance(value, bool) else type(value)


class Client:
    """Clients of a service in virtual time; a message a millisecond."""

    def __init__(
        self, truth: TruthFile, *faults: str, hand: PressingHand | None = HAND, idle: float = IDLE
    ) -> None:
        planned = Faults([parse_fault(text, SERVICE_KINDS) for text in faults])
        self.device = Inverse3(MODEL, MODEL.mass, hand, idle)
        self.service = Service(self.device, hand, planned, truth)
        self.time_ns = 1_000 * MS
        self.device.start(self.time_ns)
        self.session, text = self.service.connect(self.time_ns)
        self.inventory = json.loads(text)

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds * 1000)):
            self.time_ns += MS
            self.service.tick(self.time_ns)

    def texts(self, message: Any = None, session: int | None = None) -> list[bytes]:
        """Send a message, in JSON unless it is a text; return what has come since the last one."""
        self.wait(0.001)
        text = message if isinstance(message, bytes) else json.dumps(message or {}).encode()
        self.service.receive(session or self.session, text, self.time_ns)
        return self.come()

    def come(self) -> list[bytes]:
        waiting, found = self.service.outgoing, []
        while waiting and waiting[0].due_ns <= self.time_ns:
            found.append(waiting.popleft().text)
        return found

    def ask(self, message: Any = None, session: int | None = None) -> Any:
        (text,) = self.texts(message, session)
        return json.loads(text)

    def state(self, message: Any = None, session: int | None = None) -> Any:
        return self.ask(message, session)["inverse3"][0]["state"]

    def push(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
        return self.state(command({"set_cursor_force": {"vector": {"x": x, "y": y, "z": z}}}))

    def http(self, method: str, path: str, body: Any = None) -> tuple[int, Any]:
        place, _, query = path.partition("?session=")
        text = b"" if body is None else json.dumps(body).encode()
        return self.service.request(method, place, query, text, self.time_ns)

    def events(self) -> list[str]:
        sent = [json.loads(each) for each in self.service.events]
        self.service.events.clear()
        return [each["data"].get("safety_type", each["name"]) for each in sent]


def command(commands: Any) -> Any:
    return {"inverse3": [{"device_id": DEVICE_ID, "commands": commands}]}


def configure(**settings: Any) -> Any:
    return {"inverse3": [{"device_id": DEVICE_ID, "configure": settings}]}


def force_of(state: Any) -> tuple[float, float, float]:
    force = state["current_cursor_force"]
    return force["x"], force["y"], force["z"]


@pytest.fixture
def truth(tmp_path: Path) -> Iterator[TruthFile]:
    file = TruthFile(tmp_path / "port.truth", creates=True)
    yield file
    file.close()


def test_the_inventory_has_the_keys_and_kinds_of_the_golden_one(truth: TruthFile) -> None:
    (device,), (wanted,) = (
        each["inverse3"] for each in (Client(truth).inventory, golden("from_service/inventory"))
    )
    for part in ("state", "status"):
        assert shape(device[part]) == shape(wanted[part])
    assert device["config"]["filters"] == wanted["config"]["filters"]
    missing = wanted["config"].keys() - device["config"].keys()
    assert missing == {"extended_device_id", "extended_firmware_version"}
    assert device["device_id"] == wanted["device_id"]


def test_the_old_inventory_has_the_keys_and_kinds_of_the_golden_one(truth: TruthFile) -> None:
    client = Client(truth, "old")
    (device,), (wanted,) = (
        each["inverse3"] for each in (client.inventory, golden("from_service/inventory_3_1"))
    )
    for part in ("state", "status"):
        assert shape(device[part]) == shape(wanted[part])
    assert device["config"].keys() == wanted["config"].keys() - {
        "extended_device_id",
        "extended_firmware_version",
    }
    assert "session_id" not in client.ask()
    assert client.http("GET", "/version")[1]["project_version"] == "3.1.1.0"


@pytest.mark.parametrize("path", sorted(GOLDEN.glob("to_service/*.json")), ids=lambda p: p.stem)
def test_every_golden_message_is_answered_by_one_state(truth: TruthFile, path: Path) -> None:
    client = Client(truth)
    reply = client.ask(path.read_bytes())
    wanted = golden("from_service/state")
    (device,), (known,) = reply["inverse3"], wanted["inverse3"]
    assert shape(device["state"]) == shape(known["state"])
    assert ("config" in device) == (path.stem == "full_state")
    assert reply["session_id"] == wanted["session_id"]
    assert client.service.replies == 1


def test_a_state_has_the_keys_and_kinds_of_one_of_a_real_device(truth: TruthFile) -> None:
    (device,) = Client(truth).ask()["inverse3"]
    (real,) = golden("from_service/state_of_a_device")["inverse3"]
    del real["state"]["mode"]  # of the form before 3.5
    assert shape(device["status"]) == shape(real["status"])
    assert shape({**device["state"], "transform": 0}) == shape({**real["state"], "transform": 0})


@pytest.mark.parametrize("name", ["force_vector", "force_values"])
def test_both_forms_of_a_force_act(truth: TruthFile, name: str) -> None:
    client = Client(truth)
    assert force_of(client.state(golden(f"to_service/{name}"))) == (0.0, 0.0, 1.5)


@pytest.mark.parametrize(
    "text",
    [b"", b"{", b"\xff", b"[]", b"7", b'{"inverse3": 3}', b'{"inverse3": [{"device_id": 3}]}'],
)
def test_a_message_that_makes_no_sense_gets_a_state_and_moves_nothing(
    truth: TruthFile, text: bytes
) -> None:
    client = Client(truth)
    client.push(z=1.0)
    assert force_of(client.state(text)) == (0.0, 0.0, 0.0)


def test_a_force_that_makes_no_sense_or_is_for_another_device_moves_nothing(
    truth: TruthFile,
) -> None:
    client = Client(truth)
    bad = command({"set_cursor_force": {"vector": {"x": "1", "y": 0, "z": 0}}})
    other = golden("to_service/force_vector")
    other["inverse3"][0]["device_id"] = "04BA"
    for message in (bad, other):
        state = client.state(message)
        assert force_of(state) == (0.0, 0.0, 0.0)
        assert state["control_mode"] == "idle"


def test_http_answers_as_the_golden_exchanges(truth: TruthFile) -> None:
    client = Client(truth)
    for each in golden("http/exchanges"):
        status, reply = client.http(each["method"], each["path"], each["body"])
        assert status == each["status"], each
        assert reply.get("ok") == each["reply"].get("ok"), each
        assert reply.get("data") == each["reply"].get("data"), each


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/settings", {"devices/force_scale": -1.0}),
        ("/settings", {"devices/force_scale": "1"}),
        ("/settings", []),
        ("/settings", {"devices/force_scale": 0.5, "devices/other": 1.0}),
        ("/settings/communication/events/port", 1),
        ("/inverse3/049D/config/torque_scaling", {"enabled": 1}),
        ("/inverse3/049D/config/handedness", {"handedness": "both"}),
        ("/inverse3/049D/config/filters/force_gate?session=:0", {"gain": 2.0}),
        ("/inverse3/049D/config/filters/damping?session=:0", {"scalar": -1.0}),
    ],
)
def test_a_setting_that_does_not_fit_is_refused_and_kept(
    truth: TruthFile, path: str, body: Any
) -> None:
    client = Client(truth)
    before = client.ask(golden("to_service/full_state"))["inverse3"][0]["config"]
    status, reply = client.http("POST", path, body)
    assert (status, reply["ok"]) == (400, False)
    after = client.ask(golden("to_service/full_state"))["inverse3"][0]["config"]
    assert after == before
    assert client.http("GET", "/settings/devices/force_scale")[1]["data"] == 1.0


@pytest.mark.parametrize(
    "path", ["/", "/settings/none", "/inverse3/04BA/config/basis", "/inverse3/049D/config/none"]
)
def test_what_is_not_there_is_not_found(truth: TruthFile, path: str) -> None:
    client = Client(truth)
    assert client.http("GET", path)[0] == 404
    assert client.http("GET", "/inverse3/049D/config/filters/damping?session=99")[0] == 404


def test_http_lists_the_devices_as_the_inventory_does(truth: TruthFile) -> None:
    client = Client(truth)
    status, found = client.http("GET", "/devices")
    assert (status, {"session_id": client.session, **found}) == (200, client.inventory)


def test_global_settings_outlive_a_session_and_filters_do_not(truth: TruthFile) -> None:
    client = Client(truth)
    client.ask(configure(damping={"scalar": 2.0}, force_gate={"gain": 0.0}, basis={"a": 1}))
    client.http("POST", "/inverse3/049D/config/torque_scaling", {"enabled": False})
    config = client.ask(golden("to_service/full_state"))["inverse3"][0]["config"]
    assert config["filters"] == {"damping": {"scalar": 2.0}, "force_gate": {"gain": 0.0}}
    assert config["basis"] == {"permutation": "XYZ"}
    client.service.disconnect(client.session, client.time_ns)
    number, text = client.service.connect(client.time_ns)
    config = json.loads(text)["inverse3"][0]["config"]
    assert number == client.session + 1
    assert config["torque_scaling"] == {"enabled": False}
    assert config["filters"] == golden("from_service/inventory")["inverse3"][0]["config"]["filters"]


def test_a_preset_moves_the_origin_to_the_middle_of_the_workspace(truth: TruthFile) -> None:
    client = Client(truth, hand=None)
    place = client.state()["cursor_position"]
    assert tuple(place.values()) == pytest.approx((0.0, -0.12, 0.15), abs=2e-4)
    place = client.state(configure(preset={"preset": "arm_front_centered"}))["cursor_position"]
    assert tuple(place.values()) == pytest.approx((0.0, 0.0, 0.0), abs=2e-4)


def test_the_cursor_is_where_the_ground_truth_has_the_tip(truth: TruthFile) -> None:
    client = Client(truth)
    client.ask(configure(preset={"preset": "arm_front_centered"}))
    for _ in range(500):
        state = client.push(y=0.8)
    found = truth.read()
    assert found is not None
    assert math.hypot(*found.position) > 1e-3
    assert math.dist(found.position, tuple(state["cursor_position"].values())) < 2 * 3e-5
    assert found.velocity == pytest.approx(tuple(state["cursor_velocity"].values()), abs=1e-9)


def test_a_force_pushes_the_tip_its_way_and_against_the_hand(truth: TruthFile) -> None:
    for k, name in enumerate("xyz"):
        client = Client(truth)
        truth.announce()  # the hand waits at 0
        before = client.state()["cursor_position"]
        for _ in range(500):
            state = client.push(**{name: 1.5})
        found = truth.read()
        assert found is not None
        assert state["cursor_position"][name] - before[name] > 2e-3
        assert found.hand_force[k] < -0.5


def test_a_force_that_is_not_renewed_ends_after_the_idle_time_and_not_before(
    truth: TruthFile,
) -> None:
    client = Client(truth, idle=0.03)
    client.push(z=1.0)
    client.wait(0.028)
    assert client.device.force == (0.0, 0.0, 1.0)
    client.wait(0.003)
    assert client.device.force == (0.0, 0.0, 0.0)
    found = truth.look()
    assert found is not None
    assert found.torque == (0.0, 0.0, 0.0)
    assert found.torque_ns <= client.time_ns - MS
    assert client.state(golden("to_service/probe"))["control_mode"] == "idle"


def test_forces_of_sessions_add_and_the_second_one_is_an_event(truth: TruthFile) -> None:
    client = Client(truth)
    other, _ = client.service.connect(client.time_ns)
    client.push(z=1.0)
    assert client.events() == []
    force = golden("to_service/force_vector")
    assert force_of(client.state(force, other)) == (0.0, 0.0, 2.5)
    assert client.events() == ["device-busy"]
    assert client.ask({}, other)["inverse3"][0]["status"]["in_use"]
    assert client.device.force == (0.0, 0.0, 1.0)
    client.service.disconnect(client.session, client.time_ns)
    assert client.device.force == (0.0, 0.0, 0.0)


def test_a_still_tip_gets_the_whole_force_and_one_that_oscillates_a_part(truth: TruthFile) -> None:
    client = Client(truth)
    truth.announce()
    client.ask(configure(force_gate={"gain": 0.0}))
    assert force_of(client.push(x=1.0)) == (1.0, 0.0, 0.0)
    shares = []
    for k in range(1000):
        wanted = math.copysign(6.0, math.sin(math.tau * 25e-3 * k))
        shares.append(force_of(client.push(x=wanted))[0] / wanted)
    assert shares[0] == 1.0
    assert min(shares) < 0.5
    assert all(0.0 < share <= 1.0 for share in shares)
    client.wait(1.0)
    assert force_of(client.push(x=1.0)) == (1.0, 0.0, 0.0)


def test_the_force_gate_takes_its_share_while_the_tip_oscillates(truth: TruthFile) -> None:
    forces = []
    for gain in (0.0, 0.6):
        client = Client(truth)
        truth.announce()
        client.ask(configure(force_gate={"gain": gain}))
        for k in range(1000):
            client.push(x=math.copysign(6.0, math.sin(math.tau * 25e-3 * k)))
        forces.append(client.device._oscillation.gain)
        share = force_of(client.push(x=1.0))[0]
        assert share == pytest.approx(client.device._oscillation.gain * (1.0 - gain), rel=0.05)
    assert forces[0] < 1.0


def test_damping_brakes_and_force_scale_multiplies(truth: TruthFile) -> None:
    client = Client(truth)
    client.ask(configure(damping={"scalar": 5.0}))
    for _ in range(100):
        state = client.push(y=0.8)
    speed = state["cursor_velocity"]["y"]
    assert speed > 0.005
    assert force_of(state)[1] == pytest.approx(0.8 - 5.0 * speed, rel=1e-6)
    client.http("POST", "/settings", {"devices/force_scale": 1.5})
    client.ask(configure(damping={"scalar": 0.0}))
    assert force_of(client.push(y=0.8))[1] == pytest.approx(1.2)


def test_torque_scaling_keeps_the_direction_of_a_force_beyond_the_largest(truth: TruthFile) -> None:
    client = Client(truth)
    scaled = force_of(client.push(x=30.0, y=40.0))
    assert scaled == pytest.approx((0.6 * MODEL.saturation, 0.8 * MODEL.saturation, 0.0))
    client.http("POST", "/inverse3/049D/config/torque_scaling", {"enabled": False})
    assert force_of(client.push(x=30.0, y=4.0)) == (MODEL.saturation, 4.0, 0.0)


def test_without_gravity_compensation_the_tip_sinks(truth: TruthFile) -> None:
    client = Client(truth, hand=None)
    client.wait(0.3)
    before = client.state()["cursor_position"]["z"]
    gravity = {"enabled": False, "scaling_factor": 1.0}
    client.http("POST", "/inverse3/049D/config/gravity_compensation", gravity)
    client.wait(0.3)
    assert client.state()["cursor_position"]["z"] < before - 5e-3


def test_torques_of_the_joints_are_those_of_their_force_at_the_tip(truth: TruthFile) -> None:
    client = Client(truth)
    given = {"a0": 20.0, "a1": -30.0, "a2": 10.0}  # N mm
    torques = client.state(command({"set_angular_torques": {"torques": given}}))
    assert torques["current_angular_torques"] == pytest.approx(given)
    found = truth.look()
    assert found is not None
    assert found.torque == pytest.approx((0.020, -0.030, 0.010))


def test_friction_along_the_axes_alone_says_too_much_of_motion_across_them() -> None:
    """Why a number that is identified on one axis at a time is no lower bound on an arm."""
    arm = arm_of(MODEL, MODEL.mass)
    angles = arm.angles((0.0, 0.0, 0.0))
    assert angles is not None
    kinematics = arm.kinematics()
    assert kinematics is not None
    jacobian = np.array(kinematics.jacobian(angles))

    def friction(velocity: tuple[float, float, float]) -> float:
        rates = np.linalg.solve(jacobian, velocity)
        return float(np.abs(rates) @ np.array(arm.friction))

    along = [friction((0.0, 1.0, 0.0)), friction((0.0, 0.0, 1.0))]
    assert friction((0.0, -1.0, 1.0)) < 0.6 * sum(along)
    assert friction((0.0, -1.0, 1.0)) > 2 * 0.12


def test_the_arm_has_what_the_model_states_of_the_axes_anywhere_in_its_box() -> None:
    arm, draw = arm_of(MODEL, MODEL.mass), random.Random(1)
    assert isinstance(arm.damping, tuple)
    assert isinstance(arm.friction, tuple)
    assert isinstance(arm.resolution, float)
    kinematics = arm.kinematics()
    assert kinematics is not None
    for _ in range(300):
        place = tuple(draw.uniform(-edge / 2, edge / 2) for edge in arm.workspace)
        angles = arm.angles(place)
        assert angles is not None
        rates = [draw.gauss(0.0, 1.0) for _ in angles]
        jacobian = kinematics.jacobian(angles)
        speeds = [sum(a * b for a, b in zip(row, rates, strict=True)) for row in jacobian]
        steps = [sum(abs(x) * arm.resolution for x in row) for row in jacobian]
        friction = sum(f * abs(w) for f, w in zip(arm.friction, rates, strict=True))
        damping = sum(b * w * w for b, w in zip(arm.damping, rates, strict=True))
        assert friction >= sum(0.12 * abs(v) for v in speeds)
        assert damping >= sum(0.27 * v * v for v in speeds)
        assert max(steps) <= 3e-5
    assert arm.inertia == pytest.approx(MODEL.mass * LINK**2)


def test_a_spring_that_the_client_renders_a_tick_late_gives_the_hand_energy(
    truth: TruthFile,
) -> None:
    """Energy as the truth has it: a stiff wall without a law, and none at all."""
    energies = []
    for stiffness in (0.0, 4000.0):
        client = Client(truth)
        client.ask(configure(preset={"preset": "arm_front_centered"}, force_gate={"gain": 0.0}))
        truth.announce()
        truth.engage(client.time_ns)
        x, lowest = 0.0, 0.0
        for _ in range(1500):
            state = client.push(x=-stiffness * max(x - 0.01, 0.0))
            client.wait(0.003)
            x = state["cursor_position"]["x"]
            found = truth.read()
            assert found is not None
            lowest = min(lowest, found.energy)
        energies.append(lowest)
        assert client.device.lowest_energy <= lowest
    assert energies[0] == 0.0
    assert energies[1] < -1e-4


def test_the_hand_waits_moves_and_goes_home_as_on_a_port(truth: TruthFile) -> None:
    client = Client(truth)
    truth.announce()
    for _ in range(1500):
        client.ask()
    truth.engage(client.time_ns)
    for _ in range(1500):
        state = client.state()
    assert state["cursor_position"]["x"] > 0.015
    client.service.disconnect(client.session, client.time_ns)
    assert truth.engaged_ns == NOBODY
    client.wait(2.0)
    found = truth.read()
    assert found is not None
    assert found.position[0] < 0.004  # friction holds it short of home


@pytest.mark.parametrize("kind", ["ebrake", "motor_stall"])
def test_a_safety_function_takes_the_force_and_says_so(truth: TruthFile, kind: str) -> None:
    client = Client(truth, f"{kind}:at=10ms,for=20ms")
    forces, ready = [], []
    for _ in range(50):
        reply = client.ask(golden("to_service/force_vector"))["inverse3"][0]
        forces.append(force_of(reply["state"])[2])
        ready.append(reply["status"]["ready"])
    assert forces == [1.5 * is_ready for is_ready in ready]
    assert ready.count(False) == 20
    wanted = {"ebrake": ["ebrake_triggered", "ebrake_released"], "motor_stall": ["stall_detected"]}
    assert client.events() == wanted[kind]


def test_a_device_that_is_unplugged_is_gone_with_its_force_and_comes_back(truth: TruthFile) -> None:
    client = Client(truth, "unplug:at=5ms,for=10ms")
    there = []
    for _ in range(30):
        there.append(bool(client.ask(golden("to_service/force_vector"))["inverse3"]))
        if not there[-1]:
            assert client.device.force == (0.0, 0.0, 0.0)
            assert client.http("GET", "/inverse3/049D/config/handedness")[0] == 404
    assert there.count(False) == 10
    assert there[-1]
    assert client.events() == ["device-disconnected", "device-connected"]


def test_another_session_that_takes_the_device_adds_its_force(truth: TruthFile) -> None:
    client = Client(truth, "busy:at=5ms,for=10ms")
    states = [client.push(x=1.0) for _ in range(30)]
    assert {force_of(state)[0] for state in states} == {1.0, 1.5}
    assert force_of(states[-1])[0] == 1.0
    assert client.events() == ["device-busy"]
    client = Client(truth, "busy:at=1ms")
    replies = [client.ask() for _ in range(100)]
    assert replies[-1]["inverse3"][0]["status"]["in_use"]


def test_a_stalled_service_answers_later_and_its_last_force_ends(truth: TruthFile) -> None:
    client = Client(truth, "stall:at=5ms,for=100ms")
    counts = [len(client.texts(golden("to_service/force_vector"))) for _ in range(8)]
    assert counts == [1] * 5 + [0] * 3
    client.wait(0.060)
    assert client.device.force == (0.0, 0.0, 0.0)
    client.wait(0.060)
    assert len(client.come()) == 3


def spoiled(kind: str) -> Callable[[list[bytes]], bool]:
    def is_whole(text: bytes) -> bool:
        try:
            return bool(json.loads(text))
        except ValueError:
            return False

    return {
        "malformed": lambda texts: not is_whole(texts[0]),
        "foreign": lambda texts: json.loads(texts[0])["inverse3"][0]["device_id"] != DEVICE_ID,
        "late": lambda texts: not texts,
        "doubled": lambda texts: len(texts) == 2 and texts[0] == texts[1],
    }[kind]


@pytest.mark.parametrize("kind", ["malformed", "foreign", "late", "doubled"])
def test_one_reply_is_spoiled_on_demand(truth: TruthFile, kind: str) -> None:
    client, is_spoiled = Client(truth, f"{kind}:at=5ms"), spoiled(kind)
    sets = [client.texts() for _ in range(5)]
    assert all(len(each) == 1 and not is_spoiled(each) for each in sets)
    assert is_spoiled(client.texts())
    client.wait(0.025)
    rest = [*client.come(), *client.texts()]
    assert len(rest) == (2 if kind == "late" else 1)
    assert all(json.loads(text)["inverse3"][0]["device_id"] == DEVICE_ID for text in rest)


def test_late_replies_keep_their_order(truth: TruthFile) -> None:
    client = Client(truth, "late:at=5ms")
    for _ in range(10):
        client.texts()
    client.wait(0.030)
    replies = [json.loads(text) for text in client.come()]
    assert client.service.replies == 10
    assert len(replies) == 5


def test_an_arm_that_is_not_calibrated_says_so_from_the_start(truth: TruthFile) -> None:
    (device,) = Client(truth, "uncalibrated").inventory["inverse3"]
    assert not device["status"]["calibrated"]


def test_a_new_service_says_its_version(truth: TruthFile) -> None:
    assert Client(truth, "new").http("GET", "/version")[1]["project_version"] == "4.0.0.0"


def test_the_faults_of_a_board_are_not_those_of_a_service() -> None:
    with pytest.raises(ConfigError, match="nan"):
        parse_fault("nan", SERVICE_KINDS)
    with pytest.raises(ConfigError, match="busy"):
        parse_fault("busy")


@pytest.mark.parametrize("path", sorted(GOLDEN.glob("events/*.json")), ids=lambda p: p.stem)
def test_events_have_the_form_of_the_golden_ones(truth: TruthFile, path: Path) -> None:
    wanted = json.loads(path.read_text())
    sent = []
    for kind in ("unplug", "busy", "ebrake", "motor_stall"):
        client = Client(truth, f"{kind}:at=1ms,for=3ms")
        for _ in range(9):
            client.texts()
        sent += [json.loads(each) for each in client.service.events]
    (found,) = (
        each
        for each in sent
        if each["name"] == wanted["name"]
        and each["data"].get("safety_type") == wanted["data"].get("safety_type")
    )
    assert {**found, "message": ""} == {**wanted, "message": ""}
