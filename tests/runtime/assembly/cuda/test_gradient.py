"""The device's gradient, by atomic additions and in a fixed order: its kernels run on the host."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from counting_device import RefusingDevice
from cuda_on_host import HostDevice, HostProgram
from numpy.typing import NDArray

from yasps import DeviceMemoryError
from yasps.runtime.assembly.cuda.gradient import CudaGradient
from yasps.runtime.build.cuda.sources import runtime_sources
from yasps.runtime.device.protocol import DeviceArray


@pytest.fixture(scope="module")
def program() -> HostProgram:
    """The kernels of structure.cu."""
    return HostDevice().load([source.text for source in runtime_sources() if source.name == "structure"])


@pytest.fixture
def device() -> HostDevice:
    """A device whose fresh memory is full of rubbish."""
    return HostDevice()


def on_device(device: HostDevice, array: NDArray[Any]) -> DeviceArray:
    """int32 numbers on the device."""
    return DeviceArray(device, np.int32, "test").upload(array)


def random_slots(seed: int, most_blocks: int = 9, instances: int = 30) -> tuple[NDArray[np.int32], list[Any]]:
    """The sizes of dof blocks by scalar offset; index arrays with gaps, repeated slots, and one without instances."""
    rng = np.random.default_rng(seed)
    sizes = rng.integers(1, 13, rng.integers(1, most_blocks))
    starts = np.concatenate([[0], np.cumsum(sizes)])
    size_at = np.zeros(starts[-1], np.int32)
    size_at[starts[:-1]] = sizes
    shapes = [(instances, 4), (0, 2), (7, 1), (3, 0), (instances, 3)]
    kappas = [rng.choice(starts[:-1], shape) + 1 for shape in shapes]
    return size_at, [np.where(rng.random(kappa.shape) < 0.2, 0, kappa).astype(np.int32) for kappa in kappas]


def scatter(size_at: NDArray[np.int32], kappas: list[Any], positions: list[Any], out: NDArray[np.float64]) -> None:
    """Adds random numbers of very different sizes at the positions, in the order of energies, instances and slots."""
    rng = np.random.default_rng(0)
    for kappa, position in zip(kappas, positions, strict=True):
        for index, at in zip(kappa.reshape(-1).tolist(), position.reshape(-1).tolist(), strict=True):
            if index:
                q = size_at[index - 1]
                out[at : at + q] += rng.standard_normal(q) * 10.0 ** rng.integers(-8, 8)


@pytest.mark.parametrize("seed", range(5))
def test_sums_go_in_the_order_of_the_sources(program: HostProgram, device: HostDevice, seed: int) -> None:
    size_at, kappas = random_slots(seed, *((60, 300) if seed == 4 else (9, 30)))
    gradient = CudaGradient(device, program, deterministic=True)
    for part in (kappas, kappas[1:4], [], [np.zeros((5, 2), np.int32)], kappas):
        positions = gradient.build(size_at.size, on_device(device, size_at), [on_device(device, k) for k in part])
        assert not gradient.values.download().any()
        gradient.clear()
        target = gradient.target.download()
        assert not target.any()
        ours = [position.download() for position in positions if position is not None]
        for kappa, position in zip(part, ours, strict=True):
            np.testing.assert_array_equal(position < 0, kappa == 0)
        scatter(size_at, part, ours, target)
        gradient.target.upload(target)
        gradient.finish()
        expected = np.zeros(size_at.size)
        scatter(size_at, part, [kappa - 1 for kappa in part], expected)
        np.testing.assert_array_equal(gradient.values.download(), expected)


def test_without_a_fixed_order_kernels_add_to_the_values(program: HostProgram, device: HostDevice) -> None:
    size_at, kappas = random_slots(1)
    gradient = CudaGradient(device, program)
    assert (
        gradient.build(size_at.size, on_device(device, size_at), [on_device(device, k) for k in kappas]) == [None] * 5
    )
    assert gradient.target is gradient.values
    assert not gradient.values.download().any()
    gradient.values.upload(np.ones(size_at.size))
    gradient.finish()
    assert gradient.values.download().all()
    gradient.clear()
    assert not gradient.values.download().any()
    assert device.launches == []


@pytest.mark.parametrize("slot", [2, 3, 8, -1, 2**31 - 1, -(2**31)])
def test_wrong_index_is_refused_and_changes_nothing(program: HostProgram, device: HostDevice, slot: int) -> None:
    size_at = np.array([3, 0, 0, 2, 0, 1, 1], np.int32)
    gradient = CudaGradient(device, program, deterministic=True)
    good = on_device(device, np.array([[1, 4], [7, 0]]))
    sizes = on_device(device, size_at)
    (position,) = gradient.build(7, sizes, [good])
    assert position is not None
    before = position.download()
    gradient.target.upload(np.arange(1.0, 7.0))
    bad = on_device(device, np.array([[0, 4], [1, slot], [slot, 5]]))
    with pytest.raises(
        ValueError, match=rf"index {slot} in kappas\[1\]\[1, 1\] is not the 1-based offset .* 7 unknown"
    ):
        gradient.build(7, sizes, [good, bad])
    np.testing.assert_array_equal(position.download(), before)
    gradient.finish()
    np.testing.assert_array_equal(gradient.values.download(), [1, 2, 3, 4, 5, 0, 6])


def test_arrays_that_do_not_fit_are_refused(program: HostProgram, device: HostDevice) -> None:
    gradient = CudaGradient(device, program, deterministic=True)
    sizes = on_device(device, np.ones(3))
    with pytest.raises(ValueError, match=r"block_size_at is int32 \(3,\), but the gradient needs int32 \(4,\)"):
        gradient.build(4, sizes, [])
    with pytest.raises(ValueError, match=r"kappas\[0\] has shape \(3,\)"):
        gradient.build(3, sizes, [sizes])
    huge = DeviceArray(device, np.int32, "kappa")
    huge.shape = (2**31, 2)  # nothing may read it
    with pytest.raises(ValueError, match=r"more than 2\^32 slots"):
        gradient.build(3, sizes, [huge])
    assert gradient.size == 0


def test_no_unknowns(program: HostProgram, device: HostDevice) -> None:
    gradient = CudaGradient(device, program, deterministic=True)
    nothing = on_device(device, np.zeros(0))
    gradient.build(0, nothing, [on_device(device, np.zeros((2, 2)))])
    gradient.clear()
    gradient.finish()
    assert gradient.values.download().shape == (0,)


def test_out_of_memory_leaves_a_gradient_that_can_be_built_again(program: HostProgram) -> None:
    """Each allocation fails once."""
    size_at, kappas = random_slots(3, 30, 200)
    refusals = 0
    while True:
        device = RefusingDevice()
        gradient = CudaGradient(device, program, deterministic=True)
        sizes, slots = on_device(device, size_at), [on_device(device, kappa) for kappa in kappas]
        device.granted = refusals
        try:
            gradient.build(size_at.size, sizes, slots)
        except DeviceMemoryError:
            refusals += 1
        else:
            break
        assert gradient.size == 0
        device.granted = 1000
        gradient.build(size_at.size, sizes, slots)
        gradient.clear()
        gradient.finish()
        np.testing.assert_array_equal(gradient.values.download(), np.zeros(size_at.size))
    assert refusals > 5
