"""The vehicle of ../vehicle as an FMU by itself, written with PythonFMU: a rigid body in the plane that one tail pushes, or two.

It has three joints, at the stern and to port and starboard of it. Each has inputs for the tail's force and moment, and outputs
for its pose and rates, as displacements from where it began; so every tail begins at its own origin.

    pythonfmu build -f body.py ../vehicle/vehicle.py
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import numpy as np
from pythonfmu import Fmi2Causality, Fmi2Slave, Real
from vehicle import STEP, Vehicle

#: The joints, and how far they are to port of the stern, m.
JOINTS = {"stern": 0.0, "port": 0.03, "starboard": -0.03}
FORCES = ["force_x_n", "force_y_n", "moment_n_m"]
POSE = ["x_m", "y_m", "angle_rad", "vx_m_s", "vy_m_s", "spin_rad_s"]


class Body(Fmi2Slave):
    """The body of the vehicle's example."""

    author = "caudal"
    description = "A rigid body in the plane with linear drag, pushed by tails"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.vehicle = Vehicle()
        for joint in JOINTS:
            for name in FORCES:
                setattr(self, f"{joint}_{name}", 0.0)
                self.register_variable(Real(f"{joint}_{name}", causality=Fmi2Causality.input, start=0.0))
            for name in POSE:
                self.register_variable(Real(f"{joint}_{name}", causality=Fmi2Causality.output))
        for name in POSE:
            self.register_variable(Real(name, causality=Fmi2Causality.output))
        self.tell()

    def tell(self):
        """Sets the outputs."""
        for name, value in zip(POSE, self.vehicle.y):
            setattr(self, name, float(value))
        stern = self.vehicle.joint(np.zeros(3), 1)
        cos, sin, spin = np.cos(stern[2]), np.sin(stern[2]), stern[5]
        for joint, off in JOINTS.items():
            away = [-off * sin, off * (cos - 1.0), 0.0, -off * spin * cos, -off * spin * sin, 0.0]
            for name, value in zip(POSE, stern + away):
                setattr(self, f"{joint}_{name}", float(value))

    def do_step(self, current_time, step_size):
        """Moves on under the forces that are given, held."""
        cos, sin = np.cos(self.vehicle.y[2]), np.sin(self.vehicle.y[2])
        reaction = np.zeros(3)
        for joint, off in JOINTS.items():
            fx, fy, moment = (getattr(self, f"{joint}_{name}") for name in FORCES)
            reaction += [fx, fy, moment - off * (sin * fy + cos * fx)]
        self.vehicle.advance(reaction, reaction, round(step_size / STEP))
        self.tell()
        return True
