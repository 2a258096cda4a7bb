"""Events of the device node: answers, refused readings, missed ticks, the law, the bounder."""

from collections.abc import Mapping

from forcebound.graph.servo import ServoSettings
from forcebound.messages.control import BounderReport
from forcebound.messages.events import BOUNDER_REPORTED, LAW_CHANGED, STATE_INTERVAL_NS, EventLog
from forcebound.messages.packets import Event, Packet
from forcebound.units import energy_in_words

REFUSAL_INTERVAL_NS = 1_000_000_000  # between two events about refused readings
WINDOW_NS = 1_000_000_000  # in which missed ticks are counted
SHARE = 0.05  # of the ticks, missed in a window: more is a warning
REPEAT_NS = 10_000_000_000  # between two warnings


class DeviceEvents:
    """Events of the ticks of a device node, limited in rate.

    ``about``: data of the device, which a recording must hold wherever a ledger begins.

    :meth:`look` has something to do if ``is_answered`` or ``refused`` are no longer as here, or at
    the ``end_ns`` of the ``overload``.
    """

    def __init__(
        self, log: EventLog, servo: ServoSettings, about: Mapping[str, str] | None = None
    ) -> None:
        self._log, self._servo, self._about = log, servo, about or {}
        self.is_answered = False
        self._next_answer_ns = 0
        self.refused = 0
        self._next_refusal_ns = 0
        self.overload = Overload(servo.period_ns)

    def look(
        self,
        time_ns: int,
        is_answered: bool,
        refused: int,
        missed: int,
        of_device: int = 0,
        busy: float = 0.0,
    ) -> list[Packet]:
        """Return the events after a tick with an engaged force.

        It takes whether an answer gives the force, and readings refused and ticks missed so far:
        ``of_device``, while it read or wrote, which takes it so many s (``busy``) of a tick.
        """
        events: list[Packet] = []
        if self.is_answered != is_answered and time_ns >= self._next_answer_ns:
            self.is_answered, self._next_answer_ns = is_answered, time_ns + STATE_INTERVAL_NS
            events.append(self._answers(time_ns))
        if refused > self.refused and time_ns >= self._next_refusal_ns:
            self.refused, self._next_refusal_ns = refused, time_ns + REFUSAL_INTERVAL_NS
            events.append(self._refusals(time_ns))
        warning = self.overload.observe(time_ns, missed, of_device, busy)
        if warning is not None:
            cause = {"cause": "device" if self.overload.is_of_device else "machine"}
            events.append(self._log.emit(time_ns, "ticks_missed", warning, cause, is_fault=True))
        return events

    def law_changed(
        self, time_ns: int, law: str, before: tuple[str, float, float] | None = None
    ) -> Event:
        """Return the event of another law; the ticks that its loading has cost are no news.

        ``before`` is of a simulated device: the law before, the true energy under it, and
        ``energy_before`` of the status, in J.
        """
        self.overload = Overload(self._servo.period_ns)
        message, data = f"law: {law} from now on", {"law": law, **self._about}
        if before is not None:
            former, given, energy = before
            has = "has put in" if given >= 0.0 else "has received"
            message += f"; under {former} the hand {has} {energy_in_words(abs(given))}"
            data["energy_before"] = repr(energy)
        return self._log.emit(time_ns, LAW_CHANGED, message, data)

    def bounder(self, time_ns: int, report: BounderReport) -> Event:
        """Return the event of a report."""
        periods = report.hold_limit / (self._servo.period_ns * 1e-9)
        message = (
            f"hold limit {periods:.3g} periods on average, {report.overruns} overruns,"
            f" {report.refused_readings} refused readings"
        )
        if report.crowded_writes:
            message += f", {report.crowded_writes} forces zero behind others that did not act yet"
        if report.largest_allowance:
            repaid = "repaid" if report.allowance_repaid else "not repaid"
            message += f", late holds can have leaked {report.largest_allowance:.2g} J, {repaid}"
        if report.fast_holds:
            message += (
                f", device.hand_speed exceeded in {report.fast_holds} holds, which can have leaked"
                f" {report.speed_leak:.2g} J"
            )
        return self._log.emit(time_ns, BOUNDER_REPORTED, message, report.as_texts())

    def _answers(self, time_ns: int) -> Event:
        if self.is_answered:
            message = "replies received; ramping force up"
            return self._log.emit(time_ns, "force_engages", message, self._about)
        limit = self._servo.age_limit * 1e3
        message = f"no answer younger than the age limit of {limit:g} ms: zero force"
        return self._log.emit(time_ns, "force_released", message, is_fault=True)

    def _refusals(self, time_ns: int) -> Event:
        message = (
            f"refused readings so far: {self.refused}; they are not finite, faster than"
            " device.largest_speed (look at the encoder, its cable and the unit of its positions),"
            " or too soon after another, as after a late tick"
        )
        data = {"refused": str(self.refused)}
        return self._log.emit(time_ns, "readings_refused", message, data, is_fault=True)


class Overload:
    """The warning that a servo misses many ticks: device or machine is too slow, or too busy."""

    def __init__(self, period_ns: int) -> None:
        self._ticks, self._period_ns = WINDOW_NS / period_ns, period_ns
        self.is_of_device = False  # the last warning
        self.end_ns = 0  # of the window; 0: none has begun
        self._missed_before = self._of_device_before = 0
        self._next_warning_ns = 0

    def observe(
        self, time_ns: int, missed: int, of_device: int = 0, busy: float = 0.0
    ) -> str | None:
        """Return a warning if many ticks of the last second were ``missed``; else None."""
        end_ns = self.end_ns
        if time_ns < end_ns:
            return None
        lately = missed - self._missed_before
        self.end_ns = time_ns + WINDOW_NS
        self.is_of_device = 2 * (of_device - self._of_device_before) > lately
        self._missed_before, self._of_device_before = missed, of_device
        if end_ns == 0 or lately <= SHARE * self._ticks or time_ns < self._next_warning_ns:
            return None
        self._next_warning_ns = time_ns + REPEAT_NS
        cause = (
            "something else uses this core, or the servo has no realtime scheduling;"
            " `forcebound doctor` names the cause"
        )
        if self.is_of_device:
            cause = (
                f"the device's own reads and writes take {1e3 * busy:.2g} ms of a period of"
                f" {1e-6 * self._period_ns:.2g} ms on average, and more then;"
                " `forcebound check device` says which device.rate they permit"
            )
        return (
            f"missed {lately} of {self._ticks:.0f} ticks in the last second, so there is little"
            f" force: {cause}"
        )
