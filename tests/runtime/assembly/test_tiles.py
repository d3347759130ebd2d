"""Blocks that lie across the border of two tiles, and pieces that touch little: what one thread adds is not lost."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from yasps.runtime.assembly.assembler import Assembler, KernelCall
from yasps.runtime.build.toolchain import Compiler, Source, compile_sources, link
from yasps.runtime.core import sink
from yasps.runtime.core.library import Runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix

TILE = sink.TILE
# Every slot's gradient entries become 1, 2, 3, .. times the instance's weight, and so do those of its diagonal block.
KERNEL = (
    sink.TEXT
    + """
extern "C" long energy(const void* const* args, long begin, long end, const yasps_sink* sink) {
    const double* weight = (const double*)args[0];
    for (long i = begin; i < end; ++i) {
        const int offset = sink->kappa[i] - 1, size = sink->block_size_at[offset];
        for (int j = 0; j < size; ++j) sink->gradient[offset + j] += weight[i] * (j + 1);
        if (!sink->tiles) continue;
        const long at = sink->position[i] >> 2;
        double* tile = sink->tiles[at >> 9];
        if (!tile) tile = sink->open_tile(sink, at >> 9);
        for (int j = 0; j < size * size; ++j) tile[(at & 511) + j] += weight[i] * (j + 1);
    }
    return -1;
}
"""
)


@pytest.fixture(scope="module")
def library(compiler: Compiler) -> ctypes.CDLL:
    return ctypes.CDLL(str(link(compile_sources([Source("test-tiles", KERNEL)], compiler), compiler).path))


@pytest.mark.parametrize("size", [3, 5, 12])
@pytest.mark.parametrize("deterministic", [False, True])
def test_a_piece_that_touches_nothing_but_a_block_across_a_border(
    runtime: Runtime, library: ctypes.CDLL, size: int, deterministic: bool
) -> None:
    """The last instances, of another piece than the first, all stand at the one block that two tiles share: of the
    gradient, and then of the matrix."""
    blocks = 3 * TILE // size
    across_gradient = TILE // size
    across_matrix = TILE // (size * size)  # only diagonal blocks: they follow each other
    assert (across_gradient * size) // TILE == 0 < (across_gradient * size + size - 1) // TILE
    assert (across_matrix * size * size + size * size - 1) // TILE == 1
    instances = 8 * 64
    for across in (across_gradient, across_matrix):
        block = np.zeros(instances, np.int64)
        block[instances // 2 :] = across
        kappa = (size * block[:, None] + 1).astype(np.int32)
        matrix = BlockMatrix(runtime)
        boundaries = np.array([0, size * blocks])
        position = matrix.build(boundaries, np.array([size], np.int32), [kappa])[0]
        weight = np.random.default_rng(0).uniform(1, 2, instances)
        arguments = (ctypes.c_void_p * 1)(weight.ctypes.data)
        function = ctypes.cast(library.energy, ctypes.c_void_p).value
        assert function is not None
        call = KernelCall(function, ctypes.addressof(arguments), instances, kappa, position)
        expected_gradient = np.zeros((blocks, size))
        np.add.at(expected_gradient, block, weight[:, None] * np.arange(1, size + 1))
        expected_values = np.zeros((blocks, size * size))
        np.add.at(expected_values, block, weight[:, None] * np.arange(1, size * size + 1))
        for threads in (1, 2, 3):
            gradient = np.full(size * blocks, 7.0)
            matrix.values[:] = 7.0
            Assembler(runtime, deterministic=deterministic).assemble(
                [call], [matrix], gradient, matrix.block_size_at, threads
            )
            np.testing.assert_allclose(gradient, expected_gradient.ravel(), rtol=1e-13)
            np.testing.assert_allclose(matrix.values, expected_values.ravel(), rtol=1e-13)


def test_instances_of_all_chunks_are_counted_when_tiles_are_marked(runtime: Runtime, library: ctypes.CDLL) -> None:
    """Two pieces take turns along the instances; each chunk has a tile of its own."""
    size, instances = 4, 8 * 32
    block = np.repeat(np.arange(8) * (TILE // size), instances // 8)  # the first block of each of eight tiles
    blocks = 8 * (TILE // size)
    kappa = (size * block[:, None] + 1).astype(np.int32)
    matrix = BlockMatrix(runtime)
    position = matrix.build(np.array([0, size * blocks]), np.array([size], np.int32), [kappa])[0]
    weight = np.arange(1.0, instances + 1)
    arguments = (ctypes.c_void_p * 1)(weight.ctypes.data)
    function = ctypes.cast(library.energy, ctypes.c_void_p).value
    assert function is not None
    call = KernelCall(function, ctypes.addressof(arguments), instances, kappa, position)
    for threads in (2, 3, 5):
        gradient = np.full(size * blocks, 7.0)
        Assembler(runtime).assemble([call], [matrix], gradient, matrix.block_size_at, threads)
        expected = np.zeros((blocks, size))
        np.add.at(expected, block, weight[:, None] * np.arange(1, size + 1))
        np.testing.assert_allclose(gradient, expected.ravel(), rtol=1e-13)


def test_new_indices_of_a_gradient_alone_are_noticed(runtime: Runtime, library: ctypes.CDLL) -> None:
    """Without a Hessian no placement of blocks tells that the indices are others."""
    size, instances, blocks = 4, 8 * 16, 2 * TILE
    weight = np.arange(1.0, instances + 1)
    arguments = (ctypes.c_void_p * 1)(weight.ctypes.data)
    function = ctypes.cast(library.energy, ctypes.c_void_p).value
    assert function is not None
    assembler = Assembler(runtime)
    sizes = np.tile(np.array([size, 0, 0, 0], np.int32), blocks)
    for first in (0, blocks // 2, blocks // 4):
        block = first + np.arange(instances)
        kappa = (size * block[:, None] + 1).astype(np.int32)
        call = KernelCall(function, ctypes.addressof(arguments), instances, kappa, None, None)
        gradient = np.full(size * blocks, 7.0)
        assembler.assemble([call], [], gradient, sizes, 2)
        expected = np.zeros((blocks, size))
        expected[block] = weight[:, None] * np.arange(1, size + 1)
        np.testing.assert_array_equal(gradient, expected.ravel())
