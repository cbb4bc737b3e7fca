"""Simulations as environments of Gymnasium (``pip install "caudal[gymnasium]"``)."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any, Callable, Optional, Union

import numpy as np

from ._caudal import Stepper, _SteppersTogether
from .arguments import check_count, check_function, is_number, numbers_of
from .errors import Error
from .optional import optional
from .result import Array, Source, load

gymnasium: Any = optional("gymnasium", "caudal.gymnasium")
optional("gymnasium.vector", "caudal.gymnasium")

#: The least and largest value of an input, for all its entries.
Bounds = Mapping[str, tuple[float, float]]


def _check_options(options: Optional[Mapping[str, Any]], known: Sequence[str]) -> None:
    """Refuse options of a reset that are not `known`."""
    for name in options or {}:
        if name not in known:
            raise ValueError(f"options: found {name!r}; allowed: {', '.join(map(repr, known)) or 'none'}")


class TailEnv(gymnasium.Env):
    """A tail that an agent drives: actions are inputs and observations outputs of the table of variables.

    Actions are from -1 to 1 and map linearly to the bounds of the inputs; they are constant over a period. The reward is the value
    of `reward` for the stepper before and after. An episode is truncated at the end of the first period that reaches its duration; a
    step that fails, because the agent folds the rod for instance, terminates it with the reward `failure`.

    Parameters
    ----------
    scene : Scene, str, os.PathLike or dict
        The scene, or anything that `caudal.load` accepts.
    actions : dict of str to tuple of float
        Least and largest value of each input that the agent sets, such as ``{"natural_curvature_1_m": (-5.0, 5.0)}``.
    observations : sequence of str
        The observed variables, in order.
    reward : callable
        From the observed variables before and after a period, dictionaries of arrays, to a number.
    period_s : float
        Time between actions, s.
    duration_s : float, optional
        Duration of an episode, s; by default the scene's.
    scales : dict of str to float, optional
        Divisors of the observations, by variable; by default 1.
    groups : int, optional
        An input of the joints or nodes is set in this many groups of neighbours; by default each separately.
    failure : float, optional
        The reward of a step that fails.
    start : callable, optional
        Called at the beginning of every episode with the stepper and the environment's random numbers (`numpy.random.Generator`), to
        set inputs: a flow, a viscosity, a frequency.
    goal : callable, optional
        From the environment's random numbers to the target numbers of an episode: the last entries of the observation, and
        ``"goal"`` of what `reward` sees.
    render_mode : str, optional
        ``"rgb_array"`` for pictures.

    Examples
    --------
    >>> import caudal.gymnasium
    >>> env = caudal.gymnasium.TailEnv(
    ...     "models/glycerol.toml",
    ...     actions={"natural_curvature_1_m": (-2.0, 2.0)},
    ...     observations=["tip_x_m", "tip_y_m", "x_com_m"],
    ...     reward=lambda before, after: float(after["x_com_m"][0] - before["x_com_m"][0]),
    ...     period_s=0.05,
    ...     groups=3,
    ... )
    >>> observation, _ = env.reset(seed=1)
    >>> observation.shape, env.action_space.shape
    ((3,), (3,))
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 20}

    def __init__(
        self,
        scene: Source,
        *,
        actions: Bounds,
        observations: Sequence[str],
        reward: Callable[[dict[str, Array], dict[str, Array]], float],
        period_s: float,
        duration_s: Optional[float] = None,
        scales: Optional[Mapping[str, float]] = None,
        groups: Optional[int] = None,
        failure: float = -1.0,
        start: Optional[Callable[[Stepper, np.random.Generator], None]] = None,
        goal: Optional[Callable[[np.random.Generator], Any]] = None,
        render_mode: Optional[str] = None,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode: found {render_mode!r}; allowed: None, {', '.join(map(repr, self.metadata['render_modes']))}")
        for name, function in (("reward", reward), ("start", start), ("goal", goal)):
            check_function(name, function, required=name == "reward")
        if not isinstance(actions, Mapping) or not actions:
            raise ValueError(f"actions: found {actions!r}; allowed: a dict of inputs with their bounds")
        if isinstance(observations, str) or not isinstance(observations, Sequence) or not observations:
            raise ValueError(f"observations: found {observations!r}; allowed: a list of names")
        if scales is not None and not isinstance(scales, Mapping):
            raise ValueError(f"scales: found {scales!r}; allowed: a dict of numbers by name")
        self._stepper = Stepper(load(scene))
        self._start = self._stepper.save()
        duration_s = self._stepper.scene.duration_s if duration_s is None else duration_s
        for name, value in (("period_s", period_s), ("duration_s", duration_s)):
            if not is_number(value) or not 0 < value < np.inf:
                raise ValueError(f"{name}: found {value!r}; allowed: a positive time")
        if not is_number(failure) or not np.isfinite(failure):
            raise ValueError(f"failure: found {failure!r}; allowed: a finite number")
        check_count("groups", groups)
        self._reward, self._period, self._failure = reward, float(period_s), float(failure)
        self._steps = max(1, math.ceil(duration_s / period_s * (1.0 - 1e-12)))
        self._set_start, self._set_goal = start, goal
        self._goal: Array = np.zeros(0)
        self._made = 0
        self.render_mode = render_mode
        known = self._stepper.variables
        twice = [name for place, name in enumerate(observations) if name in observations[:place]]
        if twice:
            raise ValueError(f"observations: found `{twice[0]}` twice; allowed: each once")
        for name in (*actions, *observations):
            try:
                self._stepper.get(name)
            except Error as error:
                raise ValueError(f"{'actions' if name in actions else 'observations'}: {error}") from error
        wrong = [name for name in actions if known[name].causality != "input"]
        if wrong:
            inputs = ", ".join(name for name, variable in known.items() if variable.causality == "input")
            raise ValueError(f"{wrong[0]} is not an input; allowed: {inputs}")
        for name, bounds in actions.items():
            two = np.shape(bounds) == (2,) and all(is_number(bound) for bound in bounds)
            if not two or not -np.inf < bounds[0] < bounds[1] < np.inf:
                raise ValueError(f"actions[{name!r}]: found {bounds!r}; allowed: two numbers, the smaller first")
            for bound in bounds:
                try:
                    self._stepper.set(name, np.full(known[name].shape, bound) if known[name].shape else bound)
                except Error as error:
                    raise ValueError(f"actions[{name!r}]: {error}") from error
        self._stepper.restore(self._start)
        for name, scale in (scales or {}).items():
            if name not in observations:
                raise ValueError(f"scales: `{name}` is not observed; allowed: {', '.join(observations)}")
            if not is_number(scale) or not 0 < scale < np.inf:
                raise ValueError(f"scales[{name!r}]: found {scale!r}; allowed: a positive number")
        self._scales = {name: float((scales or {}).get(name, 1.0)) for name in observations}
        self._counts = {name: int(np.prod(known[name].shape)) for name in observations}
        # For each input: its bounds, and which of the action's entries each of its own takes.
        self._inputs: dict[str, tuple[float, float, Any]] = {}
        first = 0
        for name, (least, most) in actions.items():
            count = int(np.prod(known[name].shape))
            parts = count if groups is None else min(groups, count)
            entries = first + np.arange(count) * parts // count
            self._inputs[name] = (least, most, entries if known[name].shape else first)
            first += parts
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (first,), np.float32)
        self._begin()
        size = self._flat(self._observed()).shape
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, size, np.float32)

    def _observed(self) -> dict[str, Array]:
        observed = {name: self._stepper.get(name, np.empty(count)) for name, count in self._counts.items()}
        return observed if self._set_goal is None else {**observed, "goal": self._goal}

    def _flat(self, observed: dict[str, Array]) -> Any:
        scaled = [observed[name] / scale for name, scale in self._scales.items()]
        return np.concatenate([*scaled, self._goal]).astype(np.float32)

    def _begin(self) -> None:
        """Reset to the start of an episode."""
        self._stepper.restore(self._start)
        self._made = 0
        if self._set_start is not None:
            self._set_start(self._stepper, self.np_random)
        if self._set_goal is not None:
            goal = np.atleast_1d(numbers_of(self._set_goal(self.np_random), "goal"))
            if goal.ndim != 1 or not np.isfinite(goal).all() or self._goal.size not in (0, goal.size):
                raise ValueError(f"goal: found {goal}; allowed: finite numbers, as many at every reset")
            self._goal = goal

    @property
    def stepper(self) -> Stepper:
        """The simulation."""
        return self._stepper

    def reset(self, *, seed: Optional[int] = None, options: Optional[dict[str, Any]] = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode at the start of the scene."""
        _check_options(options, ())
        super().reset(seed=seed)
        self._begin()
        return self._flat(self._observed()), {"time_s": 0.0}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Set the inputs and advance by a control period."""
        before = self._set(action)
        return self._result(before, self._move())

    def _set(self, action: Any) -> dict[str, Array]:
        """Set the inputs; return the observation before they act."""
        action = np.minimum(np.maximum(numbers_of(action, "action"), -1.0), 1.0)
        if action.shape != self.action_space.shape:
            raise ValueError(f"action: found the shape {action.shape}; allowed: {self.action_space.shape}")
        values: dict[str, Union[float, Array]] = {}
        for name, (least, most, entries) in self._inputs.items():
            value = least + (most - least) * 0.5 * (action[entries] + 1.0)
            values[name] = float(value) if np.ndim(value) == 0 else value
        before = self._observed()
        self._stepper.set_all(values)
        return before

    def _move(self) -> Optional[str]:
        """Advance by a control period; return the error, if any."""
        try:
            self._stepper.do_step(self._period)
        except Error as error:
            return str(error)
        return None

    def _result(self, before: dict[str, Array], error: Optional[str]) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """The return value of a step."""
        failed = error is not None
        self._made += 1
        after = self._observed()
        reward = self._failure if failed else self._reward(before, after)
        if type(reward) is not float or not math.isfinite(reward):
            value = np.asarray(reward)
            if value.size != 1 or value.dtype.kind not in "fiub" or not np.isfinite(value).all():
                raise ValueError(f"reward: found {reward!r} from the function; allowed: a finite number")
            reward = float(value.item())
        info: dict[str, Any] = {"time_s": self._stepper.time_s, **({"error": error} if failed else {})}
        return self._flat(after), reward, failed, self._made >= self._steps, info

    def render(self) -> Any:
        """A picture of the rod, red, green and blue."""
        if self.render_mode != "rgb_array":
            return None
        optional("matplotlib", "render()")
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=(5, 3), layout="constrained")
        canvas = FigureCanvasAgg(figure)
        axes = figure.subplots()
        x, y = self._stepper.get("x_m"), self._stepper.get("y_m")
        axes.plot(x, y, color="#0072b2", linewidth=2.5)
        axes.plot(x[:1], y[:1], "o", color="#d55e00")
        axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)", title=f"t = {self._stepper.time_s:.2f} s")
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()


class TailVectorEnv(gymnasium.vector.VectorEnv):
    """Several tails that an agent drives at once, each an independent environment. Steps run in parallel on all cores, and four tails at a
    time in SIMD lanes where the scene and the processor allow it: for 64 tails of 17 nodes in 0.64 of the time
    (``bindings/python/benches/copies.py``).

    An episode that has ended restarts at the next step, whose action is ignored and whose reward is 0 (Gymnasium's
    ``AutoresetMode.NEXT_STEP``). The results are bit-identical to ``gymnasium.vector.SyncVectorEnv`` with as many `TailEnv`.

    Parameters
    ----------
    scene : Scene, str, os.PathLike or dict
        The scene, or anything that `caudal.load` accepts.
    num_envs : int
        Number of environments.
    threads : int, optional
        How many of them run at a time; by default one per core.
    **options
        Those of `TailEnv`.

    Examples
    --------
    >>> import caudal.gymnasium
    >>> tails = caudal.gymnasium.TailVectorEnv(
    ...     "models/glycerol.toml",
    ...     num_envs=4,
    ...     actions={"natural_curvature_1_m": (-2.0, 2.0)},
    ...     observations=["tip_x_m", "tip_y_m"],
    ...     reward=lambda before, after: float(after["tip_x_m"][0] - before["tip_x_m"][0]),
    ...     period_s=0.05,
    ... )
    >>> observations, _ = tails.reset(seed=1)
    >>> observations.shape, tails.action_space.shape
    ((4, 2), (4, 7))
    """

    def __init__(self, scene: Source, num_envs: int = 1, *, threads: Optional[int] = None, **options: Any) -> None:
        if num_envs is None:
            raise ValueError("num_envs: found None; allowed: a whole number, 1 or more")
        check_count("num_envs", num_envs)
        check_count("threads", threads)
        num_envs = int(num_envs)
        scene = load(scene)
        self.envs = [TailEnv(scene, **options) for _ in range(num_envs)]
        self.num_envs = num_envs
        one = self.envs[0]
        self.render_mode = one.render_mode
        self.metadata = {**one.metadata, "autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}
        self.single_action_space, self.single_observation_space = one.action_space, one.observation_space
        batch = gymnasium.vector.utils.batch_space
        self.action_space = batch(one.action_space, num_envs)
        self.observation_space = batch(one.observation_space, num_envs)
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        self._threads = max(1, min(threads or cores, num_envs))
        self._pool = ThreadPoolExecutor(self._threads) if self._threads > 1 else None
        self._process = os.getpid()
        #: The environments that each thread moves, and their steppers.
        self._parts = [range(num_envs)[k :: self._threads] for k in range(self._threads)]
        self._together = [_SteppersTogether([self.envs[i].stepper for i in part]) for part in self._parts]
        self._ended: Any = np.zeros(num_envs, dtype=bool)

    def reset(
        self, *, seed: Union[int, Sequence[Optional[int]], None] = None, options: Optional[dict[str, Any]] = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode of each, or of those for which ``options["reset_mask"]`` is true."""
        _check_options(options, ("reset_mask",))
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool)))
        if mask.dtype != np.bool_ or mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(f"reset_mask: found {mask!r}; allowed: {self.num_envs} truth values, one of them true")
        seeds: Any = [None] * self.num_envs if seed is None else seed
        if isinstance(seeds, (int, np.integer)):
            seeds = [int(seeds) + i for i in range(self.num_envs)]
        if not isinstance(seeds, Sequence) or len(seeds) != self.num_envs:
            raise ValueError(f"seed: found {seed!r}; allowed: one whole number, or a list of {self.num_envs}")
        self._ended[mask] = False
        infos: dict[str, Any] = {}
        observations = []
        for i, (env, own) in enumerate(zip(self.envs, seeds)):
            if mask[i]:
                observation, info = env.reset(seed=own)
                infos = self._add_info(infos, info, i)
            else:
                observation = env._flat(env._observed())
            observations.append(observation)
        return np.stack(observations), infos

    def step(self, actions: Any) -> tuple[Any, Array, Any, Any, dict[str, Any]]:
        """Advance all by a control period."""
        if np.shape(actions) != self.action_space.shape:
            raise ValueError(f"actions: found the shape {np.shape(actions)}; allowed: {self.action_space.shape}")
        before = {i: env._set(actions[i]) for i, env in enumerate(self.envs) if not self._ended[i]}
        errors = {i: error for part in self._moved(self._move, range(self._threads)) for i, error in part}
        observations: list[Any] = []
        infos: dict[str, Any] = {}
        rewards, ends = np.zeros(self.num_envs), np.zeros((2, self.num_envs), dtype=bool)
        for i, env in enumerate(self.envs):
            if self._ended[i]:
                observation, info = env.reset()
            else:
                observation, rewards[i], ends[0, i], ends[1, i], info = env._result(before[i], errors[i])
            observations.append(observation)
            infos = self._add_info(infos, info, i)
        self._ended = ends.any(axis=0)
        return np.stack(observations), rewards, ends[0], ends[1], infos

    def _move(self, k: int) -> list[tuple[int, Optional[str]]]:
        """Advance part `k` by a control period; return the errors, if any, with their places."""
        moving = [place for place, i in enumerate(self._parts[k]) if not self._ended[i]]
        errors = self._together[k].do_step(moving, self.envs[0]._period)
        return [(self._parts[k][place], None if error is None else str(error)) for place, error in zip(moving, errors)]

    def _moved(self, move: Callable[[int], Any], parts: Sequence[int]) -> list[Any]:
        """The results of `move` for every part. None of them is still running when this ends, even by an exception."""
        if self._pool is None:
            return [move(part) for part in parts]
        if self._process != os.getpid():  # a fork has none of the threads
            self._pool, self._process = ThreadPoolExecutor(self._threads), os.getpid()
        futures = [self._pool.submit(move, part) for part in parts]
        try:
            return [future.result() for future in futures]
        except BaseException:
            self._stop(True)
            raise
        finally:
            wait(futures)
            self._stop(False)

    def _stop(self, stopped: bool) -> None:
        for env in self.envs:
            env.stepper._stop(stopped)

    def render(self) -> Optional[tuple[Any, ...]]:
        """A picture of each."""
        return None if self.render_mode is None else tuple(env.render() for env in self.envs)

    def close_extras(self, **options: Any) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()


gymnasium.register("caudal/Tail-v0", entry_point=TailEnv, vector_entry_point=TailVectorEnv)
