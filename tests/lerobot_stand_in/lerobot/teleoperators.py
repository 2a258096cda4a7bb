import abc
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import draccus

from lerobot import Device
from lerobot import make as make_teleoperator_from_config

__all__ = ["Teleoperator", "TeleoperatorConfig", "make_teleoperator_from_config"]


@dataclass(kw_only=True)
class TeleoperatorConfig(draccus.ChoiceRegistry, abc.ABC):
    id: str | None = None
    calibration_dir: Path | None = None


class Teleoperator(Device):
    @property
    @abc.abstractmethod
    def feedback_features(self) -> dict[str, Any]: ...

    @abc.abstractmethod
    def get_action(self) -> dict[str, Any]: ...

    @abc.abstractmethod
    def send_feedback(self, feedback: dict[str, Any]) -> None: ...
