"""What a run shows in numbers: stiffness, energy, timing, and whether the hand came to rest.

Every function takes the telemetry as columns and the launch file as resolved for the run. For
stiffness, force and delay only samples with an engaged force count. *In contact* is a sample whose
reading lies behind the environment's surface. A result that the run or the launch file does not
define is ``None``, never NaN, so that a summary is always valid JSON.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.errors import ConfigError
from forcebound.messages.packets import Event
from forcebound.nodes.events import LINK_COUNTED, PHASE_BEGINS
from forcebound.recording import TelemetryColumns

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Mask: TypeAlias = NDArray[np.bool_]

STEADY_WINDOW = (2.0, 5.0)  # s after engagement; paper, section 4.2
STEADY_SHARE = 0.4  # of a run that ends before the steady window does: its last part
RATE_WINDOW = 0.010  # s after first contact, for "initial" in Eq. 34; long enough to average the
#                      encoder's steps, short against the 50 ms in which a hand is slowed down
RATE_SAMPLES = 3  # fewest from which a slope is taken, also if they take longer
REVERSAL_EXCURSION = 1e-4  # m, hysteresis of a turning point: three steps of a 0.03 mm encoder
REST_WINDOW = 0.5  # s at the end of the run
REST_SPEED = 1e-3  # m/s, RMS; a hand slower than this over the rest window is at rest
UNBOUNDED = 1.0 - 1e-9  # of the force asked: below, it was made smaller, not merely rounded

SURFACE_KEYS = (
    "displayed_stiffness_n_per_m",
    "rate_hardness_n_per_m",
    "peak_penetration_m",
    "contact_reversals",
    "penetration_at_rest_m",
)  # results that need an environment with a surface

UNDEFINED = "–"


@dataclass(frozen=True)
class Surface:
    """Where the environment of a run begins."""

    position: float  # m
    axis: int
    stiffness: float | None  # N/m; None where the environment has no constant one


def surface(config: Mapping[str, Any]) -> Surface | None:
    """Return the surface that the launch file describes; None for an environment without one.

    In a user's own environment (``kind: my_file.py``) a parameter of these names may be something
    else, such as a centre: what is no number is no surface.

    Args:
        config: The launch file as resolved for the run; reads ``environment``.

    Raises:
        ConfigError: If position, stiffness or axis are not plain SI numbers.
    """
    environment = config.get("environment") or {}
    if ".py" in str(environment.get("kind")):
        environment = {k: v for k, v in environment.items() if isinstance(v, int | float)}
    position = _number(environment, "position", "m")
    if position is None:
        return None
    axis = _number(environment, "axis", "a whole number") or 0
    return Surface(position, int(axis), _number(environment, "stiffness", "N/m"))


def _number(environment: Mapping[str, Any], key: str, unit: str) -> float | None:
    value = environment.get(key)
    if value is not None and not isinstance(value, int | float):
        raise ConfigError(f"environment.{key} must be a number ({unit}), got {value!r}")
    return value


def law(config: Mapping[str, Any]) -> str | None:
    """Return the name of the bounding law of the run, if the launch file says it."""
    name = (config.get("device") or {}).get("law")
    return None if name is None else str(name)


def penetration(columns: TelemetryColumns, wall: Surface) -> Floats:
    """Return how deep the reading lies behind the surface, in m, shape ``(n,)``; outside: < 0.

    Raises:
        ConfigError: If the run has no such axis.
    """
    axes = columns.position.shape[1]
    if not 0 <= wall.axis < axes:
        raise ConfigError(f"environment.axis is {wall.axis}, but the run has {axes} axes, from 0")
    return columns.position[:, wall.axis] - wall.position


def displayed_stiffness(time: Floats, force: Floats, depth: Floats) -> float | None:
    r"""Return the stiffness that the hand feels in the steady state, in N/m.

    .. math:: S_D = \operatorname{mean} \frac{F_d}{x_p}

    over the samples in contact from 2 to 5 s after the force engaged. A run that ends earlier has
    no such window: there its last 40 % count.

    Args:
        time: Time since the force engaged, in s, shape ``(n,)``.
        force: Applied force along the surface's normal, in N, same shape.
        depth: Penetration, in m, same shape.

    Returns:
        Stiffness, in N/m; None without contact in the window. Means little for a hand that is
        thrown about: a shallow sample with a late force weighs as much as a deep one.

    Source: the enhanced force bounding paper, 2017, Eq. 33 and section 4.2.
    """
    start, end = STEADY_WINDOW
    if time.size and time[-1] < end:
        start, end = time[-1] * (1.0 - STEADY_SHARE), time[-1]
    steady = (time >= start) & (time <= end) & (depth > 0.0)
    return float(np.mean(force[steady] / depth[steady])) if steady.any() else None


def rate_hardness(time: Floats, force: Floats, depth: Floats) -> float | None:
    r"""Return how crisp the first contact is, in N/m.

    .. math:: H_R = \frac{\text{initial rate of change of force}}{\text{initial velocity of
              penetration}}

    Both are least-squares slopes against time over the first 10 ms of the first contact, or its
    first three samples where the rate is low. The paper does not state its window. A wall whose
    answer comes later than that has a rate hardness of 0: at first there is nothing to feel.

    Args:
        time: Time, in s, shape ``(n,)``.
        force: Applied force along the surface's normal, in N, same shape.
        depth: Penetration, in m, same shape.

    Returns:
        Rate hardness, in N/m; None without a contact of three samples, or if the hand does not
        move inwards in it.

    Source: Lawrence et al., Rate-hardness: a new performance metric for haptic interfaces, IEEE
    Transactions on Robotics and Automation 16(4), 2000; the paper, 2017, Eq. 34.
    """
    contact = depth > 0.0
    if not contact.any():
        return None
    first = int(np.argmax(contact))
    leaves = np.flatnonzero(~contact[first:])
    length = int(leaves[0]) if leaves.size else contact.size - first
    if length < RATE_SAMPLES:
        return None
    # Half a nanosecond: stamps are whole nanoseconds, and the sample at 10 ms exactly belongs in.
    wanted = int(np.searchsorted(time[first:], time[first] + RATE_WINDOW + 5e-10))
    window = slice(first, first + min(length, max(wanted, RATE_SAMPLES)))
    velocity = _slope(time[window], depth[window])
    return _slope(time[window], force[window]) / velocity if velocity > 0.0 else None


def initial_rate_hardness(force: Floats, depth: Floats) -> float | None:
    r"""Return the rate hardness of the very first contact, as the paper's Table 1 has it, in N/m.

    .. math:: H_R = \frac{F(c+1) - F(c-1)}{q(c+1) - q(c-1)}

    the central difference about the first sample c behind the surface: two sampling periods, from
    the last sample in free motion on. :func:`rate_hardness` looks at 10 ms and so at what the hand
    feels, also behind a delay; this looks at the law alone, before the hand can answer it. The
    paper states no window. Its numbers need this one: a saturated viscous bound grows by 2B times
    the *whole* move of the sample that enters the wall, so only a difference that begins before
    the surface gives 2B exactly; and a wall that nothing bounds yet shows less than its own
    stiffness by the part of that move that lay before the surface, as the 7.87 to 8.25 of
    10 N/mm in the paper's table.

    Args:
        force: Applied force along the surface's normal, in N, shape ``(n,)``.
        depth: Penetration of the reading, negative before the surface, in m, same shape.

    Returns:
        Rate hardness, in N/m; None without a contact of two samples that begins in the run, or if
        the hand does not move inwards in it.

    Source: Lawrence et al. 2000; the paper, 2017, Eq. 34.
    """
    contact = depth > 0.0
    first = int(np.argmax(contact))
    if first == 0 or not contact[first : first + 2].all() or first + 1 >= contact.size:
        return None
    move = float(depth[first + 1] - depth[first - 1])
    return float(force[first + 1] - force[first - 1]) / move if move > 0.0 else None


def _slope(time: Floats, values: Floats) -> float:
    centred = time - time.mean()
    return float(centred @ values / (centred @ centred))


def count_reversals(position: Floats, excursion: float = REVERSAL_EXCURSION) -> int:
    """Return how often a motion that begins inwards turns round.

    A turning point counts when the position has come back from it by more than ``excursion``, so
    the steps of an encoder do not count.

    Args:
        position: Position from the first contact on, in m, shape ``(n,)``.
        excursion: In m.
    """
    reversals = 0
    direction = 1.0
    extreme = -np.inf  # furthest point in this direction so far
    for value in position.tolist():
        travelled = direction * value
        if travelled > extreme:
            extreme = travelled
        elif extreme - travelled > excursion:
            reversals += 1
            direction = -direction
            extreme = -travelled
    return reversals


def final_speed(time: Floats, true_position: Floats) -> float | None:
    """Return the RMS speed over the last 0.5 s, in m/s.

    Args:
        time: Time, in s, shape ``(n,)``.
        true_position: Unquantised position, in m, shape ``(n, axes)``; NaN where unknown. A
            reading would not do: one 0.03 mm step in a 1 ms sample is 30 mm/s.

    Returns:
        Speed, in m/s; None without ground truth or with fewer than two samples.
    """
    last = time >= (time[-1] if time.size else 0.0) - REST_WINDOW
    if np.count_nonzero(last) < 2:
        return None
    velocity = np.diff(true_position[last], axis=0) / np.diff(time[last])[:, np.newaxis]
    speed = float(np.sqrt(np.mean(np.sum(velocity**2, axis=1))))
    return speed if np.isfinite(speed) else None


def summarize(columns: TelemetryColumns, config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the results of a run, ready for JSON.

    Args:
        columns: Telemetry of the run.
        config: The launch file as resolved for the run, in SI numbers; of its keys
            ``device.law``, ``.rate``, ``.hold_limit`` and ``environment.position``, ``.axis`` are
            read, and those results that need a missing one are None.

    Returns:
        By key, SI units as the key says:

        * ``law``; ``samples``, ``duration_s``: since the force engaged for the first time
        * ``displayed_stiffness_n_per_m``, ``rate_hardness_n_per_m``: the functions above
        * ``peak_force_n``, ``peak_penetration_m``: largest applied force, deepest reading
        * ``true_energy_min_j``, ``estimated_energy_min_j``: least value since engagement, of the
          simulated device's ground truth and of the law's own ledger
        * ``bounder_active_share``: share of samples in contact in which less force was applied
          than asked; in an environment without a surface, of the samples in which force was asked
        * ``answered_share``: :func:`answered_share`
        * ``own_tick_share``: share of samples whose force answers the state of their own tick
        * ``loop_delay_ms``: ``p50``, ``p99``, ``max``
        * ``deadline_misses``: ticks skipped; ``late_writes``: :func:`late_writes`
        * ``rejected_packets`` by reason: at the end of the run
        * ``contact_reversals``: :func:`count_reversals` of the reading after first contact
        * ``final_speed_m_per_s``, ``at_rest``, ``penetration_at_rest_m``: over the last 0.5 s; the
          last is the mean depth there, None if the hand is not known to be at rest

    Raises:
        ConfigError: If the launch file describes a surface that the run cannot have had.
    """
    engaged = columns.engagement > 0.0
    time = columns.time[engaged]
    asked = np.linalg.norm(columns.commanded_force[engaged], axis=1)
    applied = np.linalg.norm(columns.applied_force[engaged], axis=1)
    speed = final_speed(time, columns.true_position[engaged])
    at_rest = None if speed is None else speed < REST_SPEED
    contact = asked > 0.0
    at_surface: dict[str, Any] = dict.fromkeys(SURFACE_KEYS)
    wall = surface(config)
    if wall is not None:
        depth = penetration(columns, wall)[engaged]
        contact = depth > 0.0
        force = columns.applied_force[engaged, wall.axis]
        at_surface = _at_surface(time, force, depth, at_rest is True)
    since_engaged = columns.time >= 0.0 if time.size else engaged
    return {
        "law": law(config),
        "samples": int(np.count_nonzero(since_engaged)),
        "duration_s": float(np.ptp(columns.time[since_engaged])) if time.size else None,
        **at_surface,
        "peak_force_n": _or_none(np.max, applied),
        "true_energy_min_j": _or_none(np.min, columns.true_energy[since_engaged]),
        "estimated_energy_min_j": _or_none(np.min, columns.estimated_energy[since_engaged]),
        "bounder_active_share": _or_none(np.mean, (applied < UNBOUNDED * asked)[contact]),
        "answered_share": answered_share(columns) if time.size else None,
        "own_tick_share": _or_none(np.mean, (columns.device_seq == columns.seq)[engaged]),
        "loop_delay_ms": _delays(columns.loop_delay[engaged]),
        "deadline_misses": _misses(columns.deadline_misses, since_engaged),
        "late_writes": late_writes(columns, config),
        "rejected_packets": dict(sorted(columns.rejected.items())),
        "final_speed_m_per_s": speed,
        "at_rest": at_rest,
    }


def _misses(counts: Ints, since_engaged: Mask) -> int | None:
    """Ticks missed since the force engaged; while the processes start, nobody holds anything."""
    if not counts.size:
        return None
    before = counts[~since_engaged]
    return int(counts[-1] - (before[-1] if before.size else 0))


def late_writes(columns: TelemetryColumns, config: Mapping[str, Any]) -> int | None:
    """Return how often the next force came later than the motor holds one, since it engaged.

    Then the motor's watchdog has dropped the force to zero, and the certified laws pay for what
    they do not know of that time. A tick that was skipped makes one late write; a tick that was
    only late may make one, too, and is no deadline miss.

    Args:
        columns: Telemetry of the run.
        config: The launch file as resolved for the run; reads ``device.rate``, ``.hold_limit``.

    Returns:
        Their number; None if the launch file does not say the limit, or the force never engaged.
    """
    device = config.get("device") or {}
    if "rate" not in device or "hold_limit" not in device or not (columns.engagement > 0.0).any():
        return None
    limit_ns = round(device["hold_limit"] * 1e9 / device["rate"])
    return int(np.count_nonzero(np.diff(columns.time_ns[columns.time >= 0.0]) > limit_ns))


def _at_surface(time: Floats, force: Floats, depth: Floats, at_rest: bool) -> dict[str, Any]:
    in_contact = np.flatnonzero(depth > 0.0)
    touched = depth[in_contact[0] :] if in_contact.size else depth[:0]
    last = time >= (time[-1] if time.size else 0.0) - REST_WINDOW
    results = (
        displayed_stiffness(time, force, depth),
        rate_hardness(time, force, depth),
        max(float(depth.max()), 0.0) if depth.size else None,
        count_reversals(touched) if depth.size else None,
        _or_none(np.mean, depth[last]) if at_rest else None,
    )
    return dict(zip(SURFACE_KEYS, results, strict=True))


def _or_none(statistic: Callable[[Any], Any], values: NDArray[Any]) -> float | None:
    known = values[np.isfinite(values)]
    return float(statistic(known)) if known.size else None


def _delays(delays: Floats) -> dict[str, float | None]:
    milliseconds = delays * 1e3
    return {
        "p50": _or_none(lambda known: np.percentile(known, 50), milliseconds),
        "p99": _or_none(lambda known: np.percentile(known, 99), milliseconds),
        "max": _or_none(np.max, milliseconds),
    }


def answered_share(columns: TelemetryColumns) -> float | None:
    """Return the share of ticks whose state was answered by a force, sooner or later, 0 to 1.

    What is missing was lost, or overtaken by a newer answer. The last ticks of a run are still
    waiting for theirs, so a run with a long delay has a little less than 1.
    """
    since_engaged = columns.elapsed > 0.0
    ticks = columns.seq[since_engaged]
    if not ticks.size:
        return None
    answered = np.unique(columns.device_seq[since_engaged])
    return float(np.count_nonzero(answered >= ticks[0])) / ticks.size


def summarize_phases(
    columns: TelemetryColumns, events: Sequence[Event], config: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """Return the results of each phase of a scripted run, ready for JSON.

    Args:
        columns: Telemetry of the run.
        events: Of the run; they tell when a phase began.
        config: The launch file as resolved for the run.

    Returns:
        By phase: ``name``, ``start_s`` (since the force engaged), ``duration_s`` as it was,
        ``answered_share``, ``force_share`` (of samples with an engaged force), and, as
        :func:`summarize` has them, ``loop_delay_ms``, ``peak_force_n``, ``true_energy_min_j``,
        ``deadline_misses``.
    """
    begins = [event for event in events if event.event == PHASE_BEGINS]
    found = []
    for event, following in zip_longest(begins, begins[1:]):
        end_ns = 2**63 - 1 if following is None else following.time_ns
        here = (columns.time_ns >= event.time_ns) & (columns.time_ns < end_ns)
        if not here.any():
            continue
        part = columns.slice(here)
        figures = summarize(part, config)
        kept = ("loop_delay_ms", "peak_force_n")
        found.append(
            {
                "name": event.data.get("name", ""),
                "start_s": float(part.elapsed[0]),
                "duration_s": float(part.elapsed[-1] - part.elapsed[0]),
                "answered_share": answered_share(part),
                "force_share": float(np.mean(part.engagement > 0.0)),
                **{name: figures[name] for name in kept},
                "true_energy_min_j": _or_none(np.min, part.true_energy),
                "deadline_misses": int(part.deadline_misses[-1] - part.deadline_misses[0]),
            }
        )
    return found


def phase_rows(phases: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """Return a table of phases in everyday units, its head first; delays are p50/p99/max."""
    rows: list[tuple[str, ...]] = [
        ("phase", "delay, ms", "answered", "force on", "peak force", "least energy")
    ]
    for phase in phases:
        delays = phase["loop_delay_ms"]
        delay = "/".join(_quantity(delays[key], "", 1.0, 1) for key in ("p50", "p99", "max"))
        rows.append(
            (
                phase["name"],
                delay,
                _quantity(phase["answered_share"], "%", 1e2, 1),
                _quantity(phase["force_share"], "%", 1e2, 1),
                _quantity(phase["peak_force_n"], "N", 1.0, 2),
                _quantity(phase["true_energy_min_j"], "mJ", 1e3, 2),
            )
        )
    return rows


def summarize_events(events: Sequence[Event]) -> dict[str, Any]:
    """Return what a run's events add to its results, ready for JSON.

    Returns:
        * ``faults``: how often each kind of fault happened; an event may stand for several
        * ``links``: by topic of an impaired link, how many packets had which fate
    """
    faults: Counter[str] = Counter()
    for event in events:
        if event.is_fault:
            faults[event.event] += 1 + int(event.data.get("suppressed", 0))
    links: dict[str, dict[str, int]] = {}
    for event in events:
        if event.event == LINK_COUNTED:  # a process that was started anew counted anew
            counts = links.setdefault(event.data["link"], {})
            for fate, count in event.data.items():
                if fate != "link":
                    counts[fate] = counts.get(fate, 0) + int(count)
    return {"faults": dict(sorted(faults.items())), "links": links}


def summary_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return a summary as rows of label and value in everyday units (N/mm, mm, mJ, ms).

    A value that is None shows as a dash. The labels do not depend on the run, so the rows of
    several runs go side by side into one table.
    """

    def show(key: str, unit: str, factor: float = 1.0, digits: int = 2) -> str:
        return _quantity(summary[key], unit, factor, digits)

    delays = summary["loop_delay_ms"]
    delay = "/".join(_quantity(delays[key], "", 1.0, 2) for key in ("p50", "p99", "max"))
    rejected = [f"{count} {why}" for why, count in summary["rejected_packets"].items() if count]
    faults = [f"{count} {kind}" for kind, count in summary.get("faults", {}).items()]
    lost = [
        f"{counts['lost'] + counts['corrupted']} of {counts['sent']} {topic}"
        for topic, counts in summary.get("links", {}).items()
        if counts["lost"] + counts["corrupted"]
    ]
    return [
        ("law", summary["law"] or UNDEFINED),
        ("duration", show("duration_s", "s")),
        ("samples", show("samples", "", digits=0)),
        ("displayed stiffness", show("displayed_stiffness_n_per_m", "N/mm", 1e-3)),
        ("rate hardness", show("rate_hardness_n_per_m", "N/mm", 1e-3)),
        ("peak force", show("peak_force_n", "N")),
        ("peak penetration", show("peak_penetration_m", "mm", 1e3)),
        ("turns after contact", show("contact_reversals", "", digits=0)),
        ("speed at the end", show("final_speed_m_per_s", "mm/s", 1e3)),
        ("penetration at rest", show("penetration_at_rest_m", "mm", 1e3)),
        ("least true energy", show("true_energy_min_j", "mJ", 1e3)),
        ("least estimated energy", show("estimated_energy_min_j", "mJ", 1e3)),
        ("bounder active", show("bounder_active_share", "%", 1e2, 1)),
        ("ticks answered", show("answered_share", "%", 1e2, 1)),
        ("own tick answered", show("own_tick_share", "%", 1e2, 1)),
        ("loop delay p50/p99/max", UNDEFINED if delays["p50"] is None else f"{delay} ms"),
        ("deadline misses", show("deadline_misses", "", digits=0)),
        ("late writes", show("late_writes", "", digits=0)),
        ("rejected packets", ", ".join(rejected) or "0"),
        ("lost or damaged", ", ".join(lost) or "0"),
        ("faults", ", ".join(faults) or "0"),
    ]


def _quantity(value: float | None, unit: str, factor: float, digits: int) -> str:
    if value is None:
        return UNDEFINED
    # Adding zero turns a rounded -0.0 into 0.0: "-0.00 mJ" would read as a leak.
    return f"{round(value * factor, digits) + 0.0:.{digits}f} {unit}".rstrip()
