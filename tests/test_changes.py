"""Parameters of a running graph: names, permitted values, phases, in virtual time and live."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from forcebound.errors import ConfigError
from forcebound.graph.graph import GraphConfig, PartSpec
from forcebound.graph.loader import from_document, load
from forcebound.graph.model import restore
from forcebound.graph.names import LAW
from forcebound.graph.parameters import change, describe, differences, node_of, parameters
from forcebound.graph.resolved import to_document
from forcebound.messages.control import Configure
from forcebound.messages.packets import EnvironmentQuery, Event
from forcebound.messages.topology import ONE_HAND
from forcebound.nodes import Node
from forcebound.nodes.environment import EnvironmentNode
from forcebound.observe.formatting import as_written
from forcebound.observe.tuning import find_parameters, read_settings
from forcebound.run.application import Tuner
from forcebound.run.build import build_device

EXAMPLES = Path(__file__).parent.parent / "examples" / "python"


@pytest.fixture(scope="module")
def config() -> GraphConfig:
    return replace(load("stiff_wall"), duration=0.5)


# --- Names and values ----------------------------------------------------------------------------


def test_every_impairment_of_every_link_and_all_of_the_environment_can_be_changed(
    config: GraphConfig,
) -> None:
    known = parameters(config)
    assert {"environment.stiffness", "environment.compute_delay"} <= known.keys()
    for topic in ("device_state", "environment_query", "environment_reply", "force_command"):
        assert known[f"links.{topic}.loss"] == 0.0
    assert [name for name in known if "kind" in name or name.startswith("device.")] == [LAW]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"environment.stifness": 1}, "did you mean 'environment.stiffness'"),
        ({"device.law": "fading"}, "unknown law .* did you mean 'certified_fading'"),
        ({"device.law": "my_law.py"}, "needs a launch of its own"),
        ({"device.law": None}, "unknown law 'None'"),
        ({"device.allowance": 1.0}, "device.allowance is fixed while a graph runs"),
        ({"remote.port": 7000}, "remote.port is fixed"),
        ({"stiffness": 2}, "did you mean 'environment.stiffness'"),
        ({"delay": 0.1}, "'links.device_state.delay' or 'links.environment_query.delay' or"),
        (
            {"xyzzy": 1},
            "'xyzzy'; what can be changed is in device.law, links.*state, .* and environment$",
        ),
        ({"links.environment_query.delay": "3 N"}, "^links.environment_query.delay: expected a"),
        ({"links.environment_query.delay": "1 s"}, "age_limit"),
    ],
)
def test_what_cannot_be_set_is_refused_with_a_reason(
    config: GraphConfig, settings: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        change(config, settings)


def test_values_are_shown_as_one_may_set_them(config: GraphConfig) -> None:
    settings = {
        "links.device_state.gemodel": {"p": 0.01, "r": "20 %"},
        "links.device_state.outages": [{"start": "3 s", "duration": "10 ms"}],
        "links.device_state.rate": "64 kB/s",
        "links.device_state.distribution": "normal",
        "links.device_state.limit": 7,
        "environment.stiffness": "2 N/mm",
    }
    new = change(config, settings)
    assert replace(new, hands=config.hands, environment=config.environment) == config
    shown = as_written(new, {**differences(config, new), "links.force_command.trace": None})
    assert shown == {
        "links.device_state.gemodel": "{ p: 0.01, r: 0.2, h: 0, k: 1 }",
        "links.device_state.outages": "[{ start: 3 s, duration: 0.01 s }]",
        "links.device_state.rate": "64000 B/s",
        "links.device_state.distribution": "normal",
        "links.device_state.limit": "7",
        "environment.stiffness": "2000 N/m",
        "links.force_command.trace": "null",
    }
    read = read_settings([f"{name}:={text}" for name, text in shown.items()])
    assert parameters(change(config, read)) == parameters(new)


def test_every_parameter_survives_the_way_to_the_reader_and_back(config: GraphConfig) -> None:
    shown = as_written(config, parameters(config))
    assert change(config, read_settings([f"{k}:={text}" for k, text in shown.items()])) == change(
        config, parameters(config)
    )


def test_a_parameter_of_a_users_file_that_is_not_read_keeps_its_unit() -> None:
    config = restore(to_document(load(EXAMPLES / "my_environment.yaml")))
    assert isinstance(config.environment.model, PartSpec)
    shown = as_written(config, {"environment.stiffness": 1500.0, "environment.damping": 1.0})
    assert shown == {"environment.stiffness": "1.5 N/mm", "environment.damping": "1 N s/m"}


@pytest.mark.parametrize("text", ["/tmp/a b.csv", "a: b", "#1", "null", "12", "", "it's"])
def test_text_is_quoted_where_yaml_needs_it(config: GraphConfig, text: str) -> None:
    shown = as_written(config, {"links.device_state.distribution": text})
    [(name, value)] = shown.items()
    assert read_settings([f"{name}:={value}"]) == {name: text}


def test_a_setting_is_read_as_in_a_launch_file() -> None:
    texts = ["environment.stiffness:=2 N/mm", "links.device_state.outages:=[{start: 1 s}]"]
    assert read_settings(texts) == {
        "environment.stiffness": "2 N/mm",
        "links.device_state.outages": [{"start": "1 s"}],
    }
    assert read_settings(["links.device_state.trace:=a.csv"]) == {
        "links.device_state.trace": str(Path("a.csv").absolute())
    }


@pytest.mark.parametrize("text", ["environment.stiffness=2", ":=2", "nonsense"])
def test_a_setting_without_name_and_sign_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="name:=value"):
        read_settings([text])


def test_a_section_stands_for_its_parameters(config: GraphConfig) -> None:
    found = find_parameters(config, ["links.force_command"])
    assert set(found) == {name for name in parameters(config) if "force_command" in name}
    assert find_parameters(config, []) == parameters(config)
    with pytest.raises(ConfigError, match="did you mean"):
        find_parameters(config, ["environment.stifness"])


# --- In a running process ------------------------------------------------------------------------


def process(nodes: list[Node]) -> Mock:
    return Mock(graph=ONE_HAND, nodes=nodes)


def request(config: GraphConfig, time_ns: int, **stiffness: float) -> Configure:
    settings = parameters(config) | {f"environment.{n}": v for n, v in stiffness.items()}
    return Configure(time_ns, settings)


def test_of_two_requests_that_overtake_each_other_the_newer_one_counts(
    config: GraphConfig,
) -> None:
    one = process([EnvironmentNode(config.environment.model)])
    tuner = Tuner(config)
    assert tuner(one, request(config, 5, stiffness=400.0)) == {"environment.stiffness": 400.0}
    assert tuner(one, request(config, 4, stiffness=300.0)) == {}
    assert tuner(one, request(config, 6, stiffness=400.0)) == {}
    (reply,) = one.nodes[0].step(5, [EnvironmentQuery(1, 1, 1, 1, 0.0, (0.02,), (0.0,), None)])
    assert reply.force == (pytest.approx(4.0),)


def with_law(config: GraphConfig, law: object) -> Configure:
    return Configure(5, parameters(config) | {LAW: law})


def test_a_device_takes_a_law_and_no_other_process_does(config: GraphConfig) -> None:
    device = build_device(config.only)
    settings = with_law(config, "none")
    other = process([EnvironmentNode(config.environment.model)])
    assert node_of(LAW, config) == "device"
    assert Tuner(config)(other, settings) == {}
    assert Tuner(config)(process([device]), settings) == {}  # it reports when it has taken it
    packets = [packet for time_ns in (0, 400_000) for packet in device.step(time_ns, ())]
    assert [packet.data["law"] for packet in packets if isinstance(packet, Event)] == ["none"]
    for damaged in ("my_law.py", 3):
        with pytest.raises(ConfigError, match=r"device\.law: .*(of its own|unknown law)"):
            Tuner(config)(process([device]), with_law(config, damaged))


def test_a_damaged_request_changes_nothing(config: GraphConfig) -> None:
    one = process([EnvironmentNode(config.environment.model)])
    with pytest.raises(ConfigError, match="expected a stiffness"):
        Tuner(config)(one, Configure(5, {"environment.stiffness": "soft"}))


def test_units_come_back_as_they_went_in(config: GraphConfig) -> None:
    settings = {"links.environment_query.delay": "20 ms", "environment.stiffness": "2 N/mm"}
    new = change(config, settings)
    values = differences(config, new)
    assert as_written(new, values, new.units) == settings
    again = from_document(json.loads(json.dumps(to_document(new))))
    assert as_written(again, values, again.units) == settings
    assert describe(values, again.units).endswith("environment.stiffness = 2 N/mm")
    bare = change(new, {"links.environment_query.delay": 0.005})
    assert as_written(bare, differences(new, bare), bare.units) == {
        "links.environment_query.delay": "5 ms"
    }
