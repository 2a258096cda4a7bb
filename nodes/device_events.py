"""Events of the device node: answers, refused readings, missed ticks, the law, the bounder."""

from collections.abc import Mapping

from forcebound.messages.control import BounderReport
from forcebound.messages.packets import Event, Packet
from forcebound.nodes.events import BOUNDER_REPORTED, LAW_CHANGED, STATE_INTERVAL_NS, EventLog
from forcebound.nodes.overload import Overload
from forcebound.nodes.servo import ServoSettings

REFUSAL_INTERVAL_NS = 1_000_000_000  # between two events about refused readings


class DeviceEvents:
    """Events of the ticks of a device node, limited in rate.

    ``about``: data of the device, which a recording must hold wherever a ledger begins.
    """

    def __init__(
        self, log: EventLog, servo: ServoSettings, about: Mapping[str, str] | None = None
    ) -> None:
        self._log, self._servo, self._about = log, servo, about or {}
        self._is_answered = False
        self._next_answer_ns = 0
        self._refused = 0
        self._next_refusal_ns = 0
        self._overload = Overload(servo.period_ns)

    def look(self, time_ns: int, is_answered: bool, refused: int, missed: int) -> list[Packet]:
        """Return the events after a tick with an engaged force.

        It takes whether an answer gives the force, and readings refused and ticks missed so far.
        """
        events: list[Packet] = []
        if self._is_answered != is_answered and time_ns >= self._next_answer_ns:
            self._is_answered, self._next_answer_ns = is_answered, time_ns + STATE_INTERVAL_NS
            events.append(self._tell_answers(time_ns))
        if refused > self._refused and time_ns >= self._next_refusal_ns:
            self._refused, self._next_refusal_ns = refused, time_ns + REFUSAL_INTERVAL_NS
            events.append(self._tell_refusals(time_ns))
        warning = self._overload.observe(time_ns, missed)
        if warning is not None:
            events.append(self._log.emit(time_ns, "ticks_missed", warning, is_fault=True))
        return events

    def tell_law(
        self, time_ns: int, law: str, before: tuple[str, float, float] | None = None
    ) -> Event:
        """Return the event of another law; the ticks that its loading has cost are no news.

        ``before`` is of a simulated device: the law before, the true energy under it, and
        ``energy_before`` of the status, in J.
        """
        self._overload = Overload(self._servo.period_ns)
        message, data = f"law: {law} from now on", {"law": law, **self._about}
        if before is not None:
            former, given, energy = before
            has = "has put in" if given >= 0.0 else "has received"
            message += f"; under {former} the hand {has} {1e3 * abs(given):.1f} mJ"
            data["energy_before"] = repr(energy)
        return self._log.emit(time_ns, LAW_CHANGED, message, data)

    def tell_bounder(self, time_ns: int, report: BounderReport) -> Event:
        """Return the event of a report."""
        periods = report.hold_limit / (self._servo.period_ns * 1e-9)
        message = (
            f"hold limit {periods:.3g} periods on average, {report.overruns} overruns,"
            f" {report.refused_readings} refused readings"
        )
        if report.largest_allowance:
            repaid = "repaid" if report.allowance_repaid else "not repaid"
            message += f", late holds can have leaked {report.largest_allowance:.2g} J, {repaid}"
        return self._log.emit(time_ns, BOUNDER_REPORTED, message, report.as_texts())

    def _tell_answers(self, time_ns: int) -> Event:
        if self._is_answered:
            message = "replies received; ramping force up"
            return self._log.emit(time_ns, "force_engages", message, self._about)
        limit = self._servo.age_limit * 1e3
        message = f"no answer younger than the age limit of {limit:g} ms: zero force"
        return self._log.emit(time_ns, "force_released", message, is_fault=True)

    def _tell_refusals(self, time_ns: int) -> Event:
        message = (
            f"refused readings so far: {self._refused}; they are not finite, too soon after"
            " another, or faster than device.largest_speed: look at the encoder and its cable"
        )
        data = {"refused": str(self._refused)}
        return self._log.emit(time_ns, "readings_refused", message, data, is_fault=True)
