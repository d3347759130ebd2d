"""Energies as functions of PyTorch tensors: `backward()`, a second `backward()`, and what `torch.func` makes of them.

Values and derivatives are computed on the host. `pip install 'yasps[torch]'` brings PyTorch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch

from yasps import Attribute, DataError, FloatArray, Scene
from yasps.bridges.energy_function import EnergyFunction
from yasps.bridges.trajectory_function import Frames, TrajectoryFunction
from yasps.inverse import Parameter, Trajectory


def energy_function(
    scene: Scene,
    inputs: Attribute | Sequence[Attribute],
    *,
    energies: Attribute | Sequence[Attribute] | None = None,
) -> Callable[..., Any]:
    """The energies [J] as a PyTorch function of one float64 tensor for each input, with exact derivatives up to the
    second.

    inputs, energies and the shapes of arguments: see `EnergyFunction`. What is no input is read from the scene whenever
    a value or derivative is computed: leave it as it is until `backward()` is done. Tensors of a GPU are copied to the
    host and back. Batches: `torch.func.vmap`, which evaluates one after another.

    Calls raise what `EnergyFunction` raises, DataError for tensors of another type, and NotImplementedError where third
    derivatives are asked for.
    """
    function = EnergyFunction(scene, inputs, energies=energies)

    def energy(*tensors: Any) -> Any:
        _check_tensors(function, tensors)
        return _Value.apply(function, *tensors)

    return energy


class _OnHost(torch.autograd.Function):  # type: ignore[misc]
    """What the three functions have in common: all arguments are kept, and a batch is a loop."""

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Any) -> None:
        """Keeps the arguments for the derivatives."""
        ctx.function = inputs[0]
        ctx.save_for_backward(*inputs[1:])
        ctx.save_for_forward(*inputs[1:])


def _looped(kind: Any, info: Any, in_dims: tuple[Any, ...], arguments: tuple[Any, ...]) -> tuple[Any, Any]:
    """The function on each member of a batch, and the axis of the batch in its results."""
    members = []
    for k in range(info.batch_size):
        own = [a if axis is None else a.select(axis, k) for a, axis in zip(arguments, in_dims, strict=True)]
        members.append(kind.apply(*own))
    if isinstance(members[0], tuple):
        stacked = tuple(torch.stack(parts) for parts in zip(*members, strict=True))
        return stacked, (0,) * len(stacked)
    return torch.stack(members), 0


class _Value(_OnHost):
    """The energy."""

    @staticmethod
    def forward(function: EnergyFunction, *tensors: Any) -> Any:
        """Its value, a tensor without axes."""
        return torch.tensor(function.value(*map(_array, tensors)), dtype=torch.float64, device=tensors[0].device)

    @staticmethod
    def backward(ctx: Any, slope: Any) -> Any:
        """The gradient, times the slope of what the energy is an argument of."""
        parts = _Gradient.apply(ctx.function, *ctx.saved_tensors)
        return None, *(slope * part for part in parts)

    @staticmethod
    def jvp(ctx: Any, _: Any, *tangents: Any) -> Any:
        """The gradient along a direction."""
        parts = _Gradient.apply(ctx.function, *ctx.saved_tensors)
        moved = [(part * tangent).sum() for part, tangent in zip(parts, tangents, strict=True) if tangent is not None]
        return sum(moved[1:], moved[0])

    @staticmethod
    def vmap(info: Any, in_dims: Any, *arguments: Any) -> Any:
        """One after another."""
        return _looped(_Value, info, in_dims, arguments)


class _Gradient(_OnHost):
    """First derivatives, one tensor for each argument."""

    @staticmethod
    def forward(function: EnergyFunction, *tensors: Any) -> Any:
        """Their values."""
        return _tensors(function.gradient(*map(_array, tensors)), tensors)

    @staticmethod
    def backward(ctx: Any, *cotangents: Any) -> Any:
        """The Hessian, which is symmetric, times the cotangents."""
        return None, *_Product.apply(ctx.function, *ctx.saved_tensors, *cotangents)

    @staticmethod
    def jvp(ctx: Any, _: Any, *tangents: Any) -> Any:
        """The Hessian times the tangents."""
        tensors = ctx.saved_tensors
        directions = [torch.zeros_like(t) if d is None else d for t, d in zip(tensors, tangents, strict=True)]
        return _Product.apply(ctx.function, *tensors, *directions)

    @staticmethod
    def vmap(info: Any, in_dims: Any, *arguments: Any) -> Any:
        """One after another."""
        return _looped(_Gradient, info, in_dims, arguments)


class _Product(_OnHost):
    """The Hessian at the first half of the tensors times a direction, the second half."""

    @staticmethod
    def forward(function: EnergyFunction, *tensors: Any) -> Any:
        """One tensor for each argument of the energy."""
        arrays = [_array(tensor) for tensor in tensors]
        half = len(arrays) // 2
        return _tensors(function.hessian_product(arrays[:half], arrays[half:]), tensors[:half])

    @staticmethod
    def backward(ctx: Any, *cotangents: Any) -> Any:
        """By the direction alone: the product is linear in it, and the Hessian symmetric."""
        half = len(cotangents)
        _refuse_third(ctx.function, ctx.needs_input_grad[1 : 1 + half])
        parts = _Product.apply(ctx.function, *ctx.saved_tensors[:half], *cotangents)
        return None, *[None] * half, *parts

    @staticmethod
    def jvp(ctx: Any, _: Any, *tangents: Any) -> Any:
        """By the direction alone."""
        half = len(tangents) // 2
        _refuse_third(ctx.function, [tangent is not None for tangent in tangents[:half]])
        tensors = ctx.saved_tensors
        moved = [torch.zeros_like(t) if d is None else d for t, d in zip(tensors[half:], tangents[half:], strict=True)]
        return _Product.apply(ctx.function, *tensors[:half], *moved)

    @staticmethod
    def vmap(info: Any, in_dims: Any, *arguments: Any) -> Any:
        """One after another."""
        return _looped(_Product, info, in_dims, arguments)


def _refuse_third(function: EnergyFunction, asked: Sequence[bool]) -> None:
    if any(asked):
        raise NotImplementedError(
            f"{function!r} has first and second derivatives, but third ones were asked for: hold the second ones "
            "constant, by detach()"
        )


def _check_tensors(function: EnergyFunction | TrajectoryFunction, tensors: Sequence[Any]) -> None:
    """Raises DataError and ShapeMismatchError for wrong arguments."""
    for k, tensor in enumerate(tensors):
        kind = getattr(tensor, "dtype", type(tensor).__name__)
        if kind != torch.float64:
            raise DataError(f"argument {k} must be a float64 tensor, got {kind}: tensor.double()")
    function.check_shapes([tuple(tensor.shape) for tensor in tensors])


def _array(tensor: Any) -> FloatArray:
    """The numbers on the host, not to be written to."""
    return np.asarray(tensor.detach().cpu().numpy())


def _tensors(arrays: Sequence[FloatArray], like: Sequence[Any]) -> tuple[Any, ...]:
    """Arrays as tensors, each on the device of one given."""
    return tuple(torch.from_numpy(array).to(tensor.device) for array, tensor in zip(arrays, like, strict=True))


def trajectory_layer(
    trajectory: Trajectory,
    parameters: Attribute | Parameter | Sequence[Attribute | Parameter],
    outputs: Attribute | Sequence[Attribute],
    *,
    frames: Frames = "last",
) -> Callable[..., Any]:
    """A run as a PyTorch function of one float64 tensor for each parameter, with exact derivatives by `backward()`; it
    gives a tensor for each output, alone if there is but one.

    See `TrajectoryFunction`. There are no second derivatives: PyTorch says so. Raises as `energy_function` does.
    """
    function = TrajectoryFunction(trajectory, parameters, outputs, frames=frames)

    def layer(*tensors: Any) -> Any:
        _check_tensors(function, tensors)
        results = _Run.apply(function, *tensors)
        return results[0] if len(results) == 1 else results

    return layer


class _Run(torch.autograd.Function):  # type: ignore[misc]
    """The steps of a run."""

    @staticmethod
    def forward(ctx: Any, function: TrajectoryFunction, *tensors: Any) -> Any:
        """One tensor for each output."""
        ctx.function = function
        ctx.save_for_backward(*tensors)
        return _tensors(function.values(*map(_array, tensors)), [tensors[0]] * len(function.outputs))

    @staticmethod
    @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
    def backward(ctx: Any, *slopes: Any) -> Any:
        """One tensor for each parameter."""
        tensors = ctx.saved_tensors
        parts = ctx.function.pull_back([*map(_array, tensors)], [*map(_array, slopes)])
        return None, *_tensors(parts, tensors)
