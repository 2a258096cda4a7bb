"""The compiled loop of one axis against the graph in virtual time, to the bit."""

import re
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import load
from forcebound.haptics.environments import ENVIRONMENTS
from forcebound.haptics.hands.hands import SinusoidalHand
from forcebound.haptics.hands.paths import TrajectoryHand
from forcebound.haptics.hands.pointer import PointerHand
from forcebound.haptics.laws import LAWS
from forcebound.lab import one_axis, runs
from forcebound.lab.runs import coverage, run_all, unserved
from forcebound.messages.topology import HAND_SECTIONS
from forcebound.network.impairment import GilbertElliott, Impairment, Outage
from forcebound.run.virtual import run_virtual

PAGE = (Path(__file__).parent.parent / "docs" / "sweeps.md").read_text(encoding="utf-8")
SERVED = re.findall(r"^\| `(\w+)` \| served \|$", PAGE, re.MULTILINE)
loaded = cache(load)


def pressed(*arguments: str, seconds: float = 0.25) -> GraphConfig:
    return replace(loaded("stiff_wall", arguments), duration=seconds)


def with_servo(config: GraphConfig, **changed: Any) -> GraphConfig:
    servo = replace(config.only.servo, **changed)
    return config.with_hand(servo=servo)


def with_model(config: GraphConfig, **changed: Any) -> GraphConfig:
    model = replace(config.only.device, **changed)
    return config.with_hand(device=model)


def with_links(config: GraphConfig, impairment: Impairment) -> GraphConfig:
    return config.with_hand(
        links=dict.fromkeys(("environment_query", "environment_reply"), impairment)
    )


def assert_same_bits(config: GraphConfig) -> None:
    (ran,) = run_all([config])
    assert (ran.engine, ran.error) == ("kernel", None)
    assert ran.result is not None
    expected = run_virtual(config)
    assert ran.result.document == expected.document
    for field in fields(expected.columns):
        ours, graph = getattr(ran.result.columns, field.name), getattr(expected.columns, field.name)
        assert np.array_equal(ours, graph, np.asarray(graph).dtype.kind == "f"), field.name


@pytest.mark.parametrize("law", sorted(LAWS))
def test_every_law_has_the_bits_of_the_graph(law: str) -> None:
    assert_same_bits(pressed(f"law:={law}", "delay:=1 ms", "approach_speed:=300 mm/s"))


@pytest.mark.parametrize("file", SERVED)
def test_every_launch_file_that_is_served_has_the_bits_of_the_graph(file: str) -> None:
    assert_same_bits(replace(loaded(file), duration=0.3))


@pytest.mark.slow
@pytest.mark.parametrize("law", sorted(LAWS))
@pytest.mark.parametrize("file", SERVED)
def test_every_law_in_every_launch_file_has_the_bits_of_the_graph(file: str, law: str) -> None:
    assert_same_bits(with_servo(replace(loaded(file), duration=1.5), law=law))


@pytest.mark.parametrize("kind", sorted(one_axis.ENVIRONMENTS))
def test_every_environment_has_the_bits_of_the_graph(kind: str) -> None:
    config = pressed("delay:=0.3 ms")
    assert_same_bits(
        replace(config, environment=replace(config.environment, model=ENVIRONMENTS[kind]()))
    )


@pytest.mark.parametrize(
    "impairment",
    [
        Impairment(delay=0.002, jitter=0.003, loss=0.2),
        Impairment(delay=0.005, reorder=0.25, duplicate=0.2, corrupt=0.1),
        Impairment(delay=0.005, jitter=0.002, distribution="pareto", correlation=0.5),
        Impairment(gemodel=GilbertElliott(0.05, 0.3), outages=(Outage(0.1, 0.05),)),
    ],
    ids=str,
)
def test_impaired_links_give_the_bits_of_the_graph(impairment: Impairment) -> None:
    config = with_links(pressed(), impairment)
    assert_same_bits(config)
    assert_same_bits(replace(config, seed=7))


def test_recorded_delays_and_paths_are_read_again(tmp_path: Path) -> None:
    path, delays = tmp_path / "path.csv", tmp_path / "delays.csv"
    for end, delay in ((0.016, 0.001), (0.014, 0.003)):
        path.write_text(f"time,x\n0,0\n0.1,0.012\n0.2,{end}\n")
        delays.write_text(f"time_s,delay_s\n0,{delay}\n")
        config = with_links(pressed(), Impairment(trace=delays))
        assert_same_bits(config.with_hand(operator=TrajectoryHand(path)))


@pytest.mark.parametrize(
    "changed",
    [
        {"servo": {"reply_wait": 0.0}},
        {"servo": {"reply_wait": 0.5, "engage_time": 0.0, "hold_limit": 1.25}},
        {"servo": {"rate": 4000.0, "age_limit": 0.006, "velocity_cutoff": 30.0}},
        {"servo": {"rate": 300.0, "energy_cap": 0.01}},
        {"model": {"resolution": 0.0, "watchdog": "silent"}},
        {"model": {"resolution": 1e-3, "friction": 0.0}},
        {"environment": {"compute_delay": 0.0017, "compute_jitter": 0.0005}},
        {"operator": SinusoidalHand(frequency=4.0)},
        {"operator": None},
    ],
    ids=str,
)
def test_other_settings_give_the_bits_of_the_graph(changed: dict[str, Any]) -> None:
    config = pressed("delay:=2 ms")
    config = with_servo(config, **changed.pop("servo", {}))
    config = with_model(config, **changed.pop("model", {}))
    environment = replace(config.environment, **changed.pop("environment", {}))
    parts = {name: changed.pop(name) for name in HAND_SECTIONS if name in changed}
    config = config.with_hand(**parts)
    assert_same_bits(replace(config, environment=environment, **changed))


def test_cases_with_one_timing_share_a_pass_of_the_links(monkeypatch: pytest.MonkeyPatch) -> None:
    passes: list[GraphConfig] = []

    def counted(config: GraphConfig) -> Any:
        passes.append(config)
        return run_virtual(config)

    monkeypatch.setattr(runs, "run_virtual", counted)
    base = pressed("delay:=1.5 ms", seconds=0.031)
    random = with_links(base, Impairment(jitter=0.001))
    stiff = pressed("delay:=1.5 ms", "stiffness:=3 N/mm", "law:=none", seconds=0.031)
    run_all([base, stiff, replace(base, seed=5), random, replace(random, seed=5)])
    assert len(passes) == 3


def test_a_run_with_a_reading_that_the_bounder_refuses_goes_through_the_graph() -> None:
    taken = pressed(seconds=0.05)  # the hand approaches at 200 mm/s
    refused = with_model(taken, largest_speed=0.1)
    assert [ran.engine for ran in run_all([taken, refused])] == ["kernel", "graph"]


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"model": {"axes": 2}}, "2 axes"),
        ({"model": {"lag": 1e-3, "watchdog": "reporting", "hand_speed": None}}, "lag"),
        ({"model": {"friction": (0.12,)}}, "friction"),
        ({"model": {"watchdog": "none", "watchdog_limit": 0.1}}, "watchdog"),
        ({"operator": PointerHand()}, "pointer"),
        ({"links": {"force_command": Impairment(rate=1e6)}}, "rate"),
    ],
)
def test_what_is_not_served_is_named(changed: dict[str, Any], reason: str) -> None:
    config = with_model(pressed(), **changed.pop("model", {}))
    (found,) = unserved(config.with_hand(**changed))
    assert reason in found


def test_the_docs_list_what_is_served_and_what_is_not() -> None:
    listed = dict(coverage())
    for name, reasons in listed.items():
        assert f"| `{name}` | {reasons or 'served'} |" in PAGE
    assert [name for name, reasons in listed.items() if not reasons] == SERVED


def test_a_run_too_short_for_a_sample_is_an_error_of_its_own() -> None:
    short, sound = run_all([pressed(seconds=1e-4), pressed(seconds=0.01)])
    assert short.result is None
    assert "before its first sample" in str(short.error)
    assert sound.error is None
