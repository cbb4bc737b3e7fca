"""Optional packages."""

from __future__ import annotations

import importlib
from types import ModuleType

#: What to install, by module: an extra of this package.
EXTRAS = {
    "gymnasium": "gymnasium",
    "h5netcdf": "xarray",
    "jax": "jax",
    "matplotlib": "plot",
    "pandas": "pandas",
    "torch": "torch",
    "tqdm": "progress",
    "xarray": "xarray",
}


def needs(module: str, what: str) -> ImportError:
    """The error for a module that `what` needs and that is not installed, with the command to install it."""
    return ImportError(f'{what} needs {module}: pip install "caudal[{EXTRAS[module]}]"', name=module)


def optional(module: str, what: str) -> ModuleType:
    """A module that `what` needs.

    Raises
    ------
    ImportError
        Where it is not installed, with how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise needs(module.split(".")[0], what) from error
