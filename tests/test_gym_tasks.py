"""Tasks of one's own for the hand in gymnasium: the page's task, what it gets, pictures, resets."""

import re
import sys
import warnings
from collections.abc import Iterator
from copy import deepcopy
from ctypes.util import find_library
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from forcebound.bounded_child import in_bounded_child
from forcebound.errors import ConfigError
from forcebound.haptics.environments import mujoco_scene
from forcebound.interface.gym import HapticEnv
from forcebound.messages.packets import Telemetry

PAGE = (Path(__file__).parent.parent / "docs/gymnasium.md").read_text(encoding="utf-8")
ADVICE = ("symmetric and normalized space", "Box observation space")  # of gymnasium's checker
needs_egl = pytest.mark.skipif(find_library("EGL") is None, reason="no library of EGL here")


def blocks(language: str) -> list[str]:
    """Return the blocks of the page in a language."""
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture
def names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, Any]]:
    """The names of the page's task, in a folder with its files."""
    monkeypatch.chdir(tmp_path)
    Path("push_box.xml").write_text(blocks("xml")[0])
    Path("push_box.yaml").write_text(blocks("yaml")[0])
    found: dict[str, Any] = {"__name__": "task"}
    task = next(one for one in blocks("python") if "class PushBox" in one)
    exec(task.partition("\nenv = ")[0], found)
    yield found
    gymnasium.registry.pop("push/Box-v0", None)


def test_the_page_prints_what_it_says(
    names: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    first, task = blocks("python")[:2]
    for code, printed in zip(
        (first, "env = " + task.partition("\nenv = ")[2]), blocks("text"), strict=True
    ):
        exec(code, names)
        assert capsys.readouterr().out == printed


@needs_egl
def test_the_picture_of_the_page_shows_the_box_where_it_is(names: dict[str, Any]) -> None:
    exec(blocks("python")[2], names)
    picture = names["picture"]
    assert (picture.shape, picture.dtype) == ((240, 320, 3), np.uint8)

    def box(picture: Any) -> Any:
        """Return the middle of what is more red than blue, in pixels from top and left."""
        red, blue = picture[..., 0].astype(int), picture[..., 2].astype(int)
        return np.argwhere(red > blue + 60).mean(axis=0)

    env = names["PushBox"](frame_skip=20, render_mode="rgb_array", camera="above")
    observation, _ = env.reset()
    before, start = env.render(), observation[2]
    while observation[2] < start + 0.02:
        observation = env.step(names["policy"](observation))[0]
    after = env.render()
    env.reset()
    again = env.render()
    env.close()
    assert before.shape == (480, 640, 3)
    assert box(after)[1] > box(before)[1] + 40.0
    assert np.array_equal(again, before)


def test_the_task_passes_the_checker_of_gymnasium(names: dict[str, Any]) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        env = gymnasium.make("push/Box-v0", frame_skip=20)
        check_env(env.unwrapped, skip_render_check=find_library("EGL") is None)
        env.close()
    words = [str(warning.message) for warning in caught]
    assert [each for each in words if not any(one in each for one in ADVICE)] == []


def test_several_environments_are_stepped_as_each_alone(names: dict[str, Any]) -> None:
    several = gymnasium.make_vec("push/Box-v0", num_envs=2, frame_skip=20)
    together = [several.reset(seed=5)[0]]
    action = np.array([0.02, 0.0, 0.01])
    together += [several.step(np.array([action, -action]))[0] for _ in range(10)]
    several.close()
    for number, sign in enumerate((1.0, -1.0)):
        env = gymnasium.make("push/Box-v0", frame_skip=20)
        alone = [env.reset(seed=5 + number)[0]]
        alone += [env.step(sign * action)[0] for _ in range(10)]
        env.close()
        assert [row.tolist() for row in alone] == [rows[number].tolist() for rows in together]


class Seen(HapticEnv):
    """Observes all that it gets."""

    def observation(self, *seen: Any) -> Any:
        return seen


def test_a_task_gets_telemetry_scene_and_signals_of_the_step(names: dict[str, Any]) -> None:
    env = Seen("push_box.yaml", frame_skip=20)
    telemetry, scene, signals = env.reset()[0]
    assert [type(tick) for tick in telemetry] == [Telemetry]
    assert scene["box"].position == pytest.approx((0.02, 0.0, 0.012))
    for _ in range(10):
        telemetry, scene, signals = env.step(np.array([0.01, 0.0, 0.01]))[0]
    assert [tick.seq for tick in telemetry] == list(range(181, 201))
    # Signals are of the answers' time step, which comes after the pose that is drawn, if at all.
    place = tuple(signals[f"box_{axis}"] for axis in "xyz")
    assert scene["box"].position == pytest.approx(place, abs=2e-4)
    assert scene["box"].position[0] > 0.0205
    assert signals["box_vx"] > 0.0


def test_an_object_that_is_not_there_gets_the_names_that_are(names: dict[str, Any]) -> None:
    env = Seen("push_box.yaml")
    _, scene, _ = env.reset()[0]
    with pytest.raises(KeyError, match="box, floor"):
        scene["goal"]
    assert scene.get("goal") is None


def test_the_model_has_three_joints_more_than_the_signals(names: dict[str, Any]) -> None:
    Path("all.yaml").write_text(blocks("yaml")[0].replace("[box]", "[qpos]"))
    env = Seen("all.yaml")
    env.reset()
    signals = env.step(np.zeros(3))[0][2]
    drawn = env.world.mujoco()
    assert drawn is not None
    model = drawn[0]
    own = [model.joint(i).name.startswith("forcebound_probe") for i in range(model.njnt)]
    assert (model.nq - len(signals), sum(own)) == (3, 3)


def test_a_copy_of_a_task_goes_on_as_the_original(names: dict[str, Any]) -> None:
    env = names["PushBox"](frame_skip=20)
    observation, _ = env.reset(seed=3)
    for _ in range(8):
        observation = env.step(names["policy"](observation))[0]
    copied = deepcopy(env)
    for _ in range(5):
        action = names["policy"](observation)
        observation, reward, *_ = env.step(action)
        other, as_much, *_ = copied.step(action)
        assert (observation.tolist(), reward) == (other.tolist(), as_much)


def test_a_reset_compiles_only_what_has_changed(
    names: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled: list[Any] = []
    file = Path("push_box.xml")

    def counted(*arguments: Any) -> bytes:
        compiled.append(arguments)
        return in_bounded_child(*arguments)

    monkeypatch.setattr(mujoco_scene, "in_bounded_child", counted)
    env = Seen("push_box.yaml", frame_skip=20)
    assert len(compiled) == 1
    env.reset()
    env.reset()
    deepcopy(env).reset(options={"environment.stiffness": "0.5 N/mm"})
    assert len(compiled) == 1
    assert env.reset()[0][1]["box"].size[0] == pytest.approx(0.024)
    file.write_text(file.read_text().replace("0.012 0.012 0.012", "0.010 0.012 0.012"))
    assert env.reset()[0][1]["box"].size[0] == pytest.approx(0.020)
    assert len(compiled) == 2


def test_a_scene_that_was_compiled_before_has_the_coupling_of_the_episode() -> None:
    given, changed = HapticEnv("push_boxes", stiffness=500.0), HapticEnv("push_boxes")
    forces: dict[str, list[Any]] = {"given": [], "changed": [], "default": []}
    for name, env, options in (
        ("given", given, None),
        ("changed", changed, {"environment.stiffness": 500.0}),
        ("default", changed, None),
    ):
        env.reset(seed=1, options=options)
        for _ in range(30):
            force = env.step(np.array([0.02, 0.0, 0.01]))[0]["commanded_force"]
            forces[name].append(force.tolist())
    assert np.abs(forces["given"]).max() > 0.1
    assert forces["changed"] == forces["given"] != forces["default"]


@pytest.mark.parametrize(
    ("file", "mode", "word"), [("stiff_wall", "rgb_array", "wall"), ("hold_arm", "human", "human")]
)
def test_a_picture_that_nothing_can_draw_is_refused(file: str, mode: str, word: str) -> None:
    with pytest.raises(ConfigError, match=word):
        HapticEnv(file, render_mode=mode)


def test_a_picture_needs_a_reset_and_a_mode() -> None:
    env = HapticEnv("hold_arm", render_mode="rgb_array")
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.render()
    assert HapticEnv("hold_arm").render() is None
    assert (env.metadata["render_modes"], env.metadata["render_fps"]) == (["rgb_array"], 100)
    assert HapticEnv("stiff_wall").metadata["render_modes"] == []


def test_a_camera_that_is_not_there_is_refused_with_the_names(names: dict[str, Any]) -> None:
    env = names["PushBox"](render_mode="rgb_array", camera="below")
    env.reset()
    with pytest.raises(ConfigError, match="'below'; known: above"):
        env.render()


def test_without_opengl_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setitem(sys.modules, "mujoco.egl", None)
    env = HapticEnv("hold_arm", render_mode="rgb_array")
    env.reset()
    with pytest.raises(ConfigError, match=r"pyopengl.*libegl1"):
        env.render()
    env.close()
