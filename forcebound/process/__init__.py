"""Live processes: the loop of a node, the loop of the recorder, their end and endpoints.

:mod:`~forcebound.process.runner` drives one node over ZeroMQ, :mod:`~forcebound.process.recorder`
records, :mod:`~forcebound.process.reader` receives whole streams;
:mod:`forcebound.topology` says where the processes of a run meet.
"""

from forcebound.process.reader import Reader, Received
from forcebound.process.recorder import COMPLETE, FailSafeSink, Sink, record
from forcebound.process.runner import Runner, run
from forcebound.process.stop import SignalPipe, Stop

__all__ = [
    "COMPLETE",
    "FailSafeSink",
    "Reader",
    "Received",
    "Runner",
    "SignalPipe",
    "Sink",
    "Stop",
    "record",
    "run",
]
