"""Checks beyond the form of a launch file: what does not go together, and users' parts.

Each raises ConfigError, with the key of the section that is wrong where it is one.
"""

import logging
from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
from typing import Any, TypeAlias

from forcebound.axes import common_kind
from forcebound.errors import ConfigError
from forcebound.graph.forms import Values
from forcebound.graph.graph import (
    KINDS,
    EnvironmentConfig,
    GraphConfig,
    HandConfig,
    RemoteConfig,
)
from forcebound.graph.servo import ServoSettings, dissipation_of
from forcebound.haptics.devices import DeviceModel
from forcebound.haptics.devices.simulated import pad
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws import LAWS, ForceBounder
from forcebound.haptics.laws.constants import axis_constants
from forcebound.haptics.parts.contract import Findings
from forcebound.haptics.parts.user_module import kind_of, user_code
from forcebound.messages.packets import MAX_AXES
from forcebound.messages.topology import HANDS, TRANSFER
from forcebound.network.addresses import numeric_address
from forcebound.network.impairment import Impairment
from forcebound.recordings.delay_traces import shortest_of

FAR = 2.0  # m; no hand reaches so far
TRIED = 20  # times at which the target is evaluated
END_OF_APPROACH = 1e6  # s; the slowest approach is over

_logger = logging.getLogger(__name__)


#: Notes what is wrong with a section of a hand, or of the graph: ""; by hand, section and error.
Note: TypeAlias = Callable[[str, str, ConfigError], None]


def check_together(made: Values, note: Note, asks: bool = False) -> None:
    """Check sections that could be made; ``asks``: whether to call a user's parts once."""
    environment = made.get("environment")
    sound: dict[str, Values] = {}  # hands so far
    remotes: dict[str, RemoteConfig] = {}
    for name, sections in made[HANDS].items():
        check = partial(_check, note, name)
        if _check_hand(sections, environment, asks, check):
            check("device", _check_beside, name, sections["device"], sound)
            sound[name] = sections
        if sections.get("remote") is not None:
            check("remote", _check_meeting, name, sections["remote"], remotes)
            remotes[name] = sections["remote"]
    if len(sound) < len(made[HANDS]):
        return
    servos = {name: sections["servo"] for name, sections in sound.items()}
    for name in servos:
        _check(note, name, "device", check_energy_partner, name, servos)
    if environment is not None and sound:
        _check(note, "", "environment", environment.served.check_hands, tuple(sound))
        axes = next(iter(sound.values()))["device"].axes
        _check(note, "", "environment", environment.model.check_axes, axes)
        if asks:
            _check(note, "", "environment", _ask, "environment", environment.model, axes)


def _check(note: Note, hand: str, section: str, what: Callable[..., None], *arguments: Any) -> bool:
    """Note the ConfigError of a check of a section; return whether there was none."""
    try:
        what(*arguments)
    except ConfigError as error:
        note(hand, section, error)
        return False
    return True


def _check_hand(
    made: Values, environment: EnvironmentConfig | None, asks: bool, check: Callable[..., bool]
) -> bool:
    """Check the sections of one hand that could be made; return whether its device is sound."""
    device, controller, operator = map(made.get, ("device", "controller", "operator"))
    if device is None or not check("device", _check_device, device, made["servo"]):
        return False
    axes = device.axes
    if operator is not None:
        check("operator", _check_path, operator, device)
    check("links", _check_deadbands, made["links"])
    answers_states = controller is not None and controller.answers_states
    if environment is not None and not answers_states:
        check("device", _check_delays, made["servo"], environment, made["links"])
    if asks:
        check("device", _ask_law, device, made["servo"])
        if controller is not None:
            check("controller", _ask, "controller", controller, axes)
    return True


def _check_beside(hand: str, device: DeviceModel, before: Mapping[str, Values]) -> None:
    """Check the device of a hand beside those of the hands before it."""
    for name, sections in before.items():
        other: DeviceModel = sections["device"]
        if other.axes != device.axes:
            raise ConfigError(
                f"{hand} has {device.axes} axes, {name} {other.axes}: one environment answers"
                " both, so they need the same number",
                field="axes",
            )
        kinds = [[axis.kind for axis in each.named_axes] for each in (device, other)]
        if kinds[0] != kinds[1]:
            raise ConfigError(
                f"the axes of {hand} are {', '.join(kinds[0])}, those of {name}"
                f" {', '.join(kinds[1])}: one environment answers both, so they need the same kinds"
            )
        # Every device that is emulated has an emulator of its own.
        if device.port not in ("", "emulated") and device.port == other.port:
            raise ConfigError(f"{hand} and {name} are both at the port {device.port}", field="port")


def _check_meeting(hand: str, own: RemoteConfig, before: Mapping[str, RemoteConfig]) -> None:
    """Check that no hand before this one meets its environment at the same address and port."""
    for name, other in before.items():
        if (_host(own), own.port) == (_host(other), other.port):
            raise ConfigError(
                f"{hand} and {name} both use {own.address} port {own.port} for the environment:"
                " each hand needs a port of its own",
                field="address",
            )


def _host(remote: RemoteConfig) -> object:
    return numeric_address(remote.address) or remote.address


def _check_device(device: DeviceModel, servo: ServoSettings) -> None:
    """Check the number of axes, and that laws have what they rely on."""
    axes = device.axes
    if not isinstance(axes, int) or not 1 <= axes <= MAX_AXES:
        raise ConfigError(f"axes must be 1 to {MAX_AXES}, got {axes!r}")
    names = {axis.name for axis in device.named_axes}
    if not len(names) == len(device.named_axes) == axes:
        shown = ", ".join(axis.name for axis in device.named_axes)
        raise ConfigError(f"named_axes: expected {axes} axes of different names, got {shown}")
    if common_kind(device.named_axes) is None:
        _check_mixed(device)
    with user_code("the numbers of the device"):
        axis_constants(dissipation_of(device, servo), axes)


def _check_mixed(device: DeviceModel) -> None:
    """Check a device with lengths and angles: neither a speed nor a path is common to them."""
    for name in ("hand_speed", "largest_speed"):
        if getattr(device, name) is not None:
            message = f"{name}: expected null: lengths and angles have no common speed, so no proof"
            raise ConfigError(message, field=name)
    if device.friction and not isinstance(device.friction, tuple):
        message = "friction: lengths and angles have no common path; expected one for each axis"
        raise ConfigError(message, field="friction")


def _check_path(operator: Operator, device: DeviceModel) -> None:
    """Check that a device has the axes of an operator, and an arm reaches its start."""
    axes = device.axes
    with user_code("target(0.0)", "kind"):
        start = pad(target := operator.target(0.0), axes)
    if len(target) > axes:
        raise ConfigError(f"the operator's path has {len(target)} axes, the device only {axes}")
    with user_code("angles"):
        is_arm, angles = device.angles((0.0,) * axes) is not None, device.angles(start)
    limits = operator.joint_limits
    if is_arm and angles is None:
        where = ", ".join(f"{1e3 * x:.4g}" for x in start)
        raise ConfigError(f"start: the arm does not reach [{where}] mm", field="start")
    if not limits:
        return
    if angles is None or len(limits) != axes:
        expected = f"{axes} pairs of angles" if is_arm else "none: it has no tip"
        raise ConfigError(
            f"joint_limits: expected {expected}, got {len(limits)}", field="joint_limits"
        )
    for joint, (angle, (low, high)) in enumerate(zip(angles, limits, strict=True)):
        if not low <= angle <= high:
            words = f"joint {joint} begins at {angle:.4g} rad, outside [{low:g}, {high:g}] rad"
            raise ConfigError(f"joint_limits: {words}", field="joint_limits")


def _check_delays(
    servo: ServoSettings, environment: EnvironmentConfig, links: Mapping[str, Impairment]
) -> None:
    """Check that the loop is not so long that the device would refuse every answer."""
    parts = (environment.computation, *links.values())
    delays = sum(shortest_of(part) for part in parts)
    wait = servo.reply_wait / servo.rate  # the device takes an answer when it writes
    shortest = max(delays, wait)
    silence = sum(link.keep_alive for link in links.values() if link.deadband)
    if shortest + silence < servo.age_limit:
        return
    if shortest < servo.age_limit:
        raise ConfigError(
            f"an answer may be {(shortest + silence) * 1e3:g} ms old, since links with a deadband"
            f" are silent for up to {silence * 1e3:g} ms, and the device refuses answers older than"
            f" age_limit = {servo.age_limit * 1e3:g} ms: lower keep_alive of these links, or raise"
            " age_limit",
            field="age_limit",
        )
    what, remedy = "delays of the links and the environment", "lower the delays"
    if wait > delays:
        what, remedy = "reply_wait over rate", "raise the rate"
    raise ConfigError(
        f"an answer takes at least {shortest * 1e3:g} ms ({what}), and the device refuses answers"
        f" older than age_limit = {servo.age_limit * 1e3:g} ms, so there would never be a force:"
        f" set age_limit in device: above {shortest * 1e3:g} ms, or {remedy}",
        field="age_limit",
    )


def _check_deadbands(links: Mapping[str, Impairment]) -> None:
    if TRANSFER in links and links[TRANSFER].deadband:
        words = "deadband: an energy transfer has no force that is felt; leave it out here"
        raise ConfigError(words, field=f"{TRANSFER}.deadband")


def check_energy_partner(hand: str, hands: Mapping[str, ServoSettings]) -> None:
    """Raise ConfigError if the ``energy_partner`` of a hand cannot exchange energy with it."""
    servo = hands[hand]
    partner, others = servo.energy_partner, [name for name in hands if name != hand]
    if not partner:
        return
    if partner not in others:
        problem = f"expected another hand ({', '.join(others) or 'there is none'})"
    elif hands[partner].energy_partner != hand:
        problem = f"expected energy_partner: {hand} of {partner}, too: energy goes both ways"
    elif not LAWS[servo.law].exchanges:
        able = ", ".join(name for name in LAWS if LAWS[name].exchanges)
        problem = f"law {servo.law} cannot exchange energy: expected law: one of {able}, or"
        problem += ' energy_partner: "" of both hands'
    else:
        return
    raise ConfigError(f"energy_partner: {problem}, got {partner!r}", field="energy_partner")


def _ask_law(device: DeviceModel, servo: ServoSettings) -> None:
    """Call a user's law once."""
    if LAWS.is_shipped(servo.law):
        return
    with user_code("law", "law"):
        bounder = ForceBounder(servo.law, dissipation_of(device, servo), device.axes)
        bounder.bound(servo.period_ns, (0.0,) * device.axes, (1.0,) * device.axes)
        bounder.settle((0.0,) * device.axes)


def _ask(section: str, model: Any, axes: int) -> None:
    """Ask a user's environment or controller once for all that its contract promises."""
    if kind_of(type(model)) is None:
        return
    contract = import_module(f"forcebound.haptics.{section}s.contract")
    found = Findings()
    contract.ask_once(model, axes, found)
    for violation in found.report({}, 1).violations[:1]:
        words = f"{violation.where}: expected {violation.expected}; got {violation.got}"
        raise ConfigError(words, field="kind")


def warn(config: GraphConfig) -> None:
    """Log what is not wrong but worth knowing before a run."""
    for hand in config.hands.values():
        _warn_uncertified(hand)
        kind = KINDS["operator"].kind_of(type(hand.operator))
        if hand.operator is not None and kind is not None and KINDS["operator"].is_shipped(kind):
            _warn_far(hand.operator, config.duration)
        servo = hand.servo
        damping = dissipation_of(hand.device, servo).least_damping
        period = servo.period_ns * 1e-9
        with user_code("controller: cautions"):
            cautions = hand.controller.cautions(damping, period, servo.reply_wait * period)
        for caution in cautions:
            _logger.warning("controller: %s", caution)


def _warn_uncertified(hand: HandConfig) -> None:
    """Log which parts in the device's process, beside the bounder, do not ship with forcebound."""
    law = hand.servo.law
    uncertified = [] if LAWS.is_shipped(law) else [("law", law)]
    for section, part in (("device", hand.device), ("operator", hand.operator)):
        kind = KINDS[section].kind_of(type(part))
        if part is not None and (kind is None or not KINDS[section].is_shipped(kind)):
            uncertified.append((section, kind or type(part).__name__))
    if hand.device.own_code:
        uncertified.append(("device", hand.device.own_code))
    for section, kind in uncertified:
        _logger.warning(
            "%s %s is not certified by forcebound: it runs in the device's process, and the proof"
            " of passivity does not cover it",
            section,
            kind,
        )


def _warn_far(operator: Operator, duration: float) -> None:
    """Log a target so far away that its unit is missing: 14 for 14 mm."""
    times = [*(duration * share / TRIED for share in range(TRIED)), END_OF_APPROACH]
    far = max(abs(x) for time in times for x in operator.target(time))
    if far > FAR:
        _logger.warning("the operator's target goes as far as %g m: is a unit missing?", far)
