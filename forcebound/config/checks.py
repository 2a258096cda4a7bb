"""Checks beyond the form of a launch file: what does not go together, and users' own parts.

Each raises ConfigError, with the key of the section that is wrong where it is one.
"""

import logging
import math
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager

from forcebound.bounding import LAWS, ForceBounder
from forcebound.config.graph import KINDS, DeviceConfig, EnvironmentConfig, GraphConfig
from forcebound.config.traces import shortest_of
from forcebound.controllers import ControllerModel
from forcebound.environments import EnvironmentModel, open_environment
from forcebound.errors import ConfigError
from forcebound.messages.codec import decode, encode
from forcebound.messages.packets import MAX_AXES, DeviceState, EnvironmentReply, Scene, Vector
from forcebound.network.impairment import Impairment
from forcebound.nodes.servo import ServoSettings, dissipation_of
from forcebound.operators import Operator
from forcebound.parts.contract import vector_fault
from forcebound.parts.user_module import describe_user_error, kind_of

FAR = 2.0  # m; no hand reaches so far
TRIED = 20  # times at which the target is evaluated
END_OF_APPROACH = 1e6  # s; the slowest approach is over

_logger = logging.getLogger(__name__)


def check_device(device: DeviceConfig) -> None:
    """Check the number of axes, and that laws have what they rely on."""
    axes = device.model.axes
    if not isinstance(axes, int) or not 1 <= axes <= MAX_AXES:
        raise ConfigError(f"axes must be 1 to {MAX_AXES}, got {axes!r}")
    with user_code("the numbers of the device"):
        dissipation_of(device.model, device.servo)


def check_law(device: DeviceConfig) -> None:
    """Call a user's law once."""
    law, model = device.servo.law, device.model
    if LAWS.is_shipped(law):
        return
    with user_code("law", "law"):
        bounder = ForceBounder(law, dissipation_of(model, device.servo), model.axes)
        bounder.bound(device.servo.period_ns, (0.0,) * model.axes, (1.0,) * model.axes)
        bounder.settle((0.0,) * model.axes)


def check_path(operator: Operator, axes: int) -> None:
    """Check that the path of an operator has no more axes than the device."""
    with user_code("target(0.0)", "kind"):
        found = len(operator.target(0.0))
    if found > axes:
        raise ConfigError(f"the operator's path has {found} axes, the device only {axes}")


def check_delays(
    servo: ServoSettings, environment: EnvironmentConfig, links: Mapping[str, Impairment]
) -> None:
    """Check that the loop is not so long that the device would refuse every answer."""
    parts = (environment.computation, *links.values())
    delays = sum(shortest_of(part) for part in parts)
    wait = servo.reply_wait / servo.rate  # the device takes an answer when it writes
    shortest = max(delays, wait)
    if shortest < servo.age_limit:
        return
    what, remedy = "delays of the links and the environment", "lower the delays"
    if wait > delays:
        what, remedy = "reply_wait over rate", "raise the rate"
    raise ConfigError(
        f"an answer takes at least {shortest * 1e3:g} ms ({what}), and the device refuses answers"
        f" older than age_limit = {servo.age_limit * 1e3:g} ms, so there would never be a force:"
        f" set age_limit in device: above {shortest * 1e3:g} ms, or {remedy}",
        field="age_limit",
    )


def check_environment(model: EnvironmentModel, axes: int) -> None:
    """Call a user's environment once, with all that it offers."""
    if kind_of(type(model)) is None:
        return
    still = (0.0,) * axes
    with user_code(f"open({axes})", "kind"):
        opened = open_environment(model, axes)
    with closing(opened):
        with user_code(f"force('', {still}, {still}, 0.0)", "kind"):
            _check_vector(opened.force("", still, still, 0.0), axes, "N")
        with user_code("contact()", "kind"):
            touched = opened.contact("")
            if touched is not None:
                proxy, normal = touched
                _check_vector(proxy, axes, "m")
                _check_vector(normal, axes, "1")
        with user_code("scene()", "kind"):
            objects = tuple(opened.scene() or ())
            decode(encode(Scene(0, 0, objects)), Scene)


def check_controller(model: ControllerModel, axes: int) -> None:
    """Give a user's controller its first state and reply."""
    if kind_of(type(model)) is None:
        return
    zero = (0.0,) * axes
    state = DeviceState(0, 0, 0.0, zero, zero, zero)
    reply = EnvironmentReply(0, 0, 0, 0, 0, 0, zero, "environment")
    with user_code("its first state and reply", "kind"), closing(model.open(axes)) as opened:
        forces = [opened.on_state(state, 0)]
        position, velocity = opened.query(state)
        forces.append(opened.on_reply(reply, 0))
        _check_vector(position, axes, "m")
        _check_vector(velocity, axes, "m/s")
        for force in forces:
            if force is not None:
                _check_vector(force, axes, "N")


def _check_vector(vector: Vector, axes: int, unit: str) -> None:
    fault = vector_fault(vector, axes, unit)
    if fault is not None:
        raise ConfigError(str(fault))


@contextmanager
def user_code(call: str, field: str | None = None) -> Iterator[None]:
    """Turn whatever code of a user raises into a ConfigError that names the call."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f"{call}: {error}", field=field) from error
    except (Exception, SystemExit) as error:
        raise ConfigError(f"{call}: {describe_user_error(error)}", field=field) from error


def warn(config: GraphConfig) -> None:
    """Log what is not wrong but worth knowing before a run."""
    _warn_uncertified(config)
    _warn_far(config)
    _warn_cautions(config)


def _warn_uncertified(config: GraphConfig) -> None:
    """Log which parts in the device's process, beside the bounder, do not ship with forcebound."""
    law, device = config.device.servo.law, config.device.model
    uncertified = [] if LAWS.is_shipped(law) else [("law", law)]
    for section, part in (("device", device), ("operator", config.operator)):
        kind = KINDS[section].kind_of(type(part))
        if part is not None and (kind is None or not KINDS[section].is_shipped(kind)):
            uncertified.append((section, kind or type(part).__name__))
    for section, kind in uncertified:
        _logger.warning(
            "%s %s is not certified by forcebound: it runs in the device's process, and the proof"
            " of passivity does not cover it",
            section,
            kind,
        )


def _warn_far(config: GraphConfig) -> None:
    """Log a target so far away that its unit is missing: 14 for 14 mm."""
    kind = KINDS["operator"].kind_of(type(config.operator))
    if config.operator is None or kind is None or not KINDS["operator"].is_shipped(kind):
        return
    length = config.duration if math.isfinite(config.duration) else 0.0
    times = [*(length * share / TRIED for share in range(TRIED)), END_OF_APPROACH]
    far = max(abs(x) for time in times for x in config.operator.target(time))
    if far > FAR:
        _logger.warning("the operator's target goes as far as %g m: is a unit missing?", far)


def _warn_cautions(config: GraphConfig) -> None:
    """Log the controller's cautions about its parameters on this device."""
    servo = config.device.servo
    damping = dissipation_of(config.device.model, servo).least_damping
    period = servo.period_ns * 1e-9
    with user_code("controller: cautions"):
        cautions = config.controller.cautions(damping, period, servo.reply_wait * period)
    for caution in cautions:
        _logger.warning("controller: %s", caution)
