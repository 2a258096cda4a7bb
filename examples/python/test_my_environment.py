"""Tests of my environment: `pytest` in this folder runs them.

A test of the contract fails with the promise that is broken, the question, and what was expected.
docs/write-your-own-environment.md explains more.
"""

from pathlib import Path

import pytest
from my_environment import Ball

import forcebound as fb
from forcebound.testing import check_environment

LAUNCH_FILE = Path(__file__).with_name("my_environment.yaml")


def test_the_ball_keeps_its_promises() -> None:
    report = check_environment(Ball(), at_rest={0.0: 0.0})  # at 0 mm, before the ball: 0 N
    assert report.held["resists"]  # a press into it met a force that resists
    assert report.held["contact"]  # it says where it is touched


def test_a_hand_feels_the_stiffness_and_receives_no_energy() -> None:
    run = fb.simulate(LAUNCH_FILE, stiffness="1 N/mm", duration="2 s")  # in virtual time
    assert run.figures.displayed_stiffness == pytest.approx(1000.0, rel=0.05)  # N/m
    assert run.figures.true_energy_min >= 0.0  # J
