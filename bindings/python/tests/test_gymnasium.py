"""The environment is one of Gymnasium's, repeats itself, and can be learned."""

import importlib.util
import warnings
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gymnasium")

import caudal.gymnasium

EXAMPLE = Path(__file__).parents[1] / "examples/learn_to_swim.py"


def example():
    spec = importlib.util.spec_from_file_location("learn_to_swim", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_environment_passes_the_checker():
    from gymnasium.utils.env_checker import check_env

    with warnings.catch_warnings():
        warnings.simplefilter("error", category=UserWarning)
        warnings.filterwarnings("ignore", message=".*(infinity|symmetric|not set|spec).*")
        check_env(example().make_environment(), skip_render_check=True)


def test_an_episode_repeats_itself_and_ends_at_its_duration():
    environment = example().make_environment()
    actions = np.random.default_rng(1).uniform(-1, 1, (60, *environment.action_space.shape))

    def episode():
        seen = [environment.reset(seed=3)[0]]
        for n, action in enumerate(actions):
            observation, reward, failed, truncated, info = environment.step(action)
            seen.append(np.append(observation, reward))
            assert not failed and truncated == (n == len(actions) - 1)
        assert info["time_s"] == pytest.approx(6.0)
        return seen

    for one, other in zip(episode(), episode()):
        np.testing.assert_array_equal(one, other)


def test_actions_are_inputs_in_groups_and_mistakes_are_named():
    environment = example().make_environment()
    environment.reset()
    environment.step(np.array([-1.0, 0.0, 1.0]))
    curvature = environment.stepper.get("natural_curvature_1_m")
    assert sorted(set(curvature)) == [-15.0, 0.0, 15.0] and list(curvature) == sorted(curvature)
    options = dict(observations=["x_com_m"], reward=lambda before, after: 0.0, period_s=0.1)
    with pytest.raises(ValueError, match="no input; allowed: .*natural_curvature_1_m"):
        caudal.gymnasium.TailEnv("models/glycerol.toml", actions={"x_com_m": (0, 1)}, **options)
    with pytest.raises(ValueError, match="no variable `curvature`"):
        caudal.gymnasium.TailEnv("models/glycerol.toml", actions={"curvature": (0, 1)}, **options)


def test_a_picture_is_drawn_where_it_is_asked_for():
    pytest.importorskip("matplotlib")
    environment = caudal.gymnasium.TailEnv(
        "models/glycerol.toml",
        actions={"natural_curvature_1_m": (-2.0, 2.0)},
        observations=["x_com_m"],
        reward=lambda before, after: 0.0,
        period_s=0.05,
        render_mode="rgb_array",
    )
    environment.reset()
    picture = environment.render()
    assert picture.shape[2] == 3 and picture.min() < 100 < picture.max()


def test_the_example_learns_to_swim_nearer():
    module = example()
    policy, rewards = module.learn(generations=8)
    assert rewards[-1] > 1.5 * rewards[0] > 0, rewards
    assert module.episode(module.make_environment(), policy) > rewards[0], rewards
