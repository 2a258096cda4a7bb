"""The compiled kernel against the virtual-time graph, case by case."""

import random
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from forcebound.analysis.bounder import REPORTED
from forcebound.bounding import LAWS
from forcebound.config.graph import GraphConfig
from forcebound.config.loader import load
from forcebound.environments import ENVIRONMENTS
from forcebound.environments.active_wall import ActiveWall
from forcebound.launch.virtual import run_virtual
from forcebound.network.impairment import Impairment
from forcebound.operators.hands import SinusoidalHand
from forcebound.operators.paths import TrajectoryHand
from forcebound.sweep import kernel as lanes
from forcebound.sweep.engine import run_all, ticks_of
from forcebound.sweep.timing import timing_of
from forcebound.topology import LINKS

SAME = (
    "time",
    "elapsed",
    "position",
    "commanded_force",
    "applied_force",
    "estimated_energy",
    "true_energy",
    "true_position",
    "engagement",
    "loop_delay",
)


loaded = cache(load)


def case(*arguments: str, seconds: float = 0.5, reply_wait: float = 0.4) -> GraphConfig:
    config = loaded("stiff_wall", arguments)
    servo = replace(config.device.servo, reply_wait=reply_wait)
    return replace(config, duration=seconds, device=replace(config.device, servo=servo))


def assert_both_agree(configs: list[GraphConfig]) -> None:
    for config, ran in zip(configs, run_all(configs), strict=True):
        assert ran.engine == "kernel"
        assert ran.result is not None
        expected = run_virtual(config)
        for name in SAME:
            ours, graph = getattr(ran.result.columns, name), getattr(expected.columns, name)
            np.testing.assert_allclose(ours, graph, rtol=1e-12, atol=1e-15, err_msg=name)
        assert np.array_equal(ran.result.columns.device_seq, expected.columns.device_seq)
        assert ran.result.document == expected.document
        ours, graph = _flat(ran.result.summary), _flat(expected.summary)
        assert ours.keys() == graph.keys()
        for name, value in graph.items():
            if isinstance(value, float):
                value = pytest.approx(value, rel=1e-9, abs=1e-15)
            assert ours[name] == value, name


def _flat(summary: Mapping[str, Any]) -> dict[str, Any]:
    delays = summary["loop_delay_ms"]
    # The kernel has no events, and so no report of a bounder.
    left_out = ("loop_delay_ms", "links", "faults", "phases", *REPORTED)
    rest = {name: value for name, value in summary.items() if name not in left_out}
    return {**rest, **{f"loop_delay_ms.{name}": value for name, value in delays.items()}}


@pytest.mark.parametrize("law", sorted(LAWS))
def test_the_kernel_equals_the_graph_for_every_law(law: str) -> None:
    chosen = f"law:={law}"
    assert_both_agree(
        [
            case(chosen),
            case(chosen, reply_wait=0.0),
            case(chosen, "delay:=2 ms", "approach_speed:=35 mm/s", seconds=0.9),
            case(chosen, "delay:=0.7 ms", "compute_delay:=1.7 ms", reply_wait=0.0),
            case(chosen, "compute_delay:=0.4 ms", "stiffness:=0.5 N/mm"),
        ]
    )


@pytest.mark.parametrize("kind", sorted(lanes.ENVIRONMENTS))
def test_the_kernel_equals_the_graph_in_every_environment_that_it_knows(kind: str) -> None:
    config = case("delay:=0.3 ms")
    wall = replace(config.environment, model=ENVIRONMENTS[kind]())
    assert_both_agree([replace(config, environment=wall)])


def test_the_kernel_equals_the_graph_for_every_hand(tmp_path: Path) -> None:
    file = tmp_path / "path.csv"
    file.write_text("time,x\n0,0\n0.1,0.012\n0.2,0.009\n0.4,0.016\n")
    config = case()
    hands = (SinusoidalHand(frequency=4.0), TrajectoryHand(file))
    assert_both_agree([replace(config, operator=hand) for hand in hands])


def test_jitter_and_loss_draw_the_same_numbers_in_both() -> None:
    bad = Impairment(delay=0.002, jitter=0.003, loss=0.2)
    links = {"environment_query": bad, "environment_reply": bad}
    assert_both_agree([replace(case(), links=links, seed=seed) for seed in range(3)])


def test_a_coarse_encoder_none_and_other_rates_agree_too() -> None:
    config = case()
    model: Any = config.device.model
    models = [replace(model, resolution=r) for r in (0.0, 1e-3)]
    configs = [replace(config, device=replace(config.device, model=model)) for model in models]
    for rate in (300.0, 4000.0):
        servo = replace(config.device.servo, rate=rate, hold_limit=1.0)
        configs.append(replace(config, device=replace(config.device, servo=servo)))
    assert_both_agree(configs)


def test_neighbours_do_not_change_a_run() -> None:
    configs = [case(f"stiffness:={k} N/mm") for k in range(1, 40)]
    alone = run_all(configs[:1])[0].result
    together = run_all(configs)[0].result
    assert alone is not None
    assert together is not None
    assert np.array_equal(alone.columns.true_position, together.columns.true_position)


def test_a_case_with_a_reading_that_the_bounder_refuses_goes_through_the_graph() -> None:
    taken = case(seconds=0.3)  # the hand approaches at 200 mm/s
    shipped: Any = taken.device.model
    model = replace(shipped, largest_speed=0.1)
    refused = replace(taken, device=replace(taken.device, model=model))
    assert [ran.engine for ran in run_all([taken, refused])] == ["kernel", "graph"]


def test_what_the_kernel_does_not_know_goes_through_the_graph() -> None:
    config = case(seconds=0.02)
    model: Any = config.device.model
    two_axes = replace(config.device, model=replace(model, axes=2))
    hurting = replace(config.environment, model=ActiveWall())
    configs = [replace(config, device=two_axes), replace(config, environment=hurting), config]
    assert [ran.engine for ran in run_all(configs)] == ["graph", "graph", "kernel"]
    assert [ran.engine for ran in run_all(configs, engine="graph")] == ["graph"] * 3


def test_a_run_too_short_for_a_sample_is_an_error_of_its_own() -> None:
    short, sound = run_all([case(seconds=1e-4), case(seconds=0.01)])
    assert short.result is None
    assert "before its first sample" in str(short.error)
    assert sound.error is None


def test_the_timing_of_a_run_is_that_of_the_graph() -> None:
    draw = random.Random(3)
    delays = [0.0, 0.0, 0.0, 1e-4, 2e-4, 3e-4, 4e-4, 5e-4, 6e-4, 1e-3, 1.4e-3, 2e-3, 3e-3]
    inexact = 0
    for seed in range(150):
        is_random = draw.random() < 0.3
        links = {
            topic: Impairment(
                delay=draw.choice(delays),
                jitter=draw.choice([0.0, 1e-3, 3e-3]) if is_random else 0.0,
                loss=draw.choice([0.0, 0.2]) if is_random else 0.0,
            )
            for topic in LINKS
        }
        config = replace(case(seconds=0.05), links=links, seed=seed)
        compute = draw.choice([*delays, 0.8e-3, 1.2e-3, 1.5e-3, 2.6e-3, 4e-3])
        servo = replace(
            config.device.servo,
            reply_wait=draw.choice([0.0, 0.4, 0.5]),
            engage_time=draw.choice([0.0, 0.01]),
            age_limit=draw.choice([0.1, 0.006, 0.009]),
        )
        config = replace(
            config,
            device=replace(config.device, servo=servo),
            environment=replace(config.environment, compute_delay=compute),
        )
        timing = timing_of(config, ticks_of(config))
        if not timing.is_exact:
            inexact += 1
            continue
        columns = run_virtual(config).columns
        assert np.array_equal(timing.answered, columns.device_seq), config
        assert np.array_equal(timing.engagement, columns.engagement), config
        assert timing.rejected == columns.rejected, config
    assert inexact <= 5
