"""Checks of a configuration whose parts are objects, as Python may have made them.

A launch file is checked before, with the places in it (:mod:`forcebound.graph.model`).
"""

from collections.abc import Iterator, Mapping

from forcebound.errors import ConfigError
from forcebound.graph import checks
from forcebound.graph.graph import KINDS, EnvironmentConfig, GraphConfig, HandConfig, PartSpec
from forcebound.graph.names import parameter_name, problem_of_hand
from forcebound.graph.problems import Place, Problems, unknown
from forcebound.messages.topology import HAND, HANDS, IMPAIRABLE, MOST_HANDS
from forcebound.quantities import check_ranges


def check(config: GraphConfig) -> None:
    """Raise ConfigError with all that is wrong with a graph, unless a part of it is not made.

    A part whose class no table has is known by the name of its class from then on.
    """
    check_ranges(config)
    _check_classes(config)
    parts = [(section, part) for _, section, part in _parts(config) if part is not None]
    if any(isinstance(part, PartSpec) for _, part in parts):
        return  # it was checked before it was written
    for section, part in parts:
        KINDS[section].known(type(part), type(part).__name__)
    problems = Problems()

    def note(hand: str, section: str, error: ConfigError) -> None:
        place = parameter_name(hand or HAND, ".".join(filter(None, (section, error.field))))
        problems.add(str(error), Place(place))

    hands = {name: vars(hand) for name, hand in config.hands.items()}
    checks.check_together({"environment": config.environment, HANDS: hands}, note)
    problems.raise_if_any()


def _parts(config: GraphConfig) -> Iterator[tuple[str, str, object]]:
    """Yield hand, section and part of each part; None: there is no operator."""
    yield HAND, "environment", config.environment.model
    for name, hand in config.hands.items():
        yield name, "device", hand.device
        yield name, "operator", hand.operator
        yield name, "controller", hand.controller


def _check_classes(config: GraphConfig) -> None:
    """Check that each thing is of its class, and has a name that it can have."""
    if not isinstance(config.environment, EnvironmentConfig):
        expected = KINDS["environment"].shape.expected
        raise ConfigError(
            f"environment: expected an object of {expected}, {_got(config.environment)}"
        )
    hands = config.hands
    if not isinstance(hands, Mapping) or not 0 < len(hands) <= MOST_HANDS:
        raise ConfigError(
            f"{HANDS}: expected a mapping with 1 to {MOST_HANDS} hands, {_got(hands)}"
        )
    for name, hand in hands.items():
        problem = problem_of_hand(name, len(hands))
        if problem is None and not isinstance(hand, HandConfig):
            problem = f"{HANDS}.{name}: expected a forcebound.Hand, {_got(hand)}"
        if problem is not None:
            raise ConfigError(problem)
        for topic in hand.links:
            if topic not in IMPAIRABLE:
                raise ConfigError(unknown("link", topic, IMPAIRABLE))
    for name, section, part in _parts(config):
        shape, is_none = KINDS[section].shape, part is None and section == "operator"
        if not (is_none or isinstance(part, PartSpec) or shape.fits(type(part))):
            place = parameter_name(name, section)
            raise ConfigError(f"{place}: expected an object of {shape.expected}, {_got(part)}")


def _got(value: object) -> str:
    hint = ", which is a class: add ()" if isinstance(value, type) else ""
    return f"got {value!r}{hint}"
