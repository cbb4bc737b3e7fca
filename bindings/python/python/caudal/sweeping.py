"""Sweeps: one scene along axes, on all cores."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, Callable, Optional, Union

from ._caudal import _sweep


def sweep(
    path: Union[str, os.PathLike[str]],
    *,
    set: Optional[Mapping[str, Any]] = None,
    out: Optional[Union[str, os.PathLike[str]]] = None,
    jobs: Optional[int] = None,
    restart: bool = False,
    progress: Optional[Callable[[int, int], Any]] = None,
) -> list[dict[str, Any]]:
    """Run the cases of a sweep, and leave the files of ``caudal sweep``: table, figures, report, and a journal.

    Cases that the folder has already are not run again: after Ctrl-C the same call goes on.

    Parameters
    ----------
    path : str or os.PathLike
        The sweep, a TOML file with a base scene and axes.
    set : dict, optional
        Overrides of the base scene by dotted key.
    out : str or os.PathLike, optional
        Folder for the results; by default ``out/`` and the name of the sweep.
    jobs : int, optional
        Threads; by default one a core.
    restart : bool, optional
        Forget what an earlier sweep left in the folder.
    progress : callable, optional
        Called with the numbers of cases that are done and of all, some twenty times a second and at the end.

    Returns
    -------
    list of dict
        One row a case: ``case``, the level of every axis, and the quantities of its summary; of a case that failed,
        ``ending`` says why. ``pandas.DataFrame(rows)`` makes a table of them.

    Raises
    ------
    caudal.errors.SceneError, caudal.errors.ReadError
        For a sweep, or any of its scenes, that is not allowed.
    caudal.errors.JournalError
        Where the folder holds results of another sweep.
    """
    return _sweep(path, None if set is None else dict(set), out, jobs, restart, progress)
