"""The bounder as plain Python: to the bit what its compiled form does.

Compiled code is what runs; a debugger, a reader and the measure of coverage see the Python.
"""

import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeAlias

import pytest
from bounding_traces import PHANTOM
from builders import MS

from forcebound.haptics.laws import LAWS, Dissipation, ForceBounder, all_axes, bounder
from forcebound.haptics.laws.one_axis import one_axis
from forcebound.haptics.laws.sample import NO_MEMORY, start_axis

Tick: TypeAlias = tuple[tuple[float, ...], float, float]
UNSURE = replace(
    PHANTOM,
    gain_error=0.1,
    lag=4e-4,
    write_delay=4e-4,
    largest_speed=1.0,
    watchdog_tolerance=0.2,
    weight_error=0.01,
    energy_cap=0.02,
)
OWN = replace(PHANTOM, damping=(0.2, 0.3), friction=(0.1, 0.05), resolution=(3e-5, 1e-5))
# Axes and samples of each; fewer samples where plain Python takes 10 ms and more for one.
DEVICES = {
    "as identified": (PHANTOM, 1, 400),
    "as identified, three axes": (PHANTOM, 3, 400),
    "own numbers of each axis": (OWN, 2, 160),
    "unsure of everything": (replace(UNSURE, presliding=2e-5), 1, 160),
    "unsure of everything, two axes": (UNSURE, 2, 160),
    "friction that yields, two axes": (replace(OWN, presliding=(2e-5, 1e-5)), 2, 160),
    "late forces are guarded": (replace(PHANTOM, watchdog="guarding", guard_period=5e-5), 1, 400),
    "cuts are reported": (replace(PHANTOM, watchdog="reporting"), 1, 400),
    "motors attenuate": (replace(OWN, attenuates="per_write", write_delay=4e-4), 2, 160),
    "nothing cuts": (replace(PHANTOM, watchdog="none", watchdog_limit=0.1, allowance=2e-3), 2, 400),
}


def driven(law: str, device: Dissipation, axes: int, samples: int) -> list[Tick]:
    """Return force, limit and energy of each sample on a path that trembles, stalls and jumps."""
    chance = random.Random(5)
    one = ForceBounder(law, device, axes)
    position = (0.0,) * axes
    one.start(0, position)
    time_ns, ticks = 0, list[Tick]()
    for n in range(samples):
        interval = chance.choice([MS, MS, MS, 1_100_000, 2 * MS, 5 * MS, 500])
        if interval > 1_250_000 and device.watchdog == "reporting":
            one.report_cut(time_ns + 1_250_000, position)
        time_ns += interval
        position = tuple(x + chance.gauss(2e-5, 1e-4) for x in position)
        if n % 97 == 50:
            position = (position[0] + 0.5, *position[1:])
        if n % 60 == 30:
            one.set_hold_limit(chance.choice([1.02e-3, 1.25e-3]))
        asked = tuple(chance.uniform(-9, 9) for _ in range(axes))
        force = one.bound(time_ns, position, asked)
        one.settle(force, time_ns + chance.randrange(0, 400_000) if device.write_delay else None)
        ticks.append((force, one.limit, one.estimated_energy))
    return ticks


@pytest.mark.parametrize("name", DEVICES)
def test_compiled_and_interpreted_bounder_agree_to_the_bit(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled = driven("certified", *DEVICES[name])
    for module in (all_axes, bounder):
        monkeypatch.setattr(module, "jit", as_it_is)
    monkeypatch.setattr(bounder, "compiled", all_axes.compiled.__wrapped__)
    assert driven("certified", *DEVICES[name]) == compiled


def as_it_is(function: Callable[..., Any]) -> Callable[..., Any]:
    return function


@pytest.mark.parametrize("law", sorted(LAWS))
def test_the_step_of_sweeps_does_what_the_bounder_does(law: str) -> None:
    chance = random.Random(6)
    one, step = ForceBounder(law, PHANTOM), one_axis(LAWS[law])
    device = LAWS[law].device(PHANTOM, 1)
    axis, memory, state = start_axis(0.0), NO_MEMORY, LAWS[law].start(device)
    one.start(0, (0.0,))
    time_ns, reading = 0, 0.0
    for _ in range(300):
        interval = chance.choice([MS, MS, 1_200_000, 3 * MS])
        time_ns += interval
        reading += chance.gauss(2e-5, 1e-4)
        asked = chance.uniform(-9, 9)
        force = one.bound(time_ns, (reading,), (asked,))
        one.settle(force)
        axis, memory, state, _, limit = step(
            axis, memory, state, reading, asked, PHANTOM.saturation, interval * 1e-9, device
        )
        assert (axis.force, limit) == pytest.approx((force[0], one.limit), rel=1e-9, abs=1e-12)
