"""A forecast of the stiffness that a hand will feel on a device, by what the device states.

A launch file runs in virtual time, on punctual ticks, with its numbers and with others in place of
some: a run for each. A device at a port is replaced by the simulated one with the same numbers.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from tabulate import tabulate

from forcebound.axes import AxisKind, at_lever, common_kind, shown_on, units_on
from forcebound.errors import ConfigError
from forcebound.graph.document import find
from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import hand_of, launch_file_of, load
from forcebound.graph.parts import member_of
from forcebound.haptics.devices import DEVICES, DeviceModel, JointsModel
from forcebound.haptics.devices.joint_device import Joints
from forcebound.haptics.laws.dissipation import MOST_LATE
from forcebound.lab.sweeps import Runs, sweep
from forcebound.messages.topology import HAND, Document
from forcebound.units import MJ, MM, MS, N_MM, Everyday, N

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FELT = "displayed_stiffness"
LIMITS = (0.005, 0.01, 0.02, 0.03, 0.05, 0.1)  # s, of a device without a watchdog
ALLOWANCES = (0.0, 0.002, 0.005, 0.01, 0.015, 0.02)  # J
SHORT_LIMIT = 0.03  # s, of the launch files that ship
LONGEST_TICK = 1.25  # periods, for which a force must be held at the least
WHOLE = 0.95  # of the environment's stiffness, which is as good as all
HAND_SPEEDS = {"m/s": (1.0, 2.0, 3.0, 5.0), "rad/s": (2.0, 5.0, 10.0, 20.0)}
RATES = (0.5, 1.0, 2.0, 4.0)  # times what is stated
FASTEST = 5000.0  # Hz, of a live run
PUSH = 0.01  # m; an allowance is the energy of a force over this path
HZ = Everyday("Hz", "Hz", 0)
#: Launch files for a kind of device; for others stiff_wall.
WALLS = {"five_bar": "five_bar_wall", "knob": "knob_wall", "serial_arm": "serial_arm_wall"}
WALLS |= {"desktop_arm": "desktop_arm"}


class Varied(NamedTuple):
    """Runs over one number of the device, or over two: a curve for each value of the second."""

    names: tuple[str, ...]  # keys of the section device
    units: tuple[Everyday, ...]
    runs: Runs


class Forecast(NamedTuple):
    """What a hand will feel.

    Attributes:
        name: Launch file or kind of device.
        asked: Stiffness of the environment, in N/m.
        felt: What a hand feels of it with all numbers as stated, in N/m.
        stated: The numbers that vary, as stated, in SI units.
        speed_unit: Of hand_speed, for people.
        varied: Runs with others in their place.
        kind: Of the axes; stiffnesses of angles are in N m/rad.
    """

    name: str
    asked: float
    felt: float
    stated: Mapping[str, float]
    speed_unit: str
    varied: Sequence[Varied]
    kind: AxisKind = "length"

    @property
    def unit(self) -> Everyday:
        """In which people read its stiffnesses."""
        return shown_on(self.kind, N_MM)

    @property
    def document(self) -> Document:
        """All of it, in SI units."""
        runs = [
            {"felt": felt, **dict(zip(one.names, values, strict=True))}
            for one in self.varied
            for *values, felt in _columns(one)
        ]
        stated = {"name": self.name, "stiffness": self.asked, "felt": self.felt}
        return {**stated, "stated": dict(self.stated), "runs": runs}

    @property
    def headline(self) -> str:
        """The forecast for the numbers as stated, which needs no others."""
        speed = Everyday(self.speed_unit, self.speed_unit)
        units = {"watchdog_limit": MS, "allowance": MJ, "rate": HZ, "hand_speed": speed}
        stated = ", ".join(f"{key} {_text(self.stated[key], units[key])}" for key in self.stated)
        return f"{self.name}: {self._felt(self.felt)}, as stated ({stated}), with punctual ticks"

    @property
    def details(self) -> Iterator[str]:
        """The forecast for other numbers, in words."""
        for one in self.varied:
            yield from _table(one, self.unit)
        yield from self._advice()

    def _felt(self, felt: float) -> str:
        share = min(felt / self.asked, 1.0)
        return f"{_text(felt, self.unit)} of {_text(self.asked, self.unit)} ({share:.0%})"

    def _advice(self) -> Iterator[str]:
        if "allowance" not in self.stated or self.felt >= WHOLE * self.asked:
            return
        runs = [*_columns(self.varied[0])]
        short = min(limit for limit, *_ in runs if limit >= SHORT_LIMIT)
        rows = {given: felt for limit, given, felt in runs if limit == short}
        enough = WHOLE * max(rows.values())
        given, felt = next((given, felt) for given, felt in rows.items() if felt >= enough)
        path = at_lever(PUSH, "m", self.kind)
        force, way = (shown_on(self.kind, unit) for unit in (N, MM))
        yield ""
        yield (
            f"With watchdog_limit {_text(short, MS)} and allowance {_text(given, MJ)}: "
            f"{self._felt(felt)}. The hand can then get at most {_text(given, MJ)}, the energy of"
            f" {given / path:.2g} {force.unit} over {path * way.factor:.3g} {way.unit}."
        )


def _columns(one: Varied) -> Iterator[tuple[float, ...]]:
    """Yield the values of each run, and the stiffness that its hand feels."""
    keys = [f"device.{name}" for name in one.names]
    yield from zip(*(one.runs[key].tolist() for key in (*keys, FELT)), strict=True)


def _table(one: Varied, unit: Everyday) -> list[str]:
    """Return the lines of a table: the first number down, the second across."""
    felt = {tuple(values): felt for *values, felt in _columns(one)}
    down, *rest = ([*dict.fromkeys(column)] for column in zip(*felt, strict=True))
    across = [(value,) for value in rest[0]] if rest else [()]
    units = one.units
    head = [one.names[0], *(_text(value[0], units[1]) if value else "felt" for value in across)]
    rows = [
        [_text(value, units[0]), *(_text(felt[value, *other], unit) for other in across)]
        for value in down
    ]
    title = f"felt, over {' and '.join(one.names)}"
    return ["", f"{title}:", *tabulate([head, *rows], tablefmt="plain").splitlines()]


def _text(value: float, unit: Everyday) -> str:
    number = value * unit.factor
    return f"{number:.0f} {unit.unit}" if number >= 1000.0 else f"{number:.3g} {unit.unit}"


def forecast(
    name: str, arguments: Sequence[str] = (), say: Callable[[str], None] = lambda _: None
) -> Forecast:
    """Return the forecast for a launch file, or for a kind of device.

    ``say`` takes its headline as soon as that is known; the other runs take minutes.

    Raises:
        ConfigError: If there is no such file, hand or device, nobody holds it, it has no stiffness
            or both lengths and angles.
    """
    graph, real = _stated(name, arguments)
    config = _in_virtual_time(graph, real)
    model, servo, kind = config.only.device, config.only.servo, common_kind(config.only.named_axes)
    if config.only.operator is None:
        raise ConfigError(f"{name}: expected `operator:`, a hand for the forecast; there is none")
    if kind is None:
        raise ConfigError(f"{name}: lengths and angles have no common stiffness to forecast")
    fastest = min(FASTEST, MOST_LATE / model.write_delay if model.write_delay else FASTEST)
    rates = [factor * servo.rate for factor in RATES if factor * servo.rate <= fastest]
    varied = [_varied(config, {"rate": (HZ, rates)})]
    runs = varied[0].runs
    ((asked, felt),) = (
        (row.get("environment.stiffness"), row["displayed_stiffness_n_per_m"])
        for row in runs.where(**{"device.rate": servo.rate})
    )
    if asked is None or felt is None:
        raise ConfigError(
            f"{name}: expected an environment with a stiffness that the hand reaches; the"
            " hand of the forecast is in operator:"
        )
    has_limit = model.watchdog == "none"
    stated = {"watchdog_limit": model.longest_force} if has_limit else {}
    stated |= {"allowance": servo.allowance} if has_limit else {}
    stated |= {"rate": servo.rate}
    stated |= {} if model.hand_speed is None else {"hand_speed": model.hand_speed}
    unit = "rad/s" if model.kinematics() is not None else units_on(model.named_axes, "m/s")
    found = Forecast(name, asked, felt, stated, unit, varied, kind)
    say(found.headline)
    if has_limit:
        possible = map(real.possible_limit, (n for n in LIMITS if n * servo.rate >= LONGEST_TICK))
        limits = (MS, _with(possible, model.longest_force))
        allowances = (MJ, _with(ALLOWANCES, servo.allowance))
        varied.insert(0, _varied(config, {"watchdog_limit": limits, "allowance": allowances}))
    speeds = _with(HAND_SPEEDS[unit], model.hand_speed or HAND_SPEEDS[unit][0])
    with suppress(ConfigError):  # some devices may not state one
        varied.append(_varied(config, {"hand_speed": (Everyday(unit, unit), speeds)}))
    return found


def _varied(config: GraphConfig, numbers: Mapping[str, tuple[Everyday, Sequence[float]]]) -> Varied:
    values: dict[str, Any] = {f"device.{key}": each for key, (_, each) in numbers.items()}
    units = tuple(unit for unit, _ in numbers.values())
    return Varied(tuple(numbers), units, sweep(config, **values))


def simulated_graph(name: str, arguments: Sequence[str] = ()) -> GraphConfig:
    """Return the graph that :func:`forecast` runs with the numbers as stated."""
    return _in_virtual_time(*_stated(name, arguments))


def _stated(name: str, arguments: Sequence[str]) -> tuple[GraphConfig, DeviceModel]:
    """Return a graph, and the device whose numbers it gets."""
    file, which = launch_file_of(name)
    if find(Path(name)) is not None or (file and name not in DEVICES):
        config = load(file or name, arguments)
        if not which and len(config.hands) > 1:
            path = Path(name).with_suffix(".yaml")
            known = " or ".join(f"{path}:{hand}" for hand in config.hands)
            raise ConfigError(f"which hand? Expected {known}, got {name}")
        if which:
            hand_of(name, arguments)  # a name that is unknown is an error
            config = _alone(config, which, file)
        return config, config.only.device
    model = member_of("device", name, arguments)
    return load(model.simulated_in or WALLS.get(name, "stiff_wall")), model


def _in_virtual_time(config: GraphConfig, model: DeviceModel) -> GraphConfig:
    hands = {}
    for key, hand in config.hands.items():
        # What one reading costs is in write_delay, which is as stated at every rate.
        servo = replace(hand.servo, readings_per_tick="auto")
        hands[key] = replace(hand, device=_simulated(model), servo=servo)
    return replace(config, hands=hands)


def _alone(config: GraphConfig, hand: str, file: str) -> GraphConfig:
    try:
        config.environment.served.check_hands((HAND,))
        return config.of(hand)
    except ConfigError:
        words = f"{hand} is coupled with another hand, and a forecast is of one alone"
        raise ConfigError(f"{words}: see both with `forcebound simulate {file}`") from None


def _simulated(model: DeviceModel) -> DeviceModel:
    if model.simulated_in is None:
        return model
    kind: type[DeviceModel] = Joints
    if not isinstance(model, JointsModel):
        kind = type(load(model.simulated_in).only.device)
    same = {each.name for each in fields(kind)} & {each.name for each in fields(model)}
    # Only a guard has a guard_period, and only a silent watchdog a tolerance; sources name more.
    stated = ((name, getattr(model, name)) for name in same - {"guard_period", "sources"})
    numbers = {name: value for name, value in stated if value is not None}
    return kind(**{**numbers, "watchdog_limit": model.longest_force})


def _with(values: Iterable[float], stated: float) -> list[float]:
    return sorted({*values, stated})


def draw(found: Forecast) -> "Figure":
    """Return a picture of a forecast: a panel for each table, with the stated numbers marked."""
    from forcebound.results.plots import blank, plain

    figure = blank(4.5 * len(found.varied) + 1.5, 3.6)
    panels = figure.subplots(1, len(found.varied), sharey=True, squeeze=False)[0]
    for panel, one in zip(panels, found.varied, strict=True):
        unit, rows = one.units[0], [*_columns(one)]
        for other in dict.fromkeys(row[1:-1] for row in rows):
            curve = [(row[0] * unit.factor, row[-1] * found.unit.factor) for row in rows]
            curve = [at for at, row in zip(curve, rows, strict=True) if row[1:-1] == other]
            words = f"{one.names[1]} {_text(other[0], one.units[1])}" if other else None
            panel.plot(*zip(*curve, strict=True), marker=".", label=words)
        if one.names[0] in found.stated:
            here = found.stated[one.names[0]] * unit.factor, found.felt * found.unit.factor
            panel.plot(*here, "o", color="black", fillstyle="none", label="as stated")
        panel.set_xscale("log")
        panel.set_xticks([at * unit.factor for at in dict.fromkeys(row[0] for row in rows)])
        panel.xaxis.set_major_formatter("{x:g}")
        panel.xaxis.minorticks_off()
        panel.set_xlabel(f"{one.names[0].replace('_', ' ')} ({unit.unit})")
        panel.axhline(found.asked * found.unit.factor, color="grey", linestyle=":")
        panel.set_ylim(bottom=0.0)
        plain(panel)
    handles, words = panels[0].get_legend_handles_labels()
    figure.legend(handles, words, loc="outside right center", frameon=False)
    panels[0].set_ylabel(f"stiffness felt ({found.unit.unit})")
    figure.suptitle(f"{found.name}: dotted, the stiffness of the wall")
    return figure
