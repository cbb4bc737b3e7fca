"""The controller brings an eel onto its course and keeps it there in a cross-flow."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import keep_course  # noqa: E402


@pytest.mark.parametrize("degrees", [-40.0, 0.0, 40.0])
def test_the_course_made_good_is_the_one_asked_for_and_a_cross_flow_does_not_change_it(degrees):
    courses, _ = keep_course.swim(np.radians(degrees), 120)
    off = np.degrees(courses) - degrees
    print(f"{degrees}: off by {np.abs(off[-20:]).max():.3f} degrees")
    # Measured over the last ten seconds: at most 0.007 degrees.
    assert np.abs(off[-20:]).max() < 0.05


def test_without_the_controller_the_cross_flow_carries_the_eel_off():
    courses, _ = keep_course.swim(0.0, 40, control=False)
    assert np.degrees(courses[15] - courses[30]) > 4.0  # measured: 5.6
