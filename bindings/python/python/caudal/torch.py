"""Simulations as functions of PyTorch, with derivatives (``pip install "caudal[torch]"``)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Callable

import numpy as np

from .gradients import Recent, simulate
from .optional import optional
from .result import Source

torch: Any = optional("torch", "caudal.torch")


class _Simulated(torch.autograd.Function):
    """The outputs of a simulation, one tensor each."""

    @staticmethod
    def forward(context: Any, recent: Recent, names: tuple[str, ...], *tensors: Any) -> Any:
        arrays = {name: t.detach().cpu().numpy().astype(np.float64) for name, t in zip(names, tensors)}
        simulation = simulate(recent.scene, recent.outputs, arrays)
        context.simulation, context.names, context.tensors = simulation, names, [(t.dtype, t.device, t.shape) for t in tensors]
        dtype = tensors[0].dtype if tensors else torch.get_default_dtype()
        device = tensors[0].device if tensors else None
        return tuple(torch.as_tensor(simulation.outputs[name], dtype=dtype, device=device) for name in recent.outputs)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(context: Any, *weights: Any) -> Any:
        wanted = [name for name, needed in zip(context.names, context.needs_input_grad[2:]) if needed]
        given = {
            name: weight.detach().cpu().numpy().astype(np.float64)
            for name, weight in zip(context.simulation.outputs, weights)
            if weight is not None
        }
        found = context.simulation.pull_back(given, wanted)
        gradients = [
            torch.as_tensor(np.asarray(found[name]), dtype=dtype, device=device).reshape(shape) if name in found else None
            for name, (dtype, device, shape) in zip(context.names, context.tensors)
        ]
        return (None, None, *gradients)


def function(scene: Source, outputs: Iterable[str]) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """A simulation as a differentiable function.

    Parameters
    ----------
    scene : Scene, str, os.PathLike or dict
        The scene, or what `caudal.load` makes one from.
    outputs : iterable of str
        What it returns, see `caudal.simulate`.

    Returns
    -------
    callable
        From a dictionary of tensors, values of `caudal.parameters`, to a dictionary of the outputs over time, in the type
        of the first. The simulation is in double precision; derivatives are once.
    """
    recent = Recent(scene, outputs)

    def of(values: dict[str, Any]) -> dict[str, Any]:
        tensors = [torch.as_tensor(value, dtype=None if torch.is_tensor(value) else torch.float64) for value in values.values()]
        found = _Simulated.apply(recent, tuple(values), *tensors)
        return dict(zip(recent.outputs, found))

    return of
