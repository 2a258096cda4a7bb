"""The hand as an environment of gymnasium: its checker, physics, equality with a run, bad input."""

import sys
import warnings
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from launch_texts import written

from forcebound.errors import ConfigError
from forcebound.haptics.environments import open_environment
from forcebound.haptics.environments.bodies import Bodies
from forcebound.haptics.hands.pointer import PointerHand, PointerTarget
from forcebound.interface.gym import OBSERVED, HapticEnv
from forcebound.messages.codec import encode
from forcebound.messages.packets import Scene, Telemetry, Vector
from forcebound.run.virtual import VirtualGraph, run_virtual

NOISY = """
forcebound: 1
include: stiff_wall.yaml
phases:
  - { name: quiet, duration: 150 ms }
  - name: noisy
    duration: 250 ms
    set: { links.environment_reply.delay: 5 ms, links.environment_reply.jitter: 2 ms }
"""
# Its advice about lengths in m, and about forces and velocities without a limit.
ADVICE = ("symmetric and normalized space", "Box observation space")


@pytest.mark.parametrize("file", ["stiff_wall", "touch_sphere", "five_bar_wall"])
def test_checker_of_gymnasium_has_nothing_but_advice(file: str) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        env = gymnasium.make("forcebound/Hand-v0", file=file, frame_skip=3)
        check_env(env.unwrapped)
        env.close()
    words = [str(warning.message) for warning in caught]
    assert [each for each in words if not any(one in each for one in ADVICE)] == []


def pressed(env: HapticEnv, target: float, steps: int) -> tuple[Any, Any]:
    for _ in range(steps):
        observation, _, _, _, info = env.step(np.array([target]))
    return observation, info


def test_force_at_rest_is_the_stiffness_times_the_penetration() -> None:
    env = HapticEnv("stiff_wall", law="none", stiffness=1000.0)
    env.reset()
    observation, info = pressed(env, 0.014, 200)
    depth = observation["position"][0] - 0.010
    assert depth > 1e-3
    assert observation["velocity"][0] == pytest.approx(0.0, abs=1e-6)
    assert observation["applied_force"][0] == pytest.approx(1000.0 * depth, rel=1e-9)
    assert observation["commanded_force"] == observation["applied_force"]
    # Spring of the hand against the wall, but for what the friction of the device holds.
    assert 950.0 * (0.014 - 0.010 - depth) == pytest.approx(1000.0 * depth, abs=0.12)
    assert (info["law"], info["tick"]) == ("none", 2000)


@pytest.mark.parametrize("law", ["certified", "none"])
def test_a_hand_that_jumps_about_gets_energy_without_the_law_alone(law: str) -> None:
    env = HapticEnv("stiff_wall", law=law, delay="5 ms", frame_skip=20)
    env.action_space.seed(1)
    env.reset()
    lowest = 0.0
    for k in range(100):
        if k % 5 == 0:
            target = np.clip(env.action_space.sample(), 0.005, 0.025)
        info = env.step(target)[4]
        lowest = min(lowest, info["energy"])
    assert lowest >= -1e-9 if law == "certified" else lowest < -1e-3


def episode(env: HapticEnv, **reset: Any) -> list[Any]:
    observation, info = env.reset(**reset)
    rows = [(observation, info)]
    for k in range(20):
        observation, *_, info = env.step(np.array([0.012 + 0.004 * (k % 2)]))
        rows.append((observation, info))
    return [[*(row[name].tolist() for name in OBSERVED), info] for row, info in rows]


def test_a_seed_and_its_actions_give_the_same_bits(tmp_path: Path) -> None:
    file = str(written(tmp_path, NOISY))
    env = HapticEnv(file, frame_skip=20)
    first = episode(env, seed=7)
    assert episode(HapticEnv(file, frame_skip=20), seed=7) == first
    second = episode(env)
    drawn = second[-1][-1]["seed"]
    assert second[-1][:-1] != first[-1][:-1]  # the jitter is another one
    assert episode(env, seed=7) == first
    assert episode(env) == second
    assert episode(env, seed=drawn) == second


def test_environments_of_a_vector_have_seeds_of_their_own(tmp_path: Path) -> None:
    file = str(written(tmp_path, NOISY))
    several = gymnasium.vector.SyncVectorEnv([lambda: HapticEnv(file, frame_skip=20)] * 3)
    seeds = [several.reset()[1]["seed"].tolist()]
    seeds += [several.reset(seed=5)[1]["seed"].tolist(), several.reset()[1]["seed"].tolist()]
    assert seeds[1] == [5, 6, 7]
    assert len({*seeds[0], *seeds[1], *seeds[2]}) == 9
    several.close()


def scripted(monkeypatch: pytest.MonkeyPatch, frame_skip: int, actions: Sequence[Vector]) -> None:
    """Let the hand of a graph be pointed where the actions of an environment's steps point it."""

    class Scripted(PointerTarget):
        time = 0.0  # s

        def advance(self, duration: float) -> Vector:
            self.time += duration
            step = int(self.time * 1e3 + 1e-6 - 1.0) // frame_skip  # the first tick is reset()'s
            if self.time > 1e-3 - 1e-9:
                self.point(actions[min(step, len(actions) - 1)])
            return super().advance(duration)

    monkeypatch.setattr(PointerHand, "follow", lambda hand, axes: Scripted(hand, axes))


def test_steps_are_the_run_of_the_launch_file_with_the_same_motion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    env = HapticEnv(str(written(tmp_path, NOISY)), frame_skip=20, law="none")
    rows = episode(env, seed=3)
    scripted(monkeypatch, 20, [(0.012 + 0.004 * (k % 2),) for k in range(20)])
    columns = run_virtual(replace(env.config, seed=3), 0.401).columns
    assert columns.applied_force.max() > 1.0
    for row in rows:
        tick = row[-1]["tick"]
        assert row[0] == columns.position[tick].tolist()
        assert row[2] == columns.applied_force[tick].tolist()
        assert row[-1]["energy"] == columns.true_energy[tick]


class Kept(HapticEnv):
    """Keeps the telemetry of every tick."""

    ticks: ClassVar[list[Telemetry]] = []

    def reward(self, telemetry: Sequence[Telemetry], *seen: Any) -> float:
        self.ticks.extend(telemetry)
        return 0.0


LOCAL = "forcebound: 1\ninclude: hold_arm.yaml\ncontroller: { kind: local_model }\n"


@pytest.mark.parametrize("file", ["hold_arm", "push_boxes", "touch_sphere", "membrane", LOCAL])
def test_every_tick_is_that_of_a_graph_that_makes_scenes_and_contacts(
    file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = str(written(tmp_path, file)) if "\n" in file else file
    env = Kept(file, frame_skip=20)
    env.ticks.clear()
    env.reset(seed=2)
    space = env.action_space
    assert isinstance(space, gymnasium.spaces.Box)
    start = (space.low + space.high) / 2.0
    actions = [
        tuple((start + min(k * 4e-3, 0.04) * np.eye(len(start))[0]).tolist()) for k in range(20)
    ]
    for action in actions:
        env.step(np.array(action))
    scripted(monkeypatch, 20, actions)
    whole: list[Any] = []
    graph = VirtualGraph(replace(env.config, seed=2), whole.append, (Telemetry, Scene))
    graph.run(401_000_000)
    graph.close()
    ticks = [packet for packet in whole if isinstance(packet, Telemetry)]
    assert [encode(tick) for tick in ticks[1:]] == [encode(tick) for tick in env.ticks]
    assert len(env.ticks) == 400
    assert len(whole) > 401
    assert max(abs(tick.applied_force[0]) for tick in ticks) > 0.1


def test_an_episode_is_as_long_as_the_launch_file_says(tmp_path: Path) -> None:
    env = HapticEnv(str(written(tmp_path, NOISY)), frame_skip=100)
    env.reset()
    assert [env.step(np.array([0.0]))[3] for _ in range(4)] == [False, False, False, True]


class Shy(HapticEnv):
    """A task: touch the wall with little force."""

    def reward(self, telemetry: Sequence[Telemetry], *seen: Any) -> float:
        assert len(telemetry) == 10
        return -max(abs(tick.applied_force[0]) for tick in telemetry)

    def is_over(self, telemetry: Sequence[Telemetry], *seen: Any) -> bool:
        return self.reward(telemetry) < -1.0


def test_a_task_has_its_own_reward_and_end() -> None:
    env = Shy("stiff_wall", stiffness="1 N/mm")
    env.reset()
    steps = [env.step(np.array([0.014])) for _ in range(100)]
    assert steps[0][1] == 0.0
    over = [step[2] for step in steps].index(True)
    assert steps[over][1] < -1.0 <= steps[over - 1][1]


def test_an_episode_may_have_parameters_of_its_own() -> None:
    env = HapticEnv("stiff_wall", law="none", stiffness=1000.0)
    env.reset(options={"environment.stiffness": "0.5 N/mm"})
    observation, _ = pressed(env, 0.014, 200)
    force, place = observation["applied_force"][0], observation["position"][0]
    assert force == pytest.approx(500.0 * (place - 0.010), rel=1e-9)
    with pytest.raises(ConfigError, match="stifness"):
        env.reset(options={"environment.stifness": 1.0})


@pytest.mark.parametrize(
    ("file", "arguments", "word"),
    [
        ("stif_wall", {}, "stif_wall"),
        ("stiff_wall", {"stifness": 1.0}, "stifness"),
        ("stiff_wall", {"stiffness": "1 s"}, "stiffness"),
        ("stiff_wall", {"frame_skip": 0}, "frame_skip"),
        ("haply_2diy", {}, "virtual time"),
    ],
)
def test_what_is_no_environment_is_refused(file: str, arguments: dict[str, Any], word: str) -> None:
    with pytest.raises(ConfigError, match=word):
        HapticEnv(file, **arguments)


def test_a_device_that_nobody_holds_is_refused(tmp_path: Path) -> None:
    file = written(
        tmp_path,
        "forcebound: 1\nseed: 1\nduration: 1 s\ndevice: {kind: "
        "phantom_premium_1_5}\nenvironment: {kind: wall}\n",
    )
    with pytest.raises(ConfigError, match="operator"):
        HapticEnv(str(file))


@pytest.mark.parametrize("action", [[0.0, 0.0], [[0.0]], [np.nan]])
def test_an_action_that_is_no_place_is_refused(action: Any) -> None:
    env = HapticEnv()
    env.reset()
    with pytest.raises(ConfigError, match="action"):
        env.step(np.array(action))


def test_a_step_needs_a_reset_first() -> None:
    env = HapticEnv()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.array([0.0]))
    env.reset()
    env.close()
    env.close()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.array([0.0]))


def test_without_gymnasium_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "forcebound.interface.gym")
    with pytest.raises(ConfigError, match=r"forcebound\[gymnasium\]"):
        import_module("forcebound.interface.gym")


def test_a_model_of_gymnasium_is_held_by_the_hand() -> None:
    import gymnasium

    file = Path(gymnasium.__file__).parent / "envs/mujoco/assets/pusher_v5.xml"
    scene: Any = open_environment(Bodies(file, tool="tips_arm", timestep=0.001), 3)
    assert scene.force("", (0.05, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0) == (0.0, 0.0, 0.0)
    at_first = next(one for one in scene.scene() if one.name == "tip_arml").position
    for i in range(3000):
        y = min(i * 1e-5, 0.02)
        force = scene.force("", (0.05, y, 0.0), (0.0, 0.0, 0.0), i * 1e-3)
    after = next(one for one in scene.scene() if one.name == "tip_arml").position
    # The arm turns about its shoulder, 0.82 m away; what is drawn is 0.1 m farther.
    assert after[1] - at_first[1] == pytest.approx(0.02 * 0.92 / 0.82, abs=1e-3)
    assert abs(force[1]) < 0.5  # nothing but the dampers of the joints


@pytest.mark.parametrize("file", ["stiff_wall", "membrane", "hold_arm"])
def test_a_deep_copy_goes_on_as_the_original_and_leaves_it_alone(file: str) -> None:
    env = HapticEnv(file, frame_skip=5)
    assert deepcopy(env).reset(seed=3)[1] == env.reset(seed=3)[1]
    actions = [0.012 * np.ones(env.action_space.shape or ()) for _ in range(20)]
    for action in actions:
        env.step(action)
    copied = deepcopy(env)
    ahead = [copied.step(action) for action in actions]
    for expected, action in zip(ahead, actions, strict=True):
        observation, *_, info = env.step(action)
        assert info == expected[-1]
        for name in OBSERVED:
            assert observation[name] == pytest.approx(expected[0][name], abs=0.0)
    copied.close()
    env.step(actions[0])
