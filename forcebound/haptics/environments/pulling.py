"""Check that no force pulls the hand deeper, as one of the opposite sign does.

A press asks for forces at rest along a straight line, while time stands still. Attractions, skins
that break and bodies that move are no mistake, so only this is one:

* wherever a press goes in against the normal of a contact, the force pulls it in, and more at some
  place than where it began; a surface that only adheres pushes out behind itself;
* where free motion ends, the force pulls the press on, and never less, up to ``FAR``: an attraction
  to a place nearer than that turns round there, and one to a place beyond has no free motion.
"""

from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from itertools import takewhile

from forcebound.haptics.environments import FAR, EnvironmentModel, open_environment
from forcebound.haptics.environments.strokes import Question
from forcebound.haptics.geometry.vectors import dot, norm, pad3, sub, unit
from forcebound.haptics.parts.contract import Findings
from forcebound.messages.topology import HAND

FREE, PULLED, TOUCHED = 5, 8, 3  # questions at least: before a pull, of one to FAR, of a contact


def check_press(
    model: EnvironmentModel,
    press: Sequence[Question],
    found: Findings,
    report: Callable[[Question], None],
) -> bool:
    """Look for a pull in a press on a new instance; return whether it, or a push, begins in none.

    What else an answer may be is a matter of other promises: then nothing is found here.
    """
    end = pad3(press[-1].position)
    direction = unit(sub(end, pad3(press[0].position)))
    forces: list[float] = []  # N, along the press; above 0 it resists
    inwards: list[float] = []  # N, into what is touched
    axes = len(press[0].position)
    with suppress(Exception, SystemExit), closing(open_environment(model, axes)) as environment:
        for question in press:
            report(question)
            force = pad3(environment.force(HAND, *question))
            contact = environment.contact(HAND)
            forces.append(dot(force, direction))
            if contact is not None and dot(pad3(contact[1]), direction) < 0.0:
                inwards.append(dot(force, pad3(contact[1])))
    if len(forces) < len(press):
        return False
    is_drawn_in = len(inwards) >= TOUCHED and min(inwards) > 0.0 and max(inwards) > inwards[0]
    is_pulled = is_drawn_in or (norm(end) >= FAR and _is_pulled_on(forces))
    if is_pulled:
        first = next((k for k, force in enumerate(forces) if force < 0.0), 0)
        got = f"{forces[first]:.4g} N, and more further in: it pulls deeper. If it is the force on"
        where = f"{press[first]}, from {press[0].position} to {press[-1].position}"
        expected = "a force that resists: along this press above 0"
        found.add("resists", expected, f"{got} the hand, return its opposite", where)
    begins = (k for k in range(FREE, len(forces)) if not any(forces[k - FREE : k]))
    return is_pulled or any(forces[k] > 0.0 for k in begins)


def _is_pulled_on(forces: list[float]) -> bool:
    pulls = list(takewhile(bool, reversed(forces)))
    free = forces[: len(forces) - len(pulls)][-FREE:]
    is_long = len(free) == FREE and len(pulls) >= PULLED and not any(free)
    return is_long and pulls[0] < pulls[-1] < 0.0 and pulls == sorted(pulls)
