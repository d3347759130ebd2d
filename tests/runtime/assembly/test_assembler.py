"""Assembly with a hand-written kernel that follows the interface of generated code, against dense NumPy sums."""

from __future__ import annotations

import ctypes
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from yasps.runtime.assembly.assembler import Assembler, KernelCall, evaluate
from yasps.runtime.build.toolchain import Compiler, Source, compile_sources, link
from yasps.runtime.core import sink
from yasps.runtime.core.library import Projection, Runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix

# E_i = 1/2 s_i (sum_a sum_j w_a x_{a,j} (j + 1))^2 over the slots a: gradient s f L and Hessian s L L^T, with
# L = w_a (j + 1). Instances with s < 0 are projected (then their Hessian is 0). A scale that is not finite is reported.
KERNEL = (
    sink.TEXT
    + """
extern "C" long energy(const void* const* args, long begin, long end, const yasps_sink* sink) {
    const double* x = (const double*)args[0];
    const double* scale = (const double*)args[1];
    const long c = *(const long*)args[2];
    if (begin % 8 != 0) return begin;
    for (long i = begin; i < end; ++i) {
        const int* kappa = sink->kappa + i * c;
        double s = scale[i];
        if (s == 1e300) return YASPS_NO_MEMORY;
        if (!(s - s == 0)) return i;
        double f = 0;
        for (long a = 0; a < c; ++a) {
            if (!kappa[a]) continue;
            const int o = kappa[a] - 1;
            for (int j = 0; j < sink->block_size_at[o]; ++j) f += (a + 1) * x[o + j] * (j + 1);
        }
        for (long a = 0; a < c; ++a) {
            if (!kappa[a]) continue;
            const int o = kappa[a] - 1;
            for (int j = 0; j < sink->block_size_at[o]; ++j) sink->gradient[o + j] += s * f * (a + 1) * (j + 1);
        }
        if (!sink->tiles) continue;
        double packed[8] = {s, 0, 0, 0, 0, 0, 0, 0};
        const long changed = sink->project(packed, 1, 1, sink->mode);
        if (changed < 0) return i;
        *sink->projected += changed;
        s = packed[0];
        const long* position = sink->position + i * (c * (c + 1) / 2);
        for (long a = 0; a < c; ++a) {
            for (long b = a; b < c; ++b, ++position) {
                if (*position < 0) continue;
                const int p = sink->block_size_at[kappa[a] - 1], q = sink->block_size_at[kappa[b] - 1];
                const long offset = *position >> 2;
                double* to = sink->tiles[offset >> 9];
                if (!to) to = sink->open_tile(sink, offset >> 9);
                to += offset & 511;
                for (int j = 0; j < p; ++j) {
                    for (int k = 0; k < q; ++k) {
                        const double h = s * (a + 1) * (j + 1) * (b + 1) * (k + 1);
                        if (*position & 1) to[k * p + j] += h; else to[j * q + k] += h;
                        if (*position & 2) to[k * q + j] += h;
                    }
                }
            }
        }
    }
    return -1;
}
extern "C" void value(const void* const* args, long begin, long end, double* out) {
    const double* scale = (const double*)args[1];
    for (long i = begin; i < end; ++i) out[i] = scale[i] + (begin % 8 == 0 ? 0 : 1e9);
}
"""
)


@dataclass
class Kernels:
    """Addresses of the compiled functions; `library` keeps them loaded."""

    library: ctypes.CDLL
    energy: int
    value: int


@pytest.fixture(scope="module")
def kernels(compiler: Compiler) -> Kernels:
    """The hand-written kernel, compiled as a generated one would be."""
    path = link(compile_sources([Source("test-assembly", KERNEL)], compiler), compiler).path
    library = ctypes.CDLL(str(path))

    def address(name: str) -> int:
        value = ctypes.cast(getattr(library, name), ctypes.c_void_p).value
        assert value is not None
        return value

    return Kernels(library, address("energy"), address("value"))


class Arguments:
    """The argument array of one kernel, and what it points to."""

    def __init__(self, x: np.ndarray, scale: np.ndarray, capacity: int) -> None:
        """Keep the arrays alive with the pointers."""
        self.keep = (x, scale, np.array([capacity], np.int64))
        self.pointers = (ctypes.c_void_p * 3)(*(array.ctypes.data for array in self.keep))

    @property
    def address(self) -> int:
        """Where the array of pointers lies."""
        return ctypes.addressof(self.pointers)


class Problem:
    """A static matrix for the first energies of a scene and a dynamic one for the rest."""

    def __init__(self, runtime: Runtime, kernels: Kernels, scene: Any, seed: int = 0) -> None:
        """Random positions and scales, some of them negative."""
        rng = np.random.default_rng(seed)
        self.scene = scene
        self.x = rng.standard_normal(scene.size)
        self.scales = [rng.standard_normal(kappa.shape[0]) for kappa in scene.kappas]
        self.parts = [BlockMatrix(runtime), BlockMatrix(runtime, with_diagonal=False)]
        self.positions = self.parts[0].build(scene.boundaries, scene.block_sizes, scene.kappas[:3])
        self.positions += self.parts[1].build(scene.boundaries, scene.block_sizes, scene.kappas[3:])
        self.arguments = [
            Arguments(self.x, scale, kappa.shape[1]) for scale, kappa in zip(self.scales, scene.kappas, strict=True)
        ]
        self.kernels = kernels

    def calls(self, mode: Projection = Projection.CLAMP, gradient_only: bool = False) -> list[KernelCall]:
        """One call per energy."""
        return [
            KernelCall(
                self.kernels.energy,
                arguments.address,
                kappa.shape[0],
                kappa,
                None if gradient_only else position,
                0 if e < 3 else 1,
                mode,
            )
            for e, (arguments, kappa, position) in enumerate(
                zip(self.arguments, self.scene.kappas, self.positions, strict=True)
            )
        ]

    def expected(self, mode: Projection) -> tuple[np.ndarray, np.ndarray]:
        """Gradient and Hessian by dense sums."""
        size = self.scene.size
        gradient, hessian = np.zeros(size), np.zeros((size, size))
        for kappa, scale in zip(self.scene.kappas, self.scales, strict=True):
            for slots, s in zip(kappa, scale, strict=True):
                line = np.zeros(size)
                for a, slot in enumerate(slots):
                    if slot > 0:
                        q = self.scene.size_of(int(slot))
                        line[slot - 1 : slot - 1 + q] += (a + 1) * np.arange(1, q + 1)
                gradient += s * (line @ self.x) * line
                projected = {Projection.CLAMP: max(s, 0), Projection.ABS: abs(s), Projection.NONE: s}[mode]
                hessian += projected * np.outer(line, line)
        return gradient, hessian


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("mode", list(Projection))
def test_assembles_the_dense_sum(
    runtime: Runtime, kernels: Kernels, scene: Any, threads: int, mode: Projection
) -> None:
    problem = Problem(runtime, kernels, scene)
    gradient = np.full(scene.size, 7.0)  # what was there is overwritten
    for part in problem.parts:
        part.values[:] = 7.0
    assembler = Assembler(runtime)
    sizes = problem.parts[0].block_size_at
    for _ in range(2):  # the second time with memory that was used before
        statuses = assembler.assemble(problem.calls(mode), problem.parts, gradient, sizes, threads)
    g, h = problem.expected(mode)
    np.testing.assert_allclose(gradient, g, rtol=1e-11, atol=1e-9)
    total = sum(part.to_scipy().toarray() for part in problem.parts)
    np.testing.assert_allclose(total, h, rtol=1e-11, atol=1e-9)
    assert [status.first_bad for status in statuses] == [None] * len(statuses)
    negative = [int((scale < 0).sum()) for scale in problem.scales]
    assert [status.projected for status in statuses] == ([0] * 6 if mode == Projection.NONE else negative)


@pytest.mark.parametrize("threads", [1, 2])
def test_gradient_alone(runtime: Runtime, kernels: Kernels, scene: Any, threads: int) -> None:
    problem = Problem(runtime, kernels, scene)
    gradient = np.empty(scene.size)
    sizes = problem.parts[0].block_size_at
    Assembler(runtime).assemble(problem.calls(gradient_only=True), [], gradient, sizes, threads)
    np.testing.assert_allclose(gradient, problem.expected(Projection.NONE)[0], rtol=1e-11, atol=1e-9)


def test_same_bits_every_time(runtime: Runtime, kernels: Kernels, scene: Any) -> None:
    problem = Problem(runtime, kernels, scene)
    assembler = Assembler(runtime)
    sizes = problem.parts[0].block_size_at
    results = []
    for _ in range(4):
        gradient = np.empty(scene.size)
        assembler.assemble(problem.calls(), problem.parts, gradient, sizes, 2)
        results.append(gradient.tobytes() + b"".join(part.values.tobytes() for part in problem.parts))
    assert len(set(results)) == 1


def test_many_tiles(runtime: Runtime, kernels: Kernels) -> None:
    """Enough blocks that threads touch different parts of their private copies, in changing patterns."""
    n = 2000
    rng = np.random.default_rng(0)
    assembler = Assembler(runtime)
    matrix = BlockMatrix(runtime)
    for width in (n - 1, 500, n - 1):
        starts = rng.integers(0, width, (width, 2))
        kappa = (3 * starts + 1).astype(np.int32)
        position = matrix.build(np.array([0, 3 * n]), np.array([3], np.int32), [kappa])[0]
        x, scale = rng.standard_normal(3 * n), rng.uniform(0, 1, width)
        arguments = Arguments(x, scale, 2)
        call = KernelCall(kernels.energy, arguments.address, width, kappa, position)
        values = []
        for threads in (1, 4):
            gradient = np.empty(3 * n)
            assembler.assemble([call], [matrix], gradient, matrix.block_size_at, threads)
            values.append((gradient, matrix.values.copy()))
        np.testing.assert_allclose(values[0][0], values[1][0], rtol=1e-12, atol=1e-10)
        np.testing.assert_allclose(values[0][1], values[1][1], rtol=1e-12, atol=1e-12)
        assert values[0][1].any()


def test_tiles_with_blocks_of_several_shapes(runtime: Runtime, kernels: Kernels) -> None:
    """Blocks that begin in one tile and end in the next, tiles that hold the end of one shape and the start of another,
    and tiles that no instance touches."""
    n, sizes = 300, np.array([3, 5, 1], np.int32)
    boundaries = np.cumsum([0, *(n * sizes)])
    rng = np.random.default_rng(5)
    touched = rng.integers(n // 3, n, (1500, 3))
    kappa = (boundaries[:3] + touched * sizes + 1).astype(np.int32)
    matrix = BlockMatrix(runtime)
    position = matrix.build(boundaries, sizes, [kappa])[0]
    arguments = Arguments(rng.standard_normal(boundaries[-1]), rng.uniform(0, 1, len(kappa)), 3)
    call = KernelCall(kernels.energy, arguments.address, len(kappa), kappa, position)
    values = []
    for threads in (1, 2, 7):
        matrix.values[:] = 7.0
        gradient = np.full(boundaries[-1], 7.0)
        Assembler(runtime).assemble([call], [matrix], gradient, matrix.block_size_at, threads)
        values.append((gradient, matrix.values.copy()))
    assert matrix.values.size > 20 * 512
    (of_shape,) = [group for group in matrix.groups if (group.r, group.c) == (5, 5)]
    assert not of_shape.values[: n // 3].any()
    for gradient, found in values[1:]:
        np.testing.assert_allclose(gradient, values[0][0], rtol=1e-11, atol=1e-9)
        np.testing.assert_allclose(found, values[0][1], rtol=1e-12, atol=1e-12)


def test_deterministic_assembler_needs_no_number_of_threads(runtime: Runtime, kernels: Kernels) -> None:
    n = 600
    rng = np.random.default_rng(0)
    kappa = (3 * np.stack([np.arange(n - 1), np.arange(1, n)], 1) + 1).astype(np.int32)
    far = (3 * rng.integers(0, n, (200, 3)) + 1).astype(np.int32)
    matrix = BlockMatrix(runtime)
    positions = matrix.build(np.array([0, 3 * n]), np.array([3], np.int32), [kappa, far])
    x = rng.standard_normal(3 * n)
    arguments = [Arguments(x, rng.uniform(0, 1, len(slots)), slots.shape[1]) for slots in (kappa, far)]
    calls = [
        KernelCall(kernels.energy, argument.address, len(slots), slots, position)
        for argument, slots, position in zip(arguments, (kappa, far), positions, strict=True)
    ]
    assembler = Assembler(runtime, deterministic=True)
    results = []
    for threads in (1, 2, 3, 5, 20):
        gradient = np.empty(3 * n)
        assembler.assemble(calls, [matrix], gradient, matrix.block_size_at, threads)
        results.append((gradient, matrix.values.copy()))
    for gradient, values in results[1:]:
        np.testing.assert_array_equal(gradient, results[0][0])
        np.testing.assert_array_equal(values, results[0][1])
    plain = np.empty(3 * n)
    Assembler(runtime).assemble(calls, [matrix], plain, matrix.block_size_at, 1)
    np.testing.assert_allclose(results[0][0], plain, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(results[0][1], matrix.values, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("deterministic", [False, True])
def test_what_pieces_touch_is_found_again_when_indices_change(
    runtime: Runtime, kernels: Kernels, deterministic: bool
) -> None:
    """Contacts come and go in the second part while the first one stays, and at times there is a gradient only."""
    n = 900
    rng = np.random.default_rng(3)
    boundaries, sizes = np.array([0, 3 * n]), np.array([3], np.int32)
    x = rng.standard_normal(3 * n)
    kappas = [(3 * np.stack([np.arange(n - 1), np.arange(1, n)], 1) + 1).astype(np.int32), np.zeros((0, 4), np.int32)]
    parts = [BlockMatrix(runtime), BlockMatrix(runtime, with_diagonal=False)]
    positions = [part.build(boundaries, sizes, [kappa])[0] for part, kappa in zip(parts, kappas, strict=True)]
    assembler = Assembler(runtime, deterministic=deterministic)
    for contacts, threads, hessian in (
        (50, 2, True),
        (400, 2, True),
        (3, 2, False),
        (200, 3, True),
        (200, 2, True),
        (0, 2, True),
        (700, 2, True),
    ):
        kappas[1] = (3 * rng.integers(0, n, (contacts, 4)) + 1).astype(np.int32)
        positions[1] = parts[1].build(boundaries, sizes, [kappas[1]])[0]
        arguments = [Arguments(x, rng.uniform(0.5, 1, len(kappa)), kappa.shape[1]) for kappa in kappas]
        calls = [
            KernelCall(
                kernels.energy, arguments[k].address, len(kappas[k]), kappas[k], positions[k] if hessian else None, k
            )
            for k in (0, 1)
        ]
        found = []
        for one, count in ((assembler, threads), (Assembler(runtime), 1)):
            gradient = np.full(3 * n, 7.0)
            one.assemble(calls, parts, gradient, parts[0].block_size_at, count)
            found.append((gradient, parts[0].values.copy(), parts[1].values.copy()))
        for got, expected in zip(*found, strict=True):
            np.testing.assert_allclose(got, expected, rtol=1e-11, atol=1e-9)


def test_new_places_for_the_same_indices_are_noticed(runtime: Runtime, kernels: Kernels) -> None:
    n = 900
    kappa = (3 * np.stack([np.arange(n - 1), np.arange(1, n)], 1) + 1).astype(np.int32)
    arguments = Arguments(np.ones(3 * n), np.ones(n - 1), 2)
    matrix, assembler = BlockMatrix(runtime), Assembler(runtime)
    there = np.arange(n, dtype=np.int32)
    for order in (there, there[::-1], there):
        position = matrix.build(np.array([0, 3 * n]), np.array([3], np.int32), [kappa], order=order)[0]
        call = KernelCall(kernels.energy, arguments.address, n - 1, kappa, position)
        values = []
        for one, threads in ((Assembler(runtime), 1), (assembler, 2)):
            one.assemble([call], [matrix], np.empty(3 * n), matrix.block_size_at, threads)
            values.append(matrix.values.copy())
        np.testing.assert_allclose(values[1], values[0], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_a_kernel_without_memory_is_no_bad_instance(
    runtime: Runtime, kernels: Kernels, scene: Any, threads: int
) -> None:
    problem = Problem(runtime, kernels, scene)
    problem.scales[0][11] = 1e300
    assembler, sizes = Assembler(runtime), problem.parts[0].block_size_at
    with pytest.raises(MemoryError):
        assembler.assemble(problem.calls(), problem.parts, np.empty(scene.size), sizes, threads)
    problem.scales[0][11] = 1.0
    gradient = np.empty(scene.size)
    assembler.assemble(problem.calls(), problem.parts, gradient, sizes, threads)
    np.testing.assert_allclose(gradient, problem.expected(Projection.CLAMP)[0], rtol=1e-11, atol=1e-9)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_first_bad_instance_is_reported(runtime: Runtime, kernels: Kernels, scene: Any, threads: int) -> None:
    problem = Problem(runtime, kernels, scene)
    problem.scales[0][[11, 12, 35]] = np.nan
    problem.scales[3][18] = np.inf
    gradient = np.empty(scene.size)
    assembler = Assembler(runtime)
    sizes = problem.parts[0].block_size_at
    statuses = assembler.assemble(problem.calls(), problem.parts, gradient, sizes, threads)
    assert [status.first_bad for status in statuses] == [11, None, None, 18, None, None]

    # The next assembly is clean again.
    for scale in problem.scales:
        scale[~np.isfinite(scale)] = 1.0
    assembler.assemble(problem.calls(), problem.parts, gradient, sizes, threads)
    np.testing.assert_allclose(gradient, problem.expected(Projection.CLAMP)[0], rtol=1e-11, atol=1e-9)


def test_nothing_to_assemble_gives_zero(runtime: Runtime, scene: Any) -> None:
    matrix = BlockMatrix(runtime)
    matrix.build(scene.boundaries, scene.block_sizes, scene.kappas)
    matrix.values[:] = 1
    gradient = np.ones(scene.size)
    assert Assembler(runtime).assemble([], [matrix], gradient, matrix.block_size_at) == []
    assert not gradient.any()
    assert not matrix.values.any()


def test_arrays_that_do_not_fit_are_refused(runtime: Runtime, kernels: Kernels, scene: Any) -> None:
    problem = Problem(runtime, kernels, scene)
    assembler = Assembler(runtime)
    sizes = problem.parts[0].block_size_at
    calls = problem.calls()
    good = np.full(scene.size, 5.0)
    with pytest.raises(ValueError, match="gradient must be"):
        assembler.assemble(calls, problem.parts, good[::2], sizes)
    with pytest.raises(ValueError, match="block_size_at is"):
        assembler.assemble(calls, problem.parts, good, sizes[:-1])
    with pytest.raises(ValueError, match=r"parts\[1\] has 0 unknowns"):
        assembler.assemble(calls, [problem.parts[0], BlockMatrix(runtime)], good, sizes)
    with pytest.raises(ValueError, match=r"writes to parts\[1\]"):
        assembler.assemble(calls, problem.parts[:1], good, sizes)
    wrong = KernelCall(kernels.energy, 0, 2, scene.kappas[0], problem.positions[0])
    with pytest.raises(ValueError, match="kappa of call 0"):
        assembler.assemble([wrong], problem.parts, good, sizes)
    wrong = KernelCall(kernels.energy, 0, 37, scene.kappas[0], problem.positions[0][:, 1:])
    with pytest.raises(ValueError, match="position of call 0"):
        assembler.assemble([wrong], problem.parts, good, sizes)
    assert (good == 5.0).all()


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("count", [0, 1, sink.LANES, 45])
def test_evaluate_and_sum(runtime: Runtime, kernels: Kernels, threads: int, count: int) -> None:
    scale = np.random.default_rng(count).standard_normal(count)
    arguments = Arguments(np.zeros(1), scale, 1)
    out = np.full(count, np.nan)
    evaluate(runtime, kernels.value, arguments.address, count, out, threads=threads)
    np.testing.assert_array_equal(out, scale)
    assert runtime.sum(out) == pytest.approx(math.fsum(scale), rel=1e-15, abs=1e-16)


def test_evaluate_refuses_wrong_out(runtime: Runtime, kernels: Kernels) -> None:
    with pytest.raises(ValueError, match="runs over 3 instances"):
        evaluate(runtime, kernels.value, 0, 3, np.zeros(2))
    with pytest.raises(ValueError, match="writeable C-contiguous"):
        evaluate(runtime, kernels.value, 0, 3, np.zeros(6)[::2])


def test_sum_is_exact_to_rounding(runtime: Runtime) -> None:
    rng = np.random.default_rng(0)
    values = rng.standard_normal(10_007) * 10.0 ** rng.integers(-8, 8, 10_007)
    assert runtime.sum(values) == pytest.approx(math.fsum(values), rel=1e-15)
    assert runtime.sum(np.array([1e16, *[1.0] * 50, -1e16])) == 50.0
    assert runtime.sum(np.array([1.0, np.inf, 2.0])) == np.inf
    assert np.isnan(runtime.sum(np.array([1.0, np.inf, -np.inf, 2.0])))
    assert np.isnan(runtime.sum(np.array([np.nan] + [1.0] * 20)))
