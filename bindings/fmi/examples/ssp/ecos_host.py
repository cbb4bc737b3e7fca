"""The co-simulation host ecos, with what it needs: the library libtbb.so.12, which `pip install tbb` brings without root rights, and
the program unzip, by which it unpacks FMUs.

Raises ImportError where one of them is missing.
"""

import ctypes
import shutil
import sys
from pathlib import Path

if shutil.which("unzip") is None:
    raise ImportError("ecos unpacks FMUs with the program unzip: install it (Debian: apt-get install unzip)")
library = Path(sys.prefix, "lib/libtbb.so.12")
try:
    if library.exists():
        # pip puts it where the loader does not look; a library that is loaded already is taken.
        ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    from ecospy import EcosSimulation, EcosSimulationStructure
except OSError as error:
    raise ImportError(f"{error}: pip install tbb, or Debian: apt-get install libtbb12") from error

__all__ = ["EcosSimulation", "EcosSimulationStructure"]
