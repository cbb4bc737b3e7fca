"""Runs side by side: the keys of their scenes and the results that differ."""

from __future__ import annotations

import html
import os
from typing import Any, Optional, Union

import numpy as np

from ._caudal import _compare
from .arguments import check_folder
from .fields import Fields
from .result import Result


def compare(
    *runs: Union[str, os.PathLike[str], Result],
    out: Optional[Union[str, os.PathLike[str]]] = None,
    force: bool = False,
) -> Comparison:
    """Compare runs: the keys in which their scenes differ, and their results with the differences from the first run.

    Parameters
    ----------
    *runs : str, os.PathLike or Result
        Two to eight folders of runs, or results in memory.
    out : str or os.PathLike, optional
        Folder for the files that ``caudal compare`` writes: report.html, results.csv, keys.csv, summary.json, figures.
    force : bool, optional
        Replace other results in the folder; otherwise an error.

    Returns
    -------
    Comparison
        The differences.

    Raises
    ------
    caudal.errors.ReadError
        If an argument is not the folder of a run.
    caudal.errors.ComparisonError
        For fewer than two runs, or more than eight.
    caudal.errors.WriteError
        If a file cannot be written; the comparison is its ``result``.

    Examples
    --------
    >>> import caudal
    >>> short = caudal.load("models/glycerol.toml", set={"solver.duration_s": 0.1})
    >>> stiff = caudal.load(short, set={"rod.youngs_modulus_pa": 1e11, "name": "stiff"})
    >>> compared = caudal.compare(caudal.run(short), caudal.run(stiff))
    >>> compared
    <caudal.Comparison of glycerol, stiff: 1 key differs>
    >>> compared.keys["rod.youngs_modulus_pa"]
    {'glycerol': 70000000000.0, 'stiff': 100000000000.0}
    """
    check_folder("out", out)
    content, failure = _compare([_run(run) for run in runs], out, force)
    comparison = Comparison(content)
    if failure is not None:
        failure.result = comparison  # type: ignore[attr-defined]
        raise failure
    return comparison


def _run(run: Any) -> Any:
    """A folder unchanged, and a result in the form that the core expects."""
    if not isinstance(run, Result):
        if not isinstance(run, (str, os.PathLike)):
            raise TypeError(f"runs: found {run!r}; allowed: the folder of a run, or a Result")
        return os.fspath(run)
    columns = [(name, values.tolist()) for name, values in run.items() if values.ndim == 1]
    columns.sort(key=lambda column: column[0] != "time_s")
    positions = None
    if "x_m" in run and "y_m" in run:
        positions = (run.nodes.tolist(), np.ravel(run["x_m"]).tolist(), np.ravel(run["y_m"]).tolist())
    return run.scene, dict(run.summary), columns, positions


class Comparison:
    """Runs side by side. In a notebook it shows the page of the comparison.

    Attributes
    ----------
    folder : pathlib.Path or None
        Where its files are, if they were written.
    labels : list of str
        The name of each run; differences are relative to the first run.
    keys : dict of str to dict of str to object
        The keys in which the scenes differ: their values by run, None where a scene does not have the key.
    results : dict of str to dict of str to object
        The results in summary.json: their values by run. A pair has two entries, ``.x`` and ``.y``.
    differences : dict of str to dict of str to dict
        For each result and each run except the first, if both have a number: ``difference`` and ``relative_difference`` from the
        first, ``stated_error``, the sum of the errors that the two runs state for it, or None, and ``above_stated_error``.
    answers : list of str
        The differences, in sentences.
    notes : list of str
        Notes on the comparison and its runs.
    figures : dict of str to str
        Its figures by file name, SVG.
    """

    def __init__(self, content: dict[str, Any]) -> None:
        self.folder = content["folder"]
        self.labels: list[str] = content["labels"]
        self.figures: dict[str, str] = content["figures"]
        self._html: str = content["html"]
        summary = content["content"]
        self.answers: list[str] = summary["answers"]
        self.notes: list[str] = summary["notes"]
        self.keys = Fields(summary["keys"])
        self.results = Fields({key: row["values"] for key, row in summary["results"].items()})
        self.differences = Fields(
            {
                key: {run: found for run, found in row["differences"].items() if found is not None}
                for key, row in summary["results"].items()
            }
        )

    def __repr__(self) -> str:
        count = len(self.keys)
        found = "no key differs" if count == 0 else "1 key differs" if count == 1 else f"{count} keys differ"
        return f"<caudal.Comparison of {', '.join(self.labels)}: {found}>"

    def to_html(self) -> str:
        """The page of the comparison, which needs no other file.

        Returns
        -------
        str
            The page, HTML.
        """
        return self._html

    def _repr_html_(self) -> str:
        page = html.escape(self._html)
        return f'<iframe srcdoc="{page}" style="width: 100%; height: 640px; border: 0" title="comparison of runs"></iframe>'
