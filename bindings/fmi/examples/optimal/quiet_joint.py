"""CasADi and the exact directional derivatives of an FMU: a tail whose reaction leaves a payload in peace.

The tail of ../vehicle beats behind a joint that is held. At every step the controller solves a small optimal-control problem
over the step to come: natural curvatures at the two joints nearest the head, within bounds, that make the moment of the
reaction least, the lateral force with less weight, and themselves no larger than they need be. The reaction is a function of the curvatures that the FMU computes at
once: for CasADi it is a Callback, with the Jacobian that `fmi3GetDirectionalDerivative` gives, exact to rounding, and
Ipopt finds the optimum in a few iterations.

    caudal fmu ../vehicle/tail.toml -o tail.fmu
    python quiet_joint.py tail.fmu               # needs casadi and FMPy
"""

from __future__ import annotations

import sys
from pathlib import Path

import casadi
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "vehicle"))
from vehicle import Tail  # noqa: E402

STEP = 2e-3  # s
JOINTS = 2  # the first ones: of the others the reaction does not know at once
LARGEST = 60.0  # natural curvature that the controller may add, 1/m
OUTPUTS = ["head_force_y_n", "head_moment_n_m"]
SCALE = np.array([0.5, 0.005])  # N, N m: the moment counts most
EFFORT = 1e-4  # of a curvature of LARGEST, against reactions of SCALE


class Reaction(casadi.Callback):
    """The outputs as a function of the curvatures, now."""

    def __init__(self, tail: Tail) -> None:
        super().__init__()
        self.tail = tail
        self.knowns = [tail.references["natural_curvature_1_m"]]
        self.unknowns = [tail.references[name] for name in OUTPUTS]
        self.construct("reaction", {})

    def get_n_in(self):
        return 1

    def get_n_out(self):
        return 1

    def get_sparsity_in(self, i):
        return casadi.Sparsity.dense(JOINTS)

    def get_sparsity_out(self, i):
        return casadi.Sparsity.dense(len(OUTPUTS))

    def give(self, curvatures) -> None:
        """Sets the curvatures of the first joints."""
        self.tail.fmu.setFloat64(self.knowns, self.along(np.ravel(curvatures)))

    def along(self, values) -> list[float]:
        """One value for each node; a head that is held is a joint."""
        return [*values, *np.zeros(self.tail.count - JOINTS)]

    def eval(self, arguments):
        self.give(arguments[0].full())
        return [casadi.DM(self.tail.get(OUTPUTS))]

    def slopes(self) -> np.ndarray:
        """The exact derivatives of the outputs by the curvatures: one direction for each."""
        columns = []
        for k in range(JOINTS):
            seed = self.along(np.eye(JOINTS)[k])
            columns.append(self.tail.fmu.getDirectionalDerivative(self.unknowns, self.knowns, seed, len(OUTPUTS)))
        return np.transpose(columns)

    def has_jacobian(self):
        return True

    def get_jacobian(self, name, names_in, names_out, options):
        return Slopes(self, name)


class Slopes(casadi.Callback):
    """Their Jacobian."""

    def __init__(self, reaction: Reaction, name: str) -> None:
        super().__init__()
        self.reaction = reaction
        reaction.jacobian = self  # CasADi keeps no reference
        self.construct(name, {})

    def get_n_in(self):
        return 2

    def get_n_out(self):
        return 1

    def get_sparsity_in(self, i):
        return casadi.Sparsity.dense(JOINTS if i == 0 else len(OUTPUTS))

    def get_sparsity_out(self, i):
        return casadi.Sparsity.dense(len(OUTPUTS), JOINTS)

    def eval(self, arguments):
        self.reaction.give(arguments[0].full())
        return [casadi.DM(self.reaction.slopes())]


def simulate(fmu: str, duration: float, control: bool):
    """Reactions by steps (N, N m), the curvatures that were added (1/m), and Ipopt's mean number of iterations."""
    tail = Tail(fmu)
    reaction = Reaction(tail)
    curvatures = casadi.MX.sym("curvatures", JOINTS)
    cost = casadi.sumsqr(reaction(curvatures) / SCALE) + EFFORT * casadi.sumsqr(curvatures / LARGEST)
    quiet = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "hessian_approximation": "limited-memory"}}
    solve = casadi.nlpsol("solve", "ipopt", {"x": curvatures, "f": cost}, quiet)
    best, rows, added, iterations = np.zeros(JOINTS), [], [], 0
    for _ in range(round(duration / STEP)):
        if control:
            best = np.ravel(solve(x0=best, lbx=-LARGEST, ubx=LARGEST)["x"].full())
            iterations += solve.stats()["iter_count"]
            reaction.give(best)
        tail.fmu.doStep(currentCommunicationPoint=tail.time, communicationStepSize=STEP)
        tail.time += STEP
        rows.append(tail.get(OUTPUTS))
        added.append(best)
    tail.close()
    return np.array(rows), np.array(added), iterations / len(rows)


def main(fmu: str) -> None:
    """Compares both."""
    for control in (False, True):
        rows, added, iterations = simulate(fmu, 2.0, control)
        force, moment = np.sqrt((rows[len(rows) // 2 :] ** 2).mean(axis=0))
        print(
            f"{'quiet' if control else 'as it is'}: {force:.1e} N and {moment:.1e} N m rms over the last second; "
            f"up to {np.abs(added).max():.0f} 1/m added, {iterations:.1f} iterations a step"
        )


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(f"usage: {sys.argv[0]} tail.fmu")
    main(sys.argv[1])
