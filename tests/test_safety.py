"""The safety chain at its limits: the ramp, the age limit, its memory, a stage more."""

from itertools import pairwise
from pathlib import Path

import pytest
from msgspec.structs import replace

from forcebound.graph.loader import load
from forcebound.graph.servo import ServoSettings
from forcebound.lab.replay import device_of
from forcebound.lab.runs import unserved
from forcebound.lab.verification import verify
from forcebound.messages.packets import DeviceState, ForceCommand, Telemetry
from forcebound.nodes import safety as stages
from forcebound.nodes.safety import REMEMBERED, Demand, SafetyChain, fresh, ramp
from forcebound.recordings.recording import read
from forcebound.run.virtual import run_virtual

AGE_LIMIT_NS, ENGAGE_NS = 100, 1_000
SERVO = ServoSettings(age_limit=AGE_LIMIT_NS * 1e-9, engage_time=ENGAGE_NS * 1e-9)


def chain(axes: int = 1) -> SafetyChain:
    return SafetyChain(axes, SERVO)


def measure(chain: SafetyChain, tick: int, time_ns: int, axes: int = 1) -> None:
    zero = (0.0,) * axes
    chain.remember(DeviceState(tick, time_ns, 0.0, zero, zero, zero))


def command(chain: SafetyChain, tick: int, measured_ns: int, force: tuple[float, ...]) -> None:
    chain.accept(ForceCommand(tick, 0, tick, measured_ns, force), measured_ns)


@pytest.mark.parametrize("force", [(4.0,), (1e6,)])
def test_half_way_up_the_ramp_the_force_is_half_of_what_is_asked(
    force: tuple[float, ...],
) -> None:
    safety = chain()
    for tick, time_ns in enumerate((0, ENGAGE_NS // 2, ENGAGE_NS)):
        measure(safety, tick, time_ns)
        command(safety, tick, time_ns, force)
        share = time_ns / ENGAGE_NS
        assert safety.demand(time_ns) == Demand((share * force[0],), time_ns, share)


def test_a_command_counts_until_the_age_limit_and_not_a_nanosecond_longer() -> None:
    safety = chain()
    measure(safety, 0, 0)
    safety.accept(ForceCommand(0, 0, 0, 0, (1.0,)), AGE_LIMIT_NS)
    assert safety.rejected == {}
    safety.demand(AGE_LIMIT_NS)
    assert safety.command is not None
    assert safety.demand(AGE_LIMIT_NS + 1).force == (0.0,)
    assert safety.command is None


def test_before_the_first_command_there_is_no_answer_and_no_engagement() -> None:
    safety = chain(2)
    assert safety.command is None
    assert safety.demand(0) == safety.no_force
    assert safety.no_force == Demand((0.0, 0.0), 0, 0.0)


def test_a_command_before_the_first_state_is_from_the_future() -> None:
    safety = chain()
    command(safety, 0, 0, (1.0,))
    assert safety.rejected == {"from_the_future": 1}


def test_a_tick_is_remembered_until_its_place_is_needed() -> None:
    safety = chain()
    for tick in range(REMEMBERED):
        measure(safety, tick, 1)
    command(safety, 0, 1, (1.0,))
    assert safety.rejected == {}
    measure(safety, REMEMBERED, 1)
    command(safety, 0, 1, (1.0,))
    assert safety.rejected == {"too_old": 1}


RATE = 100.0  # N/s


def force_rate(
    before: tuple[int, float] | None, demand: Demand, time_ns: int, servo: ServoSettings
) -> tuple[tuple[int, float], Demand]:
    """Let the force on one axis change by no more than ``RATE``."""
    last_ns, last = before or (time_ns, 0.0)
    most = RATE * (time_ns - last_ns) * 1e-9
    force = min(max(demand.force[0], last - most), last + most)
    return (time_ns, force), replace(demand, force=(force,))


def test_a_stage_more_limits_the_force_is_verified_and_is_left_to_the_graph_by_a_sweep(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    config = load("stiff_wall")
    assert not any(unserved(config))
    monkeypatch.setattr(stages, "stages_of", lambda servo: (fresh, ramp, force_rate))
    run_virtual(config, 0.6, tmp_path / "run.mcap")
    recording = read(tmp_path / "run.mcap")
    ticks = [p for p in recording.packets("telemetry") if isinstance(p, Telemetry)]
    steps = [abs(b.commanded_force[0] - a.commanded_force[0]) for a, b in pairwise(ticks)]
    assert max(steps) == pytest.approx(RATE * 1e-3)
    found = verify(recording, device_of(recording))
    assert (found.is_same, found.unknown_commands) == (True, 0)
    assert found.commands > 500
    monkeypatch.setattr(stages, "stages_of", lambda servo: (fresh, ramp))
    assert verify(recording, device_of(recording)).unknown_commands > 10
    monkeypatch.setattr(stages, "stages_of", lambda servo: (fresh, ramp, force_rate))
    assert list(unserved(config)) == ["a stage of the safety chain"]
