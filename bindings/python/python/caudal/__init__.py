"""Simulates bio-inspired tails and swimmers: a slender rod in a fluid, driven by curvature, muscles, tendons or a motor at its head.

`load` reads a scene, `run` runs it, and a `Stepper` lets a host drive it. SI units everywhere; the names of variables end in
their units.

Examples
--------
>>> import caudal
>>> scene = caudal.load("models/driven-head.toml", set={"solver.duration_s": 0.1})
>>> result = caudal.run(scene)
>>> result["time_s"].shape, result["x_m"].shape
((51,), (51, 33))
"""

import importlib
import os
from typing import Any

from . import errors
from ._caudal import Scene, Snapshot, StepDerivative, Stepper, Variable, __version__, _held_descriptors
from .comparing import Comparison, compare
from .designing import Design, design
from .errors import Error
from .gradients import Parameter, Simulation, parameters, simulate, value_and_grad
from .result import Result, export, load, run
from .studying import Findings, study
from .sweeping import Sweep, sweep

__all__ = [
    "Comparison",
    "Design",
    "Error",
    "Findings",
    "Parameter",
    "Result",
    "Scene",
    "Simulation",
    "Snapshot",
    "StepDerivative",
    "Stepper",
    "Sweep",
    "Variable",
    "__version__",
    "compare",
    "design",
    "errors",
    "export",
    "load",
    "parameters",
    "run",
    "simulate",
    "study",
    "sweep",
    "value_and_grad",
]


def _leave_journals() -> None:
    """In a forked process: closes the journals shared with the parent, which would otherwise stay locked."""
    held = _held_descriptors()
    if held:
        nothing = os.open(os.devnull, os.O_RDWR)
        for descriptor in held:
            os.dup2(nothing, descriptor)
        os.close(nothing)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_leave_journals)


def __getattr__(name: str) -> Any:
    """Import `caudal.gymnasium`, `caudal.jax` and `caudal.torch`, which need optional packages, on first use."""
    if name in ("gymnasium", "jax", "torch"):
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
