"""What a page may change: parameters, nodes, the law, outages, the pointer of the hand."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from forcebound.bounding import LAWS
from forcebound.config.graph import GraphConfig
from forcebound.errors import ConfigError, ForceboundError, RunError
from forcebound.launch.live import RunDocument
from forcebound.monitor.control import ask, start_node, stop_node
from forcebound.monitor.formatting import as_written
from forcebound.monitor.tuning import (
    configuration,
    cut_links,
    find_parameters,
    read_settings,
    set_parameters,
)
from forcebound.network.sockets import Network
from forcebound.operators.pointer import PointerHand
from forcebound.process import control_endpoint

DELAYED = ("links.environment_query.delay", "links.environment_reply.delay")
BROKEN, SAFE = ("none", "5 ms"), ("certified", "0 ms")  # law, delay each way


class Controls:
    """The controls of one running graph."""

    def __init__(self, run_dir: Path) -> None:
        self._run_dir = run_dir
        self._config = configuration(run_dir, serves=False)
        self._actions: dict[str, Callable[[Mapping[str, Any]], None]] = {
            "set": lambda wanted: self._set(wanted["settings"]),
            "stop": lambda wanted: stop_node(run_dir, str(wanted["node"])),
            "start": lambda wanted: start_node(run_dir, str(wanted["node"])),
            "law": lambda wanted: self._take_law(str(wanted["law"])),
            "outage": lambda wanted: self._cut(str(wanted["time"])),
            "break": lambda wanted: self._show(*BROKEN),
            "safe": lambda wanted: self._show(*SAFE),
        }

    def describe(self) -> dict[str, Any]:
        """Return what a page needs to know of the graph before its first frame."""
        config = self._config
        model, servo = config.device.model, config.device.servo
        return {
            "type": "hello",
            "name": RunDocument.read(self._run_dir).file,
            "description": config.description,
            "axes": model.axes,
            "law": servo.law,
            "laws": sorted(law for law in LAWS if LAWS.is_shipped(law)),
            "age_limit": servo.age_limit,
            "saturation": getattr(model, "saturation", None),
            "wall": _wall(config),
            "hand": _hand(config),
            "workspace": getattr(model, "workspace", None),
        }

    def parameters(self) -> dict[str, Any]:
        """Return the parameters that can change, each as text with its unit."""
        config = configuration(self._run_dir, serves=False)
        return {"type": "parameters", "values": as_written(config, find_parameters(config, ()))}

    def act(self, wanted: Mapping[str, Any]) -> str | None:
        """Do what a page wants; return what is wrong, or None. It may take seconds."""
        action = self._actions.get(str(wanted.get("do")))
        if action is None:
            return f"no such control: {wanted.get('do')!r}"
        try:
            action(wanted)
        except KeyError as error:
            return f"{wanted.get('do')} needs {error}"
        except ForceboundError as error:
            return str(error)
        return None

    def _set(self, settings: Any) -> None:
        if not isinstance(settings, Mapping):
            raise ConfigError("settings: expected names and values")
        set_parameters(self._run_dir, read_settings([f"{n}:={v}" for n, v in settings.items()]))

    def _cut(self, time: str) -> None:
        cut_links(self._run_dir, time, ())

    def _take_law(self, law: str) -> None:
        answer = ask(self._run_dir, "device", {"request": "law", "law": law})
        if answer is None:
            raise RunError("the device does not answer")
        if "error" in answer:
            raise ConfigError(str(answer["error"]))

    def _show(self, law: str, delay: str) -> None:
        """Make the graph show a law with a delay, for visitors."""
        if law == SAFE[0]:
            self._take_law(law)
        self._set(dict.fromkeys(DELAYED, delay))
        if law != SAFE[0]:
            self._take_law(law)


class Pointer:
    """A line to the device for the pointer of its hand, which never waits for an answer."""

    def __init__(self, run_dir: Path) -> None:
        self._network = Network()
        self._client = self._network.control_client(control_endpoint(run_dir, "device"))
        self._newest: list[float] | None = None
        self._is_asked = False

    def point(self, target: Any) -> None:
        """Take where the pointer is now, in m, one entry per axis."""
        if isinstance(target, list) and all(isinstance(x, float | int) for x in target):
            self._newest = target
        self.send()

    def send(self) -> None:
        """Send the newest place if the device has answered to the one before."""
        if self._is_asked and self._client.answer() is not None:
            self._is_asked = False
        if self._newest is not None and not self._is_asked:
            self._is_asked = self._client.ask({"request": "point", "target": self._newest})
            if self._is_asked:
                self._newest = None

    def close(self) -> None:
        """Close the line."""
        self._network.close()


def _wall(config: GraphConfig) -> float | None:
    """Where the surface of a one-axis wall is, in m; None: the scene says what there is."""
    place = getattr(config.environment.model, "position", None)
    return place if isinstance(place, float) else None


def _hand(config: GraphConfig) -> dict[str, Any] | None:
    """What a pointer may do; None: the hand follows none."""
    hand = config.operator
    if not isinstance(hand, PointerHand):
        return None
    start = hand.start if isinstance(hand.start, tuple) else (hand.start,)
    return {"start": start, "reach": hand.reach, "speed": hand.speed}
