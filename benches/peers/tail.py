"""The tail of models/baseline.toml, in a vacuum and started by a ramp, in caudal and in other programs: processor time of a simulated second
beside the error of the tip's path, as a table and as the chart of the notes (docs/src/notes/other-programs.md).

    python -m venv peer && peer/bin/pip install -r benches/peers/requirements.txt
    cargo build --release
    peer/bin/python benches/peers/tail.py target/release/caudal docs/src/notes/figures/peers.svg

Without a fluid, as none of the others has caudal's; the elasticity, the mass and the drive are the same. Each program has its own mesh of a
continuous rod, so the reference is caudal's extrapolated from 129 and 257 nodes; the script prints what that changed against 65 and 129. Where
a program takes the drive from Python at every step, as Exudyn and PyElastica do, its time has that too.
"""

import argparse
import csv
import pathlib
import resource
import subprocess
import tempfile
import time

import numpy as np

LENGTH, OUTER, INNER, YOUNG, DENSITY, GRADIENT = 1.0, 0.013, 0.011, 70e9, 2700.0, 1.0
AMPLITUDE, FREQUENCY, WAVELENGTH, RAMP = 0.6 / 0.125, 2.0, 1.0, 0.5
AREA = np.pi * (OUTER**2 - INNER**2)
EI = YOUNG * 0.25 * np.pi * (OUTER**4 - INNER**4)
EA = YOUNG * AREA
DURATION, INTERVAL = 1.0, 0.02
TIMES = np.linspace(0.0, DURATION, round(DURATION / INTERVAL) + 1)


def natural_curvature(s, t):
    """1/m, at the arc length s (m) and the time t (s)."""
    z = np.clip(t / RAMP, 0.0, 1.0)
    gain = z**3 * (10.0 - 15.0 * z + 6.0 * z**2)
    return gain * AMPLITUDE * (0.2 + 0.8 * s / LENGTH) * np.sin(2 * np.pi * (FREQUENCY * t - s / WAVELENGTH))


def bending_stiffness(s):
    """N m², at the arc length s (m)."""
    return EI * (1.0 + GRADIENT * (1.0 - s / LENGTH))


def nodes_of(count):
    """Arc lengths (m) and masses (kg) of the nodes of a chain."""
    spacing = LENGTH / (count - 1)
    mass = np.full(count, DENSITY * AREA * spacing)
    mass[[0, -1]] *= 0.5
    return np.arange(count) * spacing, mass


SCENE = f"""name = "tail"
[rod]
nodes = 9
length_m = {LENGTH}
outer_radius_m = {OUTER}
inner_radius_m = {INNER}
youngs_modulus_pa = {YOUNG}
density_kg_m3 = {DENSITY}
stiffness_gradient = {GRADIENT}
[actuation]
kind = "travelling-wave"
kappa_amp = {AMPLITUDE}
kappa_reference_length_m = 1.0
frequency_hz = {FREQUENCY}
wavelength_m = {WAVELENGTH}
envelope = [0.2, 0.8]
[start]
kind = "ramp"
ramp_s = {RAMP}
[solver]
duration_s = {DURATION}
"""


class Caudal:
    """The command; a run's time is what ten seconds more take, so that neither start nor pages count."""

    def __init__(self, command, folder):
        self.command, self.folder = command, pathlib.Path(folder)
        self.scene = self.folder / "tail.toml"
        self.scene.write_text(SCENE)

    def once(self, nodes, keys, duration, interval):
        out = self.folder / "out"
        keys = [*keys, f"rod.nodes={nodes}", f"solver.duration_s={duration}", f"record.interval_s={interval}"]
        keys = [part for key in [*keys, "record.nodes=[-1]"] for part in ("--set", key)]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([self.command, "run", self.scene, "--quiet", "--out", out, *keys], check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        with open(out / "nodes.csv", newline="") as table:
            rows = [[float(x) for x in row] for row in list(csv.reader(table))[1:]]
        return np.array(rows)[:, -2:], after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def run(self, nodes, *keys):
        path, _ = self.once(nodes, keys, DURATION, INTERVAL)
        longer = [min(self.once(nodes, keys, d, 1.0)[1] for _ in range(5)) for d in (DURATION, DURATION + 10.0)]
        return path, (longer[1] - longer[0]) / 10.0


# The servos are explicit: 1.5e-4 s fails on nine nodes, and the step falls with the square of the mesh.
MUJOCO_STEPS = [(9, 1.25e-4), (17, 3.125e-5), (33, 7.8125e-6)]


def mujoco_model(nodes, step):
    """A chain of hinges with a position servo as the spring of each, by semi-implicit Euler."""
    import mujoco

    s, mass = nodes_of(nodes)
    spacing = s[1]
    ball = '<geom type="sphere" size="1e-3" contype="0" conaffinity="0" mass="{:.17g}" pos="{:.17g} 0 0"/>'
    inner = f'<site name="tip" pos="{spacing:.17g} 0 0"/>'
    for k in range(nodes - 2, 0, -1):
        place = f'pos="{spacing:.17g} 0 0"'
        joint = f'<joint name="j{k}" type="hinge" axis="0 0 1"/>'
        inner = f"<body {place}>{joint}{ball.format(mass[k + 1], spacing)}{inner}</body>"
    free = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="hinge" axis="0 0 1"/>'
    first = ball.format(mass[0], 0.0) + ball.format(mass[1], spacing)
    servos = "".join(f'<position joint="j{k}" kp="{bending_stiffness(s[k]) / spacing:.17g}"/>' for k in range(1, nodes - 1))
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler boundmass="0" boundinertia="0"/>'
        f'<option gravity="0 0 0" timestep="{step}"/>'
        f"<worldbody><body>{free}{first}{inner}</body></worldbody><actuator>{servos}</actuator>"
        f'<sensor><framepos objtype="site" objname="tip"/></sensor></mujoco>'
    )


def mujoco_chain(nodes, step):
    """The chain along the drive; the loop over the steps is in C."""
    import mujoco
    from mujoco import rollout

    s, _ = nodes_of(nodes)
    spacing = s[1]
    model = mujoco_model(nodes, step)
    data = mujoco.MjData(model)
    state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    steps = round(DURATION / step)

    def simulate():
        # The servo's angle in the middle of a step.
        times = (np.arange(steps) + 0.5) * step
        control = natural_curvature(s[1:-1], times[:, None]) * spacing
        return rollout.rollout(model, data, state[None, :], control[None, :, :])[1][0]

    found, seconds = timed(simulate, 3)
    # Sensors are read at the beginning of a step.
    rows = np.minimum(np.round(TIMES / step).astype(int), steps - 1)
    return found[rows, :2], seconds


def exudyn_cable(elements, step):
    """ANCF cable elements, cubic and with one natural curvature each, set before every step; generalized-α."""
    import exudyn as exu
    from exudyn.utilities import NodePoint2DSlope1, ObjectANCFCable2D

    container = exu.SystemContainer()
    system = container.AddSystem()
    part = LENGTH / elements
    centres = (np.arange(elements) + 0.5) * part
    ends = [system.AddNode(NodePoint2DSlope1(referenceCoordinates=[k * part, 0, 1, 0])) for k in range(elements + 1)]
    cables = [
        system.AddObject(
            ObjectANCFCable2D(
                length=part,
                massPerLength=DENSITY * AREA,
                bendingStiffness=float(bending_stiffness(centre)),
                axialStiffness=EA,
                nodeNumbers=ends[k : k + 2],
            )
        )
        for k, centre in enumerate(centres)
    ]
    path = {}

    def before(system, t):
        for cable, curvature in zip(cables, natural_curvature(centres, t)):
            system.SetObjectParameter(cable, "referenceCurvature", float(curvature))
        return True

    def after(system, t):
        path[round(t / step)] = system.GetNodeOutput(ends[-1], exu.OutputVariableType.Position)[:2]
        return True

    system.SetPreStepUserFunction(before)
    system.SetPostStepUserFunction(after)
    system.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps = round(DURATION / step)
    settings.timeIntegration.endTime = DURATION
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.8
    settings.timeIntegration.newton.useModifiedNewton = False
    settings.timeIntegration.newton.numericalDifferentiation.minimumCoordinateSize = 1
    settings.timeIntegration.newton.relativeTolerance = 1e-6
    settings.timeIntegration.newton.absoluteTolerance = 1e-6
    settings.timeIntegration.adaptiveStep = False
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    settings.show.statistics = settings.show.computationTime = False

    def simulate():
        before(system, 0.0)
        system.SolveDynamic(settings)
        path[0] = [LENGTH, 0.0]
        return np.array([[n * step, *path[n]] for n in sorted(path)])

    found, seconds = timed(simulate, 3)
    return at_times(found), seconds


def pyelastica_rod(elements, step):
    """A Cosserat rod with shear, by position Verlet; its natural curvature is set before every step."""
    import elastica as ea

    class Simulator(ea.BaseSystemCollection, ea.Forcing, ea.CallBacks):
        pass

    radius = np.sqrt(AREA / np.pi)
    rod = ea.CosseratRod.straight_rod(
        elements, np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), LENGTH, radius, DENSITY, youngs_modulus=YOUNG
    )
    # Of a tube, not of the solid rod of the same area.
    tube = (OUTER**2 + INNER**2) / (OUTER**2 - INNER**2)
    rod.mass_second_moment_of_inertia *= tube
    rod.inv_mass_second_moment_of_inertia /= tube
    joints = np.arange(1, elements) * LENGTH / elements
    for i in (0, 1):
        rod.bend_matrix[i, i, :] = bending_stiffness(joints)
    rod.bend_matrix[2, 2, :] *= tube
    path = [[0.0, LENGTH, 0.0]]

    class Drive(ea.NoForces):
        def apply_forces(self, system, time=0.0):
            # The first director is the normal of the plane.
            system.rest_kappa[0, :] = natural_curvature(joints, time)

    class Watch(ea.CallBackBaseClass):
        def make_callback(self, system, time, current_step):
            if current_step and current_step % every == 0:
                path.append([time, *system.position_collection[:2, -1]])

    every = max(1, round(INTERVAL / step / 4))
    simulator = Simulator()
    simulator.append(rod)
    simulator.add_forcing_to(rod).using(Drive)
    simulator.collect_diagnostics(rod).using(Watch)
    simulator.finalize()
    stepper = ea.PositionVerlet()
    simulator_steps = round(DURATION / step)
    ea.integrate(stepper, simulator, 2 * step, 2, progress_bar=False)  # compiles, at rest still
    path[:] = path[:1]
    _, seconds = timed(lambda: ea.integrate(stepper, simulator, DURATION, simulator_steps, progress_bar=False), 1)
    return at_times(np.array(path)), seconds


def numba_chain(step):
    """The chain of sweep_numba.py, dense and by implicit Euler, on its nine nodes."""
    import sweep_numba
    from numba import njit

    s, mass = nodes_of(sweep_numba.NODES)
    spacing, count = s[1], sweep_numba.NODES
    joint = bending_stiffness(s) / spacing
    assemble, ea = sweep_numba.assemble, EA

    @njit
    def march(bars, step):
        q, v, path = np.zeros(2 * count), np.zeros(2 * count), np.zeros((len(bars), 2))
        q[::2] = s
        f, jac, energies, moments = np.empty(2 * count), np.empty((2 * count, 2 * count)), np.zeros(3), np.zeros(count)
        for n in range(len(bars)):
            new = q + step * v
            for _ in range(30):
                speed = (new - q) / step
                assemble(new, speed, 1.0, ea, joint, bars[n], 0.0, f, jac, energies, moments)
                for k in range(2 * count):
                    f[k] += mass[k // 2] / step * (speed[k] - v[k])
                    jac[k, k] += mass[k // 2] / step**2
                increment = np.linalg.solve(jac, f)
                new = new - increment
                if np.abs(increment).max() < 1e-10 * LENGTH:
                    break
            v = (new - q) / step
            q = new
            path[n] = q[-2:]
        return path

    times = np.arange(1, round(DURATION / step) + 1) * step
    simulate = lambda: march(natural_curvature(s, times[:, None]) * spacing, step)
    simulate()  # compiles
    found, seconds = timed(simulate, 3)
    return at_times(np.vstack([[0.0, LENGTH, 0.0], np.column_stack([times, found])])), seconds


def timed(simulate, times):
    """What it returns, and the least processor time of a simulated second, s."""
    least = np.inf
    for _ in range(times):
        start = time.process_time()
        found = simulate()
        least = min(least, time.process_time() - start)
    return found, least / DURATION


def at_times(rows):
    """The path at TIMES by cubics through its samples."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(rows[:, 0], rows[:, 1:])(TIMES)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("caudal")
    parser.add_argument("chart", nargs="?")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        caudal = Caudal(asked.caudal, folder)
        fine = ["solver.integrator=generalized-alpha", "solver.time_step_s=2.5e-4", "solver.newton_tolerance=1e-12"]
        third, second, first = (caudal.once(nodes, fine, DURATION, INTERVAL)[0] for nodes in (65, 129, 257))
        reference = first + (first - second) / 3.0
        before = second + (second - third) / 3.0
        travel = np.linalg.norm(reference - reference[0], axis=1).max()
        error = lambda path: np.linalg.norm(path - reference, axis=1).max() / travel
        print(f"the reference's mesh leaves about {error(before):.1e} of the tip's way, {travel:.3f} m")
        alpha = lambda step: ("solver.integrator=generalized-alpha", f"solver.time_step_s={step}")
        runs = [
            ("caudal, generalized-α 5 ms", [(n, caudal.run(n, *alpha(5e-3))) for n in (9, 17, 33, 65)]),
            ("caudal, ESDIRK3 at 1e-3", [(n, caudal.run(n, "solver.tolerance=1e-3")) for n in (9, 17, 33, 65)]),
            ("MuJoCo, hinges, largest stable step", [(n, mujoco_chain(n, h)) for n, h in MUJOCO_STEPS]),
            ("Exudyn, ANCF cable, 5 ms", [(n, exudyn_cable(n - 1, 5e-3)) for n in (9, 17, 33)]),
            ("PyElastica", [(n, pyelastica_rod(n - 1, h)) for n, h in ((9, 5e-6),)]),
            ("NumPy and Numba, implicit Euler", [(9, numba_chain(h)) for h in (5e-3, 1e-3)]),
        ]
    table = [(name, [(nodes, error(path), 1e3 * seconds) for nodes, (path, seconds) in points]) for name, points in runs]
    for name, points in table:
        for nodes, off, milliseconds in points:
            print(f"{name:36} {nodes:4} nodes  error {off:.1e}  {milliseconds:9.3f} ms a simulated second", flush=True)
    if asked.chart:
        chart(table, asked.chart)


def chart(table, path):
    """The chart of the table, as SVG."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams.update({"svg.hashsalt": "caudal", "font.size": 9, "svg.fonttype": "none"})
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7.2, 4.8), layout="constrained")
    for (name, points), marker in zip(table, "osD^vPX*"):
        axes.loglog([p[2] for p in points], [p[1] for p in points], marker=marker, label=name)
        for nodes, off, milliseconds in points:
            axes.annotate(f"{nodes}", (milliseconds, off), xytext=(4, 4), textcoords="offset points", fontsize=7)
    axes.set_xlabel("processor time of a simulated second (ms)")
    axes.set_ylabel("largest error of the tip's path over its way")
    axes.grid(True, which="both", linewidth=0.3)
    figure.legend(loc="outside lower center", ncols=2, fontsize=8)
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    main()
