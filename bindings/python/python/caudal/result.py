"""Runs and their results."""

from __future__ import annotations

import html
import os
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Callable, Iterable, Iterator, Optional, Union

import numpy as np
import numpy.typing as npt

from ._caudal import Scene, Variable, _film, _pictures, _run, _vtk
from .arguments import check_folder, check_function, mapping_of, names_of
from .fields import Fields, unknown
from .optional import optional

if TYPE_CHECKING:
    import matplotlib.animation
    import matplotlib.figure
    import pandas
    import xarray

#: What a scene is made from: one there is, the path of a TOML file, or the tables themselves.
Source = Union[Scene, str, "os.PathLike[str]", Mapping[str, Any]]
#: Numbers in an array.
Array = npt.NDArray[np.float64]


def load(source: Source, set: Optional[Mapping[str, Any]] = None) -> Scene:
    """Read and check a scene.

    Parameters
    ----------
    source : Scene, str, os.PathLike or dict
        The path of a TOML file, the scene's tables themselves, or another scene to start from.
    set : dict, optional
        Overrides by dotted key, such as ``{"rod.nodes": 17, "loads.gravity_m_s2": [0, -9.81]}``.

    Returns
    -------
    Scene
        The scene.

    Raises
    ------
    caudal.errors.SceneError
        For an unknown key or a value that is not allowed, with the place in the file.
    caudal.errors.ReadError
        For a file that cannot be read.

    Examples
    --------
    >>> import caudal
    >>> scene = caudal.load("models/glycerol.toml", set={"rod.nodes": 17})
    >>> scene.nodes
    17
    >>> caudal.load(scene, set={"rod.nodes": "many"})
    Traceback (most recent call last):
    caudal.errors.SceneError: rod.nodes="many": rod.nodes: found "many"; allowed: a whole number from 3 to 10000000
    """
    return Scene(source, None if set is None else mapping_of(set, "set"))


def run(
    scene: Source,
    *,
    record: Optional[Union[str, Iterable[str]]] = None,
    out: Optional[Union[str, "os.PathLike[str]"]] = None,
    force: bool = False,
    progress: Optional[Callable[[float, float], Optional[bool]]] = None,
) -> Result:
    """Run a scene over its duration.

    Other Python threads run meanwhile. Ctrl-C ends the run; what was computed is ``result`` of the exception, as it is
    if a step fails or a file cannot be written.

    Parameters
    ----------
    scene : Scene, str, os.PathLike or dict
        The scene, or anything that `load` accepts.
    record : str or iterable of str, optional
        Names of the variables to record, in addition to the time; by default those of trajectory.csv and, depending on
        the scene's ``[record]``, the positions of the nodes. The scene's ``record.every`` or ``record.interval_s`` sets
        when they are recorded.
    out : str or os.PathLike, optional
        Folder for the files that ``caudal run`` writes: tables, figures, summary.json, report.html.
    force : bool, optional
        Replace other results in the folder; otherwise an error.
    progress : callable, optional
        Called with the time and the duration (s) some twenty times a second and at the end; if it returns False, the run
        ends there.

    Returns
    -------
    Result
        The recorded variables and the summary.

    Raises
    ------
    caudal.Error
        What went wrong.

    Examples
    --------
    >>> import caudal
    >>> short = caudal.load("models/glycerol.toml", set={"solver.duration_s": 0.1})
    >>> result = caudal.run(short, record=["tip_y_m", "curvature_1_m"])
    >>> list(result)
    ['time_s', 'tip_y_m', 'curvature_1_m']
    >>> result["curvature_1_m"].shape
    (101, 7)
    """
    scene = scene if isinstance(scene, Scene) else load(scene)
    names = None if record is None else names_of(record, "record")
    check_function("progress", progress)
    check_folder("out", out)
    content, failure = _run(scene, names, out, force, progress)
    result = Result(scene, content)
    if failure is not None:
        failure.result = result  # type: ignore[attr-defined]
        raise failure
    return result


def export(
    folder: Union[str, os.PathLike[str]],
    formats: Union[str, Iterable[str]] = "png",
    *,
    figures: Optional[Union[str, Iterable[str]]] = None,
    out: Optional[Union[str, os.PathLike[str]]] = None,
    force: bool = False,
) -> list[str]:
    """Turn the figures of a run, sweep, study or design into other files.

    Parameters
    ----------
    folder : str or os.PathLike
        Where the figures are, ``.svg``.
    formats : {"png", "pdf"} or iterable of them, optional
        What they become.
    figures : str or iterable of str, optional
        Names of figures, such as ``"shape"``; by default all.
    out : str or os.PathLike, optional
        Folder for the files; by default that of the figures.
    force : bool, optional
        Replace files of the same names that were made of other results, which are refused otherwise.

    Returns
    -------
    list of str
        The files.

    Raises
    ------
    caudal.errors.ReadError, caudal.errors.WriteError
        Where there are no such figures, or the files cannot be written.

    Examples
    --------
    >>> import os, tempfile
    >>> import caudal
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     short = caudal.load("models/glycerol.toml", set={"solver.duration_s": 0.1})
    ...     result = caudal.run(short, out=folder)
    ...     [os.path.basename(file) for file in caudal.export(folder, ["png", "pdf"], figures="shape")]
    ['shape.png', 'shape.pdf']
    """
    names = None if figures is None else names_of(figures, "figures")
    check_folder("out", out)
    out = folder if out is None else out
    return [os.fspath(file) for file in _pictures(folder, names, names_of(formats, "formats"), out, force)]


#: Where a legend covers no curve.
_BESIDE: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)}


class Result(Mapping[str, Array]):
    """The result of a run: NumPy arrays by the names of variables, with the summary.

    A scalar variable has one number per time, an array of variables one row per time. In a notebook it shows the run as an
    animation.

    Attributes
    ----------
    scene : Scene
        The scene.
    summary : dict
        The content of summary.json: the end of the run, energies, work, powers, work of the solver.
    notes : list of str
        What to know before trusting the result.
    variables : dict of str to Variable
        Units and meaning of what is recorded.
    nodes : numpy.ndarray
        The nodes that the columns of variables by node stand for.
    """

    def __init__(self, scene: Scene, content: Mapping[str, Any]) -> None:
        self.scene = scene
        self.summary = Fields(content["summary"])
        self.notes: list[str] = content["notes"]
        self.variables: dict[str, Variable] = content["variables"]
        self.nodes: npt.NDArray[np.uintp] = content["nodes"]
        self._arrays: dict[str, Array] = content["arrays"]
        self._html: str = content["html"]

    @property
    def complete(self) -> bool:
        """True if the run reached its duration."""
        return bool(self.summary["complete"])

    def __getitem__(self, name: str) -> Array:
        try:
            return self._arrays[name]
        except KeyError:
            raise unknown(name, self._arrays, "is not recorded", "; run(..., record=[...]) chooses what is") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._arrays)

    def __len__(self) -> int:
        return len(self._arrays)

    def __repr__(self) -> str:
        rows = len(self["time_s"])
        return f"<caudal.Result of {self.scene.name!r}: {len(self)} variables at {rows} times, {self.summary['ending']}>"

    def to_pandas(self) -> pandas.DataFrame:
        """Everything as a data frame.

        Returns
        -------
        pandas.DataFrame
            One row per time, with the time as index; an array of variables has a column ``name[node]`` for each entry.
        """
        pd = optional("pandas", "to_pandas()")
        columns: dict[str, Array] = {}
        for name, values in self.items():
            if values.ndim == 1:
                columns[name] = values
            else:
                columns.update({f"{name}[{k}]": column for k, column in zip(self._entries(name), values.T)})
        frame: pandas.DataFrame = pd.DataFrame(columns).set_index("time_s")
        return frame

    def to_xarray(self) -> xarray.Dataset:
        """Everything as a labelled dataset.

        Returns
        -------
        xarray.Dataset
            Dimensions ``time_s``, ``node`` and ``joint``, which are numbers of nodes; every variable has the attributes
            ``units`` and ``long_name``. ``dataset.to_netcdf("run.nc", engine="h5netcdf")`` writes it to a file.
        """
        xr = optional("xarray", "to_xarray()")
        coordinates: dict[str, Any] = {"time_s": ("time_s", self["time_s"], self._attributes("time_s"))}
        variables: dict[str, Any] = {}
        for name, values in self.items():
            if name == "time_s":
                continue
            dimensions = ["time_s"]
            if values.ndim == 2:
                dimension = "node" if self.variables[name].shape == (self.scene.nodes,) else "joint"
                coordinates[dimension] = (dimension, np.asarray(list(self._entries(name))), {"long_name": "number of the node"})
                dimensions.append(dimension)
            variables[name] = (dimensions, values, self._attributes(name))
        attributes = {"title": self.scene.name, "source": f"caudal {self.summary['caudal_version']}"}
        attributes["comment"] = self.summary["ending"]
        dataset: xarray.Dataset = xr.Dataset(variables, coordinates, attributes)
        return dataset

    def _attributes(self, name: str) -> dict[str, str]:
        variable = self.variables[name]
        return {"units": variable.unit, "long_name": variable.description}

    def _entries(self, name: str) -> Iterable[Any]:
        """The nodes of a variable's columns: those recorded, or the joints, of which the last is before the tip."""
        count = self[name].shape[1]
        if self.variables[name].shape == (self.scene.nodes,):
            return self.nodes
        return range(self.scene.nodes - 1 - count, self.scene.nodes - 1)

    def plot(self, *names: str) -> matplotlib.figure.Figure:
        """Draw the run.

        Parameters
        ----------
        *names : str
            Variables to draw over time, those of nodes and joints coloured from the head to the tip; without names shapes of the
            rod, the path of its centre of mass, and the energies, as far as they are recorded, otherwise what is recorded.

        Returns
        -------
        matplotlib.figure.Figure
            The figure.
        """
        optional("matplotlib", "plot()")
        from matplotlib.figure import Figure

        panels: list[Callable[[Any], None]] = [partial(self._course, name) for name in names] or self._overview()
        if not panels:
            return self.plot(*[name for name in self if name != "time_s"][:6] or ["time_s"])
        figure = Figure(figsize=(7, 1 + (2 if names else 2.4) * len(panels)), layout="constrained")
        if not names:
            figure.suptitle(self.scene.name)
        for axes, panel in zip(figure.subplots(len(panels), sharex=bool(names), squeeze=False)[:, 0], panels):
            panel(axes)
            axes.grid(alpha=0.3)
        if names:
            axes.set_xlabel("time (s)")
        return figure

    def _course(self, name: str, axes: Any) -> None:
        """A variable over time."""
        values, variable = self[name], self.variables[name]
        axes.set_ylabel(f"{name}\n({variable.unit})")
        if values.ndim == 1:
            axes.plot(self["time_s"], values, linewidth=1)
            return
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        entries = list(self._entries(name))
        colours = ScalarMappable(Normalize(0, self.scene.nodes - 1), "viridis")
        for entry, column in zip(entries, values.T):
            axes.plot(self["time_s"], column, linewidth=1, color=colours.to_rgba(entry))
        axes.figure.colorbar(colours, ax=axes, label="node")

    def _overview(self) -> list[Callable[[Any], None]]:
        """The default variables to draw: those that are recorded."""
        energies = [name for name in self if name.endswith(("_energy_j", "_work_j")) and np.any(self[name] != 0)]
        panels: list[tuple[bool, Callable[[Any], None]]] = [
            ("x_m" in self and "y_m" in self, self._shapes),
            ("x_com_m" in self and "y_com_m" in self, self._path),
            (bool(energies), partial(self._energies, energies)),
        ]
        return [panel for there, panel in panels if there]

    def _shapes(self, axes: Any) -> None:
        """Shapes of the rod at equal times, the last one in colour."""
        time = self["time_s"]
        chosen = np.linspace(0, len(time) - 1, min(9, len(time))).astype(int)
        for i, row in enumerate(chosen[:-1]):
            label = f"from t = {time[row]:g} s" if i == 0 else None
            axes.plot(self["x_m"][row], self["y_m"][row], color=str(0.85 - 0.4 * i / len(chosen)), label=label)
        axes.plot(self["x_m"][chosen[-1]], self["y_m"][chosen[-1]], color="#0072b2", linewidth=2.5, label=f"t = {time[-1]:g} s")
        axes.set(xlabel="x (m)", ylabel="y (m)", title="shapes")
        axes.set_aspect("equal", adjustable="datalim")
        axes.legend(fontsize="small", **_BESIDE)

    def _path(self, axes: Any) -> None:
        """The path of the centre of mass."""
        axes.plot(self["x_com_m"], self["y_com_m"], color="#d55e00")
        axes.plot(self["x_com_m"][:1], self["y_com_m"][:1], "o", color="#d55e00", label="start")
        axes.set(xlabel="x (m)", ylabel="y (m)", title="path of the centre of mass")
        axes.set_aspect("equal", adjustable="datalim")
        axes.legend(fontsize="small", **_BESIDE)

    def _energies(self, names: list[str], axes: Any) -> None:
        """Energies and work over time."""
        for name in names:
            axes.plot(self["time_s"], self[name], label=name[: -len("_j")].replace("_", " "))
        axes.set(xlabel="time (s)", ylabel="energy (J)", title="energies and work")
        axes.legend(fontsize="small", **_BESIDE)

    def animate(
        self,
        path: Union[str, os.PathLike[str]],
        *,
        fps: Optional[int] = None,
        speed: Optional[float] = None,
        sharpness: float = 1.0,
        window: tuple[float, float] = (-np.inf, np.inf),
        force: bool = False,
    ) -> None:
        """Write the moving rod to a file.

        Parameters
        ----------
        path : str or os.PathLike
            ``.svg``, an animated picture; ``.gif``; or ``.mp4`` where the program ffmpeg is installed.
        fps : int, optional
            Pictures per second of a ``.gif`` or ``.mp4``, by default 25.
        speed : float, optional
            Seconds of the run per second of the film; as ``caudal export`` chooses it by default: a beat takes at least a second.
        sharpness : float, optional
            Pixels per px of a picture that is 640 px wide, 0.05 to 20.
        window : tuple of float, optional
            First and last time that it shows (s), as far as the run has them. By default it shows the last cycle of a motion that
            repeats, and of another one all of it, or as many of its last periods as a film has room for.
        force : bool, optional
            Replace a file of that name that caudal did not write, which is refused otherwise.

        Raises
        ------
        caudal.errors.OccupiedError
            For the name of a result in a folder of ``run(..., out=...)``, which no film replaces.
        caudal.errors.WriteError
            For a file that caudal did not write, another ending, pictures per second of an ``.svg``, too many pictures, no ffmpeg for
            an ``.mp4``, and where the file cannot be written. An earlier film is replaced by a complete one only: after Ctrl-C it is
            as it was.
        """
        for name in ("x_m", "y_m"):
            if name not in self:
                raise ValueError(f"a film needs {name}: run(..., record=[..., 'x_m', 'y_m'])")
        positions = [np.ascontiguousarray(self[name]) for name in ("x_m", "y_m")]
        count, begin, until = (self.summary[key] for key in ("cycles_used", "cycles_from_s", "cycles_until_s"))
        cycle = (until - (until - begin) / count, until) if count else None
        _film(path, self.scene, self["time_s"], positions, cycle, (fps, speed, sharpness, window, force))

    def to_vtk(self, folder: Union[str, os.PathLike[str]], *, force: bool = False) -> list[str]:
        """Write the run for ParaView and other programs that read VTK.

        Parameters
        ----------
        folder : str or os.PathLike
            It gets a collection, ``<name>.pvd``, and one file for every time. What is recorded becomes fields: of nodes and
            joints at the points, pairs of velocities as vectors, numbers as field data. ``x_m`` and ``y_m`` must be among it.
        force : bool, optional
            Replace files of the same names that were made of other results, which are refused otherwise.

        Returns
        -------
        list of str
            The files.
        """
        columns = [(name, np.ascontiguousarray(values)) for name, values in self.items()]
        check_folder("folder", folder)
        return _vtk(self.scene, os.fspath(folder), columns, force)

    def to_html(self) -> str:
        """A self-contained page that plays the run.

        Returns
        -------
        str
            The page, HTML.
        """
        return self._html

    def _repr_html_(self) -> str:
        page = html.escape(self._html)
        ending = "" if self.complete else f"<p>This run did not reach its end: {html.escape(self.summary['ending'])}</p>"
        frame = f'<iframe srcdoc="{page}" style="width: 100%; height: 440px; border: 0" title="the moving rod"></iframe>'
        return ending + frame
