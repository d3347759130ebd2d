"""The peer PyTorch in the benchmarks `elements` and `cloth`: vmap(hessian) of the same energies; eigh, eigenvalues
clamped."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np

from benchmarks.array_peer import ArrayPeer
from benchmarks.element_problem import (
    BARAFF_WITKIN,
    HINGE,
    LAMBDA,
    MU,
    NEO_HOOKEAN,
    SHEAR_STIFFNESS,
    STRETCH_STIFFNESS,
    Elements,
    FloatArray,
)


# PyTorch need not be installed: its module and tensors are `Any`, and `torch` is given to the energies.
def _cross(torch: Any, a: Any, b: Any) -> Any:
    return torch.linalg.cross(a, b)


def _neo_hookean(torch: Any, x: Any, inverse: Any, volume: Any) -> Any:
    f = (x[1:] - x[0]).T @ inverse
    # Written out: Hessians through torch.linalg.det were wrong in PyTorch 2.13.
    determinant = f[0] @ _cross(torch, f[1], f[2])
    stretch = (f * f).sum()
    dilation = determinant - (1 + 0.75 * MU / LAMBDA)
    strain = 0.5 * MU * (stretch - 3 - torch.log(stretch + 1))
    return volume * (strain + 0.5 * LAMBDA * dilation**2)


def _baraff_witkin(torch: Any, x: Any, inverse: Any, area: Any) -> Any:
    f = (x[1:] - x[0]).T @ inverse
    u, v = f[:, 0], f[:, 1]
    stretch = (torch.sqrt(u @ u) - 1) ** 2 + (torch.sqrt(v @ v) - 1) ** 2
    return area * (STRETCH_STIFFNESS * stretch + SHEAR_STIFFNESS * (u @ v) ** 2)


def _hinge(torch: Any, x: Any, stiffness: Any) -> Any:
    edge, left, right = x[1] - x[0], x[2] - x[0], x[3] - x[0]
    first, second = _cross(torch, edge, left), _cross(torch, right, edge)
    difference = first / torch.sqrt(first @ first) - second / torch.sqrt(second @ second)
    return stiffness * (difference @ difference)


ENERGIES: dict[str, Callable[..., Any]] = {
    NEO_HOOKEAN.name: _neo_hookean,
    BARAFF_WITKIN.name: _baraff_witkin,
    HINGE.name: _hinge,
}


def torch_elements(elements: Elements, most: int, place: str = "cpu") -> ArrayPeer:
    """PyTorch's functions for at most `most` elements, on one thread from now on, or (place "cuda") on the first GPU.

    Raises ImportError when PyTorch is not installed, or sees no GPU.
    """
    torch: Any = import_module("torch")
    torch.set_num_threads(1)
    if place == "cuda" and not torch.cuda.is_available():
        raise ImportError("PyTorch sees no GPU")
    count = min(most, len(elements))
    corners = torch.from_numpy(elements.corners[:count].astype(np.int64)).to(place)
    given = elements.constants.values()
    constants = [torch.from_numpy(np.ascontiguousarray(array[:count])).to(place) for array in given]
    energy_of = ENERGIES[elements.kind.name]

    def energy(flat: Any, *own: Any) -> Any:
        return energy_of(torch, flat.reshape(-1, 3), *own)

    gradient_of = torch.func.vmap(torch.func.grad(energy))
    hessian_of = torch.func.vmap(torch.func.hessian(energy))

    def derivatives(x: Any) -> tuple[Any, Any]:
        own = x[corners].reshape(count, -1)
        return gradient_of(own, *constants), hessian_of(own, *constants)

    def projected(x: Any) -> tuple[Any, Any]:
        gradient, hessian = derivatives(x)
        values, vectors = torch.linalg.eigh(hessian)
        return gradient, (vectors * values.clamp(min=0.0)[:, None, :]) @ vectors.transpose(1, 2)

    def there_and_back(function: Callable[[Any], tuple[Any, Any]], x: FloatArray) -> tuple[FloatArray, FloatArray]:
        gradient, hessian = function(torch.from_numpy(x).to(place))
        return gradient.cpu().numpy(), hessian.cpu().numpy()

    def resident(x: FloatArray, project: bool) -> Callable[[], object]:
        there, function = torch.from_numpy(x).to(place), projected if project else derivatives

        def run() -> None:
            function(there)
            if place == "cuda":
                torch.cuda.synchronize()

        return run

    derive, derive_projected = partial(there_and_back, derivatives), partial(there_and_back, projected)
    return ArrayPeer("PyTorch", torch.__version__, count, derive, derive_projected, resident)
