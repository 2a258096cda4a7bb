"""The program of an emulator: its parts made, its port shown, its time begun."""

import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from forcebound import realtime
from forcebound.errors import ConfigError
from forcebound.folders import runtime_folder
from forcebound.haptics.hands import Operator
from forcebound.hardware.emulators.emulation import Emulation
from forcebound.hardware.emulators.faults import Fault, Faults
from forcebound.hardware.emulators.kinds import EMULATORS, restored_operator
from forcebound.hardware.emulators.pty import PseudoPort, serve
from forcebound.stop import Stop

PRIORITY = 20  # of SCHED_FIFO; below that of the nodes


def run(
    kind: str,
    values: Mapping[str, Any],
    operator: Operator | None,
    link: Path,
    faults: Sequence[Fault],
    latency: float,
    until_unused: bool,
    say: Callable[[str], None],
    advice: str = "",
) -> None:
    """Run an emulator until it is interrupted, unplugs itself or is no longer used.

    Kind, values and operator are those of ``EMULATORS``; a reply comes ``latency`` s late, beyond
    that of the pseudo-terminal; with ``until_unused`` it ends when its user has closed the port.
    ``say`` takes the lines for the terminal, the last of which may be ``advice``.
    """
    be_punctual()
    with Stop() as stop, PseudoPort(link) as port:
        emulated = EMULATORS[kind](values, operator)
        emulation = Emulation(emulated, Faults(faults), port.truth, latency)
        realtime.freeze_garbage()
        emulation.start(time.monotonic_ns())
        port.show()
        say(f"an emulated {kind} at {link}; Ctrl-C ends it")  # a driver that starts it waits for it
        if advice:
            say(advice)
        serve(emulation, port, stop, until_unused)
    say(
        f"{emulation.replies} replies; lowest energy {emulation.lowest_energy:.3g} J;"
        f" torque held without a message for at most {1e3 * emulation.longest_hold:.3g} ms"
    )


def be_punctual() -> None:
    """Answer as soon as a board would: beside the core of the graph's nodes, before other work."""
    realtime.enter(realtime.Settings(core=realtime.choose_core("auto")), "emulator")
    with suppress(OSError):  # not permitted
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))


def default_link(kind: str) -> Path:
    """Return the path of the port of an emulator that is started by hand."""
    folder = runtime_folder()
    if folder is None:
        raise ConfigError("there is no private folder for the port: give a path with --link")
    return folder / f"forcebound-{kind}"


def launch_file_values(
    file: str, arguments: Sequence[str]
) -> tuple[Mapping[str, Any], Operator | None]:
    """Return mechanism and operator of a launch file whose device can be emulated."""
    from forcebound.graph.loader import load  # a driver that starts an emulator reads none

    config = load(file, arguments)
    model: Any = config.device.model
    return model.mechanism(), config.operator


def given_values(text: str) -> tuple[Mapping[str, Any], Operator | None]:
    """Return mechanism and operator of the document that a driver gives."""
    try:
        document = json.loads(text)
        return dict(document["mechanism"]), restored_operator(document["operator"])
    except ConfigError:
        raise
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"this is no description of an emulated device: {error!r}") from error
