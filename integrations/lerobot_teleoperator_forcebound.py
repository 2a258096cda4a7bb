"""A teleoperator of lerobot: a leader arm that a running graph of forcebound moves.

lerobot imports the modules of installed distributions that are named as this one is. It is one
distribution, so this module imports the robot, too.
"""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import lerobot_robot_forcebound  # noqa: F401 (registers the robot)
from lerobot.teleoperators import Teleoperator, TeleoperatorConfig

from forcebound.haptics.environments import check_hand
from forcebound.messages.codec import decode
from forcebound.messages.packets import DeviceState
from forcebound.messages.topology import HAND, endpoint, node_name
from forcebound.network.limits import QUEUE_LIMIT
from forcebound.network.sockets import Network
from forcebound.observe.runs import Watch, find
from forcebound.observe.tuning import configuration
from forcebound.run.run_directory import graph_in
from forcebound_lerobot import Follower


@TeleoperatorConfig.register_subclass("forcebound")
@dataclass(kw_only=True)
class ForceboundTeleoperatorConfig(TeleoperatorConfig):
    """Configuration of a leader arm.

    Attributes:
        run: The graph, by run directory or launch file; none: the only one that runs.
        hand: Name of the hand that leads.
    """

    run: Path | None = None
    hand: str = HAND


class ForceboundTeleoperator(Teleoperator):
    """A leader arm whose positions are actions, and whose hand feels the robot ``forcebound``.

    Raises:
        ConfigError: If no graph runs, several do and none is named, or it has no such hand.
    """

    config_class = ForceboundTeleoperatorConfig
    name = "forcebound"

    def __init__(self, config: ForceboundTeleoperatorConfig) -> None:
        self._network: Network | None = None
        super().__init__(config)
        self._run_dir = find(config.run, require_graph=True, option="--teleop.run=GRAPH")
        graph = configuration(self._run_dir)
        check_hand(config.hand, tuple(graph.hands), "hand")
        names = tuple(axis.name for axis in graph.hands[config.hand].named_axes)
        world = graph.environment.model
        self._follower = world if isinstance(world, Follower) else Follower(joints=names)
        [stream] = graph_in(self._run_dir).named(node_name(config.hand, "device_state"))
        self._endpoint = endpoint(self._run_dir, stream)

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
        return self._network is not None

    def connect(self, calibrate: bool = True) -> None:
        """Receive the positions of the leader.

        Raises:
            ConnectionError: If none comes.
        """
        self._network, self._watch = Network(linger_ms=0), Watch(self._run_dir)
        self._subscriber = self._network.subscriber(self._endpoint)
        self._state: DeviceState | None = None
        if not any(self._newest() for _ in range(500)):
            self.disconnect()
            raise ConnectionError("the leader sends no position")

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
        if self._network is None or (state := self._newest()) is None:
            raise ConnectionError("the leader is not connected")
        return self._follower.action(state.position)

    def _newest(self) -> DeviceState | None:
        """Return the newest state; wait for one, 10 ms at most, if there is none."""
        frames = self._subscriber.receive()
        # A queue that was full has the oldest; now that it is empty, the next one is new.
        if not 0 < len(frames) < QUEUE_LIMIT and (one := self._subscriber.wait()):
            frames.append(one)
        if frames:
            self._state = cast(DeviceState, decode(frames[-1], DeviceState))
        elif self._watch.is_over:
            raise ConnectionError("the graph of the leader has ended")
        return self._state

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Ignore it: a position is no force, and a force comes by the robot ``forcebound``."""
        warnings.warn(f"{', '.join(feedback)}: no force, so ignored", stacklevel=2)

    def disconnect(self) -> None:
        """Receive no more; the graph goes on."""
        if self._network is not None:
            self._network.close()
            self._network = None
