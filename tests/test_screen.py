"""What a launcher says of its work, and the progress of a run in virtual time."""

import pytest
from run_starts import NODES

from forcebound.graph.loader import load
from forcebound.run.actions import Engaged, Interrupted, Reported, TimeLimits
from forcebound.run.lifecycle import Lifecycle
from forcebound.run.screen import Screen, doing
from forcebound.run.virtual import run_virtual


def test_each_step_of_a_start_is_told() -> None:
    lifecycle = Lifecycle(NODES, None, 0, TimeLimits())
    assert doing(lifecycle, 0.2) == "starting controller, device, environment, recorder, 0 s"
    for node in ("environment", "controller", "recorder"):
        lifecycle.advance(1, Reported(node, ()))
    assert doing(lifecycle, 4.0) == "starting device, 4 s (a first start compiles)"
    lifecycle.advance(2, Reported("device", ("force_command",)))
    assert doing(lifecycle, 5.0) == "waiting, 5 s: device has received nothing on force_command"
    lifecycle.advance(3, Reported("device", ()))
    assert doing(lifecycle, 5.1) == "all ready: the force engages"
    lifecycle.advance(4, Engaged("device"))
    assert doing(lifecycle, 5.2) == ""
    lifecycle.advance(5, Interrupted())
    assert doing(lifecycle, 9.0) == "stopping: zero force, then the processes"


def test_lines_of_processes_stand_above_the_status(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "20")
    screen = Screen(has_status=True)
    screen.status("starting device, controller")
    screen.status("starting device, controller")
    screen.show("device", "here")
    screen.status("")
    erase = "\r\033[K"
    short = "starting device, co"  # one less than the terminal is wide
    assert capsys.readouterr().err == f"{erase}{short}{erase}[device] here\n{short}{erase}"


def test_without_a_terminal_there_are_only_lines(capsys: pytest.CaptureFixture[str]) -> None:
    screen = Screen()
    screen.status("starting device")
    screen.show("device", "here")
    assert capsys.readouterr().err == "[device] here\n"


def test_a_run_in_virtual_time_tells_how_far_it_is() -> None:
    told: list[tuple[int, int]] = []
    run_virtual(load("stiff_wall"), 0.25, progress=lambda done, end: told.append((done, end)))
    assert told == [(100, 250), (200, 250), (250, 250)]
