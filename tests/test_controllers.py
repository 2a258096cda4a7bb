"""The promises that every controller keeps, and what the direct one does."""

import pytest

from forcebound.controllers import CONTROLLERS, Controller
from forcebound.controllers.direct import DirectController
from forcebound.messages.packets import DeviceState, EnvironmentReply


def state(seq: int, position: float, axes: int) -> DeviceState:
    place = (position,) * axes
    return DeviceState(seq, seq * 1_000_000, seq * 1e-3, place, place, (0.0,) * axes)


def reply(seq: int, force: float, axes: int) -> EnvironmentReply:
    return EnvironmentReply(seq, 0, seq, seq * 1_000_000, seq, 0, (force,) * axes, "e")


@pytest.mark.parametrize("axes", [1, 3])
@pytest.mark.parametrize("name", sorted(CONTROLLERS))
def test_the_same_calls_from_open_on_give_the_same_forces_and_queries(name: str, axes: int) -> None:
    runs = []
    for _ in range(2):
        controller = CONTROLLERS[name]().open(axes)
        answers = []
        for seq in range(50):
            now = state(seq, 0.001 * seq, axes)
            answers.append(controller.on_state(now, now.time_ns))
            position, velocity = controller.query(now)
            assert len(position) == len(velocity) == axes
            answers.append(controller.on_reply(reply(seq, 0.1 * seq, axes), now.time_ns + 1000))
        controller.close()
        assert all(force is None or len(force) == axes for force in answers)
        assert any(force is not None for force in answers)
        runs.append(answers)
    assert runs[0] == runs[1]


def test_the_direct_controller_asks_about_the_device_and_passes_the_force_on() -> None:
    controller: Controller = DirectController().open(2)
    assert controller.query(state(1, 0.01, 2)) == ((0.01, 0.01), (0.01, 0.01))
    assert controller.on_state(state(1, 0.01, 2), 0) is None
    assert controller.on_reply(reply(1, 3.0, 2), 0) == (3.0, 3.0)
