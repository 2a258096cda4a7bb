"""The methods of the league in one table, and those of a user's file.

To add a method: one entry in :data:`METHODS`. Its ``words`` are ``NAME:=VALUE`` of a launch file,
in which ``{name}`` stands for one of its ``numbers``: what a user would tune.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from forcebound.errors import ConfigError
from forcebound.graph.fields import fields_of
from forcebound.haptics.controllers import CONTROLLERS
from forcebound.haptics.laws import LAWS
from forcebound.haptics.parts.user_module import names_file
from forcebound_proofs.cases import Range
from forcebound_proofs.field_ranges import ranges_of
from forcebound_proofs.league.places import Words


class Method(NamedTuple):
    """A way to keep a hand safe, as words of a launch file."""

    words: Words
    promise: str  # what it says of itself, in a few words
    source: str
    numbers: Mapping[str, Range] = {}  # to be tuned; none: it has none of its own
    derived: Callable[[Mapping[str, float]], Mapping[str, float]] = dict  # numbers of the words

    def with_numbers(self, numbers: Mapping[str, float]) -> Words:
        """Return the words with these numbers in them."""
        return tuple(word.format(**self.derived(numbers)) for word in self.words)


def _refill(numbers: Mapping[str, float]) -> Mapping[str, float]:
    """Return the numbers of an energy tank, N s/m for each J, of its largest damping."""
    return {**numbers, "refill": numbers["largest_damping"] / numbers["target_level"]}


_law = partial(Method, source="the enhanced force bounding paper, 2017")
_STEADY = "passive with an exact encoder and a steady clock"
_CERTIFIED = "passive if the device keeps the promises of docs/assumptions.md"

METHODS: dict[str, Method] = {
    "none": Method(("law:=none",), "nothing", "–"),
    "less_conservative": _law(("law:=less_conservative",), f"nearly {_STEADY}"),
    "more_conservative": _law(("law:=more_conservative",), f"nearly {_STEADY}"),
    "aol": Method(
        ("law:=aol",),
        _STEADY,
        "adjusting output-limiter, reconstructed from the enhanced force bounding paper, 2017",
    ),
    "tdpa": Method(
        ("law:=tdpa",),
        "the environment's energy is dissipated after the fact",
        "Hannaford and Ryu, IEEE T-RA 18(1), 2002",
    ),
    "virtual_coupling": Method(
        (
            "law:=none",
            "controller:=virtual_coupling",
            "controller.stiffness:={stiffness}",
            "controller.damping:={damping}",
        ),
        "passive if K (T/2 + t_d) + B <= b",
        "Colgate, Stanley and Brown, IROS 1995; Adams and Hannaford, IEEE T-RA 15(3), 1999",
        {
            "stiffness": Range(50.0, 20_000.0, is_logarithmic=True),
            "damping": Range(0.01, 20.0, is_logarithmic=True),
        },
    ),
    "energy_tank": Method(
        ("law:=energy_tank(target_level={target_level}, refill={refill:.4g})",),
        "passive in its own account of a device without friction, encoder and hold",
        "Franken, Stramigioli, Misra, Secchi and Macchelli, IEEE T-RO 27(4), 2011, as two public"
        " implementations have it",
        {
            "target_level": Range(0.01, 1.0, is_logarithmic=True),
            "largest_damping": Range(1.0, 29.9, is_logarithmic=True),
        },
        _refill,
    ),
    "successive_stiffness": Method(
        (
            "law:=none",
            "controller:=successive_stiffness",
            "controller.gain:={gain}",
            "controller.largest_force:={largest_force}",
        ),
        "nothing to the hand",
        "Lee, Kim, Singh and Ryu, ICRA 2020, as the first author's library has it",
        {"gain": Range(0.0, 1.0), "largest_force": Range(0.5, 8.5, is_logarithmic=True)},
    ),
    "tdpa_two_port": Method(
        ("law:=none", "controller:=tdpa_two_port"),
        "the network gives neither end more than the other put in",
        "Ryu, Artigas and Preusche, Mechatronics 20(7), 2010; drift: Artigas, Ryu and Preusche,"
        " IROS 2010",
    ),
    "tdpa_two_port_drifts": Method(
        ("law:=none", "controller:=tdpa_two_port", "controller.drift_compensation:=false"),
        "the network gives neither end more than the other put in",
        "Ryu, Artigas and Preusche, Mechatronics 20(7), 2010",
    ),
    "wave_variables": Method(
        (
            "law:=none",
            "controller:=wave_variables",
            "controller.impedance:={impedance}",
            "controller.cutoff:={cutoff}",
        ),
        "the network is passive, also with a delay that varies and with losses",
        "Niemeyer and Slotine, IEEE JOE 16(1), 1991, and IJRR 23(9), 2004; Lozano, Chopra and"
        " Spong, Mechatronics 2002",
        {
            "impedance": Range(0.2, 20.0, is_logarithmic=True),
            "cutoff": Range(20.0, 500.0, is_logarithmic=True),
        },
    ),
    "certified": Method(("law:=certified",), _CERTIFIED, "docs/theory.md"),
    "certified_fading": Method(("law:=certified_fading",), _CERTIFIED, "docs/theory.md"),
    "certified_deadband": Method(
        (
            "law:=certified",
            "links.environment_query.deadband:=10 %",
            "links.environment_reply.deadband:=10 %",
        ),
        _CERTIFIED,
        "docs/theory.md; codec: Hinterseer, Hirche, Chaudhuri, Steinbach and Buss, IEEE T-SP"
        " 56(2), 2008",
    ),
}
CERTIFIED = "certified"  # the one that others are compared with
_OF_A_USER = ("what its author says", "a file of yours")
OURS = ("certified", "certified_fading", "certified_deadband")


def method_of_file(kind: str) -> tuple[Method, object]:
    """Return the method of a user's law or controller, ``FILE.py`` or ``FILE.py:NAME``, and that.

    The numbers of a controller are tuned in the ranges of their types; with it there is no law.

    Raises:
        ConfigError: If the file has neither, or several of one, or cannot be loaded.
    """
    try:
        name = LAWS.resolve(kind, Path())
    except ConfigError as no_law:
        try:
            name = CONTROLLERS.resolve(kind, Path())
        except ConfigError as error:
            words = str(no_law) if str(no_law) == str(error) else f"{no_law}; {error}"
            raise ConfigError(f"--method: expected a law or a controller: {words}") from None
    else:
        return Method((f"law:={name}",), *_OF_A_USER), LAWS[name]
    model = CONTROLLERS[name]
    floats = [key for key, field in fields_of(model).items() if type(field.default) is float]
    own = (f"controller.{key}:={{{key}}}" for key in floats)
    return Method(
        ("law:=none", f"controller:={name}", *own),
        *_OF_A_USER,
        {key: ranges_of(model)[key] for key in floats},
    ), model


def chosen(files: Sequence[str]) -> tuple[dict[str, Method], list[object]]:
    """Return the methods of the table and of a user's files, by name; and what the files define.

    Raises:
        ConfigError: If a file has no method, or its name is taken.
    """
    found, parts = dict(METHODS), list[object]()
    for kind in files:
        if not names_file(kind):
            raise ConfigError(f"--method: expected FILE.py or FILE.py:NAME, got {kind!r}")
        name = Path(kind).stem
        if name in found:
            raise ConfigError(f"--method {kind}: there is a method {name!r}: rename the file")
        found[name], part = method_of_file(kind)
        parts.append(part)
    return found, parts
