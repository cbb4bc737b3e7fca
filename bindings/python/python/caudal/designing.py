"""Inverse design of stiffness."""

from __future__ import annotations

import html
import os
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, Optional, Union

from ._caudal import Scene, _design, _design_parts
from .arguments import check_folder, check_function
from .distributing import Engine
from .errors import Error
from .fields import Fields
from .optional import optional
from .result import Source, load

if TYPE_CHECKING:
    import matplotlib.figure

    from ._caudal import _Parts


class Design(Mapping[str, Any]):
    """The result of a design: the content of design.json, by keys and as attributes.

    Attributes
    ----------
    folder : pathlib.Path
        Where its files are.
    answer, lines, status, xi, stiffness_n_m2, ...
        What the goal leaves in design.json, by the names there.
    """

    def __init__(self, content: dict[str, Any]) -> None:
        self._content = Fields(content)

    def __getitem__(self, key: str) -> Any:
        return self._content[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._content)

    def __len__(self) -> int:
        return len(self._content)

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__["_content"][name]
        except KeyError:
            raise AttributeError(f"a design has no {name!r}") from None

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._content]

    def __repr__(self) -> str:
        return f"<caudal.Design {self._content.get('name')!r}: {self._content.get('status')}>"

    @property
    def scene(self) -> Scene:
        """The designed scene, for `run`."""
        return load(Path(self.folder) / f"{self['name']}-designed.toml")

    def plot(self) -> matplotlib.figure.Figure:
        """Draw the stiffness along the rod.

        Returns
        -------
        matplotlib.figure.Figure
            The figure.
        """
        optional("matplotlib", "plot()")
        from matplotlib.figure import Figure

        figure = Figure(figsize=(7, 4), layout="constrained")
        axes = figure.subplots()
        joints = (self._content.get("answer") or {}).get("joints")
        if joints:
            # What the data do not tell is no result.
            known = [joint for joint in joints if joint["verdict"] == "identified"]
            rest = [joint for joint in joints if joint["verdict"] != "identified"]
            if known:
                xi, stiffness, deviation = ([joint[key] for joint in known] for key in ("xi", "stiffness_n_m2", "deviation_n_m2"))
                axes.errorbar(xi, stiffness, deviation, fmt="o-", capsize=3, label="identified, with standard deviation")
            if rest:
                xi, stiffness = ([joint[key] for joint in rest] for key in ("xi", "stiffness_n_m2"))
                axes.plot(xi, stiffness, "o", color="0.6", fillstyle="none", label="not identified")
            axes.legend()
        else:
            axes.plot(self["xi"], self["stiffness_n_m2"], "o-")
        axes.set(xlabel="xi, from the head at 0 to the tip at 1", ylabel="bending stiffness (N m²)", title=self["name"])
        axes.grid(alpha=0.3)
        return figure

    def _repr_html_(self) -> str:
        lines = "".join(f"<p>{html.escape(str(line))}</p>" for line in self._content.get("lines", []))
        return lines + f"<p>{html.escape(str(self.folder))}/report.html</p>"


def design(
    scene: Source,
    *,
    out: Optional[Union[str, os.PathLike[str]]] = None,
    force: bool = False,
    progress: Optional[Callable[[int, float], Any]] = None,
    client: Any = None,
    executor: Optional[Executor] = None,
    workers: Optional[int] = None,
    patience_s: float = 60.0,
) -> Design:
    """Solve the design problem of the scene's ``[design]``, and write the files of ``caudal design``.

    Parameters
    ----------
    scene : Scene, str, os.PathLike or dict
        The scene, or anything that `load` accepts. Data files are relative to the file of the scene.
    out : str or os.PathLike, optional
        Folder for the results; by default ``out/<name of the scene>-design``.
    force : bool, optional
        Replace other results in the folder; otherwise an error.
    progress : callable, optional
        Called with the number of an iteration and the objective there (for a tracked tip the rms distance in m, otherwise
        the distance in m or its square over work in m²/J). Its exceptions, and Ctrl-C, end the search; the best design so far is
        then the exception's ``result``.
    client : distributed.Client, optional
        Runs the searches and the checks of the design on the workers of a Dask cluster. Their results are stored in the folder,
        and the design is bit-identical.
    executor : concurrent.futures.Executor, optional
        The same with any other executor, such as a ``ProcessPoolExecutor``.
    workers : int, optional
        Number of tasks that the engine runs at once, if it does not report it.
    patience_s : float, optional
        A warning is raised if the engine returns no results for longer than this.

    Returns
    -------
    Design
        The content of design.json, and ``folder``: among others ``status``, ``stiffness_n_m2`` at ``xi`` (joints, from the
        head at 0 to the tip at 1), ``answer`` and ``lines``, the answer in sentences. The scene with the designed stiffness is
        ``<name>-designed.toml`` in the folder.

    Raises
    ------
    caudal.errors.DesignError
        If no design meets the requirements, with the reason.
    caudal.errors.SceneError
        For a wrong ``[design]``.
    caudal.errors.EngineError, caudal.errors.LostCasesError
        If the engine fails, and for starts and checks that crash their worker.
    """
    scene = scene if isinstance(scene, Scene) else load(scene)
    check_function("progress", progress)
    check_folder("out", out)
    told = _OncePerIteration(progress)
    if (engine := Engine.asked(client, executor, workers, patience_s)) is not None:
        while (parts := told.next(scene, out, force)) is not None:
            engine.do(parts)
    content, failure = _design(scene, out, force, told.again())
    found = Design(content)
    if failure is not None:
        failure.result = found  # type: ignore[attr-defined]
        raise failure
    return found


class _OncePerIteration:
    """Report each iteration once, although the search is repeated after each batch of parts; stop it again where it was stopped."""

    def __init__(self, progress: Optional[Callable[[int, float], Any]]) -> None:
        self.progress = progress
        self.reported = self.at = 0
        self.ended: Optional[BaseException] = None

    def again(self) -> _OncePerIteration:
        """Restart at the first iteration."""
        self.at = 0
        return self

    def __call__(self, iteration: int, objective: float) -> None:
        self.at += 1
        if self.ended is not None and self.at >= self.reported:
            raise self.ended
        if self.at > self.reported:
            self.reported = self.at
            if self.progress is not None:
                self.progress(iteration, objective)

    def next(self, scene: Scene, out: Optional[Union[str, os.PathLike[str]]], force: bool) -> Optional[_Parts]:
        """The next parts, or None if the search was stopped."""
        try:
            return _design_parts(scene, out, force, self.again())
        except Error:
            raise
        except BaseException as ended:  # the design up to there is made as without an engine
            self.ended = ended
            return None
