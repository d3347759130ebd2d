"""The device's conjugate gradients: the kernels run on the host, against the CPU's solver."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cuda_on_host import HostDevice, HostProgram
from device_systems import Maker, Structure, load_solver_program, random_structure

from yasps.runtime.build.cuda.sources import runtime_sources
from yasps.runtime.core.library import Runtime
from yasps.runtime.device import protocol as device
from yasps.runtime.device.protocol import blocks_for_sum
from yasps.runtime.matrix.cuda.block_matrix import CudaBlockMatrix
from yasps.runtime.solvers.cuda.pcg import least_bytes_per_iteration
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import PcgSolver, SolveReport, StopReason

both_products = pytest.mark.parametrize("deterministic", [False, True])


@pytest.fixture(scope="module")
def program() -> HostProgram:
    """The kernels of the solver and of the matrices."""
    return load_solver_program()


@pytest.fixture
def maker(runtime: Runtime, program: HostProgram) -> Maker:
    """Makes systems and solvers on a device of the test's own."""
    return Maker(runtime, program)


def assert_same(report: SolveReport, expected: SolveReport) -> None:
    """Both solvers ended the same way."""
    assert (report.reason, report.block, report.solver) == (expected.reason, expected.block, expected.solver)
    assert abs(report.iterations - expected.iterations) <= 1
    assert report.history is not None
    assert expected.history is not None
    assert len(report.history) == len(expected.history) + report.iterations - expected.iterations
    shared = min(len(report.history), len(expected.history))
    np.testing.assert_allclose(report.history[:shared], expected.history[:shared], rtol=1e-6)


@pytest.mark.parametrize(("warm", "deterministic"), [(False, False), (True, False), (False, True), (True, True)])
def test_solves_as_the_cpu_does(
    maker: Maker,
    runtime: Runtime,
    scene: Any,
    *,
    warm: bool,
    deterministic: bool,
) -> None:
    system = maker.random(scene)
    rng = np.random.default_rng(1)
    g = rng.standard_normal(system.size)
    x0 = rng.standard_normal(system.size) if warm else None
    start = system.vector(x0) if x0 is not None else None
    options = SolveOptions(1e-25, 500, history=True, preconditioner="jacobi")
    expected, cpu = PcgSolver(runtime).solve(system.cpu, g, options, x0)
    x, report = maker.solver(deterministic).solve(system.parts, system.vector(g), options, start)
    assert report.converged
    assert_same(report, cpu)
    assert report.history is not None
    assert report.history[-1] == report.relative_squared_residual <= 1e-25
    np.testing.assert_allclose(x.download(), expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_few_blocks_take_turns(maker: Maker, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a large system: more unknowns than threads."""
    monkeypatch.setattr(device, "BLOCKS_AT_ONCE", 1)
    monkeypatch.setattr(maker.device, "multiprocessors", 1)
    system = maker.random(random_structure(3, (100, 4), (3, 5)))
    assert system.size > 2 * 128
    g = np.random.default_rng(2).standard_normal(system.size)
    x, report = maker.solver().solve(system.parts, system.vector(g), SolveOptions(1e-26, 300))
    assert report.converged
    np.testing.assert_allclose(x.download(), np.linalg.solve(system.dense, g), rtol=1e-10, atol=1e-12)


def test_no_more_blocks_than_run_at_once(maker: Maker, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every block of a kernel reads what all of the one before left."""
    monkeypatch.setattr(maker.device, "multiprocessors", 132)
    assert [blocks_for_sum(maker.device, n) for n in (0, 1, 128, 129, 10**5, 10**6)] == [0, 1, 1, 2, 782, 1056]
    monkeypatch.setattr(maker.device, "multiprocessors", 1)
    threads: dict[str, int] = {}

    def launch(kernel: Any, count: int, arguments: Any, *, block: int = device.BLOCK) -> None:
        threads[kernel.name] = count
        HostDevice.launch(maker.device, kernel, count, arguments, block=block)

    monkeypatch.setattr(maker.device, "launch", launch)
    system = maker.random(random_structure(3, (500, 4), (3, 5)), definite=False)
    assert system.size > 8 * 128
    g = np.random.default_rng(2).standard_normal(system.size)
    maker.solver().solve(system.parts, system.vector(g), SolveOptions(1e-8, 50))
    over_all = {f"yasps_pcg_{name}" for name in ("prepare", "start", "curvature", "step", "direction")}
    found = {name: count for name, count in threads.items() if name.startswith("yasps_pcg")}
    assert found == {"yasps_pcg_begin": 128} | dict.fromkeys(over_all, 1024)


@pytest.mark.parametrize("limit", [0, 1, 2, 5, 8, 9])
def test_stops_after_the_last_allowed_iteration(maker: Maker, runtime: Runtime, scene: Any, limit: int) -> None:
    """Also in the middle of a recorded graph, and at its end: x is that of the last iteration."""
    system = maker.random(scene)
    g = np.random.default_rng(1).standard_normal(system.size)
    options = SolveOptions(0.0, limit, history=True, preconditioner="jacobi")
    expected, cpu = PcgSolver(runtime).solve(system.cpu, g, options)
    x, report = maker.solver().solve(system.parts, system.vector(g), options)
    assert report.reason is StopReason.MAX_ITERATIONS
    assert report.iterations == limit
    assert_same(report, cpu)
    np.testing.assert_allclose(x.download(), expected, rtol=0, atol=1e-12 * max(1, np.abs(expected).max()))


@both_products
def test_same_bits_however_often_the_host_looks(maker: Maker, scene: Any, deterministic: bool) -> None:
    system = maker.random(scene)
    g = system.vector(np.random.default_rng(3).standard_normal(system.size))
    results = []
    for iterations in (2, 6, 24, 24):
        solver = maker.solver(deterministic, iterations)
        maker.device.downloads = 0
        x, report = solver.solve(system.parts, g, SolveOptions(1e-18))
        assert maker.device.downloads == max(1, -(-(report.iterations - 2) // iterations))
        results.append((x.download().tobytes(), report))
    assert all(result == results[0] for result in results)


def test_deterministic_solver_adds_nothing_atomically(maker: Maker, scene: Any) -> None:
    system = maker.random(scene)
    maker.solver(True).solve(system.parts, system.vector(np.ones(system.size)))
    kernels = {source.name: source.text for source in runtime_sources()}
    assert "atomicAdd" in kernels["multiply"]
    assert not any(
        "atomicAdd" in kernels[name] for name in ("gathered_multiply", "pcg", "coarse_space", "preconditioner")
    )
    assert not any(name.startswith("yasps_multiply") for name in maker.device.launches)


def test_launches_of_an_iteration(maker: Maker) -> None:
    """Three, and one for each shape of blocks, of both parts together."""
    system = maker.random(random_structure(1, (9, 5, 9), (3, 12, 3)))
    assert [len(part.groups) for part in system.parts] == [4, 3]
    solver = maker.solver()
    solver.solve(system.parts, system.vector(np.ones(system.size)), SolveOptions(max_iterations=0))
    before = len(maker.device.launches)
    solver.solve(system.parts, system.vector(np.ones(system.size)), SolveOptions(max_iterations=0))
    assert len(maker.device.launches) - before == 4 + 8 * (3 + 4)


def test_least_bytes_of_an_iteration(maker: Maker) -> None:
    """Two vertices and an affine body, in a block with one of the vertices."""
    structure = Structure((2, 1), (3, 12), [np.array([[4, 7]], np.int32)])
    system = maker.random(structure, parts=1, definite=False)
    values, blocks, scalars = 2 * 9 + 36 + 144, 4, 18
    expected = 8 * values + 8 * blocks + 120 * scalars + 8 * (2 * 9 + 144)
    assert least_bytes_per_iteration(system.parts) == expected


@both_products
def test_graph_is_recorded_anew_only_for_another_system(maker: Maker, deterministic: bool) -> None:
    structure = random_structure(1, (40,), (3,))
    system = maker.random(structure)
    solver = maker.solver(deterministic)

    def check() -> int:
        maker.device.graphs = 0
        g = np.random.default_rng(5).standard_normal(system.size)
        x, report = solver.solve(system.parts, system.vector(g), SolveOptions(1e-26))
        assert report.converged
        np.testing.assert_allclose(x.download(), np.linalg.solve(system.dense, g), rtol=1e-9, atol=1e-12)
        return maker.device.graphs

    assert check() == 1
    assert check() == 0
    maker.fill(system, seed=4)
    assert check() == 0
    # Some contacts fewer: other blocks in the same memory.
    structure.kappas[-1] = structure.kappas[-1][:-7]
    maker.fill(maker.build(system, structure, 2), seed=5)
    assert check() == 0
    # Many more: memory elsewhere.
    more = random_structure(2, (40,), (3,)).kappas[0]
    structure.kappas.append(np.concatenate([more, more[:, ::-1], np.roll(more, 1, axis=0) * (more > 0)]))
    maker.fill(maker.build(system, structure, 2), seed=6)
    check()
    other = maker.random(random_structure(2, (3, 2), (3, 12)))
    system = other
    assert check() == 1


@pytest.mark.parametrize("blocks", [1, 127, 128, 300, 2048])
def test_sums_of_many_blocks(maker: Maker, program: HostProgram, blocks: int) -> None:
    """As on a large system, whose kernels leave a number for each of up to 2048 blocks."""
    partial = np.random.default_rng(0).random((4, blocks))
    partial[0] = 0  # no entry of g that is not finite
    sent, states = maker.empty().upload(partial), maker.empty().resize(8)
    worst = maker.empty(np.int64).upload(np.array([2**63 - 1]))
    settings = maker.empty(np.int64).upload(np.array([0, 10, 0, -1]))
    addresses = [sent.address, blocks, worst.address, settings.address, states.address]
    maker.device.launch(program.kernel("yasps_pcg_begin"), 128, addresses, block=128)
    reference, squared = partial[2:].sum(axis=1)
    np.testing.assert_allclose(states.download()[:3], [squared, reference, squared / reference], rtol=1e-14)


def test_zero_gradient_gives_zero(maker: Maker, scene: Any) -> None:
    system = maker.random(scene)
    for part in system.parts:
        part.values.clear()  # H is singular, and still x = 0 solves H x = 0
    g, x0 = system.vector(np.zeros(system.size)), system.vector(np.ones(system.size))
    x, report = maker.solver().solve(system.parts, g, SolveOptions(history=True), x0=x0)
    assert not x.download().any()
    assert report == SolveReport(StopReason.CONVERGED, 0, 0.0, None, ())


def test_starts_where_it_ended(maker: Maker, scene: Any) -> None:
    """Its own solution can be the next start."""
    system = maker.random(scene)
    solver = maker.solver()
    g = system.vector(np.random.default_rng(0).standard_normal(system.size))
    x, first = solver.solve(system.parts, g, SolveOptions(1e-26))
    values = x.download()
    again, report = solver.solve(system.parts, g, SolveOptions(1e-20), x0=x)
    assert first.iterations > report.iterations == 0
    assert report.converged
    np.testing.assert_array_equal(again.download(), values)


def test_block_diagonal_system_takes_one_iteration(maker: Maker) -> None:
    """As the paper says of scenes with nothing but affine bodies; so inverses of all sizes are right."""
    sizes = (*range(1, 13), 24)
    system = maker.random(Structure((3,) * len(sizes), sizes, []), parts=1, definite=False)
    rng = np.random.default_rng(0)
    for group in system.cpu[0].groups:
        a = rng.standard_normal(group.values.shape)
        group.values[:] = a @ a.transpose(0, 2, 1) + 0.1 * np.eye(group.r)
    system.send_values()
    g = rng.standard_normal(system.size)
    x, report = maker.solver().solve(system.parts, system.vector(g), SolveOptions(1e-22))
    assert report.iterations == 1
    np.testing.assert_allclose(system.dense @ x.download(), g, rtol=0, atol=1e-10)


@pytest.mark.parametrize("value", [-1.0, 0.0, np.nan, np.inf])
def test_bad_diagonal_block_is_named(maker: Maker, runtime: Runtime, scene: Any, value: float) -> None:
    """The first one, if there are several."""
    system = maker.random(scene)
    groups = [group for group in system.cpu[0].groups if group.r == group.c]
    for group in groups:
        blocks = np.flatnonzero(group.rows == group.cols)[1:]
        for other in system.cpu[1].groups:  # so that only the static part has a say
            other.values[np.isin(other.rows, group.rows[blocks])] = 0
            other.values[np.isin(other.cols, group.rows[blocks])] = 0
        group.values[blocks] = np.eye(group.r)
        group.values[blocks, -1, -1] = value
    system.send_values()
    g, x0 = np.ones(system.size), np.full(system.size, 2.0)
    _, expected = PcgSolver(runtime).solve(system.cpu, g, SolveOptions(history=True), x0=x0)
    x, report = maker.solver().solve(system.parts, system.vector(g), SolveOptions(history=True), x0=system.vector(x0))
    assert report.block is not None
    assert (report.reason, report.block, report.history) == (expected.reason, expected.block, expected.history)
    assert report.reason is (StopReason.NOT_POSITIVE_DEFINITE if np.isfinite(value) else StopReason.NOT_FINITE)
    assert np.isnan(report.relative_squared_residual)
    np.testing.assert_array_equal(x.download(), 2.0)


def test_singular_block_is_not_mistaken_for_a_definite_one(maker: Maker) -> None:
    for q in (3, 5):
        system = maker.random(Structure((1,), (q,), []), parts=1, definite=False)
        v = np.array([0.3, 0.7, 0.9, 0.2, 0.4])[:q]
        system.cpu[0].groups[0].values[0] = np.eye(q) - np.outer(v, v) / (v @ v)
        system.send_values()
        report = maker.solver().solve(system.parts, system.vector(np.ones(q)))[1]
        assert report.reason is StopReason.NOT_POSITIVE_DEFINITE
        assert report.block == 0


def test_missing_diagonal_block_is_named(maker: Maker, scene: Any) -> None:
    system = maker.random(scene)
    touched = np.concatenate([kappa.ravel() for kappa in scene.kappas[2:]])
    starts = system.parts[0].block_start.download()
    free = starts[~np.isin(starts + 1, touched)]
    report = maker.solver().solve(system.parts[1:], system.vector(np.ones(system.size)))[1]
    assert report.reason is StopReason.NOT_POSITIVE_DEFINITE
    assert report.block is not None
    assert free.size == 0 or report.block <= free[0]


@both_products
def test_indefinite_matrix_with_definite_diagonal_blocks(maker: Maker, deterministic: bool) -> None:
    system = maker.of_scalars([1, 2, 1])
    x, report = maker.solver(deterministic).solve(
        system.parts, system.vector(np.array([1.0, -1.0])), SolveOptions(history=True)
    )
    assert report == SolveReport(StopReason.NOT_POSITIVE_DEFINITE, 0, 1.0, None, (1.0,))
    np.testing.assert_array_equal(x.download(), 0)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_not_finite_numbers(maker: Maker, bad: float) -> None:
    system = maker.of_scalars([2, 1, 2])
    solver = maker.solver()
    ones = system.vector(np.ones(2))
    unusable = system.vector(np.array([1.0, bad]))
    assert solver.solve(system.parts, unusable)[1].reason is StopReason.NOT_FINITE
    assert solver.solve(system.parts, ones, x0=unusable)[1].reason is StopReason.NOT_FINITE
    system.parts[0].values.upload(np.array([2, bad, 2]))
    report = solver.solve(system.parts, ones)[1]
    assert report.reason is StopReason.NOT_FINITE
    assert report.block is None
    system.parts[0].values.upload(np.array([2.0, 1.0, 2.0]))
    x, report = solver.solve(system.parts, ones, SolveOptions(1e-26))  # nothing of all that is left
    assert report.converged
    np.testing.assert_allclose(x.download(), 1 / 3, rtol=1e-12)


def test_empty_system(maker: Maker) -> None:
    empty = CudaBlockMatrix(maker.device, maker.program)
    solver = maker.solver()
    x, report = solver.solve([empty], maker.empty())
    assert x.shape == (0,)
    assert report.converged
    y = maker.empty()
    solver.multiply([empty], x, y)
    assert y.shape == (0,)


def test_wrong_arguments_are_refused(
    maker: Maker,
    scene: Any,
) -> None:
    system, solver = maker.random(scene), maker.solver()
    parts, g = system.parts, system.vector(np.ones(scene.size))
    with pytest.raises(ValueError, match="parts is empty"):
        solver.solve([], g)
    with pytest.raises(ValueError, match="built for other targets"):
        solver.solve([parts[0], CudaBlockMatrix(maker.device, maker.program)], g)
    with pytest.raises(ValueError, match="g has shape"):
        solver.solve(parts, system.vector(np.ones(scene.size + 1)))
    with pytest.raises(ValueError, match="x0 has shape"):
        solver.solve(parts, g, x0=maker.empty(np.float32).upload(np.ones(scene.size)))
    with pytest.raises(ValueError, match="iterations_per_check is 3"):
        maker.solver(iterations_per_check=3)
    with pytest.raises(ValueError, match="another array"):
        solver.multiply(parts, g, g)
    x, _ = solver.solve(parts, g)
    with pytest.raises(ValueError, match="overwrite it"):
        solver.solve(parts, x)


def test_sweeps_are_refused(maker: Maker, scene: Any) -> None:
    system = maker.random(scene)
    g = system.vector(np.ones(system.size))
    with pytest.raises(ValueError, match="is for the CPU, since its sweeps go row after row"):
        maker.solver().solve(system.parts, g, SolveOptions(preconditioner="gauss-seidel"))
