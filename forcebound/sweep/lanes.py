"""NamedTuples of a law as rows of numbers, ``stride`` apart: how the kernel keeps them by lane."""

from forcebound.bounding.sample import AxisMemory, DeviceConstants, Floats, Memory

AXIS_ROWS = len(AxisMemory._fields)
MEMORY_ROWS = len(Memory._fields)
DEVICE_ROWS = len(DeviceConstants._fields)


def load_axis(rows: Floats, first: int, stride: int) -> AxisMemory:
    """Return the memory of an axis from ``rows``."""
    return AxisMemory(
        rows[first],
        rows[first + stride],
        rows[first + 2 * stride],
        rows[first + 3 * stride],
        rows[first + 4 * stride],
        rows[first + 5 * stride],
        rows[first + 6 * stride],
    )


def store_axis(rows: Floats, first: int, stride: int, axis: AxisMemory) -> None:
    """Put the memory of an axis into ``rows``."""
    rows[first] = axis.reading
    rows[first + stride] = axis.force
    rows[first + 2 * stride] = axis.mean_force
    rows[first + 3 * stride] = axis.play
    rows[first + 4 * stride] = axis.path
    rows[first + 5 * stride] = axis.older
    rows[first + 6 * stride] = axis.younger


def load_memory(rows: Floats, first: int, stride: int) -> Memory:
    """Return the memory of all axes from ``rows``."""
    return Memory(
        rows[first],
        rows[first + stride],
        rows[first + 2 * stride],
        rows[first + 3 * stride],
        rows[first + 4 * stride],
        rows[first + 5 * stride],
    )


def store_memory(rows: Floats, first: int, stride: int, memory: Memory) -> None:
    """Put the memory of all axes into ``rows``."""
    rows[first] = memory.path
    rows[first + stride] = memory.loss
    rows[first + 2 * stride] = memory.between
    rows[first + 3 * stride] = memory.older_age
    rows[first + 4 * stride] = memory.younger_age
    rows[first + 5 * stride] = memory.samples


def load_device(rows: Floats, first: int, stride: int) -> DeviceConstants:
    """Return the constants of a device from ``rows``."""
    return DeviceConstants(
        rows[first],
        rows[first + stride],
        rows[first + 2 * stride],
        rows[first + 3 * stride],
        rows[first + 4 * stride],
        rows[first + 5 * stride],
        rows[first + 6 * stride],
        rows[first + 7 * stride],
        rows[first + 8 * stride],
    )
