"""An identification on a machine that stalls: what a stall spoils is done again."""

import dataclasses
from random import Random

import pytest

from experiments.identified_devices import KNOB
from forcebound.devices.phantom import PhantomPremium15
from forcebound.devices.simulated import SimulatedDevice
from forcebound.errors import DeviceError
from forcebound.identification.clock import VirtualClock
from forcebound.identification.procedure import Found, Plan, identify

SHORT = dataclasses.replace(KNOB, levels=(0.4, 1.0), pushes=4, strokes=4)


class StallingClock(VirtualClock):
    """A machine that stands still now and then, at random.

    Args:
        share: Of the ticks.
        seconds: For how long.
    """

    def __init__(self, share: float, seconds: float) -> None:
        super().__init__()
        self._random, self._share, self._stall_ns = Random(1), share, round(1e9 * seconds)

    def wait_until(self, time_ns: int) -> None:
        stalls = self._random.random() < self._share
        super().wait_until(time_ns + self._stall_ns * stalls)


class Carried(SimulatedDevice):
    """A device that holds its last force, and that somebody can bring back."""

    def __init__(self) -> None:
        self.model = PhantomPremium15(watchdog="none", watchdog_limit=100.0, substep=1e-3)
        super().__init__(self.model, None, 1.25e-3)
        self.carried = 0

    def bring_back(self) -> None:
        now_ns, self.carried = self._read_ns, self.carried + 1
        super().__init__(self.model, None, 1.25e-3)
        self.read(now_ns)


def found_of(device: Carried, clock: VirtualClock, said: list[str], plan: Plan = SHORT) -> Found:
    return identify(device, device.model, clock, plan, said.append, bring_back=device.bring_back)


def test_stalls_cost_repetitions_and_no_bound() -> None:
    said: list[str] = []
    (axis,) = found_of(Carried(), StallingClock(5e-4, 0.06), said).axes
    assert 0.9 * 0.27 <= axis.damping.lower <= 0.27
    assert 0.85 * 0.12 <= axis.friction.lower <= 0.12
    assert "movements begun anew" in said[-1]
    assert "late by up to 60 ms" in said[-1]


def test_a_device_that_a_long_stall_throws_away_is_brought_back() -> None:
    device, said = Carried(), list[str]()
    (axis,) = found_of(device, StallingClock(3e-4, 1.0), said).axes
    assert device.carried > 0
    assert 0.9 * 0.27 <= axis.damping.lower <= 0.27


def test_a_machine_that_always_stalls_ends_it_and_is_named() -> None:
    with pytest.raises(DeviceError, match=r"tried 50 times.* late by up to 60 ms .* its load is"):
        found_of(Carried(), StallingClock(0.3, 0.06), [])


def test_a_device_that_nobody_brings_back_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Carried, "bring_back", lambda device: None)
    with pytest.raises(DeviceError, match=r"nobody has brought it back.* late by up to 1000 ms"):
        found_of(Carried(), StallingClock(3e-4, 1.0), [])
