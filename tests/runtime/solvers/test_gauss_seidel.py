"""Symmetric Gauss-Seidel as preconditioner, in swept form."""

from __future__ import annotations

import numpy as np
import pytest
from net_systems import SIDE, STATIC, VERTICES, dense_of, fill_nets, net_structure, nets
from numpy.typing import NDArray

from yasps.runtime.core.library import DETERMINISTIC_PIECES, Runtime
from yasps.runtime.matrix.block_matrix import BlockMatrix
from yasps.runtime.solvers import pcg
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import TOO_FEW_DIGITS, PcgSolver, StopReason

PIECES = (1, 2, 4)


@pytest.fixture(params=PIECES)
def pieces(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """Into how many pieces systems are cut."""
    count: int = request.param
    monkeypatch.setattr(pcg, "_pieces_to_sweep", lambda _: count)
    return count


def options(tolerance: float = 1e-20, most: int = 1000, *, history: bool = False) -> SolveOptions:
    return SolveOptions(tolerance, most, history=history, preconditioner="gauss-seidel")


def starts_and_sizes(part: BlockMatrix) -> list[tuple[int, int]]:
    """Of the dof blocks."""
    starts = np.flatnonzero(part.block_size_at)
    return list(zip(starts.tolist(), part.block_size_at[starts].tolist(), strict=True))


def diagonal_of(dense: NDArray[np.float64], part: BlockMatrix) -> NDArray[np.float64]:
    d = np.zeros_like(dense)
    for start, q in starts_and_sizes(part):
        d[start : start + q, start : start + q] = dense[start : start + q, start : start + q]
    return d


@pytest.mark.parametrize("threads", [1, 2])
def test_iterations_are_those_of_textbook_pcg(runtime: Runtime, monkeypatch: pytest.MonkeyPatch, threads: int) -> None:
    monkeypatch.setattr(pcg, "_pieces_to_sweep", lambda _: 1)
    parts = nets(runtime)
    dense = dense_of(parts)
    d = diagonal_of(dense, parts[0])
    # The block of 12 scalars has a part in D alone.
    below = np.tril(dense - d)
    below[3 * VERTICES :] = 0.0
    m = (d + below) @ np.linalg.inv(d) @ (d + below).T
    g = np.random.default_rng(1).standard_normal(len(dense))
    x, r = np.zeros_like(g), g.copy()
    direction = z = np.linalg.solve(m, r)
    expected = [1.0]
    for _ in range(6):
        q = dense @ direction
        step, before = r @ z / (direction @ q), r @ z
        x, r = x + step * direction, r - step * q
        z = np.linalg.solve(m, r)
        direction = z + r @ z / before * direction
        expected.append(r @ np.linalg.solve(d, r) / (g @ np.linalg.solve(d, g)))
    found, report = PcgSolver(runtime).solve(parts, g, options(0.0, 6, history=True), threads=threads)
    assert report.gauss_seidel
    assert report.reason is StopReason.MAX_ITERATIONS
    np.testing.assert_allclose(found, x, rtol=0, atol=1e-5 * np.abs(x).max())  # H' is float32
    np.testing.assert_allclose(report.history, expected, rtol=1e-4)


@pytest.mark.parametrize("start", [False, True])
def test_solves_to_the_last_digits(runtime: Runtime, pieces: int, *, start: bool) -> None:
    """Of H itself, though the products are of float32; blocks of other shapes, contacts and both pieces take part."""
    parts = nets(runtime)
    dense = dense_of(parts)
    rng = np.random.default_rng(pieces)
    g, x0 = rng.standard_normal((2, len(dense)))
    x, report = PcgSolver(runtime).solve(parts, g, options(1e-24), x0 if start else None)
    assert report.converged
    assert report.gauss_seidel
    np.testing.assert_allclose(x, np.linalg.solve(dense, g), rtol=1e-9, atol=1e-11)
    left = dense @ x - g
    d = diagonal_of(dense, parts[0])
    assert report.relative_squared_residual <= 1e-24
    assert left @ np.linalg.solve(d, left) <= 1e-23 * (g @ np.linalg.solve(d, g))


def test_takes_less_than_half_the_iterations_of_block_jacobi(runtime: Runtime, pieces: int) -> None:
    parts = nets(runtime)
    g = np.random.default_rng(1).standard_normal(parts[0].size)
    solver = PcgSolver(runtime)
    swept = solver.solve(parts, g, options(1e-8))[1]
    jacobi = solver.solve(parts, g, SolveOptions(1e-8, preconditioner="jacobi"))[1]
    assert swept.converged
    assert (2 if pieces == 1 else 1.7) * swept.iterations < jacobi.iterations
    assert "with Gauss-Seidel" in str(swept)


def test_two_pieces_leave_nothing_out(runtime: Runtime, monkeypatch: pytest.MonkeyPatch) -> None:
    """A net takes as many iterations swept from both ends as from one, and more where couplings are left out."""
    side = 24
    ids = np.arange(side * side, dtype=np.int32).reshape(side, side)
    edges = np.concatenate(
        [np.stack([ids[:-1], ids[1:]], -1).reshape(-1, 2), np.stack([ids[:, :-1], ids[:, 1:]], -1).reshape(-1, 2)]
    )
    matrix = BlockMatrix(runtime)
    matrix.build(np.array([0, 3 * ids.size]), np.array([3], np.int32), [3 * edges + 1])
    group = matrix.groups[0]
    group.values[:] = np.where(group.rows == group.cols, 4.001, -1.0)[:, None, None] * np.eye(3)
    g = np.random.default_rng(0).standard_normal(matrix.size)
    iterations = {}
    for pieces in PIECES:
        monkeypatch.setattr(pcg, "_pieces_to_sweep", lambda _, pieces=pieces: pieces)
        report = PcgSolver(runtime).solve([matrix], g, options(1e-12))[1]
        assert report.gauss_seidel
        iterations[pieces] = report.iterations
    assert abs(iterations[2] - iterations[1]) <= 1
    assert iterations[4] > iterations[2] + 1


def test_same_bits_for_any_number_of_threads(runtime: Runtime, pieces: int) -> None:
    parts = nets(runtime)
    g = np.random.default_rng(1).standard_normal(parts[0].size)
    solver = PcgSolver(runtime)
    results = [
        solver.solve(parts, g, options(1e-16, history=True), threads=threads)
        for threads in (1, 2, 5, DETERMINISTIC_PIECES + 3)
    ]
    for x, report in results[1:]:
        np.testing.assert_array_equal(x, results[0][0])
        assert report == results[0][1]


def test_fixed_unknowns_stay(runtime: Runtime, pieces: int) -> None:
    parts = nets(runtime)
    fixed = np.zeros(parts[0].size, bool)
    for vertex in (0, 1, 40, 80, 81, 100):
        fixed[3 * vertex : 3 * vertex + 3] = True
    fixed[3 * VERTICES :] = True
    for part in parts:
        part.fix(fixed)
    g = np.where(fixed, 0.0, 1.0)
    x, report = PcgSolver(runtime).solve(parts, g, options(1e-24))
    assert report.gauss_seidel
    np.testing.assert_array_equal(x[fixed], 0.0)
    np.testing.assert_allclose(x, np.linalg.solve(dense_of(parts), g), rtol=1e-8, atol=1e-10)


def test_lists_follow_the_structure(runtime: Runtime, pieces: int) -> None:
    """Other contacts, and another static part of as many blocks."""
    solver = PcgSolver(runtime)
    structure = net_structure()
    parts = [BlockMatrix(runtime), BlockMatrix(runtime, with_diagonal=False)]
    rng = np.random.default_rng(0)
    for turn in range(4):
        pairs = rng.choice(VERTICES, (20, 2), replace=False).astype(np.int32)
        edges = 3 * rng.permutation(VERTICES)[structure.kappas[0] // 3] + 1 if turn > 1 else structure.kappas[0]
        kappas = [edges.astype(np.int32), structure.kappas[1]]
        if turn != 1:  # the second time contacts alone are new
            parts[0].build(structure.boundaries, structure.block_sizes, kappas)
        parts[1].build(structure.boundaries, structure.block_sizes, [3 * pairs + 1])
        fill_nets(parts)
        g = rng.standard_normal(parts[0].size)
        x, report = solver.solve(parts, g, options(1e-24))
        assert report.gauss_seidel
        np.testing.assert_allclose(x, np.linalg.solve(dense_of(parts), g), rtol=1e-8, atol=1e-10)


def test_lists_do_not_outlive_their_matrix(runtime: Runtime, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another matrix may lie where one was, built as often; and other pieces may be asked for."""
    solver = PcgSolver(runtime)
    rng = np.random.default_rng(0)
    for turn in range(6):
        monkeypatch.setattr(pcg, "_pieces_to_sweep", lambda _, pieces=1 + turn % 2: pieces)
        structure = net_structure()
        parts = [BlockMatrix(runtime), BlockMatrix(runtime, with_diagonal=False)]
        vertices = rng.permutation(VERTICES).astype(np.int32)
        edges = 3 * vertices[structure.kappas[0] // 3] + 1
        parts[0].build(structure.boundaries, structure.block_sizes, [edges, structure.kappas[1]])
        parts[1].build(structure.boundaries, structure.block_sizes, structure.kappas[STATIC:])
        fill_nets(parts)
        g = rng.standard_normal(parts[0].size)
        x = solver.solve(parts, g, options(1e-24))[0]
        np.testing.assert_allclose(x, np.linalg.solve(dense_of(parts), g), rtol=1e-8, atol=1e-10)
        del parts


def test_block_jacobi_goes_on_where_float32_is_not_enough(runtime: Runtime, pieces: int) -> None:
    """A long chain that is nearly free to move: its condition is that of 1e10."""
    count = 200
    matrix = BlockMatrix(runtime)
    ids = np.arange(count, dtype=np.int32)
    matrix.build(np.array([0, 3 * count]), np.array([3], np.int32), [3 * np.stack([ids[:-1], ids[1:]], 1) + 1])
    group = matrix.groups[0]
    springs = 2.0 - np.isin(group.rows, (0, 3 * (count - 1)))
    group.values[:] = np.where(group.rows == group.cols, springs + 1e-10, -1.0)[:, None, None] * np.eye(3)
    g = np.random.default_rng(pieces).standard_normal(3 * count)
    x, report = PcgSolver(runtime).solve([matrix], g, options(1e-8, 5000))
    assert report.converged
    assert not report.gauss_seidel
    assert report.why == TOO_FEW_DIGITS
    left = matrix.to_scipy() @ x - g
    assert left @ left <= 1e-7 * (g @ g)


def test_indefinite_matrix_is_refused(runtime: Runtime, pieces: int) -> None:
    parts = nets(runtime)
    for group in parts[0].groups:
        apart = group.rows != group.cols
        group.values[apart] *= 3.0
    g = np.random.default_rng(0).standard_normal(parts[0].size)
    report = PcgSolver(runtime).solve(parts, g, options())[1]
    assert report.reason is StopReason.NOT_POSITIVE_DEFINITE
    assert report.gauss_seidel


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_not_finite_numbers(runtime: Runtime, pieces: int, bad: float) -> None:
    parts = nets(runtime)
    g = np.ones(parts[0].size)
    solver = PcgSolver(runtime)
    assert solver.solve(parts, np.where(np.arange(len(g)) == 5, bad, g), options())[1].reason is StopReason.NOT_FINITE
    for group in parts[1].groups:
        group.values[group.rows != group.cols] = bad
    assert solver.solve(parts, g, options())[1].reason is StopReason.NOT_FINITE


def test_bad_diagonal_block_is_named(runtime: Runtime, pieces: int) -> None:
    parts = nets(runtime)
    for part in parts:
        for group in part.groups:
            at = np.flatnonzero((group.rows == 3 * SIDE) & (group.cols == 3 * SIDE))
            for block in at:
                group.values[block] = np.diag([1.0, -1.0, 1.0])
    report = PcgSolver(runtime).solve(parts, np.ones(parts[0].size), options())[1]
    assert (report.reason, report.block) == (StopReason.NOT_POSITIVE_DEFINITE, 3 * SIDE)


def test_nothing_to_sweep_is_for_block_jacobi(runtime: Runtime) -> None:
    matrix = BlockMatrix(runtime)
    matrix.build(np.array([0, 24]), np.array([12], np.int32), [np.array([[1, 13]], np.int32)])
    for group in matrix.groups:
        same = group.rows == group.cols
        group.values[:] = np.where(same[:, None, None], 3.0, -1.0) * np.eye(12)
    x, report = PcgSolver(runtime).solve([matrix], np.ones(24), options())
    assert report.converged
    assert not report.gauss_seidel
    assert report.why == ""
    np.testing.assert_allclose(x, 0.5)


def test_more_pieces_for_more_processors_and_larger_systems(runtime: Runtime, monkeypatch: pytest.MonkeyPatch) -> None:
    found = {}
    for processors in (1, 2, 3, 64):
        monkeypatch.setattr(pcg, "available_processors", lambda processors=processors: processors)
        for blocks in (0, 2047, 2048, 4096, 10**6):
            part = BlockMatrix(runtime)
            part.boundaries, part.block_sizes = np.array([0, 3 * blocks]), np.array([3], np.int32)
            found[processors, blocks] = pcg._pieces_to_sweep(part)
    assert [found[2, blocks] for blocks in (0, 2047, 2048, 4096, 10**6)] == [1, 1, 2, 2, 2]
    assert [found[processors, 10**6] for processors in (1, 2, 3, 64)] == [1, 2, 4, 16]


def test_static_part_has_other_shapes() -> None:
    """What the tests above rely on."""
    assert net_structure().block_sizes.tolist() == [3, 12]
    assert STATIC == 2
