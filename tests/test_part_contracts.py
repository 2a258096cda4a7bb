"""Contracts of laws, devices, operators and controllers: kept by what ships, and able to fail."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from forcebound.cli import main
from forcebound.errors import DeviceError
from forcebound.haptics.controllers import CONTROLLERS
from forcebound.haptics.controllers import contract as controllers
from forcebound.haptics.controllers.direct import DirectController
from forcebound.haptics.devices import DEVICES, DeviceModel
from forcebound.haptics.devices import contract as devices
from forcebound.haptics.devices.motor import SimulatedMotor
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.devices.simulated import SimulatedDevice
from forcebound.haptics.hands import OPERATORS, Operator
from forcebound.haptics.hands import contract as operators
from forcebound.haptics.laws import LAWS
from forcebound.haptics.laws import contract as laws
from forcebound.haptics.laws.none import NONE
from forcebound.haptics.parts.contract import Report
from forcebound.messages.packets import Vector

ticks, openings = count(), count()


@pytest.mark.parametrize("law", sorted(LAWS))
def test_every_law_keeps_its_promises(law: str) -> None:
    assert laws.check(law, samples=500).violations == ()


SIMULATED = [kind for kind in sorted(DEVICES) if "devices" in DEVICES[kind].__module__]


@pytest.mark.parametrize("kind", SIMULATED)
def test_every_device_keeps_its_promises(kind: str) -> None:
    make: Callable[..., DeviceModel] = DEVICES[kind]
    report = devices.check(make())  # pyright: ignore[reportCallIssue]
    assert report.violations == ()
    assert report.questions > 0


@pytest.mark.live
@pytest.mark.parametrize("kind", sorted(set(DEVICES) - {*SIMULATED, "program", "robot"}))
def test_every_driver_keeps_its_promises_on_its_emulator(kind: str) -> None:
    model: Any = DEVICES[kind]
    report = devices.check(model(watchdog_limit=2.54))  # the longest that all take
    assert report.violations == ()
    assert report.questions > 0


@pytest.mark.parametrize("kind", sorted(OPERATORS))
def test_every_operator_keeps_its_promises(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "path.csv"
    path.write_text("time,x\n0,0\n1,0.01\n")
    needs: dict[str, Any] = {
        "trajectory": {"file": path},
        "following": {"points": ((0.0,), (0.01,))},
    }
    assert operators.check(OPERATORS[kind](**needs.get(kind, {}))).violations == ()


@pytest.mark.parametrize("kind", sorted(CONTROLLERS))
def test_every_controller_keeps_its_promises(kind: str) -> None:
    assert controllers.check(CONTROLLERS[kind]()).violations == ()


# Each promise can be broken


@pytest.fixture
def check_law(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Report]:
    def check(**changed: Any) -> Report:
        monkeypatch.setitem(LAWS, "broken", replace(NONE, **changed))
        return laws.check("broken", samples=50)

    return check


def test_a_law_without_a_summary_or_with_an_error_is_found(
    check_law: Callable[..., Report],
) -> None:
    assert not check_law(summary="").held["summary"]

    def fails(state: float, sample: Any, device: Any) -> tuple[float, float, float]:
        return sample.nothing, 0.0, 0.0

    assert not check_law(limit=fails).held["answers"]


class LateMotor(SimulatedMotor):
    """A motor whose guard looks, or drops a force, too late."""

    leaving_ns = 0  # a look has seen something: when the force is gone

    def __init__(self, model: Any, *arguments: Any) -> None:
        super().__init__(model, *arguments)
        self._odd = model
        if model.true_period is not None:
            self._guard_ns = round(1e9 * model.true_period)

    def _hold_of(self, share: float) -> int:
        return super()._hold_of(share) + getattr(self, "_odd", Odd()).look_late

    def change(self, reading: Vector) -> bool:
        seen = self._has_moved_back(reading) and self.next_ns == self._drop_ns
        if self._odd.drop_late and seen and self.leaving_ns != self.next_ns:
            self._drop_ns = self.leaving_ns = self.next_ns + self._odd.drop_late
            self._plan()
            return False
        return super().change(reading)


class Held(SimulatedDevice):
    """A device that holds what the test wants."""

    def __init__(self, model: "Odd") -> None:
        super().__init__(model, None, 1.25e-3)
        self._odd = model
        self._motor = LateMotor(model, model.true_numbers(), 1.25e-3, (0.0,))

    def set_hold_limit(self, seconds: float) -> Any:
        limit = super().set_hold_limit(seconds)
        return limit if self._odd.says_limit else 0.0

    def read(self, time_ns: int) -> Any:
        return self._odd.reading if self._odd.reading is not None else super().read(time_ns)

    def write(self, time_ns: int, force: Any) -> Any:
        return tuple(self._odd.gain * f for f in super().write(time_ns, force))

    def close(self) -> None:
        if self._odd.fails_to_close:
            raise OSError("busy")


@dataclass(frozen=True, kw_only=True)
class Odd(PhantomPremium15):
    reading: Any = None
    gain: float = 1.0
    fails_to_close: bool = False
    port: str = "here"
    opens_anything: bool = False
    locked_after: int = 2  # openings
    look_late: int = 0  # ns
    drop_late: int = 0  # ns
    says_limit: bool = True
    true_period: float | None = None  # s, between two looks

    def open(self, operator: Operator | None, hold_limit: float) -> Held:
        if self.port != "here" and not self.opens_anything:
            raise DeviceError(f"there is no port {self.port}")
        if next(openings) >= self.locked_after:
            raise DeviceError("in use")
        return Held(self)


def test_a_law_that_was_replaced_and_put_back_ships_again() -> None:
    shipped = LAWS["certified"]
    LAWS["certified"] = replace(shipped, is_certified=False)
    assert not LAWS.is_shipped("certified")
    LAWS["certified"] = shipped
    assert LAWS.is_shipped("certified")


@pytest.mark.parametrize(
    ("changed", "promise"),
    [
        ({"reading": (0.0, 0.0)}, "shape"),
        ({"reading": (float("inf"),)}, "shape"),
        ({"gain": 2.0}, "bounded"),
        ({"fails_to_close": True}, "opens"),
        ({"locked_after": 1}, "reopens"),
        ({"opens_anything": True, "locked_after": 3}, "port"),
        ({"says_limit": False}, "set_hold_limit"),
        ({"look_late": 5_000}, "guard"),
        ({"drop_late": 5_000}, "guard"),
        ({"guard_period": 30e-6, "true_period": 50e-6}, "guard"),
    ],
)
def test_what_a_device_breaks_is_found(
    changed: dict[str, Any], promise: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"{__name__}.openings", count())
    assert not devices.check(Odd(**changed)).held[promise]


@dataclass(frozen=True)
class OddHand(Operator):
    mass: float = 0.1
    stiffness: float = 100.0
    damping: float = 1.0
    step: float = 0.0
    counts: bool = False

    def target(self, elapsed: float) -> Any:
        if self.counts:
            return (1e-9 * next(ticks),)
        return (self.step if elapsed > 0.5 else 0.0,)


@pytest.mark.parametrize(
    ("changed", "promise"),
    [({"mass": -1.0}, "passive"), ({"step": 0.1}, "even"), ({"counts": True}, "pure")],
)
def test_what_an_operator_breaks_is_found(changed: dict[str, Any], promise: str) -> None:
    assert not operators.check(OddHand(**changed), seconds=1.0).held[promise]


@dataclass(frozen=True)
class OddController(DirectController):
    answer: Any = None
    counts: bool = False

    def open(self, axes: int) -> "OddController":
        return self

    def on_state(self, state: Any, time_ns: int) -> Any:
        return (float(next(ticks)),) * len(state.position) if self.counts else self.answer


@pytest.mark.parametrize(
    ("changed", "promise"),
    [
        ({"answer": (1.0, 2.0)}, "shape"),
        ({"answer": (float("nan"),)}, "finite"),
        ({"counts": True}, "pure"),
    ],
)
def test_what_a_controller_breaks_is_found(changed: dict[str, Any], promise: str) -> None:
    assert not controllers.check(OddController(**changed), axes=(1,)).held[promise]


@dataclass(frozen=True)
class FailingController(DirectController):
    def on_state(self, state: Any, time_ns: int) -> Any:
        raise RuntimeError("no state")


def test_no_promise_about_answers_is_called_kept_by_a_controller_that_gives_none() -> None:
    held = controllers.check(FailingController(), axes=(1,)).held
    assert held["opens"]
    assert not held["answers"]
    assert not {"shape", "finite", "pure"} & held.keys()


# The commands


def invoke(*words: str) -> Any:
    return CliRunner().invoke(main, ["check", *words], catch_exceptions=False)


def test_the_command_names_a_broken_promise_and_ends_with_1(tmp_path: Path) -> None:
    file = tmp_path / "my_hand.py"
    file.write_text(
        "from dataclasses import dataclass\n\nfrom forcebound.haptics.hands import Operator\n\n\n"
        "@dataclass(frozen=True)\nclass Jump(Operator):\n"
        "    mass: float = -1.0\n    stiffness: float = 1.0\n    damping: float = 1.0\n\n"
        "    def target(self, elapsed: float) -> tuple[float, ...]:\n        return (0.0,)\n"
    )
    result = invoke("operator", str(file))
    assert result.exit_code == 1
    assert "BROKEN  passive" in result.output
    assert "expected >= 0 kg" in result.output


def test_what_there_is_not_ends_with_2() -> None:
    result = invoke("law", "certfied")
    assert result.exit_code == 2
    assert "did you mean 'certified'?" in result.stderr
