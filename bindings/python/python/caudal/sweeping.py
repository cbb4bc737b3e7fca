"""Sweeps: one scene along axes, on all cores, or wherever an engine has workers."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any, Callable, Optional, Union

from ._caudal import _Sweep
from .distributing import Distribution, Engine
from .errors import LostCasesError


def sweep(
    path: Union[str, os.PathLike[str]],
    *,
    set: Optional[Mapping[str, Any]] = None,
    out: Optional[Union[str, os.PathLike[str]]] = None,
    jobs: Optional[int] = None,
    restart: bool = False,
    client: Any = None,
    executor: Optional[Executor] = None,
    workers: Optional[int] = None,
    patience_s: float = 60.0,
    progress: Union[Callable[[int, int], Any], bool, None] = None,
    rows: bool = True,
) -> list[dict[str, Any]]:
    """Run the cases of a sweep, and leave the files of ``caudal sweep``: table, figures, report, and a journal.

    Cases that the folder has already are not run again: after Ctrl-C, or the end of any part of a cluster, the same call goes
    on, with the same engine, another one or none, as does ``caudal sweep``. The results are the same to the bit.

    Parameters
    ----------
    path : str or os.PathLike
        The sweep, a TOML file with a base scene and axes.
    set : dict, optional
        Overrides of the base scene by dotted key.
    out : str or os.PathLike, optional
        Folder for the results; by default ``out/`` and the name of the sweep.
    jobs : int, optional
        Threads of this process, where no engine is given; by default one a core.
    restart : bool, optional
        Forget what an earlier sweep left in the folder.
    client : distributed.Client, optional
        Runs the cases on the workers of a Dask cluster, which need this version of caudal and no disk in common.
    executor : concurrent.futures.Executor, optional
        Runs the cases on any other engine, such as a ``ProcessPoolExecutor`` or those of mpi4py and executorlib.
    workers : int, optional
        How many tasks the engine runs at once, where it does not say.
    patience_s : float, optional
        A warning says so where an engine returns nothing for longer.
    progress : callable or bool, optional
        Called with the numbers of cases that are done and of all, some twenty times a second and at the end; or True for a
        bar in a notebook or terminal (needs tqdm).
    rows : bool, optional
        False returns no rows: memory then does not grow with the number of cases (20 kB each), and ``table.csv`` and
        ``table.parquet`` in the folder have them.

    Returns
    -------
    list of dict
        One row per case: ``case``, the level of every axis, and the quantities of its summary; of a case that failed,
        ``ending`` says why. ``pandas.DataFrame(rows)`` makes a table of them.

    Raises
    ------
    caudal.errors.SceneError, caudal.errors.ReadError
        For a sweep, or any of its scenes, that is not allowed.
    caudal.errors.JournalError
        Where the folder holds results of another sweep.
    caudal.errors.EngineError
        Where the engine cannot go on: its scheduler is gone, or a worker has another version.
    caudal.errors.LostCasesError
        For cases that end the worker that runs them; the table has all others.
    """
    if client is not None and executor is not None:
        raise TypeError("give either client or executor")
    engine = None if client is None and executor is None else Engine(client, executor, workers)
    at_work = _Sweep(path, None if set is None else dict(set), out, jobs, restart)
    lost: list[int] = []
    try:
        with _told(progress) as told:
            if engine is None:
                at_work.run(told)
            else:
                lost = Distribution(at_work, engine, patience_s, told).run()
        table = at_work.finish(rows)
    finally:
        at_work.close()
    if lost:
        named = "; ".join(f"case {case}: {at_work.describe(case)}" for case in lost[:5])
        more = f" and {len(lost) - 5} more" if len(lost) > 5 else ""
        error = LostCasesError(
            f"{len(lost)} cases ended the worker that ran them, even alone ({named}{more}); "
            f"the results of the other {at_work.size - len(lost)} are in {at_work.folder}"
        )
        error.cases, error.rows = lost, table
        raise error
    return table


@contextmanager
def _told(progress: Union[Callable[[int, int], Any], bool, None]) -> Iterator[Optional[Callable[[int, int], Any]]]:
    """What is to be told of the progress: the callable, or a bar that is closed in the end."""
    if not isinstance(progress, bool):
        yield progress
        return
    if not progress:
        yield None
        return
    from tqdm.auto import tqdm

    with tqdm(unit="case") as bar:

        def tell(done: int, of: int) -> None:
            bar.total = of
            bar.update(done - bar.n)

        yield tell
