"""One run of an audit: plant, hand, adversary, bad clock and law, compiled.

The sample and the law are those of the live bounder
(:func:`forcebound.bounding.one_axis.one_axis`), the plant is that of the simulated
device, the adversaries are those of :mod:`forcebound.environments`.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.bounding import ENERGY_TOLERANCE, LAWS, DeviceConstants, check_law
from forcebound.bounding.one_axis import one_axis
from forcebound.bounding.sample import NO_MEMORY, start_axis
from forcebound.compiled import allow_in_kernels, jit
from forcebound.devices.plant import advance, quantise
from forcebound.environments.active_wall import active_wall_force
from forcebound.environments.walls import damper_force, wall_force
from forcebound.lab.adversaries import pushing_force
from forcebound.lab.hands import PERIOD, Case, case_of, dissipation_of

SUBSTEPS = 8  # plant steps in a hold
EARNED = 1e-5  # J; below this loss plus work, the share left has no meaning

Floats: TypeAlias = NDArray[np.float64]


class Result(NamedTuple):
    """Result of a run."""

    law: str
    energy_min: float  # J, lowest energy of the hand
    loss_and_work_min: float  # J, lowest loss plus motor work
    balance_min: float  # J, lowest balance of a plant step: the integrator's error
    share_left: float  # lowest share left of the loss plus work so far; 1 if there was none
    time_of_min: float  # s, when loss plus work was lowest
    peak_force: float  # N
    case: Case

    @property
    def lowest(self) -> float:
        """The lower of the two energies, in J."""
        return min(self.energy_min, self.loss_and_work_min)

    @property
    def is_passive(self) -> bool:
        """Whether no energy ever fell below zero by more than rounding."""
        return self.lowest >= -ENERGY_TOLERANCE


#: Columns of a trace, SI units; ``energy`` and ``loss_and_work`` are the lowest since the last row.
TRACE_COLUMNS = (
    "time",
    "position",
    "reading",
    "commanded",
    "force",
    "energy",
    "loss_and_work",
    "balance",
)

Kernel: TypeAlias = Callable[
    [Case, DeviceConstants, NDArray[np.int64], Floats, Floats, NDArray[np.int64], Floats], None
]


def attack(law: str, case: Case) -> tuple[Result, Floats]:
    """Run one case.

    Args:
        law: A key of :data:`forcebound.bounding.LAWS`.
        case: The case to run.

    Returns:
        The result, and a trace of shape ``(samples, len(TRACE_COLUMNS))``.

    Raises:
        ConfigError: If the law is not known.
    """
    check_law(law)
    chance = np.random.default_rng(case.seed).random((case.samples, 6))
    periods = PERIOD * (1.0 + case.jitter * (1.7 * chance[:, 0] - 0.7))
    periods[chance[:, 1] < case.overruns] *= 1.0 + 5.0 * chance[chance[:, 1] < case.overruns, 0]
    periods_ns = np.maximum(np.rint(periods * 1e9), 1.0).astype(np.int64)
    noise = 2.0 * chance[:, 5] - 1.0
    faults = np.zeros(case.samples, dtype=np.int64)
    faults[chance[:, 2] < case.loss] = LOST
    faults[chance[:, 3] < case.corruption] = CORRUPTED
    trace = np.zeros((case.samples, len(TRACE_COLUMNS)))
    device = LAWS[law].device(dissipation_of(case))
    _kernel_of(law)(case, device, periods_ns, 2.0 * chance[:, 4] - 1.0, noise, faults, trace)
    lost = trace[:, 6]
    earned = np.maximum.accumulate(lost)
    lowest = int(np.argmin(lost))
    result = Result(
        law=law,
        energy_min=float(trace[:, 5].min()),
        loss_and_work_min=float(lost[lowest]),
        balance_min=float(trace[:, 7].min()),
        share_left=float(
            np.divide(lost, earned, where=earned > EARNED, out=np.ones_like(lost)).min()
        ),
        time_of_min=float(trace[lowest, 0]),
        peak_force=float(np.abs(trace[:, 4]).max()),
        case=case,
    )
    return result, trace


def replay(law: str, name: str | int, seconds: float) -> tuple[Result, Floats]:
    """Run a case again by its name; see :func:`attack` and :func:`forcebound.lab.hands.case_of`.

    The same name with other ``seconds`` is the same run, cut.
    """
    return attack(law, case_of(name, seconds))


def read(sensor: int, x: float, v: float, resolution: float, noise: float) -> float:
    """Return a reading at most half a ``resolution`` from ``x``, in m; ``noise`` is in [-1, 1]."""
    if sensor == 1:
        return x + 0.5 * resolution * noise
    if sensor == 2:
        return x + 0.5 * resolution * math.copysign(1.0, noise)
    if sensor == 3:
        return x + 0.5 * resolution * math.copysign(1.0, v)
    return quantise(x, resolution)


LOST = 1  # the force of this sample did not arrive: the old one is commanded again
CORRUPTED = 2  # a random force arrived in its place


def answer_of(case: Case, reading: float, velocity: float, chance: float) -> float:
    """Return the force of the case's adversary, in N; ``chance`` is random in [-1, 1]."""
    if case.adversary == 0:
        return wall_force(reading, case.stiffness, case.surface)
    if case.adversary == 1:
        damping = -case.environment_damping
        return active_wall_force(reading, velocity, case.stiffness, damping, case.surface)
    if case.adversary == 2:
        return damper_force(velocity, -case.environment_damping)
    if case.adversary == 3:
        return case.magnitude * chance
    if case.adversary == 4:
        return pushing_force(velocity, case.magnitude, 0.0)
    return case.stiffness * (reading - case.surface)


def command(case: Case, answer: float, fault: int, chance: float, before: float) -> float:
    """Return the force that arrives, saturated, in N; ``before`` is that of the last sample."""
    if fault == LOST:
        return before
    if fault == CORRUPTED:
        answer = 1e3 * chance
    return max(-case.saturation, min(case.saturation, answer))


def target_at(case: Case, time: float) -> float:
    """Return the target of the hand, in m."""
    slow = 1.0 - math.cos(2.0 * math.pi * case.slow * time)
    fast = 1.0 - math.cos(2.0 * math.pi * case.fast * time)
    return case.amplitude * (0.5 * slow + 0.1 * fast)


class Body(NamedTuple):
    """The true motion and energies."""

    x: float  # m
    v: float  # m/s
    work: float  # J, of the hand's spring and damper
    loss: float  # J, lost by viscous damping and friction, plus work against the motor


class Lowest(NamedTuple):
    """The lowest energies since the last sample."""

    energy: float  # J, of the hand
    loss_and_work: float  # J
    balance: float  # J, of a plant step: the integrator's error


def hold(
    body: Body,
    lowest: Lowest,
    case: Case,
    target: float,
    target_velocity: float,
    duration: float,
    force: float,
) -> tuple[Body, Lowest]:
    """Move for ``duration``, in s, with the motor's ``force``, in N, from the hand's ``target``."""
    x, v, work, loss = body.x, body.v, body.work, body.loss
    energy, loss_and_work, balance = lowest.energy, lowest.loss_and_work, lowest.balance
    total_mass = case.mass + case.hand_mass
    h = duration / SUBSTEPS
    for i in range(SUBSTEPS):
        x_before, v_before, work_before = x, v, work
        x, v, work, _ = advance(
            x,
            v,
            work,
            target + target_velocity * h * i,
            target + target_velocity * h * (i + 1),
            h,
            h,
            force,
            total_mass,
            case.damping,
            case.friction,
            case.hand_stiffness,
            case.hand_damping,
        )
        dx = x - x_before
        spent = case.damping * dx * dx / h + case.friction * abs(dx) + force * dx
        kinetic = 0.5 * total_mass * (v * v - v_before * v_before)
        loss += spent
        energy = min(energy, work - 0.5 * case.hand_mass * v * v)
        loss_and_work = min(loss_and_work, loss)
        balance = min(balance, work - work_before - kinetic - spent)
    return Body(x, v, work, loss), Lowest(energy, loss_and_work, balance)


def move(
    body: Body, case: Case, target: float, target_end: float, dt: float, force: float
) -> tuple[Body, Lowest]:
    """Move for ``dt``, in s; the watchdog drops a force that is older than the hold limit."""
    lowest = Lowest(math.inf, math.inf, math.inf)
    target_velocity = (target_end - target) / dt
    held_for = min(dt, case.hold_limit)
    body, lowest = hold(body, lowest, case, target, target_velocity, held_for, force)
    if dt > held_for:
        target += target_velocity * held_for
        body, lowest = hold(body, lowest, case, target, target_velocity, dt - held_for, 0.0)
    return body, lowest


@cache
def _kernel_of(law: str) -> Kernel:
    """Return the compiled run of one law."""
    start, bound = LAWS[law].start, one_axis(LAWS[law])

    def run(
        case: Case,
        device: DeviceConstants,
        periods_ns: NDArray[np.int64],
        chances: Floats,
        noise: Floats,
        faults: NDArray[np.int64],
        trace: Floats,
    ) -> None:
        body = Body(0.0, 0.0, 0.0, 0.0)
        axis, memory, state = start_axis(0.0), NO_MEMORY, start(device)
        time = target = commanded = 0.0
        history = np.zeros((case.delay + 1, 2))  # reading and velocity, as a ring
        for n in range(case.samples):
            dt = periods_ns[n] / 1e9
            time += dt
            target_before, target = target, target_at(case, time)
            body, lowest = move(body, case, target_before, target, dt, axis.force)
            reading = read(case.sensor, body.x, body.v, case.resolution, noise[n])
            # The environment gets late readings; its answer may be lost or corrupted.
            slot = n % (case.delay + 1)
            history[slot, 0] = reading
            history[slot, 1] = (reading - axis.reading) / dt
            seen = (n + 1) % (case.delay + 1)
            answer = answer_of(case, history[seen, 0], history[seen, 1], chances[n])
            commanded = command(case, answer, faults[n], chances[n], commanded)
            axis, memory, state, _ = bound(
                axis, memory, state, reading, commanded, case.saturation, dt, device
            )
            energies = (lowest.energy, lowest.loss_and_work, lowest.balance)
            row = (time, body.x, reading, commanded, axis.force, *energies)
            for column, value in enumerate(row):
                trace[n, column] = value

    allow_in_kernels([start, bound])
    return jit(run)
