"""Force feedback over a network, without ROS, that provably stays passive.

::

    import forcebound as fb

    run = fb.simulate("stiff_wall", law="certified", delay="2 ms")
    run.figures.displayed_stiffness      # N/m, a float with .unit and .label
    run.telemetry["position"]            # numpy, one row a tick

The commands of the shell and these functions share one implementation. Nothing is imported before
it is used, so ``import forcebound`` costs next to nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from forcebound import errors

if TYPE_CHECKING:
    from forcebound.graph.graph import EnvironmentConfig as World
    from forcebound.graph.graph import GraphConfig as Graph
    from forcebound.graph.graph import HandConfig as Hand
    from forcebound.graph.graph import Phase
    from forcebound.graph.servo import ServoSettings as Servo
    from forcebound.haptics.laws import LAWS as laws
    from forcebound.haptics.parts import Table
    from forcebound.interface.figures import Figures, Quantity
    from forcebound.interface.laws import bound
    from forcebound.interface.live import Running, launch
    from forcebound.interface.runs import Run, plot, read, simulate
    from forcebound.lab.sweeps import Runs, geomspace, linspace, sweep
    from forcebound.network.impairment import Impairment as Link
    from forcebound.network.presets import named_link
    from forcebound.results.samples import Samples

    # Each class has keys of its kind.
    controllers: Table[type[Any]]
    devices: Table[type[Any]]
    environments: Table[type[Any]]
    operators: Table[type[Any]]

__all__ = [
    "Figures",
    "Graph",
    "Hand",
    "Link",
    "Phase",
    "Quantity",
    "Run",
    "Running",
    "Runs",
    "Samples",
    "Servo",
    "World",
    "bound",
    "controllers",
    "devices",
    "environments",
    "errors",
    "geomspace",
    "launch",
    "laws",
    "linspace",
    "named_link",
    "operators",
    "plot",
    "read",
    "simulate",
    "sweep",
]

#: Where each public name is defined, and the name that it has there.
_PLACES = {
    "controllers": "haptics.controllers:CONTROLLERS",
    "devices": "haptics.devices:DEVICES",
    "environments": "haptics.environments:ENVIRONMENTS",
    "operators": "haptics.hands:OPERATORS",
    "laws": "haptics.laws:LAWS",
    "Figures": "interface.figures",
    "Quantity": "interface.figures",
    "bound": "interface.laws",
    "Graph": "graph.graph:GraphConfig",
    "Hand": "graph.graph:HandConfig",
    "Phase": "graph.graph",
    "World": "graph.graph:EnvironmentConfig",
    "Servo": "graph.servo:ServoSettings",
    "Link": "network.impairment:Impairment",
    "named_link": "network.presets",
    "Samples": "results.samples",
    "Running": "interface.live",
    "launch": "interface.live",
    "Run": "interface.runs",
    "plot": "interface.runs",
    "read": "interface.runs",
    "simulate": "interface.runs",
    "Runs": "lab.sweeps",
    "geomspace": "lab.sweeps",
    "linspace": "lab.sweeps",
    "sweep": "lab.sweeps",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'forcebound' has no attribute {name!r}")
    module, _, there = _PLACES[name].partition(":")
    value = getattr(import_module(f"forcebound.{module}"), there or name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__]
