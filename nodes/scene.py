"""The scene of an environment: what there is to draw, sent now and then, after an answer.

A scene is sent when it has changed, at most 30 times a second, and at least once a second, so that
late subscribers receive it. It is made in a separate step, after an answer has left.
"""

import logging
from collections.abc import Mapping, Sequence

from msgspec.structs import replace

from forcebound.haptics.environments import Environment
from forcebound.haptics.parts import overridden
from forcebound.haptics.parts.user_module import describe_user_error
from forcebound.messages.codec import MAX_SCENE_BYTES, encode
from forcebound.messages.events import EventLog
from forcebound.messages.packets import MAX_LENGTH, Packet, Scene, SceneObject, Vector

PERIOD_NS = 33_333_334  # between two scenes that differ
REPEAT_NS = 1_000_000_000 - PERIOD_NS  # between two that do not: one a second, at least
LONGEST_WAIT_NS = 100_000_000  # of a scene with answers that go first

_logger = logging.getLogger(__name__)


class SceneSource:
    """Asks an open environment for its scene, and makes the packets.

    Attributes:
        environment: The open environment of now.
        reports_contacts: Whether answers carry its contacts.
    """

    def __init__(self, environment: Environment, events: EventLog) -> None:
        self._events = events
        self._seq = 0
        self._due_ns = 0
        self._repeat_ns = 0
        self._sent: tuple[Sequence[SceneObject], Mapping[str, Vector]] = ((), {})
        self._left_out = 0
        self._is_taken = self._takes_contacts = True
        self._wait_until_ns = 0  # until when a scene waits for a moment without an answer
        self.watch(environment)

    def watch(self, environment: Environment) -> None:
        """Ask this environment from now on."""
        methods = overridden(environment, Environment)
        # A step without a scene would make the next answer late.
        self._has_scene = "scene" in methods
        self.reports_contacts = "contact" in methods and self._takes_contacts
        self.environment = environment
        self.is_due = False  # whether the next step makes a scene; it may have none

    def leave_out(self, contacts: bool) -> None:
        """Make no scenes, and if ``contacts``, report no contacts: nobody takes them."""
        self._is_taken, self._takes_contacts = False, not contacts
        self.watch(self.environment)

    def note_answer(self, time_ns: int) -> None:
        """Plan a scene if one is due: the environment may have changed."""
        if self._has_scene and self._is_taken and not self.is_due and time_ns >= self._due_ns:
            self.is_due = True
            self._wait_until_ns = time_ns + LONGEST_WAIT_NS

    def may_wait(self, time_ns: int) -> bool:
        """Return whether an answer that leaves now goes first."""
        return time_ns < self._wait_until_ns

    def packets(self, time_ns: int, proxies: Mapping[str, Vector]) -> list[Packet]:
        """Return the scene if it has changed or is to be repeated, and events about it.

        ``proxies`` are those of the last answer to each hand that is not in free motion, in m.
        """
        self.is_due = False
        self._due_ns = time_ns + PERIOD_NS
        try:
            drawn = self.environment.scene()
            if drawn is None:
                self._has_scene = False
                return []
            objects = tuple(drawn)
            if (objects, proxies) == self._sent and time_ns < self._repeat_ns:
                return []
            scene = self._fitting(Scene(self._seq, time_ns, objects[:MAX_LENGTH], dict(proxies)))
        except Exception as error:  # of a user's code, or no scene
            self._has_scene = False
            _logger.warning("the environment's scene: %s", describe_user_error(error))
            message = "the environment's scene cannot be sent: its log gives the reason"
            return [self._events.emit(time_ns, "scene_failed", message, is_fault=True)]
        self._sent = (objects, dict(proxies))
        self._repeat_ns = time_ns + REPEAT_NS
        self._seq += 1
        return [scene, *self._count(time_ns, len(objects) - len(scene.objects))]

    def _fitting(self, scene: Scene) -> Scene:
        """Return the scene, without the last objects if it is too long."""
        while len(encode(scene)) > MAX_SCENE_BYTES:
            scene = replace(scene, objects=scene.objects[: len(scene.objects) // 2])
        return scene

    def _count(self, time_ns: int, left_out: int) -> list[Packet]:
        """Return an event if other objects than before do not fit."""
        if left_out == self._left_out:
            return []
        self._left_out = left_out
        message = f"objects of the scene that do not fit into a packet, left out: {left_out}"
        data = {"left_out": str(left_out)}
        return [self._events.emit(time_ns, "scene_cut", message, data)]
