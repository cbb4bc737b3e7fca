"""A MuJoCo body with a caudal tail: forces and poses exchanged in a Python loop, momentum and energy charted.

The body is MuJoCo's: 0.5 kg that slides and turns in the plane, with linear damping. The tail is caudal's: a silicone plate, 20 mm × 2 mm,
in water, that a wave of curvature bends, held at the body's stern. At every coupling step H both go on at once: caudal gets the
joint's pose with rates and accelerations, MuJoCo the line through the last two reactions of the tail, as force on its stern.

What MuJoCo's body gained and its damping took must be what the tail's head gave it: `head_impulse_…` and `head_work_j` of
caudal, which it integrates over its own steps. `simulate` returns what is missing.

    python mujoco_body.py figure.svg         # needs mujoco and matplotlib
"""

from __future__ import annotations

import sys
from typing import NamedTuple

import mujoco
import numpy as np

import caudal

STEP = 1e-3  # of both between couplings, s
STERN = 0.06  # from the body's centre to the joint, m
DAMPING = np.array([0.3, 1.0, 0.01])  # N s/m, N s/m, N m s

BODY = f"""
<mujoco>
  <option timestep="{STEP}" gravity="0 0 0" integrator="RK4"/>
  <worldbody>
    <body name="body">
      <joint name="x" type="slide" axis="1 0 0" damping="{DAMPING[0]}"/>
      <joint name="y" type="slide" axis="0 1 0" damping="{DAMPING[1]}"/>
      <joint name="turn" type="hinge" axis="0 0 1" damping="{DAMPING[2]}"/>
      <geom type="ellipsoid" size="{STERN} 0.03 0.04" mass="0.5"/>
      <site name="stern" pos="{STERN} 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""

TAIL = {
    "name": "mujoco-tail",
    "rod": {
        "nodes": 17,
        "length_m": 0.2,
        "outer_radius_m": 0.001,
        "section": "rectangle",
        "depth_m": 0.02,
        "youngs_modulus_pa": 3e6,
        "density_kg_m3": 1100.0,
    },
    "actuation": {
        "kind": "travelling-wave",
        "kappa_amp": 15.0,
        "frequency_hz": 2.0,
        "wavelength_m": 0.25,
        "envelope": [0.2, 0.8],
    },
    "start": {"kind": "ramp", "ramp_s": 0.5},
    "medium": {"viscosity_pa_s": 1e-3, "density_kg_m3": 1000.0},
    "drag": {"law": "cross-flow"},
    "reactive": {},
    "head": {"kind": "driven", "position_m": [STERN, 0.0], "angle_rad": 0.0},
    "solver": {"integrator": "generalized-alpha", "time_step_s": STEP, "duration_s": 10.0},
}
POSE = ["head_x_m", "head_y_m", "head_angle_rad"]
POSE += ["head_vx_m_s", "head_vy_m_s", "head_spin_rad_s"]
POSE += ["head_ax_m_s2", "head_ay_m_s2", "head_spin_rate_rad_s2"]
REACTION = ["head_force_x_n", "head_force_y_n", "head_moment_n_m"]


class History(NamedTuple):
    """By coupling steps."""

    times: np.ndarray
    #: Position and angle of the body, and their rates.
    body: np.ndarray
    #: What the coupling lost of momentum (x, y; N s) and energy (J).
    lost: np.ndarray
    #: What it gained (x, y; N s), and the actuation's work (J).
    given: np.ndarray


def joint(data: mujoco.MjData) -> np.ndarray:
    """Pose, rates and accelerations of the stern."""
    cos, sin = STERN * np.cos(data.qpos[2]), STERN * np.sin(data.qpos[2])
    spin, spin_rate = data.qvel[2], data.qacc[2]
    return np.concatenate(
        [
            data.qpos + [cos, sin, 0.0],
            data.qvel + [-sin * spin, cos * spin, 0.0],
            data.qacc + [-sin * spin_rate - cos * spin**2, cos * spin_rate - sin * spin**2, 0.0],
        ]
    )


def push(data: mujoco.MjData, reaction: np.ndarray) -> None:
    """Lets the tail's reaction act on the stern."""
    fx, fy, moment = reaction
    cos, sin = STERN * np.cos(data.qpos[2]), STERN * np.sin(data.qpos[2])
    data.qfrc_applied[:] = [fx, fy, moment + cos * fy - sin * fx]


def simulate(count: int, duration: float) -> History:
    """Couples both over `duration` (s) with H = count * STEP."""
    model = mujoco.MjModel.from_xml_string(BODY)
    data = mujoco.MjData(model)
    mass, inertia = 0.5, model.body("body").inertia[2]
    rows, damped = [], 0.0
    with caudal.Stepper(TAIL) as tail:
        read = lambda names: np.array([tail.get(name) for name in names])  # noqa: E731
        reaction = before = read(REACTION)
        push(data, reaction)
        mujoco.mj_forward(model, data)
        for _ in range(round(duration / (count * STEP))):
            tail.set_all(dict(zip(POSE, joint(data))))
            tail.do_step(count * STEP)
            for k in range(count):
                power = DAMPING @ data.qvel**2
                push(data, reaction + (reaction - before) * (k + 0.5) / count)
                mujoco.mj_step(model, data)
                damped += 0.5 * STEP * (power + DAMPING @ data.qvel**2)
            before, reaction = reaction, read(REACTION)
            push(data, reaction)
            mujoco.mj_forward(model, data)
            taken = DAMPING[:2] * data.qpos[:2]
            impulse = read(["head_impulse_x_n_s", "head_impulse_y_n_s"])
            energy = 0.5 * (mass * (data.qvel[:2] @ data.qvel[:2]) + inertia * data.qvel[2] ** 2)
            lost = [*(mass * data.qvel[:2] + taken + impulse), energy + damped + tail.get("head_work_j")]
            given = [*mass * data.qvel[:2], tail.get("actuation_work_j")]
            rows.append((data.time, [*data.qpos, *data.qvel], lost, given))
    return History(*(np.array(column) for column in zip(*rows)))


def balance(counts, duration: float) -> np.ndarray:
    """What the coupling loses at most: of momentum, relative to the body's largest, and of energy, relative to the actuation's."""
    result = []
    for count in counts:
        history = simulate(count, duration)
        momentum = np.hypot(*history.lost.T[:2]).max() / np.hypot(*history.given.T[:2]).max()
        result.append([momentum, np.abs(history.lost[:, 2]).max() / history.given[-1, 2]])
        print(f"H = {count * STEP:g} s: " + ", ".join(f"{value:.2e}" for value in result[-1]))
    return np.array(result)


def main(figure_path: str) -> None:
    """Draws the losses against H, and the body's path."""
    from matplotlib.figure import Figure

    counts = np.array([1, 2, 4, 8])
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    losses, path = figure.subplots(1, 2)
    for values, name in zip(balance(counts, 3.0).T, ["momentum", "energy"]):
        losses.loglog(1e3 * counts * STEP, values, "o-", label=name)
    losses.set(xlabel="coupling step H (ms)", ylabel="largest imbalance, relative", title="what the coupling loses")
    losses.grid(alpha=0.3, which="both")
    losses.legend()
    history = simulate(2, 6.0)
    path.plot(history.body[:, 0], history.body[:, 1])
    path.set(xlabel="x (m)", ylabel="y (m)", title="path of the body over 6 s", aspect="equal")
    path.grid(alpha=0.3)
    figure.savefig(figure_path)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(f"usage: {sys.argv[0]} figure.svg")
    main(sys.argv[1])
