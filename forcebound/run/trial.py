"""Trial of a launch file in virtual time, so that `correct` means that it starts."""

import math
from dataclasses import replace

import numpy as np

from forcebound.errors import ConfigError, DeviceError, ForceboundError, RunError
from forcebound.graph.graph import KINDS, GraphConfig
from forcebound.graph.resolved import kind_of
from forcebound.haptics.parts.user_module import describe_user_error
from forcebound.messages.events import CODE_FAILED
from forcebound.run.results import RunResult
from forcebound.run.virtual import run_virtual_hands

TICKS = 20


def try_start(config: GraphConfig) -> None:
    """Run the first ticks of a graph in virtual time; ConfigError if it does not start.

    A graph with a user's device, which may be hardware, or at a port is passed over.
    """
    for model in (hand.device for hand in config.hands.values()):
        is_shipped = KINDS["device"].is_shipped(kind_of("device", model))
        if model.simulated_in is not None or not is_shipped:
            return
    some_ticks = max((TICKS + 1.0) / hand.servo.rate for hand in config.hands.values())
    duration = min(config.duration, some_ticks)
    try:
        with np.errstate(all="ignore"):
            results = run_virtual_hands(replace(config, phases=()), duration)
    except (RunError, DeviceError, ArithmeticError) as error:
        raise ConfigError(f"the graph does not start: {error}") from error
    except ForceboundError:
        raise
    except Exception as error:
        raise ConfigError(f"the graph does not start: {describe_user_error(error)}") from error
    for result in results.values():
        _check_result(result)


def _check_result(result: RunResult) -> None:
    for event in result.events:
        if event.event in CODE_FAILED:
            raise ConfigError(f"in a trial of {TICKS} ticks {event.message}")
    columns = result.columns
    for name in ("position", "applied_force", "estimated_energy"):
        if not math.isfinite(float(np.sum(getattr(columns, name)))):
            raise ConfigError(
                f"after {TICKS} ticks in virtual time the {name.replace('_', ' ')} is no number:"
                " the numbers of device, operator and environment do not go together"
            )
