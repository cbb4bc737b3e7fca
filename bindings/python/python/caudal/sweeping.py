"""Parameter sweeps of a scene, on all cores or on the workers of an engine."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, Optional, Union

import numpy as np

from ._caudal import Scene, _rebuild, _Sweep, _toml, _units
from .arguments import check_count, check_folder, check_function, mapping_of
from .distributing import Distribution, Engine, lost_error
from .errors import Error
from .fields import Fields, unknown
from .optional import optional
from .result import Source, load
from .showing import table as html_table

if TYPE_CHECKING:
    import matplotlib.figure
    import pandas
    import xarray


class Sweep(list[dict[str, Any]]):
    """The rows of a sweep, one dictionary per case.

    Attributes
    ----------
    folder : pathlib.Path
        Where its files are.
    axes : dict of str to list
        What the column of each axis shows at each level.
    sampled : set of str
        The axes that go together through the points of a sample.
    cases : int
        The number of its cases, with ``rows=False`` too.
    failed : int
        The number of those that did not reach their end.
    """

    def __init__(
        self, rows: list[dict[str, Any]], folder: Path, axes: list[tuple[str, list[Any], bool]], cases: int, failed: int
    ) -> None:
        super().__init__(map(Fields, rows))
        self.cases, self.failed = cases, failed
        self.folder = folder
        self.axes = {name: labels for name, labels, _ in axes}
        self.sampled = {name for name, _, sampled in axes if sampled}

    @property
    def complete(self) -> bool:
        """True if every case reached its end."""
        return self.failed == 0

    def _check_rows(self) -> None:
        """Refuse to work without rows."""
        if self.cases and not self:
            raise ValueError(f"this sweep was read without its rows (rows=False): {self.folder / 'table.csv'} has them, and table.parquet")

    def __repr__(self) -> str:
        axes = ", ".join(f"{name} ({len(levels)})" for name, levels in self.axes.items())
        return f"<caudal.Sweep of {self.cases} cases over {axes}; {self.failed} failed>"

    def __reduce__(self) -> tuple[Any, ...]:
        axes = [(name, axis, name in self.sampled) for name, axis in self.axes.items()]
        return Sweep, (list(self), self.folder, axes, self.cases, self.failed)

    def to_pandas(self) -> pandas.DataFrame:
        """The table as a data frame.

        Returns
        -------
        pandas.DataFrame
            One row per case, whose number is the index.
        """
        self._check_rows()
        pd = optional("pandas", "to_pandas()")
        frame: pandas.DataFrame = pd.DataFrame(list(self)).set_index("case")
        return frame

    def to_xarray(self) -> xarray.Dataset:
        """The numbers of the table over the axes.

        Returns
        -------
        xarray.Dataset
            A dimension for each axis, and one, ``sample``, for those that go through a sample together; levels that are lists, as
            pairs and profiles, are text. Cases that are not there, did not reach their end or have no such number are NaN, but for
            ``complete`` and ``end_time_s``. Variables of the table of variables have ``units`` and ``long_name``.
        """
        self._check_rows()
        xr = optional("xarray", "to_xarray()")
        dimensions: dict[str, int] = {}
        coordinates: dict[str, Any] = {}
        for name, levels in self.axes.items():
            dimension = "sample" if name in self.sampled else name
            dimensions.setdefault(dimension, len(levels))
            coordinates[name] = (dimension, [_level(level) for level in levels])
        shape = tuple(dimensions.values())
        known = _units()
        variables: dict[str, Any] = {}
        names = {name: None for row in self for name, value in row.items() if isinstance(value, (int, float))}
        for name in names:
            if name == "case" or name in self.axes:
                continue
            values = np.full(int(np.prod(shape)), np.nan)
            for row in self:
                value = _number(row, name)
                values[row["case"]] = np.nan if not isinstance(value, (int, float)) else value
            unit, meaning = known.get(name, (None, None))
            attributes = {} if unit is None else {"units": unit, "long_name": meaning}
            variables[name] = (tuple(dimensions), values.reshape(shape), attributes)
        dataset: xarray.Dataset = xr.Dataset(variables, coordinates, {"title": self.folder.name})
        return dataset

    def plot(self, name: str) -> matplotlib.figure.Figure:
        """Draw a quantity over two axes as a heat map, with a cross for cases that failed; else over the last axis, one line per
        level of the others; over one of a sample its points.

        Parameters
        ----------
        name : str
            A column of the table.

        Returns
        -------
        matplotlib.figure.Figure
            The figure.
        """
        self._check_rows()
        optional("matplotlib", "plot()")
        from matplotlib.figure import Figure

        if not any(name in row for row in self):
            raise unknown(name, sorted({key for row in self for key in row}), "is no column")
        if not any(isinstance(row.get(name), (bool, int, float)) for row in self):
            raise ValueError(f"`{name}` has no numbers; allowed: a column of numbers")
        varied = [axis for axis, levels in self.axes.items() if len(levels) > 1]
        if len(varied) == 2 and not self.sampled.intersection(varied):
            return self._heat_map(name, varied[1], varied[0])
        *others, last = self.axes
        if last in self.sampled:
            others = [other for other in others if other not in self.sampled]
        style = "o" if last in self.sampled else "o-"
        lines: dict[tuple[Any, ...], list[tuple[Any, Any]]] = {}
        for row in self:
            levels = tuple(_level(row[other]) for other in others)
            lines.setdefault(levels, []).append((_level(row[last]), _number(row, name)))
        figure = Figure(figsize=(7, 4), layout="constrained")
        axes = figure.subplots()
        for levels, points in lines.items():
            text = ", ".join(f"{other} = {level}" for other, level in zip(others, levels))
            axes.plot([x for x, _ in points], [np.nan if y is None else y for _, y in points], style, label=text or None)
        axes.set(xlabel=last, ylabel=name)
        axes.grid(alpha=0.3)
        if others and len(lines) <= 12:
            axes.legend(fontsize="small")
        return figure

    def _heat_map(self, name: str, across: str, up: str) -> matplotlib.figure.Figure:
        """A quantity over two axes, with the largest and the least marked."""
        from matplotlib.figure import Figure

        # Levels as they are listed: the colours say what they hold, whatever their spacing.
        places = {axis: {str(level): place for place, level in enumerate(self.axes[axis])} for axis in (across, up)}
        values = np.full((len(places[up]), len(places[across])), np.nan)
        failed = []
        for row in self:
            number = _number(row, name)
            cell = places[up][str(row[up])], places[across][str(row[across])]
            values[cell] = np.nan if number is None else number
            if not row["complete"]:
                failed.append(cell)
        figure = Figure(figsize=(7, 5), layout="constrained")
        axes = figure.subplots()
        known = values[np.isfinite(values)]
        colours: dict[str, Any] = {"cmap": "viridis"}
        if known.size and known.min() < 0 < known.max():
            most = np.abs(known).max()
            colours = {"cmap": "RdBu_r", "vmin": -most, "vmax": most}
        image = axes.imshow(values, origin="lower", aspect="auto", **colours)
        figure.colorbar(image, label=name)
        for axis, set_ticks in ((across, axes.set_xticks), (up, axes.set_yticks)):
            every = -(-len(self.axes[axis]) // 12)
            set_ticks(range(0, len(self.axes[axis]), every), [str(_level(level)) for level in self.axes[axis][::every]])
        if failed:
            axes.plot([x for _, x in failed], [y for y, _ in failed], "x", color="0.5", label="failed", linestyle="none")
        if known.size:
            for label, marker, place in (("largest", "o", np.nanargmax(values)), ("least", "s", np.nanargmin(values))):
                y, x = np.unravel_index(place, values.shape)
                axes.plot(x, y, marker, color="k", markeredgecolor="w", label=f"{label}: {values[y, x]:.4g}", linestyle="none")
        if known.size or failed:
            figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", fontsize="small", ncols=3)
        axes.set(xlabel=across, ylabel=up)
        return figure

    def _repr_html_(self) -> str:
        columns = ["case", *self.axes, "ending", "x_com_m", "y_com_m", "net_displacement_m"]
        rows = [[row.get(column) for column in columns] for row in self[:20]]
        more = "" if len(self) <= 20 else f"<p>and {len(self) - 20} more: {self.folder}/report.html</p>"
        return html_table(columns, rows) + more


def sweep(
    path: Union[Source, str, os.PathLike[str]],
    axes: Optional[Mapping[str, Any]] = None,
    *,
    samples: Optional[Mapping[str, int]] = None,
    set: Optional[Mapping[str, Any]] = None,
    out: Optional[Union[str, os.PathLike[str]]] = None,
    jobs: Optional[int] = None,
    restart: bool = False,
    force: bool = False,
    client: Any = None,
    executor: Optional[Executor] = None,
    workers: Optional[int] = None,
    patience_s: float = 60.0,
    progress: Union[Callable[[int, int], Any], bool, None] = None,
    rows: bool = True,
) -> Sweep:
    """Run the cases of a sweep, and write the files of ``caudal sweep``: table, figures, report, and a journal.

    Cases that are stored in the folder are not run again: after Ctrl-C, or if part of a cluster fails, the same call resumes,
    with the same engine, another one or none, as does ``caudal sweep``. The results are bit-identical.

    Parameters
    ----------
    path : str, os.PathLike, Scene or dict
        The sweep, a TOML file with a base scene and axes; or, with `axes`, the base scene.
    axes : dict, optional
        Levels by key of the scene, as in ``[axes]`` of a file: lists, NumPy arrays, or tables such as
        ``{"from": 9, "to": 33, "count": 4}`` and ``{"between": [1.5, 6.0]}``. The last one changes fastest.
    samples : dict, optional
        ``{"count": 100, "seed": 1}`` for a Latin hypercube over the axes with bounds.
    set : dict, optional
        Overrides of the base scene by dotted key.
    out : str or os.PathLike, optional
        Folder for the results; by default ``out/`` and the name of the sweep.
    jobs : int, optional
        Threads of this process, if no engine is given; by default one per core.
    restart : bool, optional
        Discard the earlier results of this sweep in the folder.
    force : bool, optional
        Replace other results in the folder; otherwise an error.
    client : distributed.Client, optional
        Runs the cases on the workers of a Dask cluster, which need this version of caudal, but no shared disk.
    executor : concurrent.futures.Executor, optional
        Runs the cases with any other executor, such as a ``ProcessPoolExecutor`` or those of mpi4py and executorlib.
    workers : int, optional
        Number of tasks that the engine runs at once, if it does not report it.
    patience_s : float, optional
        A warning is raised if the engine returns no results for longer than this.
    progress : callable or bool, optional
        Called with the number of finished cases and of all cases, some twenty times a second and at the end; or True for a
        bar in a notebook or terminal (needs tqdm).
    rows : bool, optional
        False returns no rows: memory then does not grow with the number of cases (20 kB each), and ``table.csv`` and
        ``table.parquet`` in the folder have them.

    Returns
    -------
    Sweep
        A list with one dictionary per case: ``case``, the level of every axis, and the quantities of its summary; for a case that failed,
        ``ending`` gives the reason. It has ``to_pandas()``, ``to_xarray()`` and ``plot(name)``.

    Raises
    ------
    caudal.errors.SceneError, caudal.errors.ReadError
        For a sweep, or any of its scenes, that is not allowed.
    caudal.errors.JournalError
        If the folder holds results of another sweep.
    caudal.errors.EngineError
        If the engine fails: its scheduler is gone, or a worker has another version.
    caudal.errors.LostCasesError
        For cases that crash their worker; the table has all others.
    caudal.errors.WriteError
        If a file cannot be written; the rows are its ``result``.

    Examples
    --------
    >>> import caudal, tempfile
    >>> scene = caudal.load("models/glycerol.toml", set={"solver.duration_s": 0.1})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     rows = caudal.sweep(scene, {"actuation.kappa_amp": [0.3, 0.6], "rod.nodes": [9, 17]}, out=folder)
    >>> rows
    <caudal.Sweep of 4 cases over actuation.kappa_amp (2), rod.nodes (2); 0 failed>
    """
    check_folder("out", out)
    sources: dict[Path, bytes] = {}
    if axes is not None or isinstance(path, (Scene, Mapping)):
        path, out, sources = _as_files(path, mapping_of(axes, "axes"), samples, set, out)
        set = None
    elif samples is not None:
        raise TypeError("samples are for axes that are given here; a sweep file has its own")
    engine = Engine.asked(client, executor, workers, patience_s)
    check_count("jobs", jobs)
    at_work = _Sweep(path, None if set is None else mapping_of(set, "set"), out, jobs, restart, force, sources)
    lost: list[int] = []
    try:
        with _progress_callback(progress) as told:
            if engine is None:
                at_work.run(told)
            else:
                lost = Distribution(at_work, engine, told).run()
        table, (cases, failed), unwritten = at_work.finish(rows)
    finally:
        at_work.close()
    if lost:
        error = lost_error(at_work, lost)
        error.rows = table
        raise error from unwritten
    found = Sweep(table, at_work.folder, at_work.axes, cases, failed)
    if unwritten is not None:
        unwritten.result = found  # type: ignore[attr-defined]
        raise unwritten
    return found


def _as_files(
    source: Source,
    axes: dict[str, Any],
    samples: Optional[Mapping[str, int]],
    set: Optional[Mapping[str, Any]],
    out: Optional[Union[str, os.PathLike[str]]],
) -> tuple[Path, Path, dict[Path, bytes]]:
    """A sweep of Python objects as a file, the folder it comes into, and it and its scene there, paths and contents: `caudal
    sweep` takes them too."""
    scene = load(source, set)
    out = Path(out) if out is not None else Path("out") / f"{scene.name}-sweep"
    folder = out.resolve()
    sources: dict[Path, bytes] = {}
    base, overrides = Path(scene.file), scene.overrides
    # An axis replaces what the source overrides; `set` of an axis stays, and is refused.
    replaced = axes.keys() - (set or {}).keys()
    overrides = [override for override, key in zip(overrides, _overridden_keys(scene)) if key not in replaced]
    # A table that was overridden with the key of an axis in it, or the other way, is no line of its own.
    inherited = _overridden_keys(scene)[: len(scene.overrides) - len(set or {})]
    parts = any(_is_within(axis, key) or _is_within(key, axis) for axis in replaced for key in inherited)
    if parts or not (_is_unchanged(scene) and _is_order_independent(scene)):
        base, overrides = folder / "scene.toml", []
        sources.update((folder / name, content) for name, content in scene._standalone(base.name))
    lines = [f"name = {_toml(f'{scene.name}-sweep')}", f"scene = {_toml(str(base.resolve()))}", "[set]", *overrides]
    lines += ["[axes]", *(f"{key} = {_toml(levels)}" for key, levels in axes.items())]
    if samples is not None:
        lines += ["[samples]", *(f"{key} = {_toml(value)}" for key, value in samples.items())]
    path = folder / "sweep.toml"
    sources[path] = ("\n".join(lines) + "\n").encode()
    return path, out, sources


def _is_within(key: str, table: str) -> bool:
    return key.startswith(f"{table}.")


def _overridden_keys(scene: Scene) -> list[str]:
    return [override.split("=", 1)[0].strip() for override in scene.overrides]


def _is_unchanged(scene: Scene) -> bool:
    """True if the files of a scene have not changed since they were read."""
    files = [(Path(scene.file), scene.text.encode()), *scene._tables()]
    return all(path.is_file() and path.read_bytes() == content for path, content in files)


def _is_order_independent(scene: Scene) -> bool:
    """True if the overrides of a scene do not depend on their order, so that a table can contain them."""
    keys = _overridden_keys(scene)
    if len({*keys}) != len(keys):
        return False
    try:
        other = _rebuild(Path(scene.file), scene.text, sorted(scene.overrides), dict(scene._tables()))
    except Error:
        return False
    return other._standalone("") == scene._standalone("")


def _number(row: dict[str, Any], name: str) -> Any:
    """What a case has in a column; None if the case did not reach its end, as means of a part of a run are no means of it."""
    return row.get(name) if row["complete"] or name in ("complete", "end_time_s") else None


def _level(level: Any) -> Any:
    """A level of an axis as a number or a text."""
    return level if isinstance(level, (bool, int, float, str)) else str(level)


@contextmanager
def _progress_callback(progress: Union[Callable[[int, int], Any], bool, None]) -> Iterator[Optional[Callable[[int, int], Any]]]:
    """The callback for progress: the given one, or that of a progress bar, which is closed at the end."""
    if not isinstance(progress, bool):
        check_function("progress", progress)
        yield progress
        return
    if not progress:
        yield None
        return
    optional("tqdm", "progress=True")
    from tqdm.auto import tqdm

    with tqdm(unit="case") as bar:

        def tell(done: int, of: int) -> None:
            bar.total = of
            bar.update(done - bar.n)

        yield tell
