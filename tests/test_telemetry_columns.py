"""Telemetry as columns of numbers."""

import numpy as np
import pytest
from builders import full_telemetry
from msgspec.structs import replace

from forcebound.messages.packets import Telemetry, field_types
from forcebound.recordings.telemetry import TelemetryColumns


@pytest.mark.parametrize("axes", [1, 3])
def test_columns_hold_the_fields_of_the_packets(axes: int) -> None:
    vector, stamps = (0.5,) * axes, {"read_ns": 5, "write_ns": 7, "cut_ns": 6, "ahead_ns": 1}
    sent = [replace(full_telemetry(n, axes), joints=vector, **stamps) for n in range(4)]
    columns = TelemetryColumns.from_packets(sent)
    for name in field_types(Telemetry):  # figures do not need the reading at a cut
        if name not in {"rejected", "cut_position"}:
            expected = [getattr(packet, name) for packet in sent]
            np.testing.assert_array_equal(getattr(columns, name), expected)
    assert columns.position.shape == (4, axes)
    assert columns.rejected == {"age": 3}


def test_columns_mark_what_is_missing() -> None:
    packet = replace(
        full_telemetry(axes=2),
        true_energy=None,
        true_position=None,
        hand_force=None,
        device_seq=None,
        loop_delay=None,
    )
    columns = TelemetryColumns.from_packets([packet, full_telemetry(1, axes=2)])
    assert np.isnan(columns.true_position[0]).all()
    assert np.isnan(columns.hand_force[0]).all()
    assert np.isnan([columns.true_energy[0], columns.loop_delay[0]]).all()
    assert columns.device_seq.tolist() == [-1, 1]
    assert columns.write_ns.tolist() == [-1, -1]


def test_time_counts_from_the_first_engaged_sample() -> None:
    sent = [replace(full_telemetry(tick), engagement=0.5 * (tick >= 2)) for tick in range(4)]
    columns = TelemetryColumns.from_packets(sent)
    np.testing.assert_allclose(columns.time, [-2e-3, -1e-3, 0.0, 1e-3])


def test_columns_of_no_packets_are_empty() -> None:
    columns = TelemetryColumns.from_packets([])
    assert columns.position.shape == (0, 1)
    assert columns.time.shape == (0,)


def test_packets_with_different_numbers_of_axes_are_refused() -> None:
    with pytest.raises(ValueError, match="has 1 and 2 axes; a run has one"):
        TelemetryColumns.from_packets([full_telemetry(0, 1), full_telemetry(1, 2)])
