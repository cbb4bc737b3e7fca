"""A tail drives a rigid vehicle that is not caudal's: co-simulation with FMPy, and what the coupling does to it.

The vehicle is a rigid body with mass, moment of inertia and linear drag of its own, in the plane. The tail is the FMU of
tail.toml, clamped to its stern: the vehicle gives it the pose of the joint, it gives back force and moment. Two masters
march with the coupling step H:

- Gauss-Seidel: the vehicle steps with the force it knows, held; then the tail follows it. First order in H.
- Gauss-Seidel iterated: the force is linear over the step, from the one known to the one at its end, which the tail is
  asked for; its state is rolled back until both agree. Second order in H.

The first is simple, and unstable where the vehicle is light: at half its mass, 0.15 kg against the tail's 0.017 kg, it fed
the tail's stretching at H = 8 ms until nothing balanced any more. The second takes four to six passes a step.

Total momentum less the impulse of all drag, and total energy less all work, must not change. What they change by is the
coupling's own doing: `balance` measures it from positions and velocities of both, `main` draws it against H.

    caudal fmu tail.toml -o tail.fmu
    python vehicle.py tail.fmu vehicle.svg          # needs FMPy and matplotlib
"""

from __future__ import annotations

import shutil
import sys
from typing import NamedTuple

import fmpy
import numpy as np
from fmpy.fmi3 import FMU3Slave

STEP = 1e-3  # micro-steps, s: the tail's own


class Tail:
    """The FMU by names of variables."""

    HEAD = ["head_x_m", "head_y_m", "head_angle_rad", "head_vx_m_s", "head_vy_m_s", "head_spin_rad_s"]
    REACTION = ["head_force_x_n", "head_force_y_n", "head_moment_n_m"]
    NODES = ["x_m", "y_m", "vx_m_s", "vy_m_s"]
    ENERGY = ["kinetic_energy_j", "bending_energy_j", "stretching_energy_j"]
    WORK = ["actuation_work_j", "viscous_work_j", "numerical_dissipation_j"]

    def __init__(self, path: str) -> None:
        self.folder = fmpy.extract(path)
        description = fmpy.read_model_description(path)
        self.references = {variable.name: variable.valueReference for variable in description.modelVariables}
        self.fmu = FMU3Slave(
            guid=description.guid,
            unzipDirectory=self.folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="tail",
        )
        self.fmu.instantiate()
        self.fmu.enterInitializationMode(startTime=0.0)
        self.fmu.exitInitializationMode()
        self.time = 0.0
        self.state = None
        self.count = int(self.fmu.getUInt64([self.references["nodes"]])[0])
        mass, length = self.get(["mass_kg", "length_m"])
        self.masses = np.full(self.count, mass / (self.count - 1))
        self.masses[[0, -1]] *= 0.5
        # Drag of half an edge on its node, N s/m: along it, xi = 6 pi mu R a length, and across it.
        viscosity, radius, ratio = self.get(["viscosity_pa_s", "rod.outer_radius_m", "drag.ratio"])
        self.along = 0.5 * length / (self.count - 1) * 6 * np.pi * viscosity * radius
        self.across = ratio * self.along

    def get(self, names, count=1):
        values = self.fmu.getFloat64([self.references[name] for name in names], nValues=count * len(names))
        return np.reshape(values, (len(names), count)).squeeze(axis=1) if count == 1 else np.reshape(values, (-1, count))

    def step(self, head) -> None:
        """Moves the head there, as pose and rates, in one micro-step."""
        self.fmu.setFloat64([self.references[name] for name in self.HEAD], list(head))
        self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=STEP)
        self.time += STEP

    def save(self) -> None:
        self.forget()
        self.state = (self.time, self.fmu.getFMUState())

    def roll_back(self) -> None:
        self.time, state = self.state
        self.fmu.setFMUState(state)

    def forget(self) -> None:
        if self.state:
            self.fmu.freeFMUState(self.state[1])
        self.state = None

    def close(self) -> None:
        self.forget()
        self.fmu.terminate()
        self.fmu.freeInstance()
        shutil.rmtree(self.folder)

    def motion(self):
        """Momentum (x, y, about the origin), and drag force and moment, from what every node does."""
        x, y, vx, vy = self.get(self.NODES, self.count)
        momentum = np.array([self.masses @ vx, self.masses @ vy, self.masses @ (x * vy - y * vx)])
        edges = np.stack([np.diff(x), np.diff(y)])
        tangents = edges / np.hypot(*edges)
        force = np.zeros((2, self.count))
        for end in (slice(None, -1), slice(1, None)):
            velocity = np.stack([vx[end], vy[end]])
            along = tangents * (tangents * velocity).sum(axis=0)
            force[:, end] -= self.along * along + self.across * (velocity - along)
        return momentum, np.array([force[0].sum(), force[1].sum(), x @ force[1] - y @ force[0]])


class Vehicle:
    """A rigid body in the plane with linear drag, its stern the joint of the tail; stepped by RK4."""

    MASS, INERTIA = 0.3, 3e-3  # kg, kg m^2
    STERN = 0.05  # from the centre of mass to the joint, m
    DRAG = np.array([0.05, 0.3])  # along and across, N s/m
    SPIN_DRAG = 5e-3  # N m s

    def __init__(self) -> None:
        # Position and angle, their rates, and what they add up: impulse of drag (x, y, about the origin) and its work.
        self.y = np.zeros(10)
        self.y[0] = -self.STERN

    def rate(self, y, reaction):
        cos, sin = np.cos(y[2]), np.sin(y[2])
        vx, vy, spin = y[3:6]
        along, across = self.DRAG * (cos * vx + sin * vy, cos * vy - sin * vx)
        drag = np.array([-along * cos + across * sin, -along * sin - across * cos, -self.SPIN_DRAG * spin])
        moment = drag[2] + reaction[2] + self.STERN * (cos * reaction[1] - sin * reaction[0])
        turning = drag[2] + y[0] * drag[1] - y[1] * drag[0]
        work = -drag @ (vx, vy, spin)
        acceleration = (drag[:2] + reaction[:2]) / self.MASS
        return np.array([vx, vy, spin, *acceleration, moment / self.INERTIA, drag[0], drag[1], turning, work])

    def advance(self, first, last, count):
        """Moves on in micro-steps under reactions from the first to the last; the joint's pose and rates after each."""
        path = []
        for i in range(count):
            a, b, c = (first + (last - first) * (i + part) / count for part in (0.0, 0.5, 1.0))
            k1 = self.rate(self.y, a)
            k2 = self.rate(self.y + 0.5 * STEP * k1, b)
            k3 = self.rate(self.y + 0.5 * STEP * k2, b)
            k4 = self.rate(self.y + STEP * k3, c)
            self.y = self.y + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            path.append(self.joint())
        return path

    def joint(self):
        x, y, angle, vx, vy, spin = self.y[:6]
        cos, sin = self.STERN * np.cos(angle), self.STERN * np.sin(angle)
        return np.array([x + cos, y + sin, angle, vx - sin * spin, vy + cos * spin, spin])

    def momentum(self):
        x, y, _, vx, vy, spin = self.y[:6]
        return np.array([self.MASS * vx, self.MASS * vy, self.INERTIA * spin + self.MASS * (x * vy - y * vx)])

    def energy(self):
        return 0.5 * self.MASS * (self.y[3:5] @ self.y[3:5]) + 0.5 * self.INERTIA * self.y[5] ** 2


class History(NamedTuple):
    """What happened, by coupling steps."""

    times: np.ndarray
    #: What nothing accounts for: changes of momentum (x, y, about the origin) and of energy.
    lost: np.ndarray
    #: Position, angle, and their rates.
    vehicle: np.ndarray
    #: x and y of the tail's nodes.
    tail: np.ndarray
    #: Work of the tail's actuation, J.
    work: float
    #: Mean number of passes a step.
    passes: float


def simulate(fmu: str, micro_steps: int, iterate: bool, duration: float) -> History:
    """Couples both over `duration` (s) with H = micro_steps * STEP."""
    tail, vehicle = Tail(fmu), Vehicle()
    reaction = tail.get(Tail.REACTION)
    momentum, drag = tail.motion()
    impulse, before = np.zeros(3), momentum + vehicle.momentum()
    energy_before = tail.get(Tail.ENERGY).sum() + vehicle.energy()
    rows, passes = [(0.0, np.zeros(4), vehicle.y[:6], tail.get(Tail.NODES[:2], tail.count))], 0
    for _ in range(round(duration / (micro_steps * STEP))):
        start, guess = vehicle.y, reaction
        if iterate:
            tail.save()
        while True:
            vehicle.y = start
            drags = [drag]
            for head in vehicle.advance(reaction, guess, micro_steps):
                tail.step(head)
                momentum, now = tail.motion()
                drags.append(now)
            answer = tail.get(Tail.REACTION)
            passes += 1
            change = np.abs(answer - guess).max()
            guess = answer
            if not iterate or change <= 1e-9:
                break
            tail.roll_back()
        reaction, drag = answer, drags[-1]
        impulse += STEP * (np.sum(drags, axis=0) - 0.5 * (drags[0] + drags[-1]))
        actuation, viscous, numerical = tail.get(Tail.WORK)
        energy = tail.get(Tail.ENERGY).sum() + vehicle.energy()
        lost = momentum + vehicle.momentum() - before - impulse - vehicle.y[6:9]
        gained = energy - energy_before - (actuation - viscous - numerical) + vehicle.y[9]
        rows.append((tail.time, [*lost, gained], vehicle.y[:6], tail.get(Tail.NODES[:2], tail.count)))
    tail.close()
    return History(*(np.array(column) for column in zip(*rows)), actuation, passes / (len(rows) - 1))


def balance(fmu: str, micro_steps, iterate: bool, duration: float) -> np.ndarray:
    """Largest imbalances for each of `micro_steps`: of linear and angular momentum, relative to the vehicle's largest
    momenta, and of energy, relative to the actuation's work."""
    result = []
    for n in micro_steps:
        history = simulate(fmu, n, iterate, duration)
        _, _, _, vx, vy, spin = history.vehicle.T
        x, y, angular, energy = history.lost.T
        scales = [Vehicle.MASS * np.hypot(vx, vy).max(), Vehicle.INERTIA * np.abs(spin).max(), history.work]
        result.append(np.array([np.hypot(x, y).max(), np.abs(angular).max(), np.abs(energy).max()]) / scales)
        master = f"iterated ({history.passes:.1f} passes a step)" if iterate else "one pass"
        print(f"H = {n * STEP:g} s, {master}: " + ", ".join(f"{value:.2e}" for value in result[-1]))
    return np.array(result)


def main(fmu: str, figure_path: str) -> None:
    """Draws the balances against H, and the swimmer."""
    from matplotlib.figure import Figure

    micro_steps, duration = np.array([2, 4, 8, 16, 32]), 4.0
    figure = Figure(figsize=(11, 4.4), layout="constrained")
    over_step, picture = figure.subplots(1, 2)
    names = ["linear momentum", "angular momentum", "energy"]
    for iterate, style, label in [(False, "o--", "one pass"), (True, "s-", "iterated")]:
        found = balance(fmu, micro_steps, iterate, duration)
        for values, name, colour in zip(found.T, names, ["#0072b2", "#d55e00", "#009e73"]):
            over_step.loglog(micro_steps * STEP, values, style, color=colour, markersize=4, label=f"{name}, {label}")
    h = np.array([4e-3, 1.6e-2])
    for order, end in [(1, 0.3), (2, 2e-4)]:
        over_step.loglog(h, end * (h / h[-1]) ** order, color="0.6", linewidth=1)
        over_step.annotate(f"order {order}", (h[-1], end), color="0.4", fontsize="small")
    over_step.set_xticks(micro_steps * STEP, [f"{1e3 * n * STEP:g}" for n in micro_steps])
    over_step.minorticks_off()
    over_step.set(xlabel="coupling step H (ms)", ylabel="largest imbalance, relative", title="what the coupling loses")
    over_step.legend(fontsize="x-small")
    over_step.grid(alpha=0.3, which="both")

    history = simulate(fmu, 8, True, 2 * duration)
    period = history.times >= history.times[-1] - 1.0
    for row in np.flatnonzero(period)[::16]:
        picture.plot(*history.tail[row], color="0.8", linewidth=1)
    turn = np.linspace(0, 2 * np.pi, 60)
    for row, colour in [(0, "0.6"), (-1, "#0072b2")]:
        x, y, angle = history.vehicle[row, :3]
        along, across = Vehicle.STERN * np.cos(turn), 0.3 * Vehicle.STERN * np.sin(turn)
        cos, sin = np.cos(angle), np.sin(angle)
        picture.plot(x + cos * along - sin * across, y + sin * along + cos * across, color=colour)
        picture.plot(*history.tail[row], color=colour, linewidth=2.5, label=f"t = {history.times[row]:.0f} s")
    picture.plot(history.vehicle[:, 0], history.vehicle[:, 1], color="#d55e00", label="path of the vehicle's centre")
    picture.set(xlabel="x (m)", ylabel="y (m)", title="the swimmer, and its tail over the last period")
    picture.set_aspect("equal", adjustable="datalim")
    picture.legend(fontsize="x-small")
    picture.grid(alpha=0.3)
    figure.savefig(figure_path)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(f"usage: {sys.argv[0]} tail.fmu figure.svg")
    main(*sys.argv[1:])
