"""The computation time of an environment, during which it answers nothing else."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from builders import MS, query
from fakes import press
from launch_texts import GOOD, problems_of, written

from forcebound.graph.loader import from_document, load
from forcebound.graph.parameters import change, parameters
from forcebound.graph.resolved import to_document
from forcebound.haptics.environments.walls import Wall
from forcebound.messages.control import Configure
from forcebound.messages.packets import EnvironmentReply, Telemetry
from forcebound.network.chances import Chances, ComputationTime, Draws
from forcebound.network.impairment import Impairment
from forcebound.network.trace import DelayTrace
from forcebound.nodes.environment import EnvironmentNode
from forcebound.run.application import Tuner
from forcebound.run.build import build_device, build_links, build_node
from forcebound.run.simulation import Simulation


@pytest.mark.parametrize("distribution", ["uniform", "normal", "pareto", "paretonormal"])
def test_times_are_drawn_as_the_delays_of_a_link_of_this_seed(distribution: Any) -> None:
    impairment = Impairment(0.003, 0.001, distribution=distribution, correlation=0.5)
    computation = ComputationTime(impairment, seed=7)
    chances = Chances(impairment, Draws(7))
    times = [computation.next_ns(0) for _ in range(200)]
    assert times == [chances.travel_ns() for _ in range(200)]
    assert len(set(times)) > 150


def test_a_trace_counts_from_the_first_computation() -> None:
    trace = DelayTrace((0.0, 0.01), (0.004, None))
    computation = ComputationTime(Impairment(trace=Path("t.csv")), trace=trace)
    start = 77 * MS
    found = [computation.next_ns(start + at * MS) for at in (0, 9, 10, 19, 20)]
    assert found == [4 * MS, 4 * MS, None, None, 4 * MS]


def test_it_changes_from_the_next_computation_on_and_the_numbers_go_on() -> None:
    impairment = Impairment(0.003, 0.001)
    chances = Chances(impairment, Draws(0))
    computation = ComputationTime(impairment)
    assert computation.next_ns(0) == chances.travel_ns()
    computation.change(Impairment(0.005))
    assert computation.next_ns(0) == 5 * MS
    computation.change(impairment)
    assert computation.next_ns(0) == chances.travel_ns()


def test_a_computation_does_not_silently_do_without_its_trace() -> None:
    with pytest.raises(ValueError, match=r"trace t\.csv"):
        ComputationTime(Impairment(trace=Path("t.csv")))


def test_a_failed_computation_is_not_answered_and_the_next_one_is() -> None:
    trace = DelayTrace((0.0, 0.001), (None, 0.001))
    node = EnvironmentNode(Wall(), ComputationTime(Impairment(trace=Path("t.csv")), trace=trace))
    assert node.step(0, [query(0)]) == []
    assert node.wake_ns is None
    assert node.step(MS, [query(1)]) == []
    assert node.wake_ns == 2 * MS
    (reply,) = node.step(2 * MS, [])
    assert isinstance(reply, EnvironmentReply)
    assert reply.query_seq == 1


def test_the_node_changes_while_it_runs_and_the_computation_in_work_keeps_its_time() -> None:
    node = EnvironmentNode(Wall(), ComputationTime(Impairment(0.003)))
    node.step(0, [query(0)])
    node.set(Wall(), Impairment(0.001))
    assert node.wake_ns == 3 * MS
    node.step(3 * MS, [query(1)])
    assert node.wake_ns == 4 * MS
    node.set(Wall(), Impairment(trace=Path("t.csv")), DelayTrace((0.0,), (0.0,)))
    assert len(node.step(4 * MS, [query(2)])) == 2


def test_throughput_falls_to_one_answer_a_computation_in_virtual_time() -> None:
    computation = ComputationTime(Impairment(0.0035, 0.0005), seed=3)
    packets = press("none", 1.0, computation=computation)
    times = [p.time_ns for p in packets if isinstance(p, EnvironmentReply)]
    assert len(times) == pytest.approx(1000 / 3.5, rel=0.15)
    assert min(b - a for a, b in pairwise(times)) >= 3 * MS


SETTINGS = {
    "compute_delay": "3 ms",
    "compute_jitter": "1 ms",
    "compute_distribution": "pareto",
    "compute_correlation": "25 %",
}


def computing(folder: Path, **settings: str) -> Path:
    lines = "".join(f"\n  {name}: {value}" for name, value in settings.items())
    return written(folder, GOOD.replace("  stiffness: $(arg stiffness)", f"  position: 0 m{lines}"))


def test_a_launch_file_takes_the_words_of_a_link(tmp_path: Path) -> None:
    config = load(computing(tmp_path, **SETTINGS))
    expected = Impairment(0.003, 0.001, distribution="pareto", correlation=0.25)
    assert config.environment.computation == expected
    assert from_document(json.loads(json.dumps(to_document(config)))) == config


def test_files_are_named_relative_to_the_launch_file(tmp_path: Path) -> None:
    written(tmp_path, "time_s,delay_s\n0,0.004\n", "busy.csv")
    config = load(computing(tmp_path, compute_trace="busy.csv"))
    assert config.environment.compute_trace == tmp_path / "busy.csv"
    node = build_node("environment", config)
    node.step(0, [query(0)])
    assert node.wake_ns == 4 * MS


def test_the_seed_of_the_launch_file_decides_the_times(tmp_path: Path) -> None:
    config = load(computing(tmp_path, **SETTINGS))

    def first(seed: int) -> int | None:
        node = build_node("environment", replace(config, seed=seed))
        node.step(0, [query(0)])
        return node.wake_ns

    assert first(1) == first(1)
    assert len({first(seed) for seed in range(10)}) > 5


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"compute_jitter": "1 N"}, "15:19: compute_jitter: expected a time"),
        ({"compute_correlation": "2"}, "15:24: compute_correlation: must be 0 to 1"),
        ({"compute_trace": "no.csv", "compute_delay": "1 ms"}, "compute_trace sets each delay"),
        ({"compute_jiter": "1 ms"}, "unknown key in environment: 'compute_jiter'"),
    ],
)
def test_problems_are_told_at_their_place(
    tmp_path: Path, settings: dict[str, str], message: str
) -> None:
    assert message in problems_of(computing(tmp_path, **settings))


def test_a_computation_beyond_the_age_limit_is_refused(tmp_path: Path) -> None:
    path = computing(tmp_path, compute_delay="150 ms", compute_jitter="20 ms")
    assert "an answer takes at least 132 ms" in problems_of(path)  # with 2 ms of the link


def test_traces_are_taken_and_left_while_the_graph_runs(tmp_path: Path) -> None:
    busy = written(tmp_path, "time_s,delay_s\n0,0.004\n", "busy.csv")
    away = written(tmp_path, "time_s,delay_s\n0,0.003\n", "away.csv")
    config = load(computing(tmp_path))
    delays: list[float | None] = []
    device = build_device(config.only)
    device.engage()
    graph = Simulation(
        [build_node("environment", config), build_node("controller", config), device],
        build_links(config),
        lambda packet: delays.append(packet.loop_delay) if isinstance(packet, Telemetry) else None,
    )
    settings: tuple[dict[str, object], ...] = (
        {"environment.compute_trace": str(busy)},
        {"links.environment_query.delay": 0, "links.environment_query.trace": str(away)},
        {"environment.compute_trace": None, "links.environment_query.trace": None},
    )
    found = []
    tuner = Tuner(config)
    for number, changes in enumerate(({}, *settings)):
        new = change(config, changes)
        tuner(graph, Configure(number, parameters(new)))
        config = new
        graph.run((number + 1) * 100 * MS)
        found.append(min(delay for delay in delays[-50:] if delay is not None))
    # 2 ms of the link; and 4 ms of computing; 3 and 4 ms; nothing.
    assert found == pytest.approx([0.0024, 0.0064, 0.0074, 0.0004])
