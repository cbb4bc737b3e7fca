"""The environment is one of Gymnasium's, repeats itself, and can be learned."""

import importlib.util
import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gymnasium")

import caudal.gymnasium

ROOT = Path(__file__).parents[3]
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
    with pytest.raises(ValueError, match="not an input; allowed: .*natural_curvature_1_m"):
        caudal.gymnasium.TailEnv("models/glycerol.toml", actions={"x_com_m": (0, 1)}, **options)
    with pytest.raises(ValueError, match="actions: there is no variable `curvature` in this scene; did you mean `curvature_1_m`"):
        caudal.gymnasium.TailEnv("models/glycerol.toml", actions={"curvature": (0, 1)}, **options)
    with pytest.raises(ValueError, match="observations: .*`head_force_x_n`.*it needs a held head"):
        seen = {**options, "observations": ["head_force_x_n"]}
        caudal.gymnasium.TailEnv("models/glycerol.toml", actions={"natural_curvature_1_m": (0, 1)}, **seen)
    for wrong in (np.array([1j, 0.0, 0.0]), ["0", "0", "0"], [None] * 3):
        with pytest.raises(TypeError, match="action: found an array of the shape"):
            environment.step(wrong)


def test_options_of_a_reset_that_there_are_not_are_refused():
    module = example()
    with pytest.raises(ValueError, match="options: found 'goal'; allowed: none"):
        module.make_environment().reset(options={"goal": 1})
    tails = module.make_environments(2)
    with pytest.raises(ValueError, match="options: found 'mask'; allowed: 'reset_mask'"):
        tails.reset(options={"mask": np.array([True, False])})
    tails.close()


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


def test_a_vector_of_environments_is_gymnasiums_own_of_as_many_to_the_bit():
    from gymnasium.vector import SyncVectorEnv

    import gymnasium

    module = example()
    count = 3
    own = module.make_environments(count)
    stock = SyncVectorEnv([module.make_environment] * count)
    assert own.single_action_space == stock.single_action_space and own.action_space == stock.action_space
    assert own.observation_space == stock.observation_space
    dice = np.random.default_rng(4)
    for one, other in zip(own.reset(seed=7)[0], stock.reset(seed=7)[0]):
        np.testing.assert_array_equal(one, other)
    begun = 0
    for n in range(130):  # two ends of an episode
        actions = dice.uniform(-1.2, 1.2, own.action_space.shape)
        if n == 20:
            own.envs[1]._made = stock.envs[1]._made = 40  # no longer in step with the others
        found, expected = own.step(actions), stock.step(actions)
        for one, other in zip(found[:4], expected[:4]):
            np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(found[4]["time_s"], expected[4]["time_s"])
        begun += int(found[3].sum())
    assert begun == 6
    own.close()

    wrapped = gymnasium.wrappers.vector.RecordEpisodeStatistics(module.make_environments(2))
    wrapped.reset(seed=1)
    for _ in range(60):
        info = wrapped.step(np.zeros(wrapped.action_space.shape))[4]
    assert info["episode"]["l"].tolist() == [60, 60]
    wrapped.close()


def test_tails_in_lanes_move_as_each_alone_whatever_their_actions_flows_and_ends():
    from gymnasium.vector import SyncVectorEnv

    dice = np.random.default_rng(11)
    for width, threads in [(6, 1), (9, 2)]:
        options = {
            **OPTIONS,
            "actions": {"natural_curvature_1_m": (-2.0, 2.0), "actuation_frequency_hz": (1.0, 3.0), "force_y_n": (-0.1, 0.1)},
            "observations": ["x_m", "y_m", "vx_com_m_s", "curvature_1_m", "actuation_work_j", "viscosity_pa_s"],
            "start": lambda stepper, dice: stepper.set("viscosity_pa_s", dice.uniform(0.5, 1.5)) if dice.uniform() < 0.7 else None,
            "period_s": 0.01,
            "duration_s": 0.07,
        }
        scene = caudal.load("models/glycerol.toml", {"rod.nodes": 17})
        own = caudal.gymnasium.TailVectorEnv(scene, width, threads=threads, **options)
        stock = SyncVectorEnv([lambda: caudal.gymnasium.TailEnv(scene, **options)] * width)
        own.reset(seed=5), stock.reset(seed=5)
        ends = set()
        for n in range(24):
            actions = dice.uniform(-1.0, 1.0, own.action_space.shape)
            if n < 6:  # each in another part of its episode
                own.envs[n]._made = stock.envs[n]._made = 0
            if n == 9:  # and one that fails
                for environment in (own.envs[1], stock.envs[1]):
                    environment.stepper.set("natural_curvature_1_m", 1e5)
                    environment._set = lambda action, environment=environment: environment._observed()
            if n == 10:
                del own.envs[1]._set, stock.envs[1]._set
            found, expected = own.step(actions), stock.step(actions)
            for one, other in zip(found[:4], expected[:4]):
                np.testing.assert_array_equal(one, other)
            np.testing.assert_array_equal(found[4]["time_s"], expected[4]["time_s"])
            assert ("error" in found[4]) == ("error" in expected[4]) == (n == 9)
            if n == 9:
                assert found[2].tolist() == [i == 1 for i in range(width)] and list(found[4]["error"]) == list(expected[4]["error"])
            ends.add(tuple(found[3]))
            for one, other in zip(own.envs, stock.envs):
                assert bytes(one.stepper.save()) == bytes(other.stepper.save())
        assert len(ends) > 4
        own.close()


def test_environments_are_made_by_name():
    import gymnasium

    module = example()
    one = gymnasium.make("caudal/Tail-v0", scene=module.SCENE, **module.OPTIONS)
    assert one.reset(seed=1)[0].shape == one.observation_space.shape
    several = gymnasium.make_vec("caudal/Tail-v0", num_envs=2, scene=module.SCENE, **module.OPTIONS)
    assert isinstance(several.unwrapped, caudal.gymnasium.TailVectorEnv)
    assert several.reset(seed=1)[0].shape == (2, *one.observation_space.shape)


def test_a_tail_that_fails_ends_its_own_episode_alone():
    environment = caudal.gymnasium.TailVectorEnv(
        "models/glycerol.toml",
        num_envs=2,
        actions={"natural_curvature_1_m": (0.0, 1e4)},
        observations=["x_com_m"],
        reward=lambda before, after: 0.0,
        period_s=0.05,
    )
    environment.reset()
    actions = -np.ones(environment.action_space.shape)
    actions[1, ::2] = 1.0
    _, rewards, failed, _, infos = environment.step(actions)
    assert failed.tolist() == [False, True] and rewards.tolist() == [0.0, -1.0]
    assert infos["error"][1] and infos["_error"].tolist() == [False, True]
    _, rewards, failed, _, infos = environment.step(-np.ones(environment.action_space.shape))
    assert not failed.any() and rewards[1] == 0.0 and infos["time_s"].tolist() == [0.1, 0.0]


OPTIONS = {
    "actions": {"natural_curvature_1_m": (-1.0, 1.0)},
    "observations": ["x_com_m", "tip_y_m"],
    "reward": lambda before, after: 0.0,
    "period_s": 0.05,
}


def test_wrong_options_of_an_environment_are_named():
    options = {
        "actions": {"natural_curvature_1_m": (-1.0, 1.0)},
        "observations": ["x_com_m"],
        "reward": lambda before, after: 0.0,
        "period_s": 0.05,
    }
    for name, value, problem in [
        ("period_s", 0.0, "period_s: found 0.0; allowed: a positive time"),
        ("period_s", np.nan, "period_s: found nan"),
        ("duration_s", 0.0, "duration_s: found 0.0"),
        ("duration_s", "1", "duration_s: found '1'; allowed: a positive time"),
        ("groups", 0, "groups: found 0; allowed: a whole number, 1 or more"),
        ("groups", 1.5, "groups: found 1.5; allowed: a whole number"),
        ("reward", 1.0, "reward: found 1.0; allowed: a function"),
        ("start", 1.0, "start: found 1.0; allowed: a function"),
        ("goal", [1.0], "goal: found .1.0.; allowed: a function"),
        ("failure", "bad", "failure: found 'bad'; allowed: a finite number"),
        ("actions", {}, "actions: found {}; allowed: a dict of inputs with their bounds"),
        ("actions", ["natural_curvature_1_m"], "allowed: a dict of inputs with their bounds"),
        ("actions", {"natural_curvature_1_m": ("a", "b")}, "allowed: two numbers, the smaller first"),
        ("observations", [], "observations: found .*; allowed: a list of names"),
        ("observations", 1, "observations: found 1; allowed: a list of names"),
        ("scales", 2.0, "scales: found 2.0; allowed: a dict of numbers by name"),
        ("scales", {"x_com_m": "big"}, "found 'big'; allowed: a positive number"),
        ("actions", {"natural_curvature_1_m": (1.0, -1.0)}, "allowed: two numbers, the smaller first"),
        ("actions", {"natural_curvature_1_m": (-np.inf, 1.0)}, "allowed: two numbers, the smaller first"),
        ("actions", {"natural_curvature_1_m": 1.0}, "found 1.0; allowed: two numbers, the smaller first"),
        ("observations", "x_com_m", "observations: found 'x_com_m'; allowed: a list of names"),
        ("observations", ["x_com_m", "x_com_m"], "observations: found `x_com_m` twice"),
        ("goal", lambda generator: None, "goal: found None; allowed: a number, or an array of numbers"),
        ("goal", lambda generator: np.nan, "goal: found .*; allowed: finite numbers, as many at every reset"),
        ("scales", {"tip_y_m": 2.0}, "scales: `tip_y_m` is not observed; allowed: x_com_m"),
        ("scales", {"x_com_m": 0.0}, "found 0.0; allowed: a positive number"),
        ("render_mode", "human", "render_mode: found 'human'; allowed: None, 'rgb_array'"),
        ("actions", {"viscosity_pa_s": (-1.0, 1.0)}, r"actions\['viscosity_pa_s'\]: .*-1"),
    ]:
        with pytest.raises((TypeError, ValueError), match=problem):
            caudal.gymnasium.TailEnv("models/glycerol.toml", **{**options, name: value})
    sizes = iter([2, 2, 3])
    environment = caudal.gymnasium.TailEnv("models/glycerol.toml", **options, goal=lambda generator: np.zeros(next(sizes)))
    environment.reset()
    with pytest.raises(ValueError, match="goal: found .*; allowed: finite numbers, as many at every reset"):
        environment.reset()
    environment = caudal.gymnasium.TailEnv("models/glycerol.toml", **options)
    environment.reset()
    with pytest.raises(ValueError, match=r"action: found the shape \(3,\); allowed: \(7,\)"):
        environment.step(np.zeros(3))
    for threads in (0, 1.5, True):
        with pytest.raises(ValueError, match=f"threads: found {threads}; allowed: a whole number, 1 or more"):
            caudal.gymnasium.TailVectorEnv("models/glycerol.toml", 2, threads=threads, **options)
    for reward in ("x", None, float("nan"), [1.0, 2.0]):
        environment = caudal.gymnasium.TailEnv("models/glycerol.toml", **{**options, "reward": lambda before, after: reward})
        environment.reset()
        with pytest.raises(ValueError, match="reward: found .* from the function; allowed: a finite number"):
            environment.step(np.zeros(7))
    tails = caudal.gymnasium.TailVectorEnv("models/glycerol.toml", 2, **options)
    assert tails.reset(seed=np.int64(3))[0].shape == (2, 1)
    for seed in (1.5, [1, 2, 3], "ab"[:1]):
        with pytest.raises(ValueError, match="seed: found .*; allowed: one whole number, or a list of 2"):
            tails.reset(seed=seed)
    for copies in (None, 2.0):
        with pytest.raises(ValueError, match=f"num_envs: found {copies}; allowed: a whole number, 1 or more"):
            caudal.gymnasium.TailVectorEnv("models/glycerol.toml", copies, **options)


def test_an_episode_ends_with_the_first_period_that_reaches_its_duration():
    for duration, period, steps in [(0.25, 0.1, 3), (0.3, 0.1, 3), (0.05, 0.1, 1), (1.0, 0.1, 10)]:
        environment = caudal.gymnasium.TailEnv("models/glycerol.toml", duration_s=duration, **{**OPTIONS, "period_s": period})
        environment.reset()
        ends = [environment.step(np.zeros(7))[3] for _ in range(steps)]
        assert ends == [False] * (steps - 1) + [True]


def test_episodes_begin_and_aim_at_random_as_their_seed_says():
    environment = caudal.gymnasium.TailEnv(
        "models/glycerol.toml",
        **{**OPTIONS, "observations": ["viscosity_pa_s", "vx_com_m_s"], "reward": lambda before, after: float(after["goal"][1])},
        start=lambda stepper, dice: stepper.set("viscosity_pa_s", dice.uniform(0.5, 1.0)),
        goal=lambda dice: dice.uniform(-1.0, 1.0, 2),
    )
    first, again, other = (environment.reset(seed=seed)[0] for seed in (1, 1, 2))
    assert first.shape == environment.observation_space.shape == (4,)
    np.testing.assert_array_equal(first, again)
    assert (first[[0, 2, 3]] != other[[0, 2, 3]]).all() and 0.5 < first[0] < 1.0
    assert environment.step(np.zeros(7))[1] == pytest.approx(other[3])


def test_actions_of_another_shape_and_masks_of_a_vector_are_refused_and_masked_tails_begin_anew_alone():
    environment = caudal.gymnasium.TailVectorEnv("models/glycerol.toml", 2, **OPTIONS)
    first, _ = environment.reset(seed=1)
    for shape in [(3, 7), (1, 7), (2,), (7,)]:
        with pytest.raises(ValueError, match=r"actions: found the shape .*; allowed: \(2, 7\)"):
            environment.step(np.zeros(shape))
    moved = environment.step(np.ones((2, 7)))[0]
    for mask in [np.array([True]), np.array([0, 1]), np.array([False, False])]:
        with pytest.raises(ValueError, match="reset_mask: found"):
            environment.reset(options={"reset_mask": mask})
    masked, infos = environment.reset(options={"reset_mask": np.array([False, True])})
    np.testing.assert_array_equal(masked, [moved[0], first[1]])
    assert infos["_time_s"].tolist() == [False, True]
    assert environment.step(np.ones((2, 7)))[4]["time_s"].tolist() == pytest.approx([0.1, 0.05])


def test_the_example_learns_to_swim_nearer():
    pytest.importorskip("cma")
    module = example()
    policy, rewards = module.learn(generations=8)
    assert rewards[-1] > 1.5 * rewards[0] > 0, rewards
    assert module.episodes(module.make_environments(1), [policy])[0] > rewards[0], rewards


FORKED = """
import os, signal, sys, threading, time
import numpy as np
import caudal.gymnasium

period = float(sys.argv[1])
tails = caudal.gymnasium.TailVectorEnv(
    caudal.load("models/glycerol.toml", {"solver.time_step_s": 1e-4, "solver.duration_s": 20 * period}), num_envs=4, threads=2,
    actions={"natural_curvature_1_m": (-1.0, 1.0)}, observations=["x_com_m"], reward=lambda before, after: 0.0,
    period_s=period, duration_s=10 * period,
)
tails.reset(seed=1)
actions = np.zeros(tails.action_space.shape)
if period < 1.0:
    tails.step(actions)
    child = os.fork()
    if child == 0:
        tails.step(actions)
        os._exit(0)
    sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
signal.signal(signal.SIGINT, signal.default_int_handler)
threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
begun = time.monotonic()
try:
    tails.step(actions)
except KeyboardInterrupt:
    print(f"ended after {time.monotonic() - begun:.2f} s")
"""


@pytest.mark.skipif(os.name == "nt", reason="forks and sends SIGINT")
def test_threads_of_many_tails_are_made_anew_in_a_fork_and_end_with_ctrl_c():
    run = lambda period: subprocess.run([sys.executable, "-c", FORKED, period], cwd=ROOT, capture_output=True, text=True, timeout=120)
    forked = run("0.01")
    assert forked.returncode == 0, forked.stderr
    ended = run("1000.0")
    seconds = float(ended.stdout.split()[2])
    assert seconds < 5.0, (ended.stdout, ended.stderr)  # the whole step takes minutes; measured 0.6 s
