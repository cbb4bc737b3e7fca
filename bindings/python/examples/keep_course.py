"""A controller that keeps an eel's course: a free swimmer, bent a little to one side while it is off course.

The eel is models/eel.toml. Once per beat of its tail, which moves the head to and fro, the controller reads the course that
the eel made good over that beat, and over the next one adds a natural curvature, the same at every joint, in proportion to
what it is off and to what it has been off so far (PI), within what the eel can bend. A cross-flow sets in on the way and would
carry it off.

    python keep_course.py [course in degrees]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import caudal

SCENE = Path(__file__).parents[3] / "models/eel.toml"
PROPORTIONAL, INTEGRAL, LARGEST = 2.0, 0.5, 3.0  # 1/m per rad, 1/m per rad and beat, 1/m
CURRENT, CURRENT_SINCE = 0.05, 8.0  # m/s across the start's course, s


def swim(course: float, beats: int, control: bool = True, current: float = CURRENT):
    """The course made good over every beat (rad, zero is the start's, counter-clockwise) and the eel's places (m)."""
    scene = caudal.load(SCENE, set={"rod.nodes": 17, "solver.duration_s": 1e3})
    period = 1.0 / 2.0
    with caudal.Stepper(scene) as eel:
        joints = eel.variables["natural_curvature_1_m"].shape[0]
        places, courses, sum_off = [(eel.get("x_com_m"), eel.get("y_com_m"))], [], 0.0
        for beat in range(beats):
            if beat * period == CURRENT_SINCE:
                eel.set("flow_y_m_s", current)
            eel.do_step(period)
            places.append((eel.get("x_com_m"), eel.get("y_com_m")))
            way = np.subtract(places[-1], places[-2])
            courses.append(np.arctan2(-way[1], -way[0]))  # it begins towards -x
            off = np.angle(np.exp(1j * (courses[-1] - course)))
            if control and beat > 1:
                sum_off += off
                bend = np.clip(PROPORTIONAL * off + INTEGRAL * sum_off, -LARGEST, LARGEST)
                eel.set("natural_curvature_1_m", np.full(joints, bend))
    return np.array(courses), np.array(places)


def main(degrees: float = 30.0) -> None:
    """Says how the course settles."""
    for control in (True, False):
        courses, _ = swim(np.radians(degrees), 60, control)
        text = " ".join(f"{value:.0f}" for value in np.degrees(courses[::4]))
        print(f"course {degrees:g} degrees, {'kept' if control else 'not kept'}; made good every 2 s: {text}")


if __name__ == "__main__":
    main(*map(float, sys.argv[1:2]))
