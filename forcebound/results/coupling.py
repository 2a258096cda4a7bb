"""Figures of hands that share a graph: energy together; of leader and follower, transparency.

Samples of all hands are compared at the times of the first one, while the force of each is engaged.
"""

from collections.abc import Callable, Iterator, Mapping
from operator import itemgetter
from typing import Any

import numpy as np

from forcebound.axes import AxisKind, at_lever, common_kind, shown_on
from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound.messages.topology import Document
from forcebound.recordings.launched import launched
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.cells import Summary
from forcebound.results.contact import (
    REST_SPEED,
    displayed_stiffness,
    final_speed,
    rms,
    says_something,
)
from forcebound.results.surface import Floats
from forcebound.units import MM, N_MM, N, energy_in_words

_LAST = itemgetter(-1)
APART = 0.005  # m, between leader and follower at the start, where nothing is said


def coupling(runs: Mapping[str, TelemetryColumns], documents: Mapping[str, Document]) -> Summary:
    """Return the figures of a run of several hands; None for one that is missing.

    Args:
        runs: Telemetry of each hand, by its name.
        documents: The launch file as resolved for each hand, in SI numbers.
    """
    shared = _shared(runs)
    figures = _energies(shared)
    environment = next(iter(documents.values())).get("environment", {})
    if environment.get("kind") == "coupling":
        leads, follows = environment["leader"], environment["follower"]
        if leads in runs and follows in runs:
            met = documents[follows].get("operator", {})
            if documents[follows].get("device", {}).get("space") == "joints":
                met = {}  # its wall is at the tip
            axes = launched(documents[follows]).axes
            figures |= _transparency(shared[leads], shared[follows], environment, met)
            kind = axes[0].kind if axes else "length"
            figures |= _felt(runs[leads], figures, at_lever(REST_SPEED, "m/s", kind))
            if axes:
                figures["axes"] = {axis.name: axis.kind for axis in axes}
            if common_kind(axes) is None:  # lengths and angles have no common size
                sizes = ("position_error_rms_m", "position_error_peak_m", "position_error_start_m")
                figures |= dict.fromkeys((*sizes, "force_error_rms_n", "force_error_peak_n"))
    return figures


def coupling_lines(figures: Summary) -> Iterator[str]:
    """Yield the figures in words, a line for each matter."""
    lowest = figures["energy_min_j"]
    if lowest is not None and lowest >= -ENERGY_TOLERANCE:
        yield "Together: passive; the devices never gave more energy than they got."
    elif lowest is not None:
        got = energy_in_words(-lowest)
        yield f"Together: not passive; the devices gave up to {got} more than they got."
    net = figures["net_given_energy_j"].items()
    if given := [f"{energy_in_words(one)} from {hand}" for hand, one in net if one and one > 0.0]:
        yield f"Together: net energy transfer of {', '.join(given)}."
    if "position_error_rms_m" not in figures:
        return
    first: AxisKind = next(iter(figures.get("axes", {}).values()), "length")
    way, push, stiffness = (shown_on(first, unit) for unit in (MM, N, N_MM))
    error, peak = (figures[f"position_error_{kind}_m"] for kind in ("rms", "peak"))
    if error is not None:
        words = f"Together: the follower was off by {way.show(error)} RMS, {way.show(peak)} at most"
        force = figures["force_error_rms_n"]
        yield f"{words}{'' if force is None else f'; forces differ by {push.show(force)} RMS'}."
    start = figures["position_error_start_m"]
    if start is not None and start > at_lever(APART, "m", first):
        words = f"Together: they began {way.show(start)} apart, so the follower was pulled there"
        yield f"{words}; `offset` or a clutch couples them where they are."
    felt, moved = figures["transmitted_stiffness_n_per_m"], figures["leader_at_rest"] is False
    if felt is None and moved and figures["follower_stiffness_n_per_m"] is not None:
        yield "Together: what the leader feels is not known: it moved until the end."
    elif felt is not None:
        words = f"Together: the leader feels {stiffness.show(felt)}; the follower's wall has"
        series = figures["series_stiffness_n_per_m"]
        behind = "" if series is None else f", behind the coupling {stiffness.show(series)}"
        mean = " The leader's is a mean, since it moved until the end." if moved else ""
        yield f"{words} {stiffness.show(figures['follower_stiffness_n_per_m'])}{behind}.{mean}"


def _shared(runs: Mapping[str, TelemetryColumns]) -> dict[str, dict[str, Floats]]:
    """Return some columns of each hand at the same times; empty ones if they share none."""
    engaged = {hand: run.slice(run.engagement > 0.0) for hand, run in runs.items()}
    first = next(iter(engaged.values()))
    times = first.time_ns
    for run in engaged.values():
        ends = (run.time_ns[0], run.time_ns[-1]) if run.time_ns.size else (1, 0)
        times = times[(times >= ends[0]) & (times <= ends[1])]
    if not times.size:
        engaged = {hand: run.slice(run.time_ns < 0) for hand, run in engaged.items()}
    found = {}
    for hand, run in engaged.items():
        position = run.true_position if np.isfinite(run.true_position).all() else run.position
        vectors = {"x": position, "hand": run.hand_force, "motor": run.applied_force}
        totals = {
            "energy": run.true_energy,
            "given": run.given_energy,
            "received": run.received_energy,
        }
        found[hand] = {"time": (times - (times[0] if times.size else 0)) * 1e-9}
        for name, value in (vectors | totals).items():
            rows = value.T if name in vectors else [value]
            columns = [np.interp(times, run.time_ns, row) if times.size else row for row in rows]
            found[hand][name] = np.stack(columns, axis=1) if name in vectors else columns[0]
    return found


def _energies(shared: Mapping[str, Mapping[str, Floats]]) -> Summary:
    together = np.sum([one["energy"] for one in shared.values()], axis=0)
    net = {hand: one["given"] - one["received"] for hand, one in shared.items()}
    with_partner = {hand: one["energy"] - net[hand] for hand, one in shared.items()}
    return {
        "energy_end_j": {hand: _or_none(_LAST, one["energy"]) for hand, one in shared.items()},
        "energy_min_j": _or_none(np.min, together),
        "given_energy_j": {hand: _or_none(_LAST, one["given"]) for hand, one in shared.items()},
        "net_given_energy_j": {hand: _or_none(_LAST, one) for hand, one in net.items()},
        "energy_with_partner_min_j": {h: _or_none(np.min, one) for h, one in with_partner.items()},
    }


def _transparency(
    leader: Mapping[str, Floats],
    follower: Mapping[str, Floats],
    environment: Document,
    wall: Document,
) -> Summary:
    """Return errors of position and force, and the stiffness that the leader feels.

    Position errors are at the follower, force errors at the leader. With a clutch the offset is
    another after each use, and no position is known to be right.
    """
    axes = min(leader["x"].shape[1], follower["x"].shape[1])
    ratios = environment["force_scale"]
    ratios = environment["scale"] if ratios is None else ratios
    scale, ratio = (np.broadcast_to(one, axes) for one in (environment["scale"], ratios))
    offset = np.zeros(axes)
    given = list(environment["offset"])[:axes]
    offset[: len(given)] = given
    place = scale * leader["x"][:, :axes] + offset  # of the follower, if it follows exactly
    if environment["clutch"] is not None:
        place = np.full_like(place, np.nan)
    error = np.linalg.norm(follower["x"][:, :axes] - place, axis=1)
    contact = -follower["hand"][:, :axes]  # of the follower on what it touches
    difference = np.linalg.norm(leader["hand"][:, :axes] - ratio * contact, axis=1)
    felt = behind = known = None
    gaps = _of_axes(wall.get("gap"), axes)
    crossed = [axis for axis in range(axes) if gaps[axis] is not None]
    if wall.get("kind") == "wall" and wall["stiffness"] > 0.0 and place.size and crossed:
        axis = crossed[0]  # across which there is a wall
        side, start = np.copysign(1.0, gaps[axis]), _of_axes(wall["start"], axes)[axis] or 0.0
        way, touched = (side * (at[:, axis] - start - gaps[axis]) for at in (place, follower["x"]))
        depth = np.where(touched > 0.0, way, 0.0)  # a follower that is not there shows no wall
        push = side * scale[axis] * leader["motor"][:, axis]
        felt = displayed_stiffness(leader["time"], push, depth)
        turned = float(ratio[axis] * scale[axis])
        known = turned * float(wall["stiffness"])
        own = turned * float(np.broadcast_to(environment["stiffness"], axes)[axis])
        if environment["architecture"] != "four_channel":
            behind = own * known / (own + known) if own > 0.0 else 0.0
    return {
        "position_error_rms_m": _or_none(rms, error),
        "position_error_peak_m": _or_none(np.max, error),
        "position_error_start_m": _or_none(itemgetter(0), error),
        "force_error_rms_n": _or_none(rms, difference),
        "force_error_peak_n": _or_none(np.max, difference),
        "transmitted_stiffness_n_per_m": felt,
        "follower_stiffness_n_per_m": known,
        "series_stiffness_n_per_m": behind,
    }


def _felt(leader: TelemetryColumns, figures: Summary, slow: float) -> Summary:
    """Return whether the leader is at rest, slower than ``slow``, and what it feels if known."""
    speed = final_speed(leader.time, leader.true_position)
    is_at_rest = None if speed is None else speed < slow
    felt, asked = (figures[f"{one}_stiffness_n_per_m"] for one in ("transmitted", "series"))
    asked = figures["follower_stiffness_n_per_m"] if asked is None else asked
    is_known = felt is None or says_something(felt, asked, is_at_rest)
    known = {} if is_known else {"transmitted_stiffness_n_per_m": None}
    return {"leader_at_rest": is_at_rest, **known}


def _of_axes(value: Any, axes: int) -> list[Any]:
    """Return a number of the first axis, or a list of one for each, as long as the axes."""
    return ([*value] if isinstance(value, list) else [value]) + [None] * axes


def _or_none(statistic: Callable[[Floats], Any], values: Floats) -> float | None:
    """Return a statistic of samples; None without samples, or if one is unknown."""
    known = values.size and np.isfinite(values).all()
    return float(statistic(values)) if known else None
