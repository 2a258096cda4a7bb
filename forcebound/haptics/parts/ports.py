"""The second port of a controller: its end in the process of the environment.

A method for a delayed network is a two-port: one end at the hand, which is the controller, and one
at the environment, beyond the delay. The queries carry the signals of the first end, the replies
those of the second one.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping
from typing import ClassVar, TypeAlias

from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import EnvironmentQuery, Vector

#: Asks the environment: position (m) and velocity (m/s) in, force (N) out, one entry per axis.
Ask: TypeAlias = Callable[[Vector, Vector], Vector]


class SecondPort(ABC):
    """The end of one hand's controller at the environment, with its state."""

    @abstractmethod
    def answer(self, query: EnvironmentQuery, ask: Ask) -> tuple[Vector, Mapping[str, float]]:
        """Return the force of the reply, in N, and the numbers that it carries.

        A query may be late, overtaken or doubled. ``ask`` may be called more than once: no time
        passes in between.
        """


class TwoPort:
    """What a model of a controller says about its second port.

    Attributes:
        port_signals: The numbers that the second port sends; none: it has no second port.
    """

    port_signals: ClassVar[Collection[Signal]] = ()

    def open_port(self, axes: int) -> SecondPort:
        """Return a new second port, for vectors of this many entries."""
        raise NotImplementedError
