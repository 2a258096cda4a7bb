"""A teleoperator of lerobot: a leader arm that a graph of forcebound runs.

lerobot imports the modules of installed distributions that are named as this one is. It is one
distribution, so this module imports the robot, too.
"""

import logging
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import lerobot_robot_forcebound  # noqa: F401 (registers the robot)
from lerobot.teleoperators import Teleoperator, TeleoperatorConfig

import forcebound as fb
from forcebound.haptics.environments import check_hand
from forcebound.interface.live import UNTIL_ENDED, launch_unrecorded
from forcebound.messages.codec import decode
from forcebound.messages.packets import DeviceState
from forcebound.messages.topology import HAND, endpoint
from forcebound.network.sockets import Network
from forcebound.network.streams import Subscriber
from forcebound.observe.runs import Watch, find
from forcebound.observe.tuning import configuration
from forcebound.run.run_directory import graph_in
from forcebound_lerobot import Follower

DEVICE_STATE = "device_state"
LATE_NS = 20_000_000  # age of a position for which a newer one is waited for
FIRST = 5.0  # s to wait for the first position

_logger = logging.getLogger(__name__)


@TeleoperatorConfig.register_subclass("forcebound")
@dataclass(kw_only=True)
class ForceboundTeleoperatorConfig(TeleoperatorConfig):
    """Configuration of a leader arm.

    Attributes:
        launch: Launch file of the graph, which then runs as long as the session; none: the graph of
            ``run`` does already.
        arguments: Values of the file's arguments.
        record: Recording of the graph, ``.mcap``; its verdict is logged at the end.
        run: The running graph, by run directory or launch file; none: the only one.
        hand: Name of the hand that leads.
    """

    launch: str | None = None
    arguments: dict[str, str] = field(default_factory=dict)
    record: Path | None = None
    run: Path | None = None
    hand: str = HAND


class ForceboundTeleoperator(Teleoperator):
    """A leader arm whose positions are actions, and whose hand feels the robot ``forcebound``."""

    config_class = ForceboundTeleoperatorConfig
    name = "forcebound"

    def __init__(self, config: ForceboundTeleoperatorConfig) -> None:
        self._subscriber: Subscriber | None = None
        self._running: fb.Running | None = None
        super().__init__(config)
        self.config = config
        if config.launch is None:
            self._graph = configuration(find(config.run, require_graph=True, option="run"))
        else:
            graph = fb.Graph.read(config.launch, **config.arguments)
            self._graph = replace(graph, duration=UNTIL_ENDED)
        check_hand(config.hand, tuple(self._graph.hands), "hand")
        names = tuple(axis.name for axis in self._graph.hands[config.hand].named_axes)
        world = self._graph.environment.model
        self._follower = world if isinstance(world, Follower) else Follower(joints=names)

    @property
    def action_features(self) -> dict[str, type]:
        """A number for each joint, as the robot's ``.pos``."""
        return {f"{joint}.pos": float for joint in self._follower.joints}

    @property
    def feedback_features(self) -> dict[str, type]:
        """None: force comes from the robot ``forcebound``, and no position moves the leader."""
        return {}

    @property
    def is_connected(self) -> bool:
        """Whether the positions of the leader are received."""
        return self._subscriber is not None

    def connect(self, calibrate: bool = True) -> None:
        """Start the graph, if that is this program's, and wait for the first position.

        Raises:
            ConfigError: If the graph cannot start, or none runs.
            RunError: If a process of it did not become ready.
            ConnectionError: If no position comes.
        """
        config = self.config
        if config.launch is None:
            self._run_dir = find(config.run, require_graph=True, option="run")
        else:
            graph, record = self._graph, config.record
            running = fb.launch(graph, record=record) if record else launch_unrecorded(graph)
            self._running, self._run_dir = running, running.run_dir
        self._watch = Watch(self._run_dir)
        streams = graph_in(self._run_dir).of(config.hand).streams
        [stream] = [one for one in streams if one.topic == DEVICE_STATE]
        self._network = Network(linger_ms=0)
        self._subscriber = self._network.subscriber(endpoint(self._run_dir, stream))
        self._state: DeviceState | None = None
        end = time.monotonic() + FIRST
        while self._newest(self._subscriber) is None:
            if time.monotonic() > end:
                self.disconnect()
                raise ConnectionError(f"the leader has sent no position for {FIRST:g} s")

    @property
    def is_calibrated(self) -> bool:
        """True: the launch file has the zero of each joint."""
        return True

    def calibrate(self) -> None:
        """Do nothing: see :attr:`is_calibrated`."""

    def configure(self) -> None:
        """Do nothing: the launch file has all there is."""

    def get_action(self) -> dict[str, float]:
        """Return the newest positions of the leader; those of before while it is silent.

        Raises:
            ConnectionError: If it is not connected, or the graph has ended.
        """
        state = None if self._subscriber is None else self._newest(self._subscriber)
        if state is None:
            raise ConnectionError("the leader is not connected")
        return self._follower.action(state.position)

    def _newest(self, subscriber: Subscriber) -> DeviceState | None:
        """Return the newest state; wait for one, 10 ms at most, if it is late."""
        if data := subscriber.receive():
            self._take(data[-1])
        if self._state is None or time.monotonic_ns() - self._state.time_ns > LATE_NS:
            # A queue that was full has the oldest; now that it is empty, the next one is new.
            if one := subscriber.wait():
                self._take(one)
            elif self._watch.is_over:
                raise ConnectionError("the graph of the leader has ended")
        return self._state

    def _take(self, data: bytes) -> None:
        packet = decode(data, DeviceState)
        if isinstance(packet, DeviceState):
            self._state = packet

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Ignore it: a position is no force, and a force comes by the robot ``forcebound``."""
        if not self._has_warned:
            self._has_warned = True
            _logger.warning(
                "send_feedback: ignored, as %s is no force; --robot.type=forcebound sends one",
                ", ".join(feedback),
            )

    _has_warned = False

    def disconnect(self) -> None:
        """Close the link; end the graph if that is this program's, with zero force first."""
        if self._subscriber is not None:
            self._subscriber = None
            self._network.close()
        if self._running is not None:
            running, self._running = self._running, None
            running.close()
            if self.config.record is not None:
                _logger.info("%s", running.run)
