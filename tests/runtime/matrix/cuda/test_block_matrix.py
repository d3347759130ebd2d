"""Structure, positions and sums of the device's block matrix: its kernels run on the host, against the CPU runtime."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pytest
from cuda_on_host import HostDevice, HostMemory, HostProgram
from numpy.typing import NDArray

from yasps.runtime.build.cuda.sources import runtime_sources
from yasps.runtime.core.library import Runtime
from yasps.runtime.device.protocol import DeviceArray, DeviceMemoryError
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.matrix.cuda.block_matrix import BuildScratch, CudaBlockMatrix


@dataclass(frozen=True)
class RandomScene:
    """Targets with blocks of 1 to 12 scalars, some without instances; energies with gaps and repeated slots."""

    boundaries: NDArray[np.int64]
    block_sizes: NDArray[np.int32]
    kappas: list[NDArray[np.int32]]

    def size_of(self, slot: int) -> int:
        """Size of the dof block that a 1-based offset names."""
        return int(self.block_sizes[np.searchsorted(self.boundaries, slot - 1, side="right") - 1])


def random_scene(seed: int, most_blocks: int = 8, instances: int = 20) -> RandomScene:
    """Other sizes, targets and indices for every seed."""
    rng = np.random.default_rng(seed)
    targets = int(rng.integers(1, 6))
    sizes, counts = rng.integers(1, 13, targets), rng.integers(0, most_blocks, targets)
    counts[rng.integers(targets)] += 1
    boundaries = np.concatenate([[0], np.cumsum(sizes * counts)])
    starts = np.concatenate(
        [np.arange(first, end, q) for first, end, q in zip(boundaries, boundaries[1:], sizes, strict=False)]
    )
    kappas = []
    for capacity in (4, 1, 2, 5, 3):
        n = 0 if capacity == 2 else int(rng.integers(1, instances))
        kappa = rng.choice(starts, (n, capacity)) + 1
        kappa[rng.random(kappa.shape) < 0.2] = 0
        repeated = rng.random(n) < 0.3
        kappa[repeated, -1] = kappa[repeated, 0]
        kappas.append(kappa.astype(np.int32))
    return RandomScene(boundaries, sizes.astype(np.int32), [*kappas, kappas[0][:5].copy()])


class CountingDevice(HostDevice):
    """Counts what waits for the device."""

    downloads = 0

    def download(self, address: int, array: NDArray[Any]) -> None:
        """As on the host."""
        self.downloads += 1
        super().download(address, array)


class RefusingDevice(HostDevice):
    """Has no room after some allocations."""

    granted = 1000

    def allocate(self, size: int, purpose: str) -> HostMemory:
        """As on the host, as long as it is granted."""
        if self.granted == 0:
            raise DeviceMemoryError(f"no room for {purpose}")
        self.granted -= 1
        return super().allocate(size, purpose)


@pytest.fixture(scope="module")
def program() -> HostProgram:
    """The kernels of structure.cu."""
    return HostDevice().load([source.text for source in runtime_sources() if source.name == "structure"])


@pytest.fixture
def device() -> CountingDevice:
    """A device whose fresh memory is full of rubbish."""
    return CountingDevice()


def upload(device: HostDevice, kappas: Sequence[NDArray[Any]]) -> list[DeviceArray]:
    """Index arrays on the device."""
    return [DeviceArray(device, np.int32, "kappa").upload(kappa) for kappa in kappas]


def read(device: HostDevice, address: int, count: int) -> NDArray[np.int32]:
    """int32 numbers at an address of the device."""
    array = np.empty(count, np.int32)
    device.download(address, array)
    return array


def build_both(
    runtime: Runtime, matrix: CudaBlockMatrix, layout: tuple[Any, Any], kappas: list[Any], *, with_diagonal: bool = True
) -> tuple[BlockMatrix, list[NDArray[np.int64]], list[NDArray[np.int64]]]:
    """Builds the matrix, and one on the CPU; returns that with the positions of both."""
    expected = BlockMatrix(runtime, with_diagonal)
    expected_positions = expected.build(*layout, kappas)
    positions = matrix.build(*layout, upload(matrix.device, kappas))
    return expected, expected_positions, [position.download() for position in positions]


def assert_same_structure(matrix: CudaBlockMatrix, expected: BlockMatrix) -> None:
    """All that the two say about dof blocks and global blocks."""
    assert matrix.size == expected.size
    assert matrix.block_count == expected.block_count
    np.testing.assert_array_equal(matrix.block_size_at.download(), expected.block_size_at)
    starts = np.flatnonzero(expected.block_size_at)
    np.testing.assert_array_equal(matrix.block_start.download(), starts)
    np.testing.assert_array_equal(matrix.block_size.download(), expected.block_size_at[starts])
    diagonal = dict.fromkeys(starts.tolist(), -1)
    assert len(matrix.groups) == len(expected.groups)
    first_value = 0
    for group, host in zip(matrix.groups, expected.groups, strict=True):
        assert (group.r, group.c, group.count) == host.values.shape[1:] + host.values.shape[:1]
        assert group.first_value == first_value
        np.testing.assert_array_equal(read(matrix.device, group.rows, group.count), host.rows)
        np.testing.assert_array_equal(read(matrix.device, group.cols, group.count), host.cols)
        for k in np.flatnonzero(host.rows == host.cols).tolist():
            diagonal[int(host.rows[k])] = first_value + k * group.r * group.c
        first_value += host.values.size
    assert matrix.values.shape == (first_value,)
    np.testing.assert_array_equal(matrix.diagonal.download(), list(diagonal.values()))


def sources_of(scene: RandomScene, rng: np.random.Generator) -> list[tuple[int, int, int, NDArray[np.float64]]]:
    """Energy, instance, pair, and a random block, for all local blocks; of sizes that make the order of sums show."""
    sources = []
    for energy, kappa in enumerate(scene.kappas):
        rows, cols = np.triu_indices(kappa.shape[1])
        for instance, slots in enumerate(kappa):
            for pair, (a, b) in enumerate(zip(rows, cols, strict=True)):
                if slots[a] and slots[b]:
                    shape = scene.size_of(int(slots[a])), scene.size_of(int(slots[b]))
                    block = rng.standard_normal(shape) * 10.0 ** rng.integers(-8, 8)
                    sources.append((energy, instance, pair, block))
    return sources


def scatter(values: NDArray[np.float64], positions: list[NDArray[np.int64]], sources: list[Any]) -> None:
    """Adds all local blocks in order, as generated code does."""
    for energy, instance, pair, block in sources:
        offset, flags = divmod(int(positions[energy][instance, pair]), 4)
        turned = block.T if flags & 1 else block
        values[offset : offset + block.size] += (turned + turned.T if flags & 2 else turned).reshape(-1)


def assemble(matrix: CudaBlockMatrix, positions: list[NDArray[np.int64]], sources: list[Any]) -> NDArray[np.float64]:
    """The matrix's values after all local blocks were added to its target."""
    matrix.clear()
    target = matrix.target.download()
    assert not target.any()
    scatter(target, positions, sources)
    matrix.target.upload(target)
    matrix.finish()
    return matrix.values.download()


@pytest.mark.parametrize("with_diagonal", [True, False])
@pytest.mark.parametrize("seed", range(6))
def test_structure_and_positions_are_those_of_the_cpu(
    runtime: Runtime, program: HostProgram, device: CountingDevice, seed: int, with_diagonal: bool
) -> None:
    scene = random_scene(seed)
    matrix = CudaBlockMatrix(device, program, with_diagonal=with_diagonal)
    layout = (scene.boundaries, scene.block_sizes)
    expected, theirs, ours = build_both(runtime, matrix, layout, scene.kappas, with_diagonal=with_diagonal)
    assert_same_structure(matrix, expected)
    assert not matrix.values.download().any()
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(a, b)
    sources = sources_of(scene, np.random.default_rng(1))
    scatter(expected.values, theirs, sources)
    np.testing.assert_array_equal(assemble(matrix, ours, sources), expected.values)
    for group, host in zip(matrix.download_groups(), expected.groups, strict=True):
        np.testing.assert_array_equal(group.rows, host.rows)
        np.testing.assert_array_equal(group.cols, host.cols)
        np.testing.assert_array_equal(group.values, host.values)


@pytest.mark.parametrize("with_diagonal", [True, False])
@pytest.mark.parametrize("seed", range(6))
def test_deterministic_sums_go_in_the_order_of_the_sources(
    runtime: Runtime, program: HostProgram, device: CountingDevice, seed: int, with_diagonal: bool
) -> None:
    scene = random_scene(seed)
    matrix = CudaBlockMatrix(device, program, with_diagonal=with_diagonal, deterministic=True)
    layout = (scene.boundaries, scene.block_sizes)
    expected, theirs, ours = build_both(runtime, matrix, layout, scene.kappas, with_diagonal=with_diagonal)
    assert_same_structure(matrix, expected)
    assert not matrix.values.download().any()
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(a < 0, b < 0)
        np.testing.assert_array_equal(a & 3, b & 3)
    sources = sources_of(scene, np.random.default_rng(2))
    scatter(expected.values, theirs, sources)
    shuffled = [sources[k] for k in np.random.default_rng(3).permutation(len(sources))]
    np.testing.assert_array_equal(assemble(matrix, ours, shuffled), expected.values)


def test_many_blocks_of_threads(runtime: Runtime, program: HostProgram, device: CountingDevice) -> None:
    scene = random_scene(10, most_blocks=300, instances=700)
    matrix = CudaBlockMatrix(device, program)
    layout = (scene.boundaries, scene.block_sizes)
    expected, theirs, ours = build_both(runtime, matrix, layout, scene.kappas)
    assert sum(position.size for position in ours) > 3000
    assert_same_structure(matrix, expected)
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("deterministic", [False, True])
def test_build_again_with_other_sizes(
    runtime: Runtime, program: HostProgram, device: CountingDevice, deterministic: bool
) -> None:
    scenes = [random_scene(seed) for seed in (21, 22)]
    matrix = CudaBlockMatrix(device, program, with_diagonal=False, deterministic=deterministic)
    for scene, part in [(0, slice(None)), (0, slice(0)), (0, slice(1, 3)), (1, slice(None)), (0, slice(None))]:
        case = scenes[scene]
        kappas = case.kappas[part]
        layout = (case.boundaries, case.block_sizes)
        expected, theirs, ours = build_both(runtime, matrix, layout, kappas, with_diagonal=False)
        assert_same_structure(matrix, expected)
        sources = [source for source in sources_of(case, np.random.default_rng(5)) if part == slice(None)]
        scatter(expected.values, theirs, sources)
        np.testing.assert_array_equal(assemble(matrix, ours, sources), expected.values)


def test_building_again_needs_no_memory_one_download_and_few_launches(
    program: HostProgram, device: CountingDevice
) -> None:
    scene = random_scene(3)
    matrix = CudaBlockMatrix(device, program, with_diagonal=False)
    layout = (scene.boundaries, scene.block_sizes)
    kappas = upload(device, scene.kappas)
    positions = matrix.build(*layout, kappas)
    used, device.downloads = device.used, 0
    device.launches.clear()
    smaller = matrix.build(*layout, kappas[:2])
    assert device.downloads == 1
    assert len(device.launches) == 5
    assert all(a is b for a, b in zip(positions, smaller, strict=False)), "the same arrays, overwritten"
    matrix.build(*layout, kappas)
    assert device.used == used


def test_builds_can_share_scratch(runtime: Runtime, program: HostProgram, device: CountingDevice) -> None:
    scene = random_scene(7)
    scratch = BuildScratch(device)
    static = CudaBlockMatrix(device, program, scratch=scratch)
    dynamic = CudaBlockMatrix(device, program, with_diagonal=False, scratch=scratch)
    layout = (scene.boundaries, scene.block_sizes)
    expected, theirs, _ = build_both(runtime, static, layout, scene.kappas[:3])
    positions = static.build(*layout, upload(device, scene.kappas[:3]))
    dynamic.build(*layout, upload(device, scene.kappas))
    assert_same_structure(static, expected)
    for a, b in zip(positions, theirs, strict=True):
        np.testing.assert_array_equal(a.download(), b)


EMPTY = np.zeros((0, 3), np.int32)


@pytest.mark.parametrize(
    ("boundaries", "sizes", "kappas"),
    [
        ([0], [], []),
        ([0], [], [np.zeros((2, 2), np.int32), EMPTY]),
        ([0, 0], [3], [EMPTY]),
        ([0, 1], [1], [np.array([[1]], np.int32)]),
        ([0, 6], [3], []),
        ([0, 6], [3], [EMPTY, np.zeros((5, 0), np.int32), np.zeros((4, 2), np.int32)]),
        ([0, 6], [3], [EMPTY, np.array([[4, 0, 4], [0, 4, 1]], np.int32), np.zeros((5, 0), np.int32), EMPTY]),
        ([0, 0, 24, 24, 25], [2, 12, 5, 1], [np.array([[25, 13], [0, 25]], np.int32)]),
    ],
)
def test_next_to_nothing(
    runtime: Runtime,
    program: HostProgram,
    boundaries: list[int],
    sizes: list[int],
    kappas: list[NDArray[np.int32]],
) -> None:
    layout = (np.array(boundaries), np.array(sizes, np.int32))
    for with_diagonal, deterministic in product((False, True), repeat=2):
        matrix = CudaBlockMatrix(HostDevice(), program, with_diagonal=with_diagonal, deterministic=deterministic)
        expected, theirs, ours = build_both(runtime, matrix, layout, kappas, with_diagonal=with_diagonal)
        assert_same_structure(matrix, expected)
        for a, b in zip(ours, theirs, strict=True):
            assert a.shape == b.shape
            np.testing.assert_array_equal(a < 0, b < 0)
        assert not assemble(matrix, ours, []).any()


def test_a_matrix_that_was_never_built(program: HostProgram, device: CountingDevice) -> None:
    matrix = CudaBlockMatrix(device, program)
    assert (matrix.size, matrix.block_count, matrix.groups) == (0, 0, [])
    assert repr(matrix) == "CudaBlockMatrix(0 x 0, blocks: none)"
    matrix.clear()
    matrix.finish()
    matrix.build(np.array([0, 6]), np.array([3], np.int32), upload(device, [np.array([[1, 4]])]))
    assert repr(matrix) == "CudaBlockMatrix(6 x 6, blocks: 3 of 3x3)"


@pytest.mark.parametrize("slot", [2, 3, 10, -2, 2**31 - 1, -(2**31)])
@pytest.mark.parametrize("boundaries", [[0, 9], [0, 9, 9]])
def test_wrong_index_is_refused_and_changes_nothing(
    runtime: Runtime, program: HostProgram, device: CountingDevice, slot: int, boundaries: list[int]
) -> None:
    matrix = CudaBlockMatrix(device, program)
    sizes = np.full(len(boundaries) - 1, 3, np.int32)
    good = np.array([[1, 4], [4, 7]], np.int32)
    expected, theirs, _ = build_both(runtime, matrix, (np.array([0, 9]), np.array([3], np.int32)), [good])
    positions = matrix.build(np.array([0, 9]), np.array([3], np.int32), upload(device, [good]))
    values = np.random.default_rng(0).standard_normal(matrix.values.size)
    matrix.values.upload(values)
    bad = np.array([[1, 4, 7], [0, 4, slot], [slot, 2, 3]], np.int32)
    with pytest.raises(ValueError, match=rf"index {slot} in kappas\[1\]\[1, 2\] is not") as ours:
        matrix.build(np.array(boundaries), sizes, upload(device, [good, bad, bad]))
    with pytest.raises(ValueError, match="index") as cpu:
        BlockMatrix(runtime).build(np.array(boundaries), sizes, [good, bad, bad], 1)
    assert str(ours.value) == str(cpu.value)
    assert_same_structure(matrix, expected)
    np.testing.assert_array_equal(matrix.values.download(), values)
    np.testing.assert_array_equal(positions[0].download(), theirs[0])


@pytest.mark.parametrize(
    ("boundaries", "sizes", "message"),
    [
        ([0, 9], [3, 3], "T targets need"),
        ([1, 9], [3], "start at 0"),
        ([0, 9, 6], [3, 3], "never fall"),
        ([0, 10], [3], "target 0 has 10 scalars"),
        ([0, 2**29], [1], "the runtime can index at most"),
        ([0, 2**29 - 11, 2**29 - 9, 2**29 - 6, 2**29 - 2], [1, 2, 3, 4], "need keys of 63 bits"),
    ],
)
def test_layouts_that_contradict_or_are_too_large_are_refused(
    program: HostProgram, device: CountingDevice, boundaries: list[int], sizes: list[int], message: str
) -> None:
    matrix = CudaBlockMatrix(device, program, with_diagonal=False)
    with pytest.raises(ValueError, match=message):
        matrix.build(np.array(boundaries), np.array(sizes, np.int32), [])
    assert matrix.size == 0


def test_wrong_or_too_many_indices_are_refused(program: HostProgram, device: CountingDevice) -> None:
    layout = (np.array([0, 9]), np.array([3], np.int32))
    good = DeviceArray(device, np.int32, "kappa").upload(np.array([[1, 4]]))
    matrix = CudaBlockMatrix(device, program)
    matrix.build(*layout, [good])
    for dtype, shape in ((np.int32, (4,)), (np.int64, (2, 2)), (np.float64, (2, 2))):
        wrong = DeviceArray(device, dtype, "kappa").resize(*shape)
        with pytest.raises(ValueError, match=r"kappas\[1\] has shape .*int32 of shape \[instances, slots\] is needed"):
            matrix.build(*layout, [good, wrong])
    huge = DeviceArray(device, np.int32, "kappa")
    huge.shape = (2**32 - 3, 1)  # one too many with the diagonal; nothing may read it
    with pytest.raises(ValueError, match=r"more than 2\^32 local blocks"):
        matrix.build(*layout, [huge])
    assert matrix.block_count == 4


@pytest.mark.parametrize("deterministic", [False, True])
def test_out_of_memory_leaves_a_matrix_that_can_be_built_again(
    runtime: Runtime, program: HostProgram, deterministic: bool
) -> None:
    """Each allocation fails once."""
    scene = random_scene(8, most_blocks=30, instances=100)
    layout, small = (scene.boundaries, scene.block_sizes), [scene.kappas[1][:2]]
    refusals, kept = 0, 0
    while True:
        device = RefusingDevice()
        matrix = CudaBlockMatrix(device, program, deterministic=deterministic)
        before, _, _ = build_both(runtime, matrix, layout, small)
        kappas = upload(device, scene.kappas)
        device.granted = refusals
        try:
            matrix.build(*layout, kappas)
        except DeviceMemoryError:
            assert_same_structure(matrix, before if matrix.size else BlockMatrix(runtime))
            refusals += 1
            kept += 1 if matrix.size else 0
        else:
            break
        device.granted = 1000
        expected, _, _ = build_both(runtime, matrix, layout, scene.kappas)
        assert_same_structure(matrix, expected)
    assert kept >= 4, "keys and sources, before and after sorting"
    assert refusals - kept >= (10 if deterministic else 8), "positions, rows, columns, and values"
