"""The promises that every controller keeps, and what the direct one does."""

import math
from typing import Any

import numpy as np
import pytest
from builders import reply, state
from msgspec.structs import replace

from forcebound.haptics.controllers import Controller
from forcebound.haptics.controllers.direct import DirectController
from forcebound.messages.codec import decode, encode
from forcebound.messages.packets import (
    DeviceState,
    EnvironmentQuery,
    EnvironmentReply,
    Event,
    ForceCommand,
    Vector,
)
from forcebound.nodes.controller import ControllerNode


def test_the_direct_controller_asks_about_the_device_and_passes_the_force_on() -> None:
    controller: Controller = DirectController().open(2)
    now = state(1, 0.01, 0.02, velocity=0.03)
    assert controller.query(now) == ((0.01, 0.02), (0.03, 0.03))
    assert controller.on_state(now, 0) is None
    assert controller.on_reply(reply(1, 3.0, 4.0), 0) == (3.0, 4.0)


class Odd(DirectController):
    """Answers states itself, and fails at every second reply."""

    def __init__(self) -> None:
        self.replies = 0
        self.closed = 0

    def on_state(self, state: DeviceState, time_ns: int) -> Any:
        return (np.float32(0.5),) * len(state.position)

    def on_reply(self, reply: EnvironmentReply, time_ns: int) -> Any:
        self.replies += 1
        return reply.force if self.replies % 2 else 1 / 0

    def close(self) -> None:
        self.closed += 1
        raise OSError("busy")


def test_a_force_for_a_state_is_commanded_at_once_with_the_echo_of_that_state() -> None:
    node = ControllerNode(Odd())
    command, query = node.step(5, [state(7, 0.01, 0.01)])
    assert decode(encode(command), ForceCommand) == ForceCommand(0, 5, 7, 7_000_000, (0.5, 0.5))
    assert isinstance(query, EnvironmentQuery)


def test_a_controller_that_fails_is_counted_and_commands_nothing() -> None:
    node = ControllerNode(Odd())
    packets = [node.step(k, [reply(k, 1.0)]) for k in range(1, 5)]
    commands = [[p for p in sent if isinstance(p, ForceCommand)] for sent in packets]
    assert [len(sent) for sent in commands] == [1, 0, 1, 0]
    assert node.status().failures == 2
    events = [p.event for sent in packets for p in sent if isinstance(p, Event)]
    assert events == ["environment_serves", "controller_failed"]


def test_a_controller_is_closed_once_and_may_fail_in_it() -> None:
    controller = Odd()
    ControllerNode(controller).close()
    assert controller.closed == 1


class Remembering(DirectController):
    """A controller that keeps all replies."""

    def __init__(self) -> None:
        self.replies: list[EnvironmentReply] = []

    def on_reply(self, reply: EnvironmentReply, time_ns: int) -> Vector:
        self.replies.append(reply)
        return reply.force


@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_no_controller_hears_of_a_number_that_is_not_finite(number: float) -> None:
    controller = Remembering()
    node = ControllerNode(controller)
    sound = EnvironmentReply(0, 0, 0, 0, 0, 0, (1.0,), "e", (0.01,), (-1.0,))
    for changed in ("force", "proxy", "normal"):
        *_, command = node.step(1, [replace(sound, **{changed: (number,)})])
        assert isinstance(command, ForceCommand)  # which the device rejects if it has to
        assert repr(command.force) == repr((number,) if changed == "force" else (1.0,))
    assert controller.replies == [replace(sound, proxy=None, normal=None)] * 2
    assert node.status().rejected == {"not_finite": 2}
