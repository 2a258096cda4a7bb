"""Controllers: what connects the device with the environment.

A controller is a frozen dataclass of its parameters (:class:`ControllerModel`) whose ``open``
returns the :class:`Controller` that the controller node calls: for each device state, first
``on_state``, then ``query``; for each reply of the environment, ``on_reply``. Each force that one
of them returns is commanded at once, as the answer to that state, or to the state that the reply
answers. The device takes no answer to an older state than the one it has taken.

The bounder at the device keeps every controller passive. A controller that answers states by itself
should let its force end when replies stay away: nobody else knows that the environment is gone.

To add a controller: copy ``direct.py`` to ``my_controller.py``, add one line to ``CONTROLLERS``;
``tests/test_part_contracts.py`` tests it with all the others, and launch files know it as
``controller: {kind: my_controller}``. Or name a custom file (docs/write-your-own.md).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import ClassVar, TypeAlias

from forcebound.haptics.parts import PartShape, Table
from forcebound.haptics.parts.signals import Publisher, Publishing, Signal
from forcebound.messages.packets import DeviceState, EnvironmentQuery, EnvironmentReply, Vector

#: Asks the environment: position (m) and velocity (m/s) in, force (N) out, one entry per axis.
Ask: TypeAlias = Callable[[Vector, Vector], Vector]


class Controller(Publisher, ABC):
    """An open controller, which may keep state; ``query`` alone has no default.

    The same calls, in the same order from ``open`` on, return the same forces.
    """

    @abstractmethod
    def query(self, state: DeviceState) -> tuple[Vector, Vector]:
        """Return the position, in m, and velocity, in m/s, to send to the environment."""

    def on_state(self, state: DeviceState, time_ns: int) -> Vector | None:
        """Return the force to command now, in N, one entry per axis; None: no command.

        Args:
            state: Of the device.
            time_ns: Now, on the clock of the controller's process, in ns.
        """
        return None

    def on_reply(self, reply: EnvironmentReply, time_ns: int) -> Vector | None:
        """Return the force to command now, in N, one entry per axis; None: no command.

        Args:
            reply: Of the environment; ``reply.force`` is a force on the device, in N.
            time_ns: As for :meth:`on_state`.
        """
        return None

    def close(self) -> None:
        """Release what ``open`` took; called once."""


class SecondPort(ABC):
    """The other end of a controller, beyond the network: in the environment's process.

    A method for a delayed network is a two-port. With a second port, the queries carry the signals
    of the controller; the second port stands between them and the environment.
    """

    @abstractmethod
    def answer(
        self, query: EnvironmentQuery, signals: Mapping[str, float], ask: Ask
    ) -> tuple[Vector, Mapping[str, float]]:
        """Return the force of the reply, in N, and the signals that it carries.

        Queries come in order, none twice; some are missing. ``ask`` may be called more than once:
        for the environment no time passes in between.
        """


class ControllerModel(Publishing, ABC):
    """Parameters of a kind of controller: a frozen dataclass.

    Attributes:
        answers_states: Whether ``on_state`` returns forces, so that an environment may be further
            away than the device's age limit.
        takes_contacts: Whether it uses the contact of a reply.
        port_signals: What its second port sends; empty: it has no second port.
    """

    answers_states: ClassVar[bool] = False
    takes_contacts: ClassVar[bool] = True
    port_signals: ClassVar[Collection[Signal]] = ()

    @abstractmethod
    def open(self, axes: int) -> Controller:
        """Return a new controller in its initial state, for vectors of this many entries."""

    def open_port(self, axes: int) -> SecondPort | None:
        """Return a new second port, for vectors of this many entries; None if the kind has none."""
        return None

    def cautions(self, damping: float, period: float, delay: float) -> Sequence[str]:
        """Return what to know about the parameters before a start, a sentence each; it is logged.

        Args:
            damping: Least damping of the device, in N s/m.
            period: Of its servo, in s.
            delay: From reading to writing, in s.
        """
        return ()


CONTROLLERS: Table[type[ControllerModel]] = Table(
    "controllers",
    {
        "direct": "forcebound.haptics.controllers.direct:DirectController",
        "local_model": "forcebound.haptics.controllers.local_model:LocalModel",
        "scaled": "forcebound.haptics.controllers.scaled:Scaled",
        "successive_stiffness": (
            "forcebound.haptics.controllers.successive_stiffness:SuccessiveStiffness"
        ),
        "tdpa_two_port": "forcebound.haptics.controllers.tdpa_two_port:TdpaTwoPort",
        "virtual_coupling": "forcebound.haptics.controllers.virtual_coupling:VirtualCoupling",
        "wave_variables": "forcebound.haptics.controllers.wave_variables:WaveVariables",
    },
    PartShape("forcebound.haptics.controllers:ControllerModel"),
)
