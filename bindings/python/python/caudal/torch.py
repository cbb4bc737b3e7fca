"""Simulations as functions of PyTorch, with derivatives (``pip install "caudal[torch]"``)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Callable, Union

import numpy as np

from ._caudal import Scene, Stepper
from .arguments import names_of
from .gradients import Step, simulate
from .optional import optional
from .result import Source, load

torch: Any = optional("torch", "caudal.torch")


class _Simulated(torch.autograd.Function):
    """The outputs of a simulation, one tensor each."""

    @staticmethod
    def forward(context: Any, scene: Scene, outputs: list[str], names: tuple[str, ...], *tensors: Any) -> Any:
        arrays = {name: t.detach().cpu().numpy().astype(np.float64) for name, t in zip(names, tensors)}
        simulation = simulate(scene, outputs, arrays)
        context.save_for_backward(*tensors)
        context.simulation, context.names, context.tensors = simulation, names, [(t.dtype, t.device, t.shape) for t in tensors]
        dtype = next((t.dtype for t in tensors if t.is_floating_point()), torch.get_default_dtype())
        device = tensors[0].device if tensors else None
        return tuple(torch.as_tensor(simulation.outputs[name], dtype=dtype, device=device) for name in outputs)

    @staticmethod
    def backward(context: Any, *weights: Any) -> Any:
        wanted = [name for name, needed in zip(context.names, context.needs_input_grad[3:]) if needed]
        given = [name for name, weight in zip(context.simulation.outputs, weights) if weight is not None]
        weights = tuple(weight for weight in weights if weight is not None)
        found = _Derivatives.apply(context.simulation, given, wanted, *weights, *context.saved_tensors)
        gradients = [
            found[wanted.index(name)].to(dtype=dtype, device=device).reshape(shape) if name in wanted else None
            for name, (dtype, device, shape) in zip(context.names, context.tensors)
        ]
        return (None, None, None, *gradients)


class _Derivatives(torch.autograd.Function):
    """What the weights of some outputs come to by some parameters, one tensor each; it depends on all values of the simulation."""

    @staticmethod
    def forward(context: Any, simulation: Any, given: list[str], wanted: list[str], *tensors: Any) -> Any:
        weights = {name: weight.detach().cpu().numpy().astype(np.float64) for name, weight in zip(given, tensors)}
        found = simulation.pull_back(weights, wanted)
        return tuple(torch.as_tensor(np.asarray(found[name])) for name in wanted)

    @staticmethod
    def backward(context: Any, *weights: Any) -> Any:
        raise NotImplementedError("caudal.torch: simulations have first derivatives only")


def function(scene: Source, outputs: Union[str, Iterable[str]]) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """A simulation as a differentiable function.

    Parameters
    ----------
    scene : Scene, str, os.PathLike or dict
        The scene, or anything that `caudal.load` accepts.
    outputs : str or iterable of str
        What it returns, see `caudal.simulate`.

    Returns
    -------
    callable
        From a dictionary of tensors or numbers, values of `caudal.parameters`, to a dictionary of the outputs over time, in the
        type of the first tensor that is not of whole numbers, else PyTorch's default. The simulation is in double precision;
        it has first derivatives, and second ones raise an error.
    """
    own, wanted = load(scene), names_of(outputs, "outputs")

    def of(values: dict[str, Any]) -> dict[str, Any]:
        tensors = [torch.as_tensor(value, dtype=None if torch.is_tensor(value) else torch.float64) for value in values.values()]
        return dict(zip(wanted, _Simulated.apply(own, wanted, tuple(values), *tensors)))

    return of


class _Step(torch.autograd.Function):
    """The state at the end of a step, and the outputs there."""

    @staticmethod
    def forward(context: Any, own: Step, state: Any, values: Any) -> Any:
        end, outs, context.found = own(*(t.detach().cpu().numpy().astype(np.float64) for t in (state, values)))
        context.types = [(t.dtype, t.device) for t in (state, values)]
        return tuple(torch.as_tensor(found, dtype=state.dtype, device=state.device) for found in (end, outs))

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(context: Any, of_end: Any, of_outs: Any) -> Any:
        end, outs = (weights.cpu().numpy().astype(np.float64) for weights in (of_end, of_outs))
        found = context.found
        by = (end @ found.a + outs @ found.c, end @ found.b + outs @ found.d)
        return (None, *(torch.as_tensor(x, dtype=dtype, device=device) for x, (dtype, device) in zip(by, context.types)))


def step(stepper: Stepper, h: float, inputs: Union[str, Iterable[str]] = (), outputs: Union[str, Iterable[str]] = ()) -> Callable[..., Any]:
    """One communication step as a differentiable function.

    For steps at later times move the stepper on and make another function: what drives the scene depends on the time.

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

    def tensor(values: Any) -> Any:
        return torch.as_tensor(values, dtype=None if torch.is_tensor(values) else torch.float64).reshape(-1)

    if not own.inputs:
        return lambda state: _Step.apply(own, tensor(state), torch.zeros(0, dtype=torch.float64))
    return lambda state, values: _Step.apply(own, tensor(state), tensor(values))
