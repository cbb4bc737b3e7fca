"""Studies of a scene: accuracy, fluid, modes, stability and others."""

from __future__ import annotations

import html
import os
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any, Callable, Literal, Optional, Union

from ._caudal import Scene, _runs_of, _study
from .arguments import check_folder, check_function
from .distributing import Engine
from .fields import Fields
from .optional import optional
from .result import Source, load

if TYPE_CHECKING:
    import pandas


def study(
    kind: Literal["accuracy", "fluid", "modes", "scaling", "stability"],
    scene: Source,
    *,
    out: Optional[Union[str, os.PathLike[str]]] = None,
    force: bool = False,
    progress: Optional[Callable[[int, int], Any]] = None,
    client: Any = None,
    executor: Optional[Executor] = None,
    workers: Optional[int] = None,
    patience_s: float = 60.0,
    **asked: Any,
) -> Findings:
    """Study a scene, and write the files of ``caudal study``: tables, figures, report, summary.

    After Ctrl-C the same call resumes with the runs that are stored in its folder.

    Parameters
    ----------
    kind : {"accuracy", "fluid", "modes", "scaling", "stability"}
        Error against cost of every method, step and mesh; the same motion under every valid fluid law; natural
        frequencies and mode shapes; time, memory and error of meshes from coarse to fine; the outcome of every method at every
        step, over a parameter.
    scene : Scene, str, os.PathLike or dict
        The scene, or anything that `load` accepts.
    out : str or os.PathLike, optional
        Folder for the results; by default ``out/<name of the scene>-study-<kind>``.
    force : bool, optional
        Replace other results in the folder; otherwise an error.
    progress : callable, optional
        Called with the number of finished runs and of all runs, some twenty times a second and at the end.
    client : distributed.Client, optional
        Runs a study of accuracy, fluid or stability on the workers of a Dask cluster. The findings are bit-identical, except
        for the computing times of accuracy, which are those of the workers.
    executor : concurrent.futures.Executor, optional
        The same with any other executor, such as a ``ProcessPoolExecutor``.
    workers : int, optional
        Number of tasks that the engine runs at once, if it does not report it.
    patience_s : float, optional
        A warning is raised if the engine returns no results for longer than this.
    **asked
        The options of ``caudal study <kind>``, for example ``nodes=[17, 33]``, ``steps=[1e-3, 1e-4]``,
        ``vary="amplitude"``, ``range=[0.1, 1.0]``, ``points=12``, ``count=12``.

    Returns
    -------
    Findings
        The findings.

    Raises
    ------
    caudal.errors.StudyError
        For options that are not allowed, and for an engine if the study measures this machine.
    caudal.errors.EngineError, caudal.errors.LostCasesError
        If the engine fails, and for runs that crash their worker.
    caudal.errors.WriteError
        If a file cannot be written; the findings are its ``result``.

    Examples
    --------
    >>> import caudal, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     found = caudal.study("modes", "models/baseline.toml", count=3, out=folder)
    >>> found
    <caudal.Findings on natural modes: 3 tables, 3 figures>
    """
    scene = scene if isinstance(scene, Scene) else load(scene)
    check_function("progress", progress)
    check_folder("out", out)
    if (engine := Engine.asked(client, executor, workers, patience_s)) is not None:
        while (runs := _runs_of(scene, kind, asked, out, force)) is not None:
            engine.do(runs, progress)
    content, failure = _study(scene, kind, asked, out, force, progress)
    found = Findings(content)
    if failure is not None:
        failure.result = found  # type: ignore[attr-defined]
        raise failure
    return found


class Findings:
    """The findings of a study. In a notebook it shows its answers and figures.

    Attributes
    ----------
    folder : pathlib.Path
        Where its files are.
    subject : str
        What was studied.
    answers : list of str
        The answer in words.
    numbers : dict
        The numbers behind it, as in summary.json.
    tables : dict of str to dict of str to list
        Its tables by name: columns by name.
    figures : dict of str to str
        Its figures by file name, SVG.
    """

    def __init__(self, content: dict[str, Any]) -> None:
        self.folder = content["folder"]
        self.subject: str = content["subject"]
        self.answers: list[str] = content["answers"]
        self.numbers = Fields(content["numbers"])
        self.tables: dict[str, dict[str, list[Any]]] = content["tables"]
        self.figures: dict[str, str] = content["figures"]

    def __repr__(self) -> str:
        def count(things: dict[str, Any], name: str) -> str:
            return f"{len(things)} {name}{'' if len(things) == 1 else 's'}"

        return f"<caudal.Findings on {self.subject}: {count(self.tables, 'table')}, {count(self.figures, 'figure')}>"

    def to_pandas(self, table: Optional[str] = None) -> pandas.DataFrame:
        """A table as a data frame.

        Parameters
        ----------
        table : str, optional
            Its name in `tables`; by default the first.

        Returns
        -------
        pandas.DataFrame
            One row per entry.
        """
        pd = optional("pandas", "to_pandas()")
        frame: pandas.DataFrame = pd.DataFrame(self.tables[next(iter(self.tables)) if table is None else table])
        return frame

    def _repr_html_(self) -> str:
        answers = "".join(f"<p>{html.escape(answer)}</p>" for answer in self.answers)
        return answers + "".join(self.figures.values())
