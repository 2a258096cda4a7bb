"""The state of a hand in words: passive or not, at rest or not.

It is made of the figures of a run, or of those of a run that goes on. The verdict, the doctor and
the live page have it from here, so none of them denies what another one says.
"""

from collections.abc import Iterable, Iterator, Sequence
from enum import StrEnum
from typing import NamedTuple

from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound.recordings.launched import DeviceSection, Launched
from forcebound.results.cells import Summary
from forcebound.results.promises import COSTS_FORCE, BrokenPromise, in_words, is_uncovered
from forcebound.results.samples import is_certified
from forcebound.units import MM, MM_S, energy_in_words, in_unit

STAYS = "pressing"  # the hand that a passive wall brings to rest; others move by themselves
WALL = "wall"  # in place of a hand: nobody holds this device


class Passivity(StrEnum):
    """What is known of the passivity of a hand."""

    PASSIVE = "passive"
    UNKNOWN = "unknown"  # of a real device without a certificate
    UNCOVERED = "uncovered"  # the device broke a promise on which the certificate rests
    NOT_PASSIVE = "not_passive"


class State(NamedTuple):
    """The state of a hand."""

    kind: Passivity
    head: str  # such as "Not passive"
    known: str  # what follows the colon: which energy is known
    costly: str  # sentences before: promises whose break costs force alone
    rest: str  # a sentence; empty: neither truth nor a surface

    @property
    def passivity(self) -> str:
        """All about passivity."""
        return f"{self.costly}{self.head}: {self.known}." if self.known else f"{self.head}."


def state(s: Summary, run: Launched) -> State:
    """Return the state of a hand.

    Args:
        s: Its figures by key; of those that are not measured yet, None.
        run: Its launch file.
    """
    lowest = s["true_energy_min_j"]
    promises: Sequence[BrokenPromise] = s["broken_promises"]
    if lowest is None:
        kind, head, known = _without_truth(s, run.device, _motor(s))
    else:
        kind, head = _with_truth(s, run.device, lowest)
        known = _received(s, run)
    measured = _motor(s) if lowest is None else known
    paid = [one for one in promises if not is_uncovered(one) and one["promise"] != COSTS_FORCE]
    if any(map(is_uncovered, promises)):
        head = "Not covered by the certificate"
        kind = kind if kind is Passivity.NOT_PASSIVE else Passivity.UNCOVERED
        known = f"{_all_in_words(filter(is_uncovered, promises))}. In this run {measured}"
    elif paid:
        head = "Covered by the certificate all the same"
        known = f"{_all_in_words(paid)}. In this run {measured}"
    elif not head:
        head, known = known[0].upper() + known[1:], ""
    costly = "".join(f"{in_words(one)}. " for one in promises if one["promise"] == COSTS_FORCE)
    return State(kind, head, known, costly, "".join(_rest(s, run)))


def _all_in_words(promises: Iterable[BrokenPromise]) -> str:
    return "; ".join(map(in_words, promises))


def _with_truth(s: Summary, device: DeviceSection, lowest: float) -> tuple[Passivity, str]:
    if lowest >= -ENERGY_TOLERANCE:
        return Passivity.PASSIVE, "Passive"
    if device.energy_partner:  # both together are judged by results.coupling
        return Passivity.PASSIVE, ""
    allowed, fast = (
        (device.allowance if _is_certified(s, device) else 0.0),
        s["speed_leak_j"] or 0.0,
    )
    if lowest < -max(allowed, fast):
        return Passivity.NOT_PASSIVE, "Not passive"
    if lowest < -allowed:
        return Passivity.PASSIVE, f"Passive but for at most {energy_in_words(fast)} ({_fast(s)})"
    return Passivity.PASSIVE, f"Passive but for device.allowance ({energy_in_words(allowed)})"


def _fast(s: Summary) -> str:
    return f"device.hand_speed exceeded in {counted(s['fast_holds'], 'hold')}"


def _is_certified(s: Summary, device: DeviceSection) -> bool:
    return is_certified(device.law or s["law"])  # that of a summary may begin with its hand


def _received(s: Summary, run: Launched) -> str:
    """What a hand received, or the simulated thing that a device meets, from ground truth."""
    lowest, left = s["true_energy_min_j"], s["energy_left_j"]
    hand = "what it meets" if run.operator.kind == WALL else "the hand"
    if lowest >= -ENERGY_TOLERANCE:
        words = f"{hand} never received energy that it had not put in"
        if left is None or left <= 0.0:
            return words
        return f"{words}; since contact, {energy_in_words(left)} or more were left"
    received = f"{hand} received up to {energy_in_words(-lowest)}"
    if partner := run.device.energy_partner:
        return f"{received} more than it put in, from the ledger of {partner}"
    return f"{received} that it had not put in"


def _motor(s: Summary) -> str:
    """What the motor gave: of a real device, what its friction takes is not known."""
    given, error = _given(s)
    if given + error <= ENERGY_TOLERANCE:
        return "the motor never gave more energy than it took"
    if given <= error:
        return f"the motor gave at most {energy_in_words(given + error)} more than it took"
    about = f" (± {energy_in_words(error)})" if error > ENERGY_TOLERANCE else ""
    return f"the motor gave up to {energy_in_words(given)}{about} more than it took"


def _given(s: Summary) -> tuple[float, float]:
    """What the motor gave more than it took, and how much more that may be, in J."""
    return -(s["observed_energy_min_j"] or 0.0), s["observed_energy_error_j"] or 0.0


def _without_truth(s: Summary, device: DeviceSection, motor: str) -> tuple[Passivity, str, str]:
    if sum(_given(s)) <= ENERGY_TOLERANCE:
        return Passivity.PASSIVE, "Passive, as far as readings tell", motor
    if not _is_certified(s, device):
        words = f"{motor}; the device's own friction may have taken that"
        return Passivity.UNKNOWN, "Unknown if passive", words
    late, fast = s["largest_allowance_j"] or 0.0, s["speed_leak_j"] or 0.0
    cause = _fast(s) if fast > late else "device.allowance"
    leaked = max(late, fast)
    but = f" but for at most {energy_in_words(leaked)} ({cause})" if leaked else ""
    trust = "if the device's numbers are right"
    if device.watchdog == "silent" and s["hold_limit_overruns"]:
        trust += f" and its watchdog dropped {counted(s['hold_limit_overruns'], 'late force')}"
    partner = f" and the ledger of {device.energy_partner}" if device.energy_partner else ""
    words = f"{motor}, which its friction and damping{partner} cover"
    return Passivity.PASSIVE, f"Passive by the certificate{but}, {trust}", words


def _rest(s: Summary, run: Launched) -> Iterator[str]:
    speed, amplitude, turns = (
        s[key] for key in ("final_speed_m_per_s", "limit_cycle_amplitude_m", "contact_bounces")
    )
    if s["at_rest"]:
        depth = s["penetration_at_rest_m"]
        yield "At rest at the end" + (f", {run.shown(MM).show(depth)} deep." if depth else ".")
    elif speed is not None:
        words = in_unit(speed, run.shown(MM_S).unit, 3)
        yield f"Not at rest: it moves at {words} at the end"
        yield f", and turned round {times(turns)} after first contact." if turns else "."
        hand = run.operator.kind
        if hand not in ("", STAYS, WALL):
            yield f" (A hand of kind {hand} may do that by itself.)"
    elif amplitude is not None:
        yield f"The last 0.5 s: within {run.shown(MM).show(2.0 * amplitude)}."


def times(count: int) -> str:
    """Return how often: ``once``, ``3 times``."""
    return "once" if count == 1 else f"{count} times"


def counted(count: int, noun: str) -> str:
    """Return a count with its noun, in the plural unless it is one."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
