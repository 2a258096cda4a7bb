"""Trial of a launch file in virtual time, so that `correct` means that it starts."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from forcebound.config.graph import KINDS, GraphConfig
from forcebound.config.resolved import kind_of, restore, to_document
from forcebound.config.sandbox import LOADING, Progress, run_in_sandbox
from forcebound.errors import ConfigError, DeviceError, ForceboundError, RunError
from forcebound.launch.virtual import run_virtual
from forcebound.parts.user_module import describe_user_error, file_of, names_file

TICKS = 20
FAILURES = ("environment_failed", "controller_failed")  # events of code of the user's own


def try_start(config: GraphConfig) -> None:
    """Run the first ticks of a graph in virtual time; files of the user's own, in the sandbox.

    A graph with a device of the user's own is passed over, since that may be hardware. So is one
    with a device at a port.

    Raises:
        ConfigError: If it does not start, or its numbers leave the range of floats.
    """
    parts = {
        "device": config.device.model,
        "operator": config.operator,
        "controller": config.controller,
        "environment": config.environment.model,
    }
    if config.device.model.simulated_in is not None:
        return
    kinds = {name: kind_of(name, part) for name, part in parts.items() if part is not None}
    if not KINDS["device"].is_shipped(kinds["device"]):
        return
    law = config.device.servo.law
    files = [file_of(kind, Path()) for kind in (*kinds.values(), law) if names_file(kind)]
    if files:
        run_in_sandbox(try_document, [to_document(config)], files, limit=LOADING)
    else:
        _try(config)


def try_document(progress: Progress, document: Mapping[str, Any]) -> None:
    """Try the start of a resolved launch document here, whatever the user's code raises."""
    config = restore(document)
    progress("a trial in virtual time", 0, 0)
    try:
        _try(config)
    except ForceboundError:
        raise
    except Exception as error:
        raise ConfigError(f"the graph does not start: {describe_user_error(error)}") from error


def _try(config: GraphConfig) -> None:
    some_ticks = (TICKS + 1.0) / config.device.servo.rate
    try:
        with np.errstate(all="ignore"):
            result = run_virtual(replace(config, phases=()), min(config.duration, some_ticks))
    except (RunError, DeviceError, ArithmeticError) as error:
        raise ConfigError(f"the graph does not start: {error}") from error
    for event in result.events:
        if event.event in FAILURES:
            raise ConfigError(f"in a trial of {TICKS} ticks {event.message}")
    columns = result.columns
    for name in ("position", "applied_force", "estimated_energy"):
        if not math.isfinite(float(np.sum(getattr(columns, name)))):
            raise ConfigError(
                f"after {TICKS} ticks in virtual time the {name.replace('_', ' ')} is no number:"
                " the numbers of device, operator and environment do not go together"
            )
