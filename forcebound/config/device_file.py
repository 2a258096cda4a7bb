"""The file of an identified device, which the section ``device:`` of a launch file includes.

``device: {include: device.yaml}`` takes the section ``device:`` of that file, as ``forcebound
identify`` writes it, and lays what the launch file says over it. A file of another kind of device
is refused: its numbers would promise what this device does not keep.
"""

from dataclasses import replace
from pathlib import Path

from forcebound.config.document import MAX_BYTES, merge
from forcebound.config.problems import Problems
from forcebound.config.tree import Value, parse
from forcebound.errors import ConfigError
from forcebound.files import read_text

WHAT = "the file of the device"


def with_device_file(root: Value, problems: Problems) -> Value:
    """Return a launch file with the file that its device includes beneath that section."""
    section = root.entries.get("device")
    if section is None or "include" not in section.entries:
        return root
    wanted = section.entries["include"]
    rest = {name: value for name, value in section.entries.items() if name != "include"}
    own = replace(section, content=rest)
    beneath = None
    if isinstance(wanted.content, str):
        beneath = _section_of(wanted, own, problems)
    elif wanted.content is not None and not wanted.is_broken:
        problems.add(f"device: include must name one file, got {wanted}", wanted.place)
    device = own if beneath is None else merge(beneath, own)
    return replace(root, content={**root.entries, "device": device})


def _section_of(wanted: Value, own: Value, problems: Problems) -> Value | None:
    path = Path(wanted.place.name).parent / wanted.text if wanted.place.line else Path(wanted.text)
    try:
        root = parse(read_text(path, WHAT, MAX_BYTES), str(path), problems)
    except ConfigError as error:
        problems.add(str(error), wanted.place)
        return None
    device = None if root is None else root.entries.get("device")
    if device is None or "kind" not in device.entries:
        problems.add(f"{path} has no section device: with a kind", wanted.place)
        return None
    kind, meant = device.entries["kind"], own.entries.get("kind")
    if meant is not None and kind.plain != meant.plain:
        message = f"{path} is of a device of the kind {kind}, this launch file is for {meant}"
        problems.add(f"{message}: identify this one with `forcebound identify`", wanted.place)
        return None
    return device
