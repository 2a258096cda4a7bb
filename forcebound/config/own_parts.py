"""Where a launch file names a file of the user's own: its class, and what is checked of it.

:mod:`forcebound.config.own` loads the file.
"""

import json
from pathlib import Path
from typing import Any

from forcebound.config import own
from forcebound.config.fields import Section, check_fields
from forcebound.config.resolved import member_document
from forcebound.config.tree import Value
from forcebound.environments.contract import force_fault
from forcebound.errors import ConfigError

OWN = {"environment": {"force": 3}}  # sections with classes of the user's own; their methods


def own_file(root: Value) -> Path | None:
    """Return the file of the user's own that a launch file takes its environment from, if any."""
    section = root.entries.get("environment")
    kind = None if section is None else section.entries.get("kind")
    if kind is None or not own.names_file(kind.text):
        return None
    return own.file_of(kind.text, _beside(kind))


def _beside(value: Value) -> Path:
    """The folder that a relative path starts from: that of the file that says it."""
    return Path(value.place.name).parent if value.place.line else Path()


def own_class(section: Section, value: Value, taken: set[str]) -> type | None:
    """Return the class in a user's file; None with a problem noted if there is none."""
    try:
        member = own.load_class(str(value.content), _beside(value), OWN[section.name])
        check_fields(member, taken)
    except ConfigError as error:
        section.add(f"{section.name}: {error}", value)
        return None
    return member


def can_be_written(made: object, section: Section) -> bool:
    """Return whether the parameters can be written into documents and recordings."""
    for name, value in member_document(section.name, made).items():
        try:
            json.dumps(value, allow_nan=False)
        except (TypeError, ValueError) as error:
            section.add_here(f"{section.name}: {name} cannot be written down: {error}")
            return False
    return True


def check_answer(model: Any, axes: int, section: Section) -> None:
    """Note what a user's environment does wrong at the first question: nobody has tried it yet."""
    if own.kind_of(type(model)) is None:
        return
    still = (0.0,) * axes
    try:
        fault = force_fault(model.force(still, still, 0.0), axes)
    except (Exception, SystemExit) as error:
        fault = own.blame(error, type(model))
    if fault is not None:
        question = f"force({still}, {still}, 0.0)"
        section.add(f"environment: {question}: {fault}", section.value.entries["kind"])
