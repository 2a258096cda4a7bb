"""The contract of each part as one call, for tests; what it asks is what ``forcebound check`` asks.

Each call returns its report. ``report.held`` has True for each promise that was seen to be kept:
one that the part does not make, such as ``contact`` of a world that reports none, is missing.
"""

from collections.abc import Iterable, Mapping

from forcebound.graph.parts import law_of
from forcebound.haptics.controllers import ControllerModel
from forcebound.haptics.controllers import contract as controllers
from forcebound.haptics.devices import DeviceModel
from forcebound.haptics.devices import contract as devices
from forcebound.haptics.environments import EnvironmentModel
from forcebound.haptics.environments import contract as environments
from forcebound.haptics.hands import Operator
from forcebound.haptics.hands import contract as operators
from forcebound.haptics.laws import LAWS, BoundingLaw
from forcebound.haptics.laws import contract as laws
from forcebound.haptics.parts.contract import Report
from forcebound.interface.runs import known_law
from forcebound.messages.packets import MAX_AXES


def check_environment(
    model: EnvironmentModel,
    axes: Iterable[int] = range(1, MAX_AXES + 1),
    at_rest: Mapping[float, float] | None = None,
    at_most: int | None = None,
) -> Report:
    """Check that an environment keeps its promises, with each number of ``axes``.

    Args:
        model: Its parameters.
        axes: Numbers of axes to try, 1 to 6.
        at_rest: Force, in N, that is expected first at a position on the first axis, in m:
            ``{0.0: 0.0}`` for free motion at 0 m.
        at_most: How many questions to ask, approximately, of an environment that is slow; None:
            all, some thousands.

    Raises:
        AssertionError: If it breaks one; it names the question, what was expected and what came.
    """
    return _kept(model, environments.check(model, axes, at_rest, at_most))


def check_device(model: DeviceModel, ticks: int = 100, hold_limit: float = 1.25e-3) -> Report:
    """Check a device in so many ticks; opened with ``hold_limit`` (s), hardware gets no force.

    Raises:
        AssertionError: As :func:`check_environment`.
    """
    return _kept(model, devices.check(model, ticks, hold_limit))


def check_controller(
    model: ControllerModel, axes: Iterable[int] = range(1, MAX_AXES + 1)
) -> Report:
    """Check a controller, with each number of ``axes``, 1 to 6.

    Raises:
        AssertionError: As :func:`check_environment`.
    """
    return _kept(model, controllers.check(model, axes))


def check_operator(model: Operator, seconds: float = 5.0) -> Report:
    """Check a simulated hand in this time of its path, in s.

    Raises:
        AssertionError: As :func:`check_environment`.
    """
    return _kept(model, operators.check(model, seconds))


def check_law(law: str | BoundingLaw, samples: int = 2000) -> Report:
    """Check a law, by its name or as it was made, in walks of so many samples.

    Whether it is passive is not asked: ``forcebound audit --law FILE`` does that.

    Raises:
        AssertionError: As :func:`check_environment`.
        ConfigError: If there is no law of this name.
    """
    if isinstance(law, str):
        return _kept(law, laws.check(law_of(law), samples=samples))
    before = LAWS.added
    name = known_law(law)
    try:
        return _kept(name, laws.check(name, samples=samples))
    finally:
        if name not in before:
            del LAWS[name]  # other tests list the laws


def _kept(part: object, report: Report) -> Report:
    if report.violations:
        text = [f"{part} breaks its contract"]
        for one in report.violations:
            text += [f"{one.promise}: {report.promises[one.promise]}", *one.lines()]
        raise AssertionError("\n".join(text))
    return report
