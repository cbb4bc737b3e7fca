"""Films of a run."""

from __future__ import annotations

import os
import shutil
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .result import Array, Result


def _motion(result: Result, times: Array) -> tuple[Array, Array]:
    """Positions at `times`, linear between those recorded."""
    for name in ("x_m", "y_m"):
        if name not in result:
            raise ValueError(f"a film needs {name}: run(..., record=[..., 'x_m', 'y_m'])")
    recorded = result["time_s"]
    place = np.clip(np.searchsorted(recorded, times, side="right"), 1, len(recorded) - 1)
    span = recorded[place] - recorded[place - 1]
    part = ((times - recorded[place - 1]) / span)[:, None]
    x, y = ((1 - part) * result[name][place - 1] + part * result[name][place] for name in ("x_m", "y_m"))
    return x, y


def animate(result: Result, path: str, fps: int, speed: float, dpi: int) -> None:
    """Write a film of `result`; see `Result.animate`."""
    from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter
    from matplotlib.figure import Figure

    ending = os.path.splitext(path)[1].lower()
    if ending not in (".gif", ".mp4"):
        raise ValueError(f"found {path!r}; allowed: a name that ends in .gif or .mp4")
    if ending == ".mp4" and shutil.which("ffmpeg") is None:
        raise RuntimeError("an .mp4 needs the program ffmpeg, which is not installed; a .gif needs none")
    if fps < 1 or not speed > 0:
        raise ValueError(f"found fps = {fps}, speed = {speed}; allowed: positive numbers")
    end = float(result["time_s"][-1])
    if end == 0.0:
        raise ValueError("a film needs a run of more than one time")
    times = np.linspace(0.0, end, max(2, round(end / speed * fps)))
    x, y = _motion(result, times)
    figure = Figure(figsize=(7, 3.5), layout="constrained")
    axes = figure.subplots()
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes.grid(alpha=0.3)
    margin = 0.05 * max(np.ptp(x), np.ptp(y))
    axes.set(xlim=(x.min() - margin, x.max() + margin), ylim=(y.min() - margin, y.max() + margin))
    (rod,) = axes.plot([], [], color="#0072b2", linewidth=2.5, solid_capstyle="round")
    (head,) = axes.plot([], [], "o", color="#d55e00", markersize=5)
    title = axes.set_title(result.scene.name)

    def draw(frame: int) -> list[object]:
        rod.set_data(x[frame], y[frame])
        head.set_data(x[frame, :1], y[frame, :1])
        title.set_text(f"{result.scene.name}, t = {times[frame]:.2f} s")
        return [rod, head, title]

    film = FuncAnimation(figure, draw, frames=len(times), blit=False)  # type: ignore[arg-type]
    beside = f"{os.path.splitext(path)[0]}.partial{ending}"
    try:
        film.save(beside, PillowWriter(fps=fps) if ending == ".gif" else FFMpegWriter(fps=fps), dpi=dpi)
        os.replace(beside, path)
    finally:
        if os.path.exists(beside):
            os.remove(beside)
