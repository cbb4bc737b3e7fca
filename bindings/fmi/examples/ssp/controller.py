"""A PID controller as an FMU, written with PythonFMU: it turns a hinged head to an angle and holds it there.

    pythonfmu build -f controller.py
"""

from pythonfmu import Fmi2Causality, Fmi2Slave, Real

#: The angle, rad.
TARGET = 0.3
#: Gains of the error (N m), its integral (N m/s) and the angular velocity (N m s).
P, I, D = 0.2, 0.5, 0.005


class Pid:
    """The controller by itself."""

    def __init__(self):
        self.summed = 0.0

    def torque(self, angle: float, spin: float, step: float) -> float:
        """The torque (N m) for the next step."""
        error = TARGET - angle
        self.summed += step * error
        return P * error + I * self.summed - D * spin


class Controller(Fmi2Slave):
    """The same as an FMU."""

    author = "caudal"
    description = "A PID controller of the angle of a head"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.pid = Pid()
        self.angle_rad = self.spin_rad_s = self.torque_n_m = 0.0
        for name in ("angle_rad", "spin_rad_s"):
            self.register_variable(Real(name, causality=Fmi2Causality.input, start=0.0))
        self.register_variable(Real("torque_n_m", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        """Reads the angle at the start of the step."""
        self.torque_n_m = self.pid.torque(self.angle_rad, self.spin_rad_s, step_size)
        return True
