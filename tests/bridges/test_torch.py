"""Energies as PyTorch functions, by PyTorch's own checks of derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bridge_scenes import springs_over_a_union

from yasps import DataError, ShapeMismatchError

torch = pytest.importorskip("torch", reason="pip install 'yasps[torch]'")

from yasps.bridges import EnergyFunction  # noqa: E402
from yasps.bridges.torch import energy_function  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore:.*torch[.]jit:FutureWarning")  # by torch.func, of torch itself


def made() -> tuple[Any, list[Any], EnergyFunction]:
    """A scene's energies as a function of tensors, where it stands, and the same function of NumPy arrays."""
    scene, inputs = springs_over_a_union()
    plain = EnergyFunction(scene, inputs)
    tensors = [torch.from_numpy(array).requires_grad_() for array in plain.numbers()]
    return energy_function(scene, inputs), tensors, plain


def test_gradients_by_torch() -> None:
    energy, tensors, _ = made()
    assert torch.autograd.gradcheck(energy, tensors, check_forward_ad=True)
    assert torch.autograd.gradgradcheck(energy, tensors, check_fwd_over_rev=True)


def test_values_and_second_derivatives() -> None:
    energy, tensors, plain = made()
    value = energy(*tensors)
    arrays = [tensor.detach().numpy() for tensor in tensors]
    assert value.item() == plain.value(*arrays)
    value.backward()
    for tensor, expected in zip(tensors, plain.gradient(*arrays), strict=True):
        np.testing.assert_array_equal(tensor.grad.numpy(), expected)
    hessian = plain.hessian(*arrays).toarray()
    rows = torch.autograd.functional.hessian(energy, tuple(tensors))
    sizes = [tensor.numel() for tensor in tensors]
    found = [
        [part.reshape(n, m).numpy() for part, m in zip(row, sizes, strict=True)]
        for row, n in zip(rows, sizes, strict=True)
    ]
    np.testing.assert_allclose(np.block(found), hessian, rtol=1e-13, atol=1e-13)


def test_transformations_of_torch_func() -> None:
    energy, tensors, plain = made()
    first, *rest = [tensor.detach() for tensor in tensors]
    hessian = torch.func.hessian(energy)(first, *rest).reshape(9, 9).numpy()
    expected = plain.hessian(*[tensor.numpy() for tensor in (first, *rest)]).toarray()[:9, :9]
    np.testing.assert_allclose(hessian, expected, rtol=1e-13, atol=1e-13)
    batch = torch.stack([first, 2 * first])
    slopes = torch.func.vmap(torch.func.grad(energy), in_dims=(0, None, None, None, None))(batch, *rest)
    alone = plain.gradient(batch[1].numpy(), *[tensor.numpy() for tensor in rest])[0]
    np.testing.assert_array_equal(slopes[1].numpy(), alone)


def test_refusals() -> None:
    energy, tensors, _ = made()
    with pytest.raises(DataError, match=r"argument 1 must be a float64 tensor, got torch\.float32"):
        energy(tensors[0], tensors[1].float(), *tensors[2:])
    with pytest.raises(ShapeMismatchError, match="in this order; got 1"):
        energy(tensors[0])
    with pytest.raises(DataError, match=r"argument 0 \(mesh\.free\.position\) needs"):
        energy(tensors[0][:2], *tensors[1:])
    with pytest.raises(DataError, match=r"argument 0 \(mesh\.free\.position\): entry 0 is nan"):
        energy(tensors[0] * torch.nan, *tensors[1:])
    (slope,) = torch.autograd.grad(energy(*tensors), tensors[0], create_graph=True)
    (second,) = torch.autograd.grad(slope.square().sum(), tensors[0], create_graph=True)
    with pytest.raises(NotImplementedError, match="third ones were asked for"):
        second.sum().backward()
    transposed = tensors[1].detach().transpose(1, 2).contiguous().transpose(1, 2)
    assert not transposed.is_contiguous()
    assert energy(tensors[0], transposed, *tensors[2:]).item() == energy(*tensors).item()
