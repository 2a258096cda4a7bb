import abc
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import draccus

from lerobot import Device
from lerobot import make as make_robot_from_config

__all__ = ["Robot", "RobotConfig", "make_robot_from_config"]


@dataclass(kw_only=True)
class RobotConfig(draccus.ChoiceRegistry, abc.ABC):
    id: str | None = None
    calibration_dir: Path | None = None


class Robot(Device):
    def __init__(self, config: Any) -> None:
        super().__init__(config)
        self.robot_type = self.name

    @property
    @abc.abstractmethod
    def observation_features(self) -> dict[str, Any]: ...

    @abc.abstractmethod
    def get_observation(self) -> dict[str, Any]: ...

    @abc.abstractmethod
    def send_action(self, action: dict[str, Any]) -> dict[str, Any]: ...
