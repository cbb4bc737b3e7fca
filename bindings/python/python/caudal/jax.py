"""Simulations as functions of JAX, with derivatives (``pip install "caudal[jax]"``)."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any, Callable, Union

import numpy as np

from .arguments import numbers_of
from .fields import unknown
from ._caudal import Stepper
from .gradients import Recent, Step, parameters
from .optional import optional
from .result import Source

jax: Any = optional("jax", "caudal.jax")
jnp: Any = optional("jax.numpy", "caudal.jax")


class _Callbacks:
    """Calls of functions of NumPy arrays, whose errors come through JAX as they are."""

    def __init__(self) -> None:
        self._failures: deque[Exception] = deque(maxlen=16)  # the last ones; other threads may be here too

    def __call__(self, work: Callable[..., Any], result: Any, *arguments: Any) -> Any:
        def noted(*arguments: Any) -> Any:
            try:
                return work(*arguments)
            except Exception as error:
                self._failures.append(error)
                raise error.with_traceback(None) from None  # JAX prints the whole trace before the reason

        try:
            return jax.pure_callback(noted, result, *arguments, vmap_method="sequential")
        except Exception as error:  # JAX's class of it depends on what was called before
            reason = next((own for own in reversed(self._failures) if f"{type(own).__name__}: {own}" in str(error)), None)
            if reason is None:
                raise
        raise reason.with_traceback(None)


def function(scene: Source, outputs: Union[str, Iterable[str]]) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """A simulation as a differentiable function.

    It goes through ``jit``, ``grad``, ``vmap`` (one simulation after the other) and ``value_and_grad``; derivatives are
    reverse-mode. Numbers are JAX's own, single precision unless ``jax_enable_x64`` is set; the simulation is in double.

    A run that fails raises its error of `caudal.errors`. What ``jit`` has compiled raises JAX's own ``JaxRuntimeError``, whose
    message ends with the class and the text of that error.

    Parameters
    ----------
    scene : Scene, str, os.PathLike or dict
        The scene, or anything that `caudal.load` accepts.
    outputs : str or iterable of str
        What it returns, see `caudal.simulate`.

    Returns
    -------
    callable
        From a dictionary of values of `caudal.parameters` to a dictionary of the outputs over time.
    """
    recent = Recent(scene, outputs)
    outputs = recent.outputs
    known = parameters(recent.scene)
    first = recent({})
    shapes = {name: values.shape for name, values in first.outputs.items()}

    # In any other order the same values would be another simulation.
    def sorted_arrays(values: dict[str, Any]) -> dict[str, Any]:
        return {name: numbers_of(values[name], name) for name in sorted(values)}

    def real(name: str, value: Any) -> Any:
        array = jnp.asarray(value)
        if jnp.iscomplexobj(array):
            raise TypeError(f"{name}: found the type {array.dtype}; allowed: a number, or an array of numbers")
        return array.astype(float)

    def check_names(values: dict[str, Any]) -> None:
        wrong = [name for name in values if name not in known]
        if wrong:
            raise ValueError(unknown(wrong[0], known, "has no derivative", "; caudal.parameters(scene) lists them"))

    called = _Callbacks()

    def forward(values: dict[str, Any]) -> dict[str, Any]:
        found = recent(sorted_arrays(values)).outputs
        dtype = jnp.result_type(float)
        return {name: found[name].astype(dtype) for name in outputs}

    def back(values: dict[str, Any], weights: dict[str, Any]) -> dict[str, Any]:
        simulation = recent(sorted_arrays(values))
        found = simulation.pull_back({name: np.asarray(weights[name], dtype=np.float64) for name in outputs}, list(values))
        return {name: np.asarray(found[name], dtype=values[name].dtype).reshape(values[name].shape) for name in values}

    def call(values: dict[str, Any]) -> dict[str, Any]:
        check_names(values)
        result = {name: jax.ShapeDtypeStruct(shapes[name], jnp.result_type(float)) for name in outputs}
        found: dict[str, Any] = called(forward, result, values)
        return found

    @jax.custom_vjp
    def simulated(values: dict[str, Any]) -> dict[str, Any]:
        return call(values)

    def simulated_forward(values: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        return call(values), values

    def simulated_back(values: dict[str, Any], weights: dict[str, Any]) -> tuple[dict[str, Any]]:
        result = {name: jax.ShapeDtypeStruct(value.shape, value.dtype) for name, value in values.items()}
        return (called(back, result, values, weights),)

    simulated.defvjp(simulated_forward, simulated_back)

    def of(values: dict[str, Any]) -> dict[str, Any]:
        return simulated({name: real(name, value) for name, value in values.items()})

    return of


def step(stepper: Stepper, h: float, inputs: Union[str, Iterable[str]] = (), outputs: Union[str, Iterable[str]] = ()) -> Callable[..., Any]:
    """One communication step as a differentiable function, in forward and reverse mode.

    It goes through ``jit``, ``grad``, ``jacfwd`` and ``vmap`` (one step after the other). For steps at later times move the stepper on and
    make another function: what drives the scene depends on the time. A step that fails raises its error of `caudal.errors`, see `function`.

    Parameters
    ----------
    stepper : Stepper
        Where the step begins: its time, and all inputs that are not given. It stays as it is.
    h : float
        The step, s.
    inputs, outputs : str or iterable of str, optional
        As of `Stepper.linearize`.

    Returns
    -------
    callable
        From a state, as `Stepper.motion` has it, and the values of the inputs, one after the other, to the state at the end and the values of
        the outputs there. Without `inputs` it takes the state alone.
    """
    own = Step(stepper, h, inputs, outputs)

    callbacks = _Callbacks()

    def called(callback: Callable[..., Any], shapes: list[tuple[int, ...]], *arguments: Any) -> Any:
        dtype = jnp.result_type(float)
        result = [jax.ShapeDtypeStruct(shape, dtype) for shape in shapes]

        def cast(*arguments: Any) -> list[Any]:
            return [np.asarray(values, dtype=dtype) for values in callback(*arguments)]

        return callbacks(cast, result, *arguments)

    states, given, read = own.state.size, own.given.size, own.read

    def matrices(state: Any, values: Any) -> Any:
        end, outs, found = own(np.asarray(state), np.asarray(values))
        return [end, outs, found.a, found.b, found.c, found.d]

    @jax.custom_jvp
    def of(state: Any, values: Any) -> Any:
        return tuple(called(lambda *both: matrices(*both)[:2], [(states,), (read,)], state, values))

    @of.defjvp
    def of_jvp(primals: Any, tangents: Any) -> Any:
        shapes = [(states,), (read,), (states, states), (states, given), (read, states), (read, given)]
        end, outs, a, b, c, d = called(matrices, shapes, *primals)
        moved, changed = tangents
        return (end, outs), (a @ moved + b @ changed, c @ moved + d @ changed)

    def real(values: Any) -> Any:
        return jnp.ravel(jnp.asarray(values, dtype=float))

    if not own.inputs:
        return lambda state: of(real(state), jnp.zeros(0))
    return lambda state, values: of(real(state), real(values))
