"""A tail drives a rigid vehicle that is not caudal's: co-simulation with FMPy, and what the coupling does to it.

The vehicle is a rigid body with mass, moment of inertia and linear drag of its own, in the plane. The tail is the FMU of
tail.toml, held at its stern: the vehicle gives it the pose of the joint, it gives back force and moment, both only at the
coupling step H. A `Scheme` says who moves first, what the tail is told of the joint, and which force the vehicle takes
over its step: the last one held, the last two extrapolated, or the line to the one that the tail answers with.

Total momentum less the impulse of all drag, and total energy less all work, must not change. What they change by is the
coupling's own doing: `balance` measures it from positions and velocities of both, `main` draws it against H. Held forces
make it of first order, lines between forces of second. Nothing damps the tail's stretching here, and what jumps from step to
step can feed it: over 4 s at H = 8 ms, of the schemes without iteration only that in which the vehicle goes first under a
held force, and that in which the tail goes first, stay within their order; at 16 ms the latter does not.

    caudal fmu tail.toml -o now.fmu
    caudal fmu tail.toml --set head.input=at-end -o at-end.fmu
    python vehicle.py now.fmu at-end.fmu vehicle.svg          # needs FMPy and matplotlib
"""

from __future__ import annotations

import shutil
import sys
from typing import NamedTuple

import fmpy
import numpy as np
from fmpy.fmi3 import FMU3Slave

STEP = 1e-3  # the steps of either between couplings, s
MOST_PASSES = 60  # in the mean of all steps until then


class Scheme(NamedTuple):
    """How a master couples them."""

    name: str
    #: What a pose is that the tail is given: "now", at the beginning of the step, or "at-end", where the vehicle is then.
    head: str
    #: The derivatives of the pose that go with it.
    derivatives: int
    #: The force on the vehicle over a step: "held", "extrapolated" or "interpolated".
    force: str
    #: Repeated, with the tail rolled back, until both agree.
    iterate: bool = False
    #: Each pass goes to where the derivatives of both say that they agree.
    jacobian: bool = False
    #: Of the imbalance in H.
    order: int = 2
    #: How much of its change the force takes over from one pass to the next.
    relaxation: float = 1.0


SCHEMES = [
    Scheme("Jacobi, pose alone", "now", 0, "held", order=1),
    Scheme("Jacobi, pose and rates", "now", 1, "held", order=1),
    Scheme("Jacobi, rates and accelerations, force extrapolated", "now", 2, "extrapolated"),
    Scheme("Gauss-Seidel, tail first", "now", 2, "interpolated"),
    Scheme("Gauss-Seidel, vehicle first", "at-end", 1, "held", order=1),
    Scheme("Gauss-Seidel, vehicle first, force extrapolated", "at-end", 1, "extrapolated"),
    Scheme("Gauss-Seidel, iterated", "at-end", 1, "interpolated", iterate=True),
    Scheme("Gauss-Seidel, iterated with the interface Jacobian", "at-end", 2, "interpolated", iterate=True, jacobian=True),
]


class Tail:
    """The FMU by names of variables."""

    HEAD = ["head_x_m", "head_y_m", "head_angle_rad", "head_vx_m_s", "head_vy_m_s", "head_spin_rad_s"]
    HEAD += ["head_ax_m_s2", "head_ay_m_s2", "head_spin_rate_rad_s2"]
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

    def step(self, head, step: float) -> None:
        """Gives it the pose of its head, with as many derivatives as there are, and moves on by a coupling step."""
        self.fmu.setFloat64([self.references[name] for name in self.HEAD[: len(head)]], list(head))
        self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=step)
        self.time += step

    def slopes(self, count):
        """How the reaction changes with so many numbers of the pose given for the end of the step that was just made: through that
        step."""
        unknowns = [self.references[name] for name in self.REACTION]
        knowns = [self.references[name] for name in self.HEAD[:count]]
        return np.transpose([self.fmu.getDirectionalDerivative(unknowns, [known], [1.0]) for known in knowns])

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

    def advance(self, first, last, count) -> None:
        """Moves on by a coupling step of so many of its own, under reactions from the first to the last."""
        for i in range(count):
            a, b, c = (first + (last - first) * (i + part) / count for part in (0.0, 0.5, 1.0))
            k1 = self.rate(self.y, a)
            k2 = self.rate(self.y + 0.5 * STEP * k1, b)
            k3 = self.rate(self.y + 0.5 * STEP * k2, b)
            k4 = self.rate(self.y + STEP * k3, c)
            self.y = self.y + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    def slopes(self, start, first, last, count, derivatives):
        """How the pose of the joint, with so many derivatives, at the end of a step from `start` changes with the last reaction: by
        differences, which a rigid body's few numbers allow. It is left at that end."""
        size, columns = 1e-4, []
        for axis in [*np.eye(3), None]:
            ends = []
            for sign in (1, -1) if axis is not None else (0,):
                self.y, reaction = start, last + sign * size * (0 if axis is None else axis)
                self.advance(first, reaction, count)
                ends.append(self.joint(reaction, derivatives))
            if axis is not None:
                columns.append((ends[0] - ends[1]) / (2 * size))
        return np.transpose(columns)

    def joint(self, reaction, derivatives):
        """Pose of the joint, and so many of its derivatives."""
        x, y, angle, vx, vy, spin = self.y[:6]
        ax, ay, spin_rate = self.rate(self.y, reaction)[3:6]
        cos, sin = self.STERN * np.cos(angle), self.STERN * np.sin(angle)
        pose = [x + cos, y + sin, angle]
        rates = [vx - sin * spin, vy + cos * spin, spin]
        accelerations = [ax - sin * spin_rate - cos * spin**2, ay + cos * spin_rate - sin * spin**2, spin_rate]
        return np.array([*pose, *rates, *accelerations])[: 3 * (derivatives + 1)]

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


def integrals(values, step):
    """Of each column from the start to every row, by cubics: their error is of fourth order, below what is measured."""
    parts = np.empty((len(values) - 1, *values.shape[1:]))
    parts[0] = 9 * values[0] + 19 * values[1] - 5 * values[2] + values[3]
    parts[-1] = 9 * values[-1] + 19 * values[-2] - 5 * values[-3] + values[-4]
    parts[1:-1] = -values[:-3] + 13 * values[1:-2] + 13 * values[2:-1] - values[3:]
    return step / 24 * np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(parts, axis=0)])


def simulate(fmus: dict[str, str], scheme: Scheme, count: int, duration: float) -> History:
    """Couples both over `duration` (s) with H = count * STEP."""
    tail, vehicle, step = Tail(fmus[scheme.head]), Vehicle(), count * STEP
    reaction = before = tail.get(Tail.REACTION)
    rows, passes = [], 0

    def record():
        momentum, drag = tail.motion()
        actuation, viscous, numerical = tail.get(Tail.WORK)
        energy = tail.get(Tail.ENERGY).sum() + vehicle.energy() - (actuation - viscous - numerical) + vehicle.y[9]
        free = [*(momentum + vehicle.momentum() - vehicle.y[6:9]), energy]
        rows.append((tail.time, free, [*drag, 0.0], vehicle.y[:6], tail.get(Tail.NODES[:2], tail.count)))

    record()
    for _ in range(round(duration / step)):
        start = vehicle.y
        foreseen = scheme.force == "extrapolated" or scheme.jacobian
        answer = 2 * reaction - before if foreseen else reaction
        if scheme.iterate:
            tail.save()
        while True:
            guess, vehicle.y = answer, start
            if scheme.head == "at-end":
                vehicle.advance(reaction, guess, count)
                tail.step(vehicle.joint(guess, scheme.derivatives), step)
                answer = tail.get(Tail.REACTION)
            else:
                tail.step(vehicle.joint(reaction, scheme.derivatives), step)
                answer = tail.get(Tail.REACTION)
                vehicle.advance(reaction, answer if scheme.force == "interpolated" else guess, count)
            passes += 1
            if not scheme.iterate or np.abs(answer - guess).max() <= 1e-9:
                break
            if passes > MOST_PASSES * (len(rows) + 1):
                tail.close()
                raise RuntimeError(f"vehicle and tail do not agree at t = {tail.time:.3f} s")
            change = scheme.relaxation * (answer - guess)
            if scheme.jacobian:
                # Where guess + change is the answer to itself, as far as both are linear.
                given = vehicle.slopes(start, reaction, guess, count, scheme.derivatives)
                change = np.linalg.solve(np.eye(3) - tail.slopes(len(given)) @ given, change)
            answer = guess + change
            tail.roll_back()
        before, reaction = reaction, answer
        record()
    work = tail.get(Tail.WORK)[0]
    tail.close()
    times, free, drags, path, nodes = (np.array(column) for column in zip(*rows))
    return History(times, free - free[0] - integrals(drags, step), path, nodes, work, passes / (len(rows) - 1))


def balance(fmus: dict[str, str], scheme: Scheme, counts, duration: float) -> np.ndarray:
    """Largest imbalances for each of `counts`: of linear and angular momentum, relative to the vehicle's largest
    momenta, and of energy, relative to the actuation's work."""
    result = []
    for count in counts:
        history = simulate(fmus, scheme, count, duration)
        _, _, _, vx, vy, spin = history.vehicle.T
        x, y, angular, energy = history.lost.T
        scales = [Vehicle.MASS * np.hypot(vx, vy).max(), Vehicle.INERTIA * np.abs(spin).max(), history.work]
        result.append(np.array([np.hypot(x, y).max(), np.abs(angular).max(), np.abs(energy).max()]) / scales)
        passes = f"{history.passes:.1f}" if scheme.iterate else "1"
        cells = " | ".join(f"{value:.1e}" for value in result[-1])
        print(f"| {scheme.name} | {passes} | {count * STEP * 1e3:g} ms | {cells} |")
    return np.array(result)


def main(now: str, at_end: str, figure_path: str) -> None:
    """Draws the balances against H, and the swimmer."""
    from matplotlib.figure import Figure

    counts, duration, fmus = np.array([2, 4, 8, 16, 32]), 4.0, {"now": now, "at-end": at_end}
    figure = Figure(figsize=(12, 8.4), layout="constrained")
    axes = figure.subplots(2, 2)
    colours = ["#56b4e9", "#0072b2", "#009e73", "#f0e442", "#e69f00", "#d55e00", "#cc79a7", "#000000"]
    for scheme, colour in zip(SCHEMES, colours):
        found = balance(fmus, scheme, counts, duration)
        for axis, values in zip(axes.flat, found.T):
            style = "o--" if scheme.order == 1 else "s-"
            axis.loglog(counts * STEP, values, style, color=colour, markersize=4, label=scheme.name)
    for axis, name in zip(axes.flat, ["linear momentum", "angular momentum", "energy"]):
        low = axis.get_ylim()[0]
        for order in (1, 2):
            axis.loglog([4e-3, 1.6e-2], [2 * low, 2 * low * 4**order], color="0.6", linewidth=1)
            axis.annotate(f"order {order}", (1.6e-2, 2 * low * 4**order), color="0.4", fontsize="small")
        axis.set_xticks(counts * STEP, [f"{1e3 * count * STEP:g}" for count in counts])
        axis.minorticks_off()
        axis.set(xlabel="coupling step H (ms)", ylabel="largest imbalance, relative", title=name)
        axis.grid(alpha=0.3, which="both")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize="small")

    picture = axes[1, 1]
    history = simulate(fmus, SCHEMES[-1], 8, 2 * duration)
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
    if len(sys.argv) != 4:
        sys.exit(f"usage: {sys.argv[0]} now.fmu at-end.fmu figure.svg")
    main(*sys.argv[1:])
