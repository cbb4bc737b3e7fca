"""Inverse design of stiffness."""

from __future__ import annotations

import os
from typing import Any, Callable, Optional, Union

from ._caudal import Scene, _design
from .result import Source, load


def design(
    scene: Source,
    *,
    out: Optional[Union[str, os.PathLike[str]]] = None,
    progress: Optional[Callable[[int, float], Any]] = None,
) -> dict[str, Any]:
    """Design what the scene's ``[design]`` asks for, and leave the files of ``caudal design``.

    Parameters
    ----------
    scene : Scene, str, os.PathLike or dict
        The scene, or what `load` makes one from. Data that it names are sought beside its file.
    out : str or os.PathLike, optional
        Folder for the results; by default ``out/<name of the scene>``.
    progress : callable, optional
        Called with the number of an iteration and the objective there (of a tracked tip the rms distance in m, else the
        distance in m or the efficiency in m²/J). What it raises, and Ctrl-C, end the search; the best design so far is
        then the exception's ``result``.

    Returns
    -------
    dict
        The content of design.json, and ``folder``: among others ``status``, ``stiffness_n_m2`` at ``xi`` (joints, from the
        head at 0 to the tip at 1), ``answer`` and ``lines``, the answer in words. The scene with the designed stiffness is
        ``<name>-designed.toml`` in the folder.

    Raises
    ------
    caudal.errors.DesignError
        Where no design does what is asked, with the reason.
    caudal.errors.SceneError
        For a wrong ``[design]``.
    """
    scene = scene if isinstance(scene, Scene) else load(scene)
    found, failure = _design(scene, out, progress)
    if failure is not None:
        failure.result = found  # type: ignore[attr-defined]
        raise failure
    return found
