"""Orientation and buttons: from a device that senses them to the environment's query."""

import math
from dataclasses import dataclass
from typing import Any

import pytest
from builders import MS
from fakes import DISSIPATION
from msgspec import UNSET

from forcebound.errors import DeviceError
from forcebound.graph.servo import ServoSettings
from forcebound.haptics.controllers.direct import DirectController
from forcebound.haptics.devices.contract import check
from forcebound.haptics.devices.guard import GuardedDevice
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.devices.simulated import SimulatedDevice
from forcebound.haptics.hands import Operator
from forcebound.haptics.hands.hands import PressingHand
from forcebound.messages.codec import encode
from forcebound.messages.packets import DeviceState, EnvironmentQuery
from forcebound.nodes.controller import ControllerNode
from forcebound.nodes.device import DeviceNode
from forcebound.testing import Handle, OpenHandle

TURNED = (math.sqrt(0.5), 0.0, 0.0, -math.sqrt(0.5))


class Stylus(OpenHandle):
    """A device that senses how it is held."""

    def __init__(self, orientation: Any = TURNED, buttons: Any = 0b101) -> None:
        super().__init__(Handle(axes=3))
        self.sensed = orientation, buttons

    def orientation(self) -> Any:
        return self.sensed[0]

    def buttons(self) -> Any:
        return self.sensed[1]


def first_state(device: Any) -> DeviceState:
    node = DeviceNode(device, DISSIPATION, ServoSettings(law="none", engage_time=0.0))
    (state,) = node.step(0, [])
    assert isinstance(state, DeviceState)
    return state


def test_a_state_tells_what_the_device_senses_and_the_query_passes_it_on() -> None:
    state = first_state(Stylus())
    assert (state.orientation, state.buttons) == (TURNED, 0b101)
    (query,) = ControllerNode(DirectController()).step(MS, [state])
    assert isinstance(query, EnvironmentQuery)
    assert (query.orientation, query.buttons) == (TURNED, 0b101)


def test_a_force_sensor_is_read_with_the_position_and_the_query_passes_it_on() -> None:
    grip = PressingHand(mass=0.2, stiffness=300.0, damping=5.0, start=0.01, end=0.02)
    device = PhantomPremium15(force_sensor=True).open(grip, 1e-3)
    device.read(0)
    device.engage(0)
    device.read(30 * MS)
    (felt,) = list(device.measured_force() or ())
    assert felt == device.truth().hand_force[0]
    assert felt > 0.1  # it pushes on, into the environment
    node = DeviceNode(device, DISSIPATION, ServoSettings(law="none", engage_time=0.0))
    (state,) = node.step(30 * MS, [])
    assert isinstance(state, DeviceState)
    (query,) = ControllerNode(DirectController()).step(31 * MS, [state])
    assert isinstance(query, EnvironmentQuery)
    assert query.measured_force == state.measured_force == (felt,)


def test_without_a_force_sensor_packets_are_as_long_as_without_the_field() -> None:
    device = PhantomPremium15().open(None, 1e-3)
    assert device.measured_force() is None
    state = first_state(device)
    assert state.measured_force is UNSET
    assert b"measured_force" not in encode(state)


def test_a_guarded_device_tells_them_as_plain_numbers() -> None:
    state = first_state(GuardedDevice(Stylus(orientation=[0, 1, 0, 0], buttons=True)))
    assert (state.orientation, state.buttons) == ((0.0, 1.0, 0.0, 0.0), 1)
    assert type(state.buttons) is int
    neither = first_state(GuardedDevice(OpenHandle(Handle())))
    assert (neither.orientation, neither.buttons) == (None, None)


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"orientation": (1.0, 0.0, 0.0)}, "orientation"),
    ({"orientation": (math.nan, 0.0, 0.0, 0.0)}, "4 numbers of length 1"),
    ({"buttons": -1}, "a bit for each button"),
    ({"buttons": 2**63}, "a bit for each button"),
    ({"buttons": "left"}, "buttons"),
]


@pytest.mark.parametrize(("sensed", "said"), WRONG)
def test_what_no_device_can_sense_is_a_device_error(sensed: dict[str, Any], said: str) -> None:
    with pytest.raises(DeviceError, match=said):
        first_state(GuardedDevice(Stylus(**sensed)))


@dataclass(frozen=True, kw_only=True)
class SensingPhantom(PhantomPremium15):
    """A simulated device with a stylus."""

    told_orientation: Any = TURNED
    told_buttons: Any = 0

    def open(self, operator: Operator | None, hold_limit: float) -> SimulatedDevice:
        return SensingDevice(self, operator, hold_limit)


class SensingDevice(SimulatedDevice):
    def __init__(self, model: SensingPhantom, operator: Operator | None, hold_limit: float) -> None:
        super().__init__(model, operator, hold_limit)
        self.model = model

    def orientation(self) -> Any:
        return self.model.told_orientation

    def buttons(self) -> Any:
        return self.model.told_buttons


def test_the_contract_asks_for_what_a_device_senses() -> None:
    kept = check(SensingPhantom(), ticks=5)
    assert kept.violations == ()
    assert {"orientation", "buttons"} <= kept.held.keys()
    assert not {"orientation", "buttons"} & check(PhantomPremium15(), ticks=5).held.keys()
    for sensed, _ in WRONG:
        ((name, value),) = sensed.items()
        assert not check(SensingPhantom(**{f"told_{name}": value}), ticks=5).held[name]
