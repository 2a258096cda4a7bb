"""The safety chain at its limits: the ramp, the age limit, its memory."""

import pytest

from forcebound.messages.packets import DeviceState, ForceCommand
from forcebound.nodes.safety import REMEMBERED, SafetyChain

AGE_LIMIT_NS, ENGAGE_NS = 100, 1_000


def chain(axes: int = 1) -> SafetyChain:
    return SafetyChain(axes, AGE_LIMIT_NS, ENGAGE_NS)


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
        assert safety.force(time_ns) == (share * force[0],)
        assert safety.engagement == share


def test_a_command_counts_until_the_age_limit_and_not_a_nanosecond_longer() -> None:
    safety = chain()
    measure(safety, 0, 0)
    safety.accept(ForceCommand(0, 0, 0, 0, (1.0,)), AGE_LIMIT_NS)
    assert safety.rejected == {}
    safety.force(AGE_LIMIT_NS)
    assert safety.answered_tick == 0
    assert safety.force(AGE_LIMIT_NS + 1) == (0.0,)
    assert safety.answered_tick is None


def test_before_the_first_command_there_is_no_answer_and_no_engagement() -> None:
    safety = chain(2)
    assert (safety.answered_tick, safety.engagement) == (None, 0.0)
    assert safety.force(0) == (0.0, 0.0)
    assert safety.engagement == 0.0


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
