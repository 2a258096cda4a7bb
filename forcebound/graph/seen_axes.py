"""The axes by which the sections of a hand are read, and those that a document names."""

from forcebound.axes import Axis, common_kind
from forcebound.errors import ConfigError
from forcebound.graph.forms import note_error, read_as
from forcebound.graph.problems import Problems
from forcebound.graph.tree import Value
from forcebound.haptics.devices import DeviceModel
from forcebound.haptics.parts.user_module import user_code


def axes_of(device: object, which: str) -> tuple[Axis, ...] | None:
    """Return the axes of a device that was made; none if they are the lengths of the types.

    None: the device is wrong, and its axes are not known.
    """
    if device is None:
        return None
    if not isinstance(device, DeviceModel):
        return ()
    with user_code(which):
        axes: tuple[Axis, ...] = getattr(device, which)
    return () if common_kind(axes) == "length" else axes


def seen_axes(value: Value, device: object, problems: Problems) -> tuple[Axis, ...]:
    """Return the axes that a document names; none with a problem noted.

    A launch file names none, since its device does.
    """
    try:
        axes: tuple[Axis, ...] = read_as(tuple[Axis, ...], value, "axes")
        if isinstance(device, DeviceModel) and axes != device.named_axes:
            own = ", ".join(f"{axis.name} ({axis.kind})" for axis in device.named_axes)
            raise ConfigError(f"axes are those of the device, {own}: leave them out")
    except ConfigError as error:
        note_error(error, "axes", value, problems)
        return ()
    return axes
