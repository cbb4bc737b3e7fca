"""How much faster many copies of a tail step in SIMD lanes: `python bindings/python/benches/copies.py`.

64 copies with 17 nodes on one thread, each with actions of its own, in turns with as many that step one by one. The times are processor
time, so that other work on the machine counts little. A whole step of the environment has observations and rewards in Python besides.
"""

import time

import numpy as np

import caudal
import caudal.gymnasium

COPIES, PERIOD = 64, 0.05
#: With the bounds of their actions, 1/m: drag in proportion to the velocity with 50 internal steps per action, and water with 10.
SCENES = {"glycerol": 1.0, "eel": 3.0}


def make(name):
    return caudal.gymnasium.TailVectorEnv(
        caudal.load(f"models/{name}.toml", {"rod.nodes": 17}),
        num_envs=COPIES,
        threads=1,
        actions={"natural_curvature_1_m": (-SCENES[name], SCENES[name])},
        observations=["tip_x_m", "tip_y_m", "x_com_m"],
        reward=lambda before, after: float(after["x_com_m"][0] - before["x_com_m"][0]),
        period_s=PERIOD,
        duration_s=1e3,
    )


class Timed:
    """An environment that adds up the time of its steps, and of the part that moves the tails."""

    def __init__(self, name, lanes):
        self.tails, self.whole, self.moving = make(name), [], []
        alone = lambda k: [(i, self.tails.envs[i]._move()) for i in self.tails._parts[k]]
        move = self.tails._move if lanes else alone

        def timed(k):
            begin = time.process_time_ns()
            result = move(k)
            self.moving.append(time.process_time_ns() - begin)
            return result

        self.tails._move = timed

    def step(self, actions):
        begin = time.process_time_ns()
        result = self.tails.step(actions)
        self.whole.append(time.process_time_ns() - begin)
        return result


dice = np.random.default_rng(1)
for name in SCENES:
    lanes, alone = Timed(name, True), Timed(name, False)
    for one, other in zip(lanes.tails.reset(seed=1), alone.tails.reset(seed=1)):
        assert str(one) == str(other)
    for _ in range(40):
        actions = dice.uniform(-1.0, 1.0, lanes.tails.action_space.shape)
        for one, other in zip(lanes.step(actions)[:4], alone.step(actions)[:4]):
            assert np.array_equal(one, other)
    for what, times in [("stepping", (alone.moving, lanes.moving)), ("whole step", (alone.whole, lanes.whole))]:
        one, four = (float(np.median(part)) / 1e3 / COPIES for part in times)
        print(f"{name}, {what}: {one:.1f} us a copy one by one, {four:.1f} us in lanes: {one / four:.2f} times as fast")
