"""What the tests of the examples share: FMUs, written by the command that CAUDAL_COMMAND names."""

import os
import subprocess

import pytest


@pytest.fixture(scope="session")
def make_fmu(tmp_path_factory):
    """Writes the FMU of a scene, and returns its path."""
    command = os.environ.get("CAUDAL_COMMAND")
    if not command:
        pytest.skip("CAUDAL_COMMAND names no caudal command that writes the FMU")

    def make(scene, *options):
        path = tmp_path_factory.mktemp("fmu") / f"{scene.stem}.fmu"
        subprocess.run([command, "fmu", scene, "-o", path, *options], check=True, stdout=subprocess.DEVNULL)
        return str(path)

    return make
