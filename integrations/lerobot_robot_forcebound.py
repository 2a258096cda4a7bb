"""A robot of lerobot: any follower, whose observations also reach the leader's graph as force."""

from dataclasses import dataclass
from typing import Any

import draccus
from lerobot.robots import Robot, RobotConfig, make_robot_from_config

from forcebound_lerobot import Observations


@RobotConfig.register_subclass("forcebound")
@dataclass(kw_only=True)
class ForceboundRobotConfig(RobotConfig):
    """Configuration of a follower that is felt.

    ``follower`` is a mapping, not a ``RobotConfig``: draccus makes the options of every robot for
    such a field, those of this one too, without end.

    Attributes:
        follower: The configuration of the robot, as below ``--robot``: its ``type`` and all else.
        link: That of the environment.
    """

    follower: dict[str, Any]
    link: str = "lerobot"


class ForceboundRobot(Robot):
    """The follower itself, for lerobot; what it observes is sent to the graph, too."""

    config_class = ForceboundRobotConfig
    name = "forcebound"

    def __init__(self, config: ForceboundRobotConfig) -> None:
        self.follower: Robot = make_robot_from_config(draccus.decode(RobotConfig, config.follower))
        self.name = self.follower.name  # data sets and policies are the follower's
        super().__init__(config)
        self._link = config.link

    @property
    def cameras(self) -> Any:
        """Those of the follower."""
        return getattr(self.follower, "cameras", {})

    @property
    def observation_features(self) -> dict[str, Any]:
        """Those of the follower."""
        return self.follower.observation_features

    @property
    def action_features(self) -> dict[str, Any]:
        """Those of the follower."""
        return self.follower.action_features

    @property
    def is_connected(self) -> bool:
        """Whether the follower is connected."""
        return self.follower.is_connected

    def connect(self, calibrate: bool = True) -> None:
        """Connect to the follower, and open the link."""
        self._observations = Observations(self._link)
        self.follower.connect(calibrate)

    @property
    def is_calibrated(self) -> bool:
        """Whether the follower is calibrated."""
        return self.follower.is_calibrated

    def calibrate(self) -> None:
        """Calibrate the follower."""
        self.follower.calibrate()

    def configure(self) -> None:
        """Configure the follower."""
        self.follower.configure()

    def get_observation(self) -> dict[str, Any]:
        """Return what the follower observes; its numbers are sent to the graph."""
        observation = self.follower.get_observation()
        self._observations.send(observation)
        return observation

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Send an action to the follower; return what it takes."""
        return self.follower.send_action(action)

    def disconnect(self) -> None:
        """Disconnect from the follower, and close the link: no force from now on."""
        self._observations.close()
        self.follower.disconnect()
