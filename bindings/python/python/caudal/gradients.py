"""Exact derivatives of simulations by the adjoint method: one backward pass for any number of parameters."""

from __future__ import annotations

import functools
import html
import threading
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, Optional, Union

import numpy as np
import numpy.typing as npt

from ._caudal import Scene, StepDerivative, Stepper, _parameters, _Simulation
from .arguments import arrays_of, names_of, numbers_of
from .fields import Fields
from .result import Array, Source, load
from .showing import table

#: A number, or an array.
Value = Union[float, Array]


class Parameter(NamedTuple):
    """A parameter that a simulation can be differentiated by.

    Attributes
    ----------
    value : float or numpy.ndarray
        What it is in the scene: a number, or one for each joint, node, component or point of a profile.
    unit : str
        SI unit; ``"1"`` where there is none.
    description : str
        What it is.
    """

    value: Value
    unit: str
    description: str

    def _repr_html_(self) -> str:
        return table(("value", "unit", "description"), [self])


def parameters(scene: Source) -> dict[str, Parameter]:
    """All parameters that simulations of a scene can be differentiated by.

    Parameters
    ----------
    scene : Scene, str, os.PathLike or dict
        The scene, or anything that `load` accepts: with the full model and fixed steps (``solver.time_step_s``) of a one-stage
        method (``generalized-alpha``, ``newmark``, ``implicit-euler``).

    Returns
    -------
    dict of str to Parameter
        Numbers of the scene by their keys, lengths, radii, densities, fluid, drive, drag: one, both of a pair, or one for each
        point of a profile; stiffness, factors and phases of the actuation at the joints; natural curvature and forces, constant or
        over time; and the first positions and velocities of the nodes, of which node 0 follows a held head: its derivatives are 0,
        and another value there is refused. Mass and stiffness follow the numbers of the body, unless
        ``joint_stiffness_n_m2`` is given. A flow along interfaces changes along them only: its derivatives are those of that part,
        and 0 across them.

    Raises
    ------
    caudal.errors.SceneError
        For a scene without fixed steps.

    Examples
    --------
    >>> import caudal
    >>> known = caudal.parameters("models/glycerol.toml")
    >>> known["medium.viscosity_pa_s"].value, known["joint_stiffness_n_m2"].value.shape
    (1.0, (7,))
    """
    scene = scene if isinstance(scene, Scene) else load(scene)
    return Fields({name: Parameter(*content) for name, content in _parameters(scene).items()})


class Simulation:
    """A simulation whose outputs have derivatives.

    Attributes
    ----------
    scene : Scene
        The scene.
    times_s : numpy.ndarray
        Its times, the start's first.
    outputs : dict of str to numpy.ndarray
        The outputs: a number per time, and for ``x_m``, ``y_m``, ``vx_m_s`` and ``vy_m_s`` a row per time.
    notes : list of str
        The notes of `run`: where the model, the steps and the energy balance leave their ranges. They are computed by another
        simulation at the first access.
    """

    def __init__(self, scene: Scene, content: _Simulation, values: Mapping[str, npt.ArrayLike]) -> None:
        self.scene = scene
        self._values = dict(values)
        self.times_s: Array = content.times
        self.outputs: dict[str, Array] = Fields(content.values())
        self._content = content

    @functools.cached_property
    def notes(self) -> list[str]:
        """The notes of `run`: model, steps or energy balance that are out of range."""
        return self._content.notes()

    def pull_back(
        self, weights: Mapping[str, npt.ArrayLike], with_respect_to: Union[str, Iterable[str]]
    ) -> dict[str, Value]:
        """Derivatives of a weighted sum of all outputs over all times.

        Parameters
        ----------
        weights : dict of str to array_like
            Weights by output, each of its shape; outputs that are not named have none.
        with_respect_to : str or iterable of str
            Names of `parameters`. First positions and velocities must have been given; those that are not follow the scene's start.

        Returns
        -------
        dict of str to float or numpy.ndarray
            The derivatives, each of the shape of what it is by.
        """
        if not isinstance(weights, Mapping):
            raise TypeError(f"weights: found {type(weights).__name__}; allowed: a dict of weights by output")
        rows = []
        for name, weight in weights.items():
            if name not in self.outputs:
                raise ValueError(f"`{name}` was not read; allowed: {', '.join(self.outputs)}")
            shape = self.outputs[name].shape
            array = numbers_of(weight, f"weights of {name}")
            if not np.isfinite(array).all():
                raise ValueError(f"weights of {name}: found numbers that are not finite")
            if array.shape != shape:
                raise ValueError(f"weights of {name}: found the shape {array.shape}; allowed: {shape}")
            rows.append((name, array))
        return self._content.pull_back(rows, names_of(with_respect_to, "with_respect_to"))

    def __repr__(self) -> str:
        return f"<caudal.Simulation of {self.scene.name!r}: {', '.join(self.outputs)} at {len(self.times_s)} times>"

    def _repr_html_(self) -> str:
        rows = ((name, values.shape, float(values.min()), float(values.max())) for name, values in self.outputs.items())
        return f"<p>{html.escape(repr(self))}</p>" + table(("output", "shape", "least", "largest"), rows)

    def __reduce__(self) -> tuple[Any, ...]:
        return simulate, (self.scene, list(self.outputs), self._values)  # the same again, to the bit


def simulate(
    scene: Source, outputs: Union[str, Iterable[str]], values: Optional[Mapping[str, npt.ArrayLike]] = None
) -> Simulation:
    """Simulate a scene so that its outputs can be differentiated.

    Parameters
    ----------
    scene : Scene, str, os.PathLike or dict
        The scene, or anything that `load` accepts.
    outputs : str or iterable of str
        Names of recorded variables, or ``x_m``, ``y_m``, ``vx_m_s``, ``vy_m_s`` of the nodes.
    values : dict of str to array_like, optional
        Values of `parameters` in place of the scene's. Natural curvature and forces may have a row for each time: values at
        the steps of a function of time. With implicit Euler this is what a `Stepper` does whose inputs are set before each step.

    Returns
    -------
    Simulation
        The outputs, and their derivatives.

    Examples
    --------
    >>> import caudal
    >>> short = caudal.load("models/glycerol.toml", set={"solver.duration_s": 0.1})
    >>> simulation = caudal.simulate(short, "tip_y_m", {"medium.viscosity_pa_s": 2.0})
    >>> weights = {"tip_y_m": simulation.times_s == simulation.times_s[-1]}     # the tip at the end
    >>> list(simulation.pull_back(weights, ["medium.viscosity_pa_s"]))
    ['medium.viscosity_pa_s']
    """
    scene = scene if isinstance(scene, Scene) else load(scene)
    names = names_of(outputs, "outputs")
    if not names:
        raise ValueError("outputs: found an empty list; allowed: at least one name")
    given = arrays_of(values)
    return Simulation(scene, _Simulation(scene, given, names), dict(given))


class ValueAndGrad(tuple[float, dict[str, Value]]):
    """A number and its derivatives by name: a pair, which also has the notes of its simulation."""

    _content: _Simulation
    _made_of: tuple[Any, ...]

    @functools.cached_property
    def notes(self) -> list[str]:
        """The notes of the simulation, see `Simulation.notes`."""
        return self._content.notes()

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (tuple(self), *self._made_of)


def _again(found: tuple[float, dict[str, Value]], scene: Scene, values: list[tuple[str, Any]], read: list[str]) -> ValueAndGrad:
    """The pair, with a simulation for its notes that has not run yet."""
    pair = ValueAndGrad(found)
    pair._content, pair._made_of = _Simulation(scene, values, read), (scene, values, read)
    return pair


def value_and_grad(
    scene: Source,
    output: str,
    with_respect_to: Union[str, Iterable[str]],
    values: Optional[Mapping[str, npt.ArrayLike]] = None,
) -> ValueAndGrad:
    """The final value of an output of a simulation, and its exact derivatives.

    Parameters
    ----------
    scene : Scene, str, os.PathLike or dict
        The scene, or anything that `load` accepts.
    output : str
        A recorded variable, which is taken at the end, or a mean over the last whole cycles such as
        ``cycle_forward_speed_m_s``; a driving frequency also shifts the ends of the cycles.
    with_respect_to : str or iterable of str
        Names of `parameters`.
    values : dict of str to array_like, optional
        Values of `parameters` in place of the scene's.

    Returns
    -------
    value : float
        The number.
    gradient : dict of str to float or numpy.ndarray
        Its derivatives by name. Initial positions and velocities among them are independent; those that are neither named nor given
        follow from the scene and its other parameters. The returned pair also has ``notes``, see `Simulation`.

    Examples
    --------
    >>> import caudal
    >>> scene = caudal.load("models/glycerol.toml", set={"solver.duration_s": 0.5})
    >>> value, gradient = caudal.value_and_grad(scene, "x_com_m", ["actuation.kappa_amp", "joint_stiffness_n_m2"])
    >>> gradient["joint_stiffness_n_m2"].shape
    (7,)
    """
    scene = scene if isinstance(scene, Scene) else load(scene)
    if not isinstance(output, str):
        raise TypeError(f"output: found {output!r}; allowed: one name; Simulation.pull_back has the derivatives of several")
    read = [] if output.startswith("cycle_") else [output]
    given = arrays_of(values)
    content = _Simulation(scene, given, read)
    found = ValueAndGrad(content.value_and_grad(output, names_of(with_respect_to, "with_respect_to")))
    found._content, found._made_of = content, (scene, given, read)
    return found


class Recent:
    """A cache of the last simulations of a function, for its derivative."""

    def __init__(self, scene: Source, outputs: Union[str, Iterable[str]], size: int = 4) -> None:
        self.scene = scene if isinstance(scene, Scene) else load(scene)
        self.outputs = names_of(outputs, "outputs")
        self._size = size
        self._kept: dict[tuple[Any, ...], Simulation] = {}

    def __call__(self, values: Mapping[str, Array]) -> Simulation:
        key = tuple((name, array.shape, array.tobytes()) for name, array in values.items())
        found = self._kept.pop(key, None) or simulate(self.scene, self.outputs, values)
        self._kept[key] = found
        for old in list(self._kept)[: -self._size]:  # other threads may be here too
            self._kept.pop(old, None)
        return found


class Step:
    """One communication step from where a stepper is, as a function of the state and of inputs: what `caudal.jax.step` and
    `caudal.torch.step` call. It has its own stepper; several threads may call it, one after the other.

    Parameters
    ----------
    stepper : Stepper
        It stays as it is.
    h : float
        The step, s.
    inputs, outputs : str or iterable of str
        As of `Stepper.linearize`.
    """

    def __init__(self, stepper: Stepper, h: float, inputs: Union[str, Iterable[str]], outputs: Union[str, Iterable[str]]) -> None:
        self.inputs, self.outputs = names_of(inputs, "inputs"), names_of(outputs, "outputs")
        self._h, self._begin, self._own, self._lock = h, stepper.save(), Stepper(stepper.scene), threading.Lock()
        self._own.restore(self._begin)
        #: State and inputs where it begins.
        self.state: Array = self._own.motion()
        self.given: Array = self._read(self.inputs)
        self.read = self(self.state, self.given)[1].size

    def _read(self, names: list[str]) -> Array:
        return np.concatenate([np.zeros(0), *(np.ravel(self._own.get(name)) for name in names)])

    def __call__(self, state: Any, values: Any) -> tuple[Array, Array, StepDerivative]:
        """The state at the end, the outputs there, one after the other, and the matrices."""
        with self._lock:
            self._own.restore(self._begin)
            self._own.set_motion(numbers_of(state, "state"))
            first = 0
            for name in self.inputs:
                count = np.size(self._own.get(name))
                self._own.set(name, numbers_of(values[first : first + count], name))
                first += count
            found = self._own.linearize(self._h, inputs=self.inputs, outputs=self.outputs)
            return self._own.motion(), self._read(self.outputs), found
