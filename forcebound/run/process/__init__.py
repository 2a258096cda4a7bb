"""Live processes: the loop of a node, the loop of the recorder, their end and endpoints.

:mod:`~forcebound.run.process.runner` drives one node over ZeroMQ,
:mod:`~forcebound.run.process.recorder` records, :mod:`~forcebound.run.process.reader` receives
whole streams; :mod:`forcebound.messages.topology` says where the processes of a run meet.
"""

from forcebound.run.process.reader import Reader, Received
from forcebound.run.process.recorder import COMPLETE, FailSafeSink, record
from forcebound.run.process.runner import Runner, run
from forcebound.stop import SignalPipe, Stop

__all__ = [
    "COMPLETE",
    "FailSafeSink",
    "Reader",
    "Received",
    "Runner",
    "SignalPipe",
    "Stop",
    "record",
    "run",
]
