"""One run of an audit again, by its name: as a document, as lines, as a picture."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from forcebound.errors import ConfigError
from forcebound.lab.engine import Row
from forcebound.results.plots import check_picture, save
from forcebound_proofs.law_cases import ADVERSARIES, SENSORS, case_of
from forcebound_proofs.law_run import SECONDS, TRACE_COLUMNS, attack
from forcebound_proofs.paths.campaign import replay as replay_path
from forcebound_proofs.paths.run import TRACE_COLUMNS as PATH_COLUMNS
from forcebound_proofs.worlds import replay as replay_world

_NUMBERS = {
    "kg": "mass hand_mass",
    "N s/m": "damping hand_damping environment_damping",
    "N": "friction saturation magnitude weight weight_error",
    "N/m": "hand_stiffness stiffness",
    "m": "resolution amplitude surface presliding pressing sideways",
    "s": "hold_limit period lag write_delay watchdog_limit guard_period lateness write_jitter"
    " link_delay delay_jitter",
    "Hz": "slow fast frequency late_rate",
    "J": "allowance energy_cap",
    "m/s": "largest_speed",
    "periods": "jitter excess_hold",
}
#: Units of the numbers of a case; those of a result end in theirs.
UNITS = {name: unit for unit, names in _NUMBERS.items() for name in names.split()}


def run_again(law: str, case: str, seconds: float | None, picture: Path | None) -> Row:
    """Repeat a case, draw it on request, and return its description and result.

    Args:
        law: A key of :data:`forcebound.haptics.laws.LAWS`.
        case: ``SEED`` or ``cCODE``; ``CERTIFICATE:s3.17``; ``WORLD/CONTROLLER:SEED`` or
            ``WORLD/CONTROLLER:cCODE``.
        seconds: Length of the run, in s, if it has none of its own.
        picture: Where to draw it.

    Raises:
        ConfigError: If the law or the case is not known, or has no such length or picture.
    """
    if picture is not None:
        check_picture(picture)
    if "/" in case:
        if picture is not None:
            raise ConfigError("a run against a world is not drawn: omit --output")
        return replay_world(law, case, seconds)
    if ":" in case:
        if seconds is not None:
            raise ConfigError("the case of a certificate has a length of its own: omit --duration")
        document, trace = replay_path(law, case)
        columns: Row = dict(zip(PATH_COLUMNS, np.array(trace).T, strict=True))
    else:
        scenario = case_of(case, seconds or SECONDS)
        result, rows = attack(law, scenario)
        columns = dict(zip(TRACE_COLUMNS, rows.T, strict=True))
        named = {"adversary": ADVERSARIES[scenario.adversary], "sensor": SENSORS[scenario.sensor]}
        document = {"law": law, "case": scenario._asdict() | named, **result._asdict()}
    if picture is not None:
        _draw(columns, f"{law}, case {case}", picture)
    return _known(document) | {"case": _known(document["case"])}


def _known(numbers: Row) -> Row:
    """Leave out what is not stated, and what is infinite, which JSON has not."""
    return {key: one for key, one in numbers.items() if one not in (None, math.inf, -math.inf)}


def lines(document: Row) -> Iterator[str]:
    """Yield a repeated run for a terminal: its case, then its result, with units."""
    for name, value in [*document["case"].items(), *document.items()]:
        if name != "case":
            shown = f"{value:.6g}" if isinstance(value, float) else str(value)
            yield f"{name:<22}{shown} {UNITS.get(name, '')}".rstrip()


def _draw(columns: Row, title: str, picture: Path) -> None:
    """Draw position, forces and energies over time; .png or .svg."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 7.0), layout="constrained")
    energies = columns["energy"], columns["loss_and_work"]
    in_joules = max(np.abs(one).max() for one in energies) >= 10.0
    scale, unit = (1.0, "J") if in_joules else (1e3, "mJ")
    lowest = int(np.argmin(energies[1]))
    words = f"lowest {scale * energies[1][lowest]:.3g} {unit}"
    panels = {
        "position (mm)": (1e3, {"position": "position", "reading": "reading"}),
        "force (N)": (1.0, {"commanded": "commanded", "applied": "force"}),
        f"energy ({unit})": (scale, {"of the hand": "energy", "loss plus work": "loss_and_work"}),
    }
    every = figure.subplots(3, 1, sharex=True)
    for axes, (label, (factor, curves)) in zip(every, panels.items(), strict=True):
        for name, column in curves.items():
            axes.plot(columns["time"], factor * columns[column], lw=1.0, label=name)
        axes.set_ylabel(label)
    axes.axhline(0.0, color="k", lw=0.7)
    axes.axvline(columns["time"][lowest], color="r", lw=0.7, label=words)
    axes.set_xlabel("time (s)")
    for axes in every:
        axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize="small")
    figure.suptitle(f"{title}: {words}", fontsize="small")
    save(figure, picture)
