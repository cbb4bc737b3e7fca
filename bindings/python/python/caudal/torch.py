"""Simulations as functions of PyTorch, with derivatives (``pip install "caudal[torch]"``)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Callable, Union

import numpy as np

from ._caudal import Scene
from .arguments import names_of
from .gradients import simulate
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
        The scene, or what `caudal.load` makes one from.
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
