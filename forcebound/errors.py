"""Errors, by who has to act.

::

    ForceboundError
     +-- ConfigError (ValueError)   the launch file or a parameter is wrong: before start
     +-- PacketError (ValueError)   a peer sent bytes that are not the promised packet
     +-- DeviceError (OSError)      the device does not answer, or answers nonsense
     |    +-- GuardianError         no process guards the force of the device any more
     +-- RunError (RuntimeError)    a started graph could not be kept running
"""


class ForceboundError(Exception):
    """Base of every error that forcebound raises on purpose."""


class ConfigError(ForceboundError, ValueError):
    """A launch file, an argument or a parameter is wrong; raised before anything starts.

    Attributes:
        problem: What is wrong.
        action: What to do; empty if the problem says it.
        field: Name of the dataclass field that is wrong, if it is one.
    """

    def __init__(self, problem: str, action: str = "", field: str | None = None) -> None:
        super().__init__(f"{problem}: {action}" if action else problem)
        self.problem = problem
        self.action = action
        self.field = field


class PacketError(ForceboundError, ValueError):
    """Received bytes are not the promised packet.

    Attributes:
        reason: One word for counting: ``"malformed"``, ``"version"`` or ``"value"``.
    """

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason


class DeviceError(ForceboundError, OSError):
    """A device does not answer, or answers nonsense."""


class GuardianError(DeviceError):
    """The guardian of a force is gone or silent; the graph waits for its user, without force."""


class RunError(ForceboundError, RuntimeError):
    """A graph was started and could not be kept running."""
