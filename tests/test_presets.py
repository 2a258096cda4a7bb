"""Named networks, and the spikes of a link."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import MS
from chance_tests import delays, is_likely
from launch_texts import GOOD, problems_of, written

import forcebound as fb
from forcebound.errors import ConfigError
from forcebound.graph.loader import from_document, load
from forcebound.graph.parameters import change
from forcebound.graph.resolved import to_document
from forcebound.network.chances import Chances, Draws
from forcebound.network.impairment import Impairment, Spike
from forcebound.network.presets import PRESETS, named_link
from forcebound.run.virtual import run_virtual

QUERY = "links.environment_query"


def network(name: str, **own: float) -> Impairment:
    return replace(PRESETS[name](), **own)  # type: ignore[arg-type]  # numbers of a link


# Spikes


def test_a_spike_delays_what_arrives_in_it_in_each_period() -> None:
    link = Impairment(delay=0.002, spikes=(Spike(0.05, 0.01, 0.004, start=0.03),))
    found = [delay // MS for delay in delays(link, 150)]
    assert found == ([2] * 30 + [6] * 10 + [2] * 10) * 3


def test_spikes_add_to_each_other_and_to_jitter_that_is_never_negative() -> None:
    spikes = (Spike(0.1, 0.1, 0.004), Spike(0.1, 0.1, 0.003))
    assert set(delays(Impairment(spikes=spikes), 100)) == {7 * MS}
    found = delays(Impairment(jitter=0.002, spikes=spikes), 1000)
    assert min(found) == 7 * MS
    assert max(found) > 8 * MS


def test_a_period_has_its_spike_by_chance_however_many_packets_arrive() -> None:
    link = Impairment(spikes=(Spike(0.01, 0.01, 0.005, chance=0.3),))
    every = [delay // MS for delay in delays(link, 20_000)]
    periods = [set(every[at : at + 10]) for at in range(0, 20_000, 10)]
    assert all(len(one) == 1 for one in periods)
    assert is_likely([one == {5} for one in periods], 0.3)
    assert delays(link, 20_000) == delays(link, 20_000) != delays(link, 20_000, seed=2)
    chances, few = Chances(link, Draws(1)), range(0, 20_000, 37)
    assert [chances.travel_ns(at * MS) for at in few] == [every[at] * MS for at in few]


def test_a_spike_that_outlasts_its_period_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"1\.1 s") as caught:
        Spike(period=1.0, start=0.9, duration=0.2, delay=0.01)
    assert caught.value.field == "duration"


# What the sources say


def one_way(name: str, seconds: int = 600) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    """Delays, in ms, of a packet each ms."""
    chances = Chances(PRESETS[name](), Draws(1))
    return np.array([chances.travel_ns(packet * MS) or 0 for packet in range(seconds * 1000)]) / 1e6


def test_a_round_trip_over_wifi_has_the_published_percentiles() -> None:
    median, p90, p99 = 2.0 * np.percentile(one_way("wifi"), [50, 90, 99])
    assert median == pytest.approx(3.0, rel=0.1)
    assert p90 == pytest.approx(20.0, rel=0.15)
    assert 200.0 < p99 < 280.0  # a single spell more or less moves it


def test_starlink_has_the_published_cycle_and_percentiles() -> None:
    delays_ms = one_way("starlink", 60)
    assert 2.0 * np.median(delays_ms) == pytest.approx(33.0, abs=0.5)
    assert 60.0 < 2.0 * np.percentile(delays_ms, 99) < 65.0
    is_late = delays_ms > 25.0
    assert np.flatnonzero(np.diff(is_late[:30_000])).tolist() == [139, 14_924, 15_139, 29_924]


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("lan", 0.0, 1.0),
        ("5g_nsa", 7.0, 18.0),
        ("transatlantic", 27.9, 45.0),
        ("geo", 239.0, 279.0),
    ],
)
def test_other_networks_stay_within_what_is_measured_or_possible(
    name: str, least: float, most: float
) -> None:
    """Of geo: the way of light up and down, from the middle and the edge of the Earth."""
    found = one_way(name, 10)
    assert least < found.min() < found.max() < most


# In a launch file


def of(path: Path, *overrides: str) -> Impairment:
    return load(path, overrides).only.links["environment_query"]


def preset_file(folder: Path, link: str) -> Path:
    return written(folder, GOOD.replace("delay: 2 ms", link))


def test_the_keys_beside_a_preset_win(tmp_path: Path) -> None:
    path = preset_file(tmp_path, "preset: starlink, loss: 2 %, jitter: 0")
    assert of(path) == network("starlink", loss=0.02, jitter=0.0)
    config = load(path)
    assert from_document(json.loads(json.dumps(to_document(config)))) == config
    assert fb.named_link("starlink", loss=0.02, jitter=0.0) == of(path)


def test_a_preset_takes_the_place_of_the_link_of_an_included_file(tmp_path: Path) -> None:
    written(tmp_path, GOOD, "base.yaml")
    text = "forcebound: 1\ninclude: base.yaml\nlinks: {environment_query: {preset: wifi}}\n"
    assert of(written(tmp_path, text)) == network("wifi")
    again = "forcebound: 1\ninclude: graph.yaml\nlinks: {environment_query: {loss: 1 %}}\n"
    assert of(written(tmp_path, again, "above.yaml")) == network("wifi", loss=0.01)


def test_on_the_command_line_a_preset_comes_before_what_is_beside_it(tmp_path: Path) -> None:
    path = preset_file(tmp_path, "delay: 2 ms, loss: 5 %")
    assert of(path, f"{QUERY}.preset:=transatlantic") == network("transatlantic")
    both = (f"{QUERY}.jitter:=0", f"{QUERY}.preset:=transatlantic")
    assert of(path, *both) == of(path, *reversed(both)) == network("transatlantic", jitter=0.0)


@pytest.mark.parametrize("link", ["preset: moon", "preset: 5"])
def test_an_unknown_network_is_refused_at_its_place(tmp_path: Path, link: str) -> None:
    problem = problems_of(preset_file(tmp_path, link))
    assert [name for name in ("16:31", *PRESETS) if name not in problem] == []
    with pytest.raises(ConfigError, match="moon"):
        named_link("moon")


def test_a_phase_and_a_change_set_all_keys_of_the_network(tmp_path: Path) -> None:
    text = preset_file(tmp_path, "delay: 2 ms, duplicate: 5 %").read_text()
    far = f"{QUERY}.preset: wifi, {QUERY}.loss: 1 %"
    phases = (
        "phases:\n"
        "  - { name: before, duration: 50 ms }\n"
        f"  - {{ name: far, duration: 50 ms, set: {{ {far} }} }}\n"
        "  - { name: after, duration: 50 ms }\n"
    )
    config = load(written(tmp_path, text.replace("duration: 6 s\n", "") + phases))
    changed = change(replace(config, phases=()), config.phases[1].settings)
    assert changed.only.links["environment_query"] == network("wifi", loss=0.01)
    assert from_document(json.loads(json.dumps(to_document(config)))) == config
    columns = run_virtual(config).columns
    for start in (0.01, 0.12):  # the phases around it are as the file says
        is_there = (columns.time >= start) & (columns.time < start + 0.03)
        assert set(columns.loop_delay[is_there].round(4)) == {0.0024}

    values = {f"{QUERY}.loss": "1 %", f"{QUERY}.preset": "wifi"}
    assert change(config, values).only.links["environment_query"] == network("wifi", loss=0.01)
    with pytest.raises(ConfigError, match="moon"):
        change(config, {f"{QUERY}.preset": "moon"})
    wrong = written(tmp_path, text.replace("duration: 6 s\n", "") + phases.replace("wifi", "moon"))
    assert "moon" in problems_of(wrong)
