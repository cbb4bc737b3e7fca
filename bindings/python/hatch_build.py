"""Builds what is compiled of the wheel, in one go, so that the core is compiled once: the extension module, the shared library
that goes into FMUs, and the command `caudal`."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

HERE = Path(__file__).parent
#: Where cargo works: in the repository here, in a source distribution in the core that it brings.
CORE = HERE / "core/bindings/python" if (HERE / "core").exists() else HERE
#: Symbols of Python are resolved where the module is loaded.
MACOS = 'target."cfg(target_os=\\"macos\\")".rustflags=["-C", "link-arg=-undefined", "-C", "link-arg=dynamic_lookup"]'
EXTENSION = "_caudal.pyd" if sys.platform == "win32" else "_caudal.abi3.so"


def compiled():
    """What cargo makes, by the names of its targets."""
    profile = os.environ.get("CAUDAL_PROFILE", "release")
    packages = [f"--package={name}" for name in ("caudal", "caudal-fmi", "caudal-python")]
    command = ["cargo", "build", "--locked", f"--profile={profile}", "--lib", "--bins", "--message-format=json", "--config", MACOS]
    # The stable interface needs no interpreter, whose path would make every build a new one.
    environment = {**os.environ, "PYO3_NO_PYTHON": "1"}
    built = subprocess.run([*command, *packages], cwd=CORE, env=environment, check=True, stdout=subprocess.PIPE, text=True)
    files = {}
    for message in map(json.loads, built.stdout.splitlines()):
        if message["reason"] == "compiler-artifact":
            names = [message["executable"]] if message["executable"] else message["filenames"]
            files.setdefault(message["target"]["name"], []).extend(map(Path, names))
    return files


class CustomBuildHook(BuildHookInterface):
    def initialize(self, version, build_data):
        files = compiled()
        shared = {name: next(path for path in files[name] if path.suffix in (".so", ".dylib", ".dll")) for name in ("_caudal", "caudal_fmi")}
        command = next(path for path in files["caudal"] if path.suffix in ("", ".exe"))
        laid = {shared["_caudal"]: EXTENSION, shared["caudal_fmi"]: shared["caudal_fmi"].name}
        for path, name in laid.items():
            if version == "editable":  # the package stays where it is
                shutil.copy(path, HERE / "python/caudal" / name)
            else:
                build_data["force_include"][str(path)] = f"caudal/{name}"
        build_data["shared_scripts"][str(command)] = command.name
        build_data["pure_python"] = False
        platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["tag"] = f"cp39-abi3-{platform}"
