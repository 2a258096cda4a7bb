"""Trial of a launch file: some ticks in virtual time, so that `correct` means that it starts."""

import math
from dataclasses import replace

import numpy as np

from forcebound.config.graph import KINDS, GraphConfig
from forcebound.config.resolved import kind_of
from forcebound.errors import ConfigError, DeviceError, RunError
from forcebound.launch.virtual import run_virtual

TICKS = 20


def try_ticks(config: GraphConfig) -> None:
    """Run the first ticks of a graph in virtual time.

    A graph with parts of the user's own is passed over: the loader has asked them for an answer in
    its sandbox, and their device may be hardware. So is one with a device at a port.

    Raises:
        ConfigError: If it does not start, or its numbers leave the range of floats.
    """
    parts = {
        "device": config.device.model,
        "operator": config.operator,
        "controller": config.controller,
        "environment": config.environment.model,
    }
    if getattr(config.device.model, "simulated_in", None) is not None:
        return
    kinds = {name: kind_of(name, part) for name, part in parts.items() if part is not None}
    if not all(KINDS[name].is_shipped(kind) for name, kind in kinds.items()):
        return
    some_ticks = (TICKS + 1.0) / config.device.servo.rate
    try:
        with np.errstate(all="ignore"):
            result = run_virtual(replace(config, phases=()), min(config.duration, some_ticks))
    except (RunError, DeviceError, ArithmeticError) as error:
        raise ConfigError(f"the graph does not start: {error}") from error
    columns = result.columns
    for name in ("position", "applied_force", "estimated_energy"):
        if not math.isfinite(float(np.sum(getattr(columns, name)))):
            raise ConfigError(
                f"after {TICKS} ticks in virtual time the {name.replace('_', ' ')} is no number:"
                " the numbers of device, operator and environment do not go together"
            )
