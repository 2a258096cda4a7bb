"""A follower whose first joint meets a wall at 10 of its units; a plug-in as anybody's is."""

from dataclasses import dataclass
from typing import Any

from lerobot.robots import Robot, RobotConfig

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
WALL = 10.0


@RobotConfig.register_subclass("wall")
@dataclass(kw_only=True)
class WallRobotConfig(RobotConfig): ...


class WallRobot(Robot):
    config_class = WallRobotConfig
    name = "wall"

    def __init__(self, config: WallRobotConfig) -> None:
        super().__init__(config)
        self.places = {f"{joint}.pos": 0.0 for joint in JOINTS}

    @property
    def observation_features(self) -> dict[str, Any]:
        return {**self.action_features, "front": (2, 2, 3)}

    @property
    def action_features(self) -> dict[str, Any]:
        return dict.fromkeys(self.places, float)

    @property
    def is_connected(self) -> bool:
        return True

    @property
    def is_calibrated(self) -> bool:
        return True

    def connect(self, calibrate: bool = True) -> None: ...

    def calibrate(self) -> None: ...

    def configure(self) -> None: ...

    def get_observation(self) -> dict[str, Any]:
        return {**self.places, "front": [[[0] * 3] * 2] * 2}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        for name, goal in action.items():
            self.places[name] += 0.5 * (goal - self.places[name])
        self.places["shoulder_pan.pos"] = min(self.places["shoulder_pan.pos"], WALL)
        return action

    def disconnect(self) -> None: ...
