"""Episodes of a running graph: parts of a recording that somebody begins, and keeps or discards.

At the beginning of an episode, and after one that is discarded, the world begins again. The devices
write zero force before it does and until it has; then the force returns over ``engage_time``.
"""

import logging
import os
import sys
import termios
import tty
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import get_args

from forcebound.errors import ConfigError, RunError
from forcebound.messages import control
from forcebound.messages.packets import TOPIC_OF, DeviceState
from forcebound.messages.topology import is_bound, node_name
from forcebound.network import sockets
from forcebound.observe.control import ANSWER_TIMEOUT, ask, ask_all, ask_launcher
from forcebound.observe.runs import Watch
from forcebound.roles import DEVICE, ENVIRONMENT
from forcebound.run.process.reader import Reader
from forcebound.run.run_directory import RunDocument, graph_in

_logger = logging.getLogger(__name__)

ACTIONS: tuple[control.EpisodeAction, ...] = get_args(control.EpisodeAction)


def mark(run_dir: Path, action: control.EpisodeAction) -> control.Episodes:
    """Begin an episode, or keep or discard the open one; return how many there are.

    An episode begins between the reset of the world and the return of the force.

    Raises:
        ConfigError: If there is no such action, it does not go with what is open, or there is no
            launcher.
        RunError: If the world does not begin again, or a process does not answer.
    """
    if action not in ACTIONS:
        raise ConfigError(f"an episode: expected start, keep or discard, got {action!r}")
    ask_launcher(run_dir, control.MarkEpisode(action, is_question=True))
    if action == "start":
        with _world_reset(run_dir):
            return ask_launcher(run_dir, control.MarkEpisode(action)).episodes
    found = ask_launcher(run_dir, control.MarkEpisode(action)).episodes
    if action == "discard":
        with _world_reset(run_dir):
            pass
    return found


@contextmanager
def _world_reset(run_dir: Path) -> Iterator[None]:
    """Let the world begin again, with zero force until the block ends; then the force ramps.

    A world on another machine goes on. Errors are as of :func:`mark`.
    """
    nodes = graph_in(run_dir).nodes
    devices = [name for name, node in nodes.items() if node.role == DEVICE]
    if not is_bound(run_dir, nodes[ENVIRONMENT]):
        words = "the world is on another machine, and goes on: it has not begun again"
        _logger.warning("%s; put its bodies back there, or restart its graph", words)
        yield
        return
    try:
        ask_all(run_dir, dict.fromkeys(devices, control.Release()), ANSWER_TIMEOUT)
        answer = ask(run_dir, ENVIRONMENT, control.ResetWorld())
        if not isinstance(answer, control.Accepted):
            why = answer.error if isinstance(answer, control.Refused) else "it does not answer"
            raise RunError(f"the world did not begin again: {why}")
        yield
    finally:
        ask_all(run_dir, dict.fromkeys(devices, control.Engage()), ANSWER_TIMEOUT)


def buttons_of(text: str) -> dict[int, control.EpisodeAction]:
    """Return the actions of buttons by their bits, from ``start=0,keep=1``; ConfigError if none."""
    found: dict[int, control.EpisodeAction] = {}
    for entry in filter(None, text.split(",")):
        name, _, bit = entry.strip().partition("=")
        if not bit.isdecimal() or name not in ACTIONS:
            expected = "such as start=0,keep=1,discard=2, each with the bit of a button"
            raise ConfigError(f"buttons: expected actions, {expected}, got {text!r}")
        found[int(bit)] = next(action for action in ACTIONS if action == name)
    return found


def watch(
    run_dir: Path,
    hand: str | None,
    buttons: Mapping[int, control.EpisodeAction],
    act: Callable[[control.EpisodeAction], None],
) -> None:
    """Call ``act`` for each key s, k or d, and each press of a button of a hand, if there is one.

    It returns after the key q, or when the graph ends. Presses of a button while ``act`` works are
    dropped. ConfigError if the hand has no buttons.
    """
    keys = {action[0]: action for action in ACTIONS}
    run, over = RunDocument.read(run_dir), Watch(run_dir)
    topic = TOPIC_OF[DeviceState]
    streams = () if hand is None else run.graph.named(node_name(hand, topic))
    held: int | None = None
    with _keys() as typed, Reader(run_dir, streams, run.core) as reader:
        while not over.is_over:
            reader.wait()
            chosen: list[str] = [keys.get(key, key) for key in typed()]
            for received in reader.take():
                assert isinstance(received.packet, DeviceState)
                if received.packet.buttons is None:
                    raise ConfigError(f"buttons: the device of {hand} has none; use keys")
                before, held = held, received.packet.buttons
                pressed = 0 if before is None else held & ~before
                chosen += [action for bit, action in buttons.items() if pressed >> bit & 1]
            if "q" in chosen:
                return
            action = next(filter(chosen.count, ACTIONS), None)
            if action is not None:
                act(action)
                reader.forget()
                held = None


@contextmanager
def _keys() -> Iterator[Callable[[], str]]:
    """Give the keys since the last call; without a terminal none."""
    if not sys.stdin.isatty():
        yield lambda: ""
        return
    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    try:
        tty.setcbreak(terminal)
        yield (
            lambda: (
                os.read(terminal, 9).decode(errors="replace")
                if sockets.wait((terminal,), 0)
                else ""
            )
        )
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)
