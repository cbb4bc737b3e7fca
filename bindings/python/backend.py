"""Builds the wheel: the shared library that goes into FMUs, laid into the package, then all else by maturin."""

import json
import shutil
import subprocess
from pathlib import Path

import maturin
from maturin import *  # noqa: F403  the other functions of PEP 517

HERE = Path(__file__).parent


def lay_library():
    manifest = HERE.parent / "fmi/Cargo.toml"
    command = ["cargo", "rustc", "--release", "--lib", "--manifest-path", manifest, "--message-format=json"]
    built = subprocess.run([*command, "--", "-C", "strip=symbols"], check=True, stdout=subprocess.PIPE, text=True)
    for message in map(json.loads, built.stdout.splitlines()):
        if message["reason"] == "compiler-artifact" and message["target"]["name"] == "caudal_fmi":
            library = next(Path(name) for name in message["filenames"] if Path(name).suffix in (".so", ".dylib", ".dll"))
            shutil.copy(library, HERE / "python/caudal")


def build_wheel(*arguments, **named):
    lay_library()
    return maturin.build_wheel(*arguments, **named)


def build_editable(*arguments, **named):
    lay_library()
    return maturin.build_editable(*arguments, **named)
