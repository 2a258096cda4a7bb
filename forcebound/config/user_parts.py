"""Parts of the user's own in a launch file: their files, and what is checked of them.

:mod:`forcebound.parts.user_module` loads a file, the tables of
:data:`forcebound.config.graph.KINDS` find the part in it.
"""

import json
import logging
import math
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from forcebound.bounding import LAWS, ForceBounder
from forcebound.config.fields import Section, check_fields
from forcebound.config.graph import KINDS, DeviceConfig, GraphConfig
from forcebound.config.resolved import member_document
from forcebound.config.tree import Value
from forcebound.controllers import ControllerModel
from forcebound.environments import EnvironmentModel, open_environment
from forcebound.errors import ConfigError
from forcebound.messages.codec import decode, encode
from forcebound.messages.packets import MAX_AXES, DeviceState, EnvironmentReply, Scene, Vector
from forcebound.nodes.servo import dissipation_of
from forcebound.operators import Operator
from forcebound.parts import Table
from forcebound.parts.contract import vector_fault
from forcebound.parts.user_module import describe_user_error, file_of, kind_of, names_file

FAR = 2.0  # m; no hand reaches so far
LOOKS = 20  # at a target, over the duration
AT_LAST = 1e6  # s; a slow approach has come to its end

_logger = logging.getLogger(__name__)


def user_files(root: Value) -> list[Path]:
    """Return the files of the user's own that a launch file names."""
    places = [(section, "kind") for section in KINDS] + [("device", "law")]
    found = []
    for name, key in places:
        section = root.entries.get(name)
        kind = None if section is None else section.entries.get(key)
        if kind is not None and names_file(kind.text):
            found.append(file_of(kind.text, _beside(kind)))
    return list(dict.fromkeys(found))


def _beside(value: Value) -> Path:
    """The folder that a relative path starts from: that of the file that says it."""
    return Path(value.place.name).parent if value.place.line else Path()


def find_class(section: Section, value: Value, table: Table[Any], taken: set[str]) -> type | None:
    """Return the class of a part that does not ship; None with a problem noted if there is none.

    Args:
        section: Of the launch file.
        value: The kind that it names.
        table: Of this section.
        taken: Names that already mean something in the section.
    """
    try:
        member: type = table[table.resolve(value.text, _beside(value))]
        check_fields(member, taken)
    except ConfigError as error:
        section.add(f"{section.name}: {error}", value)
        return None
    return member


def find_law(section: Section, value: Value) -> str | None:
    """Return the absolute kind of a law; None with a problem noted."""
    try:
        return LAWS.resolve(value.text, _beside(value))
    except ConfigError as error:
        section.add(f"law: {error}", value)
        return None


def can_be_written(made: object, section: Section) -> bool:
    """Return whether the parameters can be written into documents and recordings."""
    for name, value in member_document(section.name, made).items():
        try:
            json.dumps(value, allow_nan=False)
        except (TypeError, ValueError) as error:
            section.add_here(f"{section.name}: {name} cannot be written down: {error}")
            return False
    return True


def check_device(device: DeviceConfig, section: Section, asks: bool) -> bool:
    """Return whether device and law can be used; ``asks``: whether to call the law, once."""
    model, law = device.model, device.servo.law
    try:
        if not isinstance(model.axes, int) or not 1 <= model.axes <= MAX_AXES:
            raise ConfigError(f"axes must be 1 to {MAX_AXES}, got {model.axes!r}")
        dissipation = dissipation_of(model, device.servo)
    except (Exception, SystemExit) as error:
        section.add_here(f"device: {_words(error)}")
        return False
    if not asks or LAWS.is_shipped(law):
        return True
    try:
        bounder = ForceBounder(law, dissipation, model.axes)
        bounder.bound(device.servo.period_ns, (0.0,) * model.axes, (1.0,) * model.axes)
        bounder.settle((0.0,) * model.axes)
    except (Exception, SystemExit) as error:
        section.add(f"law: {_words(error)}", section.value.entries["law"])
        return False
    return True


def check_path(operator: Operator, axes: int, section: Section) -> None:
    """Note what is wrong with the path of an operator at its beginning."""
    with _noting(section, "target(0.0)"):
        wanted = len(operator.target(0.0))
        if wanted > axes:
            section.add_here(f"the operator's path has {wanted} axes, the device only {axes}")


def warn_far(config: GraphConfig) -> None:
    """Log a target so far away that its unit is missing: 14 for 14 mm."""
    kind = KINDS["operator"].kind_of(type(config.operator))
    if config.operator is None or kind is None or not KINDS["operator"].is_shipped(kind):
        return
    length = config.duration if math.isfinite(config.duration) else 0.0
    times = [*(length * share / LOOKS for share in range(LOOKS)), AT_LAST]
    far = max(abs(x) for time in times for x in config.operator.target(time))
    if far > FAR:
        _logger.warning("the operator's target goes as far as %g m: is a unit missing?", far)


def check_environment(model: EnvironmentModel, axes: int, section: Section) -> None:
    """Note what a user's environment does wrong at the first question: nobody has tried it yet."""
    if kind_of(type(model)) is None:
        return
    still = (0.0,) * axes
    with (
        _noting(section, f"force({still}, {still}, 0.0)"),
        closing(open_environment(model, axes)) as opened,
    ):
        _check_vector(opened.force("", still, still, 0.0), axes, "N")
        with _noting(section, "contact()"):
            touched = opened.contact("")
            if touched is not None:
                proxy, normal = touched
                _check_vector(proxy, axes, "m")
                _check_vector(normal, axes, "1")
        with _noting(section, "scene()"):
            objects = tuple(opened.scene() or ())
            decode(encode(Scene(0, 0, objects, None)), Scene)


def check_controller(model: ControllerModel, axes: int, section: Section) -> None:
    """Note what a user's controller does wrong at the first state and reply."""
    if kind_of(type(model)) is None:
        return
    zero = (0.0,) * axes
    state = DeviceState(0, 0, 0.0, zero, zero, zero)
    reply = EnvironmentReply(0, 0, 0, 0, 0, 0, zero, "environment")
    with _noting(section, "its first state and reply"), closing(model.open(axes)) as opened:
        forces = [opened.on_state(state, 0)]
        position, velocity = opened.query(state)
        forces.append(opened.on_reply(reply, 0))
        _check_vector(position, axes, "m")
        _check_vector(velocity, axes, "m/s")
        for force in forces:
            if force is not None:
                _check_vector(force, axes, "N")


def warn_cautions(config: GraphConfig) -> None:
    """Log what the controller has to say about its parameters on this device."""
    servo = config.device.servo
    damping = dissipation_of(config.device.model, servo).least_damping
    period = servo.period_ns * 1e-9
    try:
        cautions = config.controller.cautions(damping, period, servo.reply_wait * period)
    except Exception as error:
        raise ConfigError(f"controller: cautions: {describe_user_error(error)}") from error
    for caution in cautions:
        _logger.warning("controller: %s", caution)


def _check_vector(vector: Vector, axes: int, unit: str) -> None:
    fault = vector_fault(vector, axes, unit)
    if fault is not None:
        raise ConfigError(str(fault))


@contextmanager
def _noting(section: Section, what: str) -> Iterator[None]:
    """Note what is raised within at the part's kind."""
    try:
        yield
    except (Exception, SystemExit) as error:
        section.add(f"{section.name}: {what}: {_words(error)}", section.value.entries["kind"])


def _words(error: BaseException) -> str:
    return str(error) if isinstance(error, ConfigError) else describe_user_error(error)


def warn_uncertified(config: GraphConfig) -> None:
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
