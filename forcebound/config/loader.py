"""Launch files read into configurations, with every problem reported at once.

1. :mod:`forcebound.config.document` reads the file, and those that it includes, into a tree.
2. :mod:`forcebound.config.arguments` finds the value of each argument and puts it where it is used.
3. The sections of the tree become the dataclasses of :mod:`forcebound.config.graph`
   (:mod:`forcebound.config.fields`), and what concerns several sections is checked.

Each step notes its problems and passes on what is sound, so that all of them are seen at once.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from forcebound.bounding import LAWS
from forcebound.config.arguments import Argument, Arguments, Substitution, check_overrides_are_used
from forcebound.config.delays import check_delays, has_trace
from forcebound.config.device_file import with_device_file
from forcebound.config.document import find, missing, read
from forcebound.config.fields import Section, fields_of
from forcebound.config.graph import (
    BESIDE_MODEL,
    FORMAT,
    KINDS,
    LAW,
    RUN_KEYS,
    DeviceConfig,
    EnvironmentConfig,
    GraphConfig,
    RealtimeConfig,
    RemoteConfig,
)
from forcebound.config.parameters import parameters, takeable_laws, unknown_parameter
from forcebound.config.parts import model_of
from forcebound.config.phases import KEY, phase_duration, read_phases
from forcebound.config.problems import Problems, unknown
from forcebound.config.resolved import to_document
from forcebound.config.sandbox import Progress, run_in_sandbox
from forcebound.config.tree import Value, from_plain
from forcebound.config.user_parts import (
    check_controller,
    check_device,
    check_environment,
    check_path,
    find_law,
    user_files,
    warn_cautions,
    warn_far,
    warn_uncertified,
)
from forcebound.environments import EnvironmentModel
from forcebound.errors import ConfigError
from forcebound.messages.packets import LINKS
from forcebound.network.ends import DEFAULT_PORT
from forcebound.network.impairment import Impairment
from forcebound.nodes.servo import ServoSettings
from forcebound.parts.user_module import names_file

SECTIONS = ("device", "operator", "controller", "environment", "links", "realtime", "remote")


def load(path: str | Path, overrides: Sequence[str] = ()) -> GraphConfig:
    """Return the configuration that a launch file describes.

    Args:
        path: A file; or the name of one that comes with forcebound: ``stiff_wall``.
        overrides: Values for the file's arguments, each ``name:=value``.

    Raises:
        ConfigError: If there is no such file or anything in it is wrong; the message has every
            problem with its place.
    """
    problems = Problems()
    return build(_read(path, problems), overrides, problems)


def load_tried(path: str | Path, overrides: Sequence[str] = ()) -> GraphConfig:
    """Return the same as :func:`load`, for a command in the foreground.

    Files of the user's own are loaded and run in the sandbox first, where they may hang or exit.
    This process then loads them, too, and asks nothing. The log says what is not certified.

    Raises:
        ConfigError: As :func:`load`; or if the user's code was too slow or ended its process.
    """
    problems = Problems()
    filled = _filled(_read(path, problems), overrides, problems)
    files = user_files(filled)
    if files:
        run_in_sandbox(try_out, [str(path), list(overrides)], files)
    config = _build(filled, problems, asks=not files)
    warn_uncertified(config)
    warn_far(config)
    warn_cautions(config)
    return config


def try_out(progress: Progress, path: str, overrides: Sequence[str]) -> None:
    """Load a launch file for its problems alone, in the sandbox of :func:`load_tried`."""
    load(path, overrides)


def read_template(path: str | Path) -> Value:
    """Return a launch file with its arguments still open, to :func:`build` it many times.

    Raises:
        ConfigError: If there is no such file or it cannot be read.
    """
    problems = Problems()
    root = _read(path, problems)
    problems.raise_if_any()
    return root


def build(
    template: Value, overrides: Sequence[str] = (), problems: Problems | None = None
) -> GraphConfig:
    """Return the configuration of a launch file that :func:`read_template` has read.

    Raises:
        ConfigError: As :func:`load`, with the ``problems`` found before.
    """
    problems = Problems() if problems is None else problems
    return _build(_filled(template, overrides, problems), problems)


def _filled(template: Value, overrides: Sequence[str], problems: Problems) -> Value:
    """The template with its arguments' values in their places."""
    arguments = Arguments(template, problems)
    substitution = Substitution(arguments.values(overrides), problems)
    rest = {name: value for name, value in template.entries.items() if name != "arguments"}
    filled = substitution.apply(replace(template, content=rest))
    check_overrides_are_used(overrides, substitution.used, arguments.declared, problems)
    return with_device_file(filled, problems)


def arguments_of(path: str | Path) -> list[Argument]:
    """Return the arguments that a launch file declares, in its order.

    Raises:
        ConfigError: If there is no such file, or it or its arguments cannot be read.
    """
    problems = Problems()
    arguments = Arguments(_read(path, problems), problems)
    problems.raise_if_any()
    return list(arguments.declared.values())


def from_document(document: Mapping[str, Any]) -> GraphConfig:
    """Return the configuration of a resolved document that may have been changed.

    Raises:
        ConfigError: If anything in it is wrong.
    """
    return _build(from_plain(document, "document"), Problems())


def change(config: GraphConfig, settings: Mapping[str, Any]) -> GraphConfig:
    """Return the configuration with other parameters, checked as a launch file is.

    Args:
        config: What runs.
        settings: New values by name; quantities are SI, or text with their unit.

    Raises:
        ConfigError: If there is no such parameter, or it cannot have this value.
    """
    known = parameters(config)
    for name in settings:
        if name not in known:
            raise ConfigError(unknown_parameter(name, config))
    _check_law(settings.get(LAW, known[LAW]), known[LAW])
    document = to_document(config)
    for name, value in settings.items():
        *path, last = name.split(".")
        section = document
        for step in path:
            section = section.setdefault(step, {})
        section[last] = value
    try:
        return from_document(document)
    except ConfigError as error:  # the places are names of parameters: they need no other words
        raise ConfigError(re.sub(r"^document: ", "", str(error), flags=re.MULTILINE)) from None


def _check_law(law: Any, present: str) -> None:
    """Refuse a law that a running device cannot take."""
    if law == present or law in takeable_laws():
        return
    message = unknown("law", str(law), takeable_laws())
    if names_file(str(law)):
        message = "a law of your own needs a launch of its own: law:=FILE.py"
    raise ConfigError(f"{LAW}: {message}")


def _read(path: str | Path, problems: Problems) -> Value:
    found = find(Path(path))
    if found is None:
        raise ConfigError(missing(path))
    root = read(found, problems)
    if root is None:
        raise problems.error()
    return root


def _build(root: Value, problems: Problems, asks: bool = True) -> GraphConfig:
    """Return what the tree says; ``asks``: whether to ask a user's own parts for an answer."""
    top = Section(root, "the launch file", root, problems)
    _check_format(top)
    top.check_keys(("forcebound", "arguments", "include", "identified", KEY, *RUN_KEYS, *SECTIONS))
    has_phases = KEY in root.entries
    run_keys = tuple(key for key in RUN_KEYS if key != "duration" or not has_phases)
    values = top.read(fields_of(GraphConfig, run_keys))
    sections = {name: Section(root.entries.get(name), name, root, problems) for name in SECTIONS}
    made = {
        "device": _device(sections["device"], asks),
        "operator": None if sections["operator"].is_empty else model_of(sections["operator"]),
        "controller": _controller(sections["controller"]),
        "environment": _environment(sections["environment"]),
        "links": _links(sections["links"]),
        "realtime": sections["realtime"].make(RealtimeConfig, knows_all=True),
        "remote": None,
    }
    if "remote" in root.entries:
        made["remote"] = sections["remote"].make(RemoteConfig, knows_all=True)
        if made["remote"] is None:  # whatever is wrong with the address, the rest is checked
            sections["remote"].make(RemoteConfig, address="127.0.0.1", port=DEFAULT_PORT)
    _check_together(made, sections, asks)
    problems.raise_if_any()
    assert values is not None  # what could not be read was a problem
    config = GraphConfig(**{"duration": math.inf, **values, **made})
    if not has_phases:
        return config
    phases = read_phases(root, config, partial(_build, asks=asks), problems)
    problems.raise_if_any()
    return replace(config, phases=phases, duration=phase_duration(phases))


def _check_together(made: Mapping[str, Any], sections: Mapping[str, Section], asks: bool) -> None:
    """Check what concerns several sections, as far as they could be made."""
    device, environment, controller = made["device"], made["environment"], made["controller"]
    if device is None:
        return
    axes = device.model.axes
    if made["operator"]:
        check_path(made["operator"], axes, sections["operator"])
    if environment and not controller.answers_states:
        check_delays(device.servo, environment, made["links"], sections["device"])
    if environment and asks:
        check_environment(environment.model, axes, sections["environment"])
    if controller is not None and asks:
        check_controller(controller, axes, sections["controller"])


def _check_format(top: Section) -> None:
    version = top.value.entries.get("forcebound")
    if version is None:
        top.add_here(f"the launch file needs 'forcebound: {FORMAT}', the version of its format")
    elif (version.content is True or version.content != FORMAT) and not version.is_broken:
        message = f"this version reads launch files of format {FORMAT}, this one is {version}"
        top.add(message, version)


def _device(section: Section, asks: bool) -> DeviceConfig | None:
    model = model_of(section, fields_of(ServoSettings))
    law = section.value.entries.get("law")
    servo = section.make(ServoSettings)
    if law is not None and isinstance(law.content, str):
        kind = find_law(section, law) if section.choose("law", "law", LAWS) else None
        servo = None if servo is None or kind is None else replace(servo, law=kind)
    if model is None or servo is None:
        return None
    device = DeviceConfig(model, servo)
    return device if check_device(device, section, asks) else None


def _controller(section: Section) -> Any:
    return KINDS["controller"]["direct"]() if section.is_empty else model_of(section)


def _environment(section: Section) -> EnvironmentConfig | None:
    model = model_of(section, fields_of(EnvironmentConfig, BESIDE_MODEL))
    made: EnvironmentConfig | None = section.make(EnvironmentConfig, model=model)
    if made is None or not has_trace(section, "compute_trace", made.computation):
        return None
    return made if _has_files(section, model) else None


def _has_files(section: Section, model: EnvironmentModel) -> bool:
    """Whether the files that a model names will do, if it can tell; if not, a problem is noted."""
    try:
        model.check_files()
    except ConfigError as error:
        at = section.value
        for name in (error.field or "file").split("."):
            at = at.entries.get(name, at)
        section.add(str(error), at)
        return False
    return True


def _links(section: Section) -> dict[str, Impairment]:
    links: dict[str, Impairment] = {}
    section.check_keys(LINKS)
    for topic, value in section.value.entries.items():
        if topic in LINKS:
            link = Section(value, f"links.{topic}", value, section.problems)
            impairment = link.make(Impairment, knows_all=True)
            if impairment is not None and has_trace(link, "trace", impairment):
                links[topic] = impairment
    return {topic: links[topic] for topic in LINKS if topic in links}
