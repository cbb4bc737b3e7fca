"""The 192 cases of models/sweep-192.toml in plain NumPy, compiled by Numba: what a careful user would write without caudal.

Dense matrices, full Newton with the exact Jacobian, implicit Euler, one case after the other on one core; the same
quantities are summed up in every step. Equations: those of the study with the readings that caudal documents.

    python -m venv peer && peer/bin/pip install numba scipy
    peer/bin/python benches/peers/sweep_numba.py                          # times it
    peer/bin/python benches/peers/sweep_numba.py out/sweep-192/table.csv  # also compares every case with caudal's table
"""

import csv
import itertools
import sys
import time

import numpy as np
from numba import njit

NODES, LENGTH, STEP, STEPS = 9, 1.0, 1e-4, 5000
SPACING = LENGTH / (NODES - 1)
GRADIENT, RATIO, HEAD_WEIGHT, WAVELENGTH, ENVELOPE = 1.0, 5.0, 10.0, 1.0, (0.2, 0.8)
TOLERANCE, MOST_ITERATIONS = 1e-10, 30


@njit
def natural(amplitude, frequency, t, out):
    for k in range(1, NODES - 1):
        xi = k / (NODES - 1)
        envelope = ENVELOPE[0] + ENVELOPE[1] * xi
        out[k] = amplitude * envelope * np.sin(2 * np.pi * (frequency * t - xi * LENGTH / WAVELENGTH))


@njit
def assemble(q, v, mass, ea, joint, kappa_bar, along, f, jac, energies, moments):
    """Adds elastic and drag forces to f and to jac, d f/d q + (1/STEP) d f/d v; returns energies and viscous power."""
    f[:] = 0.0
    jac[:] = 0.0
    energies[:] = 0.0
    t = np.empty((NODES - 1, 2))
    n = np.empty((NODES - 1, 2))
    length = np.empty(NODES - 1)
    viscous = 0.0
    for e in range(NODES - 1):
        dx, dy = q[2 * e + 2] - q[2 * e], q[2 * e + 3] - q[2 * e + 1]
        length[e] = np.hypot(dx, dy)
        t[e, 0], t[e, 1] = dx / length[e], dy / length[e]
        n[e, 0], n[e, 1] = -t[e, 1], t[e, 0]
        strain = length[e] / SPACING - 1.0
        energies[0] += 0.5 * ea * SPACING * strain**2
        tension = ea * strain
        for i in range(2):
            f[2 * e + i] -= tension * t[e, i]
            f[2 * e + 2 + i] += tension * t[e, i]
            for j in range(2):
                h = ea / SPACING * t[e, i] * t[e, j] + tension / length[e] * n[e, i] * n[e, j]
                jac[2 * e + i, 2 * e + j] += h
                jac[2 * e + 2 + i, 2 * e + 2 + j] += h
                jac[2 * e + i, 2 * e + 2 + j] -= h
                jac[2 * e + 2 + i, 2 * e + j] -= h
        for k in (e, e + 1):
            weight = 0.5 * SPACING * along * (HEAD_WEIGHT if k == 0 else 1.0)
            vt = v[2 * k] * t[e, 0] + v[2 * k + 1] * t[e, 1]
            vn = v[2 * k] * n[e, 0] + v[2 * k + 1] * n[e, 1]
            viscous += weight * (vt * vt + RATIO * vn * vn)
            for i in range(2):
                f[2 * k + i] += weight * (vt * t[e, i] + RATIO * vn * n[e, i])
                # The direction turns with the edge: d t = n d phi, d n = -t d phi, d phi = n . d(edge)/length.
                turned = weight * (1.0 - RATIO) * (vn * t[e, i] + vt * n[e, i]) / length[e]
                for j in range(2):
                    resistance = weight * (t[e, i] * t[e, j] + RATIO * n[e, i] * n[e, j])
                    jac[2 * k + i, 2 * k + j] += resistance / STEP
                    jac[2 * k + i, 2 * e + 2 + j] += turned * n[e, j]
                    jac[2 * k + i, 2 * e + j] -= turned * n[e, j]
    g = np.empty(6)
    for k in range(1, NODES - 1):
        a, b = k - 1, k
        cross = t[a, 0] * t[b, 1] - t[a, 1] * t[b, 0]
        kappa = 2.0 * cross / (1.0 + t[a, 0] * t[b, 0] + t[a, 1] * t[b, 1])
        deviation = kappa - kappa_bar[k]
        s = 1.0 + 0.25 * kappa * kappa
        moments[k] = joint[k] * deviation
        energies[1] += 0.5 * moments[k] * deviation
        couple = moments[k] * s
        second = joint[k] * (s * s + 0.5 * deviation * kappa * s)
        for i in range(2):
            ga, gb = n[a, i] / length[a], n[b, i] / length[b]
            g[i], g[2 + i], g[4 + i] = ga, -ga - gb, gb
        base = 2 * (k - 1)
        for i in range(6):
            f[base + i] += couple * g[i]
            for j in range(6):
                jac[base + i, base + j] += second * g[i] * g[j]
        for i in range(2):
            for j in range(2):
                ha = couple * (t[a, i] * n[a, j] + n[a, i] * t[a, j]) / length[a] ** 2
                hb = -couple * (t[b, i] * n[b, j] + n[b, i] * t[b, j]) / length[b] ** 2
                jac[base + i, base + j] += ha
                jac[base + 2 + i, base + 2 + j] += ha + hb
                jac[base + 4 + i, base + 4 + j] += hb
                jac[base + i, base + 2 + j] -= ha
                jac[base + 2 + i, base + j] -= ha
                jac[base + 2 + i, base + 4 + j] -= hb
                jac[base + 4 + i, base + 2 + j] -= hb
    for i in range(2 * NODES):
        energies[2] += 0.5 * mass * v[i] * v[i]
    return viscous


@njit
def case(youngs, density, amplitude, frequency, outer, inner, viscosity):
    area = np.pi * (outer**2 - inner**2)
    ei = youngs * 0.25 * np.pi * (outer**4 - inner**4)
    mass = density * area * SPACING
    joint = np.zeros(NODES)
    for k in range(1, NODES - 1):
        joint[k] = ei / SPACING * (1.0 + GRADIENT * (1.0 - k / (NODES - 1)))
    along = 6.0 * np.pi * viscosity * np.sqrt(area / np.pi)
    q, v = np.zeros(2 * NODES), np.zeros(2 * NODES)
    q[::2] = np.arange(NODES) * SPACING
    kappa_bar, old_bar = np.zeros(NODES), np.zeros(NODES)
    moments, old_moments = np.zeros(NODES), np.zeros(NODES)
    f, jac, energies = np.empty(2 * NODES), np.empty((2 * NODES, 2 * NODES)), np.zeros(3)
    natural(amplitude, frequency, 0.0, kappa_bar)
    viscous = assemble(q, v, mass, youngs * area, joint, kappa_bar, along, f, jac, energies, moments)
    first, y_max, actuation_work, viscous_work, bending_time = q[::2].mean(), 0.0, 0.0, 0.0, 0.0
    for step in range(1, STEPS + 1):
        old_bar[:], old_moments[:], old_viscous, old_bending = kappa_bar, moments, viscous, energies[1]
        natural(amplitude, frequency, step * STEP, kappa_bar)
        new = q + STEP * v
        for _ in range(MOST_ITERATIONS):
            speed = (new - q) / STEP
            assemble(new, speed, mass, youngs * area, joint, kappa_bar, along, f, jac, energies, moments)
            f += mass / STEP * (speed - v)
            for i in range(2 * NODES):
                jac[i, i] += mass / STEP**2
            increment = np.linalg.solve(jac, f)
            new = new - increment
            if np.abs(increment).max() < TOLERANCE * LENGTH:
                break
        v = (new - q) / STEP
        q = new
        viscous = assemble(q, v, mass, youngs * area, joint, kappa_bar, along, f, jac, energies, moments)
        y_max = max(y_max, abs(q[1::2].mean()))
        for k in range(1, NODES - 1):
            actuation_work -= 0.5 * (moments[k] + old_moments[k]) * (kappa_bar[k] - old_bar[k])
        viscous_work += 0.5 * STEP * (viscous + old_viscous)
        bending_time += 0.5 * STEP * (energies[1] + old_bending)
    return q[::2].mean() - first, y_max, actuation_work, viscous_work, bending_time / (STEPS * STEP)


def sweep():
    """All cases, in the order of the sweep's file."""
    axes = itertools.product((0.7, 1.0), (0.90, 1.0), (0.8, 1.2), (1.0, 1.5, 2.0), (0.95, 1.0), (1e-3, 1.0), (0.8, 1.0))
    return [
        case(70e9 * e, 2700.0 * rho, kappa, f, 0.013 * radius, 0.011 * radius, fluid * viscosity)
        for e, rho, kappa, f, radius, fluid, viscosity in axes
    ]


def main():
    case(70e9, 2700.0, 0.6, 1.0, 0.013, 0.011, 1e-3)  # compiles
    start = time.perf_counter()
    found = sweep()
    print(f"{len(found)} cases in {time.perf_counter() - start:.2f} s on one core, compilation not counted")
    if len(sys.argv) > 1:
        with open(sys.argv[1], newline="") as table:
            rows = list(csv.DictReader(table))
        assert len(rows) == len(found)
        names = ["net_displacement_m", "max_lateral_excursion_m", "actuation_work_j", "viscous_work_j", "mean_bending_energy_j"]
        for i, name in enumerate(names):
            worst = max(abs(float(row[name]) / case[i] - 1.0) for row, case in zip(rows, found))
            print(f"{name}: largest relative difference from caudal {worst:.1e}")
            assert worst < 1e-6, name


if __name__ == "__main__":
    main()
