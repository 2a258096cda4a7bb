"""The base classes of lerobot that the plug-ins derive from, without torch and draccus."""

import abc
import sys
from typing import Any


class Device(abc.ABC):
    """What its Robot and its Teleoperator have in common."""

    config_class: type[Any]
    name: str

    def __init__(self, config: Any) -> None:
        self.id = config.id

    @property
    @abc.abstractmethod
    def action_features(self) -> dict[str, Any]: ...

    @property
    @abc.abstractmethod
    def is_connected(self) -> bool: ...

    @property
    @abc.abstractmethod
    def is_calibrated(self) -> bool: ...

    @abc.abstractmethod
    def connect(self, calibrate: bool = True) -> None: ...

    @abc.abstractmethod
    def calibrate(self) -> None: ...

    @abc.abstractmethod
    def configure(self) -> None: ...

    @abc.abstractmethod
    def disconnect(self) -> None: ...


def make(config: Any) -> Any:
    module = sys.modules[type(config).__module__]
    return getattr(module, type(config).__name__.removesuffix("Config"))(config)
