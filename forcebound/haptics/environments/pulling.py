"""Whether a force pulls the hand deeper, as one of the opposite sign does.

A press asks for forces at rest along a straight way, while time stands still. Attractions, skins
that break and bodies that move are no mistake, so only this is one:

* wherever a press goes in against the normal of a contact, the force pulls it in, and more at some
  place than where it began; a surface that only adheres pushes out behind itself;
* where free motion ends, the force pulls the press on, and never less, up to ``FAR``: an attraction
  to a place nearer than that turns round there, and one to a place beyond has no free motion.
"""

from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from itertools import pairwise

from forcebound.haptics.environments import FAR, EnvironmentModel, open_environment
from forcebound.haptics.environments.strokes import Question
from forcebound.haptics.geometry.vectors import dot, norm, pad3, sub, unit
from forcebound.haptics.parts.contract import Findings

FREE, PULLED, TOUCHED = 5, 8, 3  # questions at least: before a pull, of one to FAR, of a contact
APART = 20  # questions between the two forces that are shown


def check_press(
    model: EnvironmentModel,
    press: Sequence[Question],
    found: Findings,
    report: Callable[[Question], None],
) -> bool:
    """Look for a pull in a press on a new instance; return whether it, or a push, begins in none.

    What else an answer may be is a matter of other promises: then nothing is found here.
    """
    way = unit(sub(pad3(press[-1].position), pad3(press[0].position)))
    forces: list[float] = []  # N, along the way; above 0 it resists
    inwards: dict[int, float] = {}  # N, into what is touched, by question
    with (
        suppress(Exception, SystemExit),
        closing(open_environment(model, len(press[0].position))) as environment,
    ):
        for number, question in enumerate(press):
            report(question)
            force = pad3(environment.force("", *question))
            contact = environment.contact("")
            forces.append(dot(force, way))
            if contact is not None and dot(pad3(contact[1]), way) < 0.0:
                inwards[number] = dot(force, pad3(contact[1]))
    if len(forces) < len(press):
        return False
    pulled = _in_contact(inwards)
    if not pulled and norm(pad3(press[-1].position)) >= FAR:
        pulled = _without_end(forces)
    if pulled:
        places = (pulled[0], pulled[min(APART, len(pulled) - 1)])
        shown = ", ".join(f"{forces[one]:.4g} N at {_at(press[one])}" for one in places)
        got = f"it pulls deeper: {shown}. If it is the force on the hand, return its opposite"
        where = f"pressed at rest from {_at(press[0])} to {_at(press[-1])}"
        found.add("resists", "a force that resists: above 0 along the press", got, where)
    begins = (k for k in range(FREE, len(forces)) if not any(forces[k - FREE : k]))
    return bool(pulled) or any(forces[k] > 0.0 for k in begins)


def _at(question: Question) -> str:
    return f"{tuple(round(entry, 5) for entry in question.position)} m"


def _in_contact(inwards: dict[int, float]) -> list[int]:
    pulls = list(inwards.values())
    is_pull = len(pulls) >= TOUCHED and min(pulls) > 0.0 and max(pulls) > pulls[0]
    return list(inwards) if is_pull else []


def _without_end(forces: Sequence[float]) -> list[int]:
    end = max((number + 1 for number, force in enumerate(forces) if force == 0.0), default=0)
    pulls = forces[end:]
    is_pull = (
        end >= FREE
        and not any(forces[end - FREE : end])
        and len(pulls) >= PULLED
        and 0.0 > pulls[0] > pulls[-1]
        and all(one >= other for one, other in pairwise(pulls))
    )
    return list(range(end, len(forces))) if is_pull else []
