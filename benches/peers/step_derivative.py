"""The derivative of a step of MuJoCo: `mjd_transitionFD` on the chain of benches/peers/tail.py, its time and its error, as a table.

    peer/bin/python benches/peers/step_derivative.py

All of A, B, C, D, with as many inputs as servos and the tip's place as the output. Time is in MuJoCo's own steps, the fastest of some. The
error is the largest difference from central differences that are extrapolated twice, over the largest entry of a block: of positions and
velocities by positions, velocities and inputs.
"""

import time

import mujoco
import numpy as np
from tail import MUJOCO_STEPS, mujoco_model, natural_curvature, nodes_of

# The size of the differences: of the program's own example, and those around its best.
SIZES = [1e-4, 1e-6, 1e-8]


def moved(model, steps, time_s):
    """The chain after some driven steps, so that it is bent and moves."""
    data = mujoco.MjData(model)
    s, _ = nodes_of(model.nu + 2)
    for _ in range(steps):
        data.ctrl[:] = natural_curvature(s[1:-1], data.time + time_s) * s[1]
        mujoco.mj_step(model, data)
    return data


def stepper(model, data):
    """The end of a step as a function of positions, velocities and inputs; hinges and slides have coordinates that add up."""
    start = np.concatenate([data.qpos, data.qvel, data.ctrl])
    other = mujoco.MjData(model)

    def end(change):
        q, v, u = np.split(start + change, [model.nq, model.nq + model.nv])
        other.qpos[:], other.qvel[:], other.ctrl[:] = q, v, u
        other.qacc_warmstart[:] = data.qacc_warmstart
        mujoco.mj_step(model, other)
        return np.concatenate([other.qpos, other.qvel])

    return end, len(start)


def richardson(end, count, size):
    """Central differences over size, a half and a quarter of it, extrapolated."""

    def central(i, h):
        change = np.zeros(count)
        change[i] = h
        return (end(change) - end(-change)) / (2 * h)

    def column(i):
        a, b, c = (central(i, size / part) for part in (1, 2, 4))
        ab, bc = (4 * b - a) / 3, (4 * c - b) / 3
        return (16 * bc - ab) / 15

    return np.array([column(i) for i in range(count)]).T


def blocks(matrix, nv):
    return [block for rows in np.split(matrix, [nv]) for block in np.split(rows, [nv, 2 * nv], axis=1)]


def error(found, exact, nv):
    """The largest over the blocks."""
    pairs = zip(blocks(found, nv), blocks(exact, nv), strict=True)
    return max(np.abs(a - b).max() / np.abs(b).max() for a, b in pairs if np.abs(b).max() > 0)


def fastest(action, times, tries=7):
    best = float("inf")
    for _ in range(tries):
        before = time.process_time()
        for _ in range(times):
            action()
        best = min(best, (time.process_time() - before) / times)
    return best


def main():
    print("| N | differences | time, in steps | error |\n|---|---|---|---|")
    for nodes, step in MUJOCO_STEPS:
        model = mujoco_model(nodes, step)
        data = moved(model, 200, 0.5)
        # Forces along the state are those of its own beginning.
        mujoco.mj_forward(model, data)
        end, count = stepper(model, data)
        exact = richardson(end, count, 1e-3 if nodes < 33 else 3e-4)
        unsure = error(richardson(end, count, 5e-4 if nodes < 33 else 1.5e-4), exact, model.nv)
        free = mujoco.MjData(model)

        def steps():
            # From the same state: without a drive the chain diverges in some hundred steps of this length.
            free.qpos[:], free.qvel[:], free.ctrl[:] = data.qpos, data.qvel, data.ctrl
            mujoco.mj_step(model, free, 100)

        one = fastest(steps, 20) / 100
        nv, nu = model.nv, model.nu
        a, b = np.zeros((2 * nv, 2 * nv)), np.zeros((2 * nv, nu))
        c, d = np.zeros((model.nsensordata, 2 * nv)), np.zeros((model.nsensordata, nu))
        for centred in (False, True):
            for size in SIZES:
                call = lambda: mujoco.mjd_transitionFD(model, data, size, centred, a, b, c, d)
                seconds = fastest(call, 20)
                off = error(np.hstack([a, b]), exact, nv)
                kind = "central" if centred else "forward"
                print(f"| {nodes} | {kind}, {size:.0e} | {seconds / one:.0f} ({1e6 * seconds:.0f} µs) | {off:.1e} |", flush=True)
        print(f"| {nodes} | the reference itself | a step: {1e6 * one:.2f} µs | {unsure:.1e} |")


if __name__ == "__main__":
    main()
