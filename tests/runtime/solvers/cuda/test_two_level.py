"""The device's coarse space: the kernels run on the host, against the CPU's solver."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest
from cuda_on_host import HostProgram
from device_systems import Maker, Structure, System, load_solver_program, random_structure
from net_systems import STATIC, fill_nets, net_structure

from yasps.runtime.core.library import Runtime
from yasps.runtime.solvers.cuda.coarse_space import CudaCoarseSpace
from yasps.runtime.solvers.options import SolveOptions
from yasps.runtime.solvers.pcg import PcgSolver, PreconditionerChoice, StopReason

TWO_LEVEL = SolveOptions(1e-14, 500, history=True, preconditioner="two-level")


@pytest.fixture(scope="module")
def program() -> HostProgram:
    """The kernels of the solver and of the matrices."""
    return load_solver_program()


@pytest.fixture
def maker(runtime: Runtime, program: HostProgram) -> Maker:
    """Makes systems and solvers on a device of the test's own."""
    return Maker(runtime, program)


SIDE = 4
"""Of most nets: the host is a slow device."""


def net_system(maker: Maker, side: int = SIDE, *, stiffness: float = 100.0) -> System:
    """Two nets, a wide block and contacts."""
    structure = net_structure(side)
    system = maker.build(maker.random(structure, definite=False), structure, STATIC)
    fill_nets(system.cpu, stiffness)
    system.send_values()
    return system


def right_side(system: System) -> np.ndarray:
    """The same for all."""
    return np.random.default_rng(1).standard_normal(system.size)


def assert_twins(maker: Maker, system: System, options: SolveOptions, *, deterministic: bool = False) -> None:
    """CPU and device take the same way to the same solution."""
    g = right_side(system)
    expected, cpu = PcgSolver(maker.runtime).solve(system.cpu, g, options)
    x, report = maker.solver(deterministic).solve(system.parts, system.vector(g), options)
    assert report.converged
    assert report.two_level
    assert (report.reason, report.iterations, report.two_level) == (cpu.reason, cpu.iterations, cpu.two_level)
    assert report.history is not None
    np.testing.assert_allclose(report.history, cpu.history, rtol=1e-6)
    np.testing.assert_allclose(x.download(), expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("deterministic", [False, True])
def test_takes_the_way_of_the_cpu(maker: Maker, deterministic: bool) -> None:
    side = SIDE if deterministic else 9
    assert_twins(maker, net_system(maker, side), TWO_LEVEL, deterministic=deterministic)


@pytest.mark.parametrize(("counts", "sizes"), [((9, 5, 9), (3, 12, 3)), ((5, 4, 2), (9, 5, 17)), ((70,), (2,))])
def test_any_sizes_of_blocks(maker: Maker, counts: tuple[int, ...], sizes: tuple[int, ...]) -> None:
    """Also blocks that are stored turned, and more coarse unknowns than fit a tile, or than panels are full of."""
    assert_twins(maker, maker.random(random_structure(1, counts, sizes)), TWO_LEVEL)


def test_inverts_the_coarse_matrix(maker: Maker) -> None:
    """Minus its inverse, symmetric to the last bit."""
    system = net_system(maker, 9)
    space = maker.solver()._coarse
    assert space.make(system.parts)
    unknown_of = space._unknown_of.download()
    p = np.zeros((system.size, space._unknowns))
    p[np.flatnonzero(unknown_of >= 0), unknown_of[unknown_of >= 0]] = 1.0
    assert (p.sum(0) >= 1).all()
    inverse = space._inverse.download()[: space._unknowns, : space._unknowns]
    assert space._unknowns % 8
    np.testing.assert_array_equal(inverse, inverse.T)
    np.testing.assert_allclose(-inverse @ (p.T @ system.dense @ p), np.eye(len(inverse)), rtol=0, atol=1e-11)


def test_aggregates_are_those_of_the_cpu(maker: Maker) -> None:
    system = net_system(maker)
    space = maker.solver()._coarse
    space.make(system.parts)
    np.testing.assert_array_equal(space._aggregate_of.download(), system.cpu[0].aggregates())


def test_every_run_is_the_same(maker: Maker) -> None:
    """Bit for bit, where products are: however often the host looks, with a graph of its own and without."""
    system = net_system(maker)
    g = system.vector(right_side(system))
    results = []
    options = replace(TWO_LEVEL, max_iterations=5)
    for iterations in (2, 6):
        solver = maker.solver(True, iterations)
        for _ in range(2):
            x, report = solver.solve(system.parts, g, options)
            results.append((x.download().tobytes(), report))
    assert all(result == results[0] for result in results)


def test_both_graphs_are_kept(maker: Maker) -> None:
    system = net_system(maker)
    g = system.vector(right_side(system))
    solver = maker.solver()
    options = [SolveOptions(1e-8, preconditioner=name) for name in ("jacobi", "two-level")]
    for expected in (2, 2):
        for one in options:
            assert solver.solve(system.parts, g, one)[1].converged
        assert maker.device.graphs == expected


def test_auto_decides_by_what_both_take(maker: Maker, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a trial finds, while the solution of the first solve stays, also from a start that lies in its place."""
    for name, value in (("FEWEST_BLOCKS", 10), ("SLOW", 7), ("SETUP", 0.0), ("SHORTEST_WAIT", 0)):
        monkeypatch.setattr(PreconditionerChoice, name, value)
    hard, easy = net_system(maker), net_system(maker, stiffness=1e-4)
    easy.cpu[1].values[:] = 0.0
    easy.send_values()
    solver = maker.solver()
    found: list[bool] = []
    expected, x = None, None
    for number, system in enumerate((hard, hard, easy, easy)):
        g = np.roll(right_side(system), number)
        starts = (expected, x) if number == 1 else (None, None)
        x, report = solver.solve(
            system.parts, system.vector(g), SolveOptions(1e-12, history=True, preconditioner="auto"), starts[1]
        )
        kinds = ("two-level", "jacobi") if report.two_level else ("jacobi", "two-level")
        (expected, cpu), (_, other) = (
            PcgSolver(maker.runtime).solve(system.cpu, g, SolveOptions(1e-12, preconditioner=kind), starts[0])
            for kind in kinds
        )
        np.testing.assert_allclose(x.download(), expected, rtol=0, atol=1e-9 * np.abs(expected).max())
        assert (report.iterations, report.two_level) == (cpu.iterations, cpu.two_level)
        assert 0 <= report.trial_iterations <= other.iterations
        assert report.trial_iterations > 0 or number > 1
        found.append(report.two_level)
    assert found[:2] == [False, True]


def test_auto_loses_its_patience_as_on_the_cpu(maker: Maker, monkeypatch: pytest.MonkeyPatch) -> None:
    """The solution is that of the second solve then."""
    for name, value in (("FEWEST_BLOCKS", 10), ("PATIENCE", 5)):
        monkeypatch.setattr(PreconditionerChoice, name, value)
    system = net_system(maker)
    g = right_side(system)
    options = SolveOptions(1e-12, preconditioner="auto")
    expected, cpu = PcgSolver(maker.runtime).solve(system.cpu, g, options)
    x, report = maker.solver().solve(system.parts, system.vector(g), options)
    np.testing.assert_allclose(x.download(), expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    assert report.two_level
    assert report.trial_iterations == cpu.trial_iterations == 5
    assert report.iterations == cpu.iterations


def test_other_contacts_and_other_bodies(maker: Maker) -> None:
    """What was found for one sparsity is not taken for the next."""
    structure = net_structure(SIDE)
    system = net_system(maker)
    solver = maker.solver()

    def check() -> None:
        g = right_side(system)
        x, report = solver.solve(system.parts, system.vector(g), TWO_LEVEL)
        assert report.two_level
        np.testing.assert_allclose(system.dense @ x.download(), g, rtol=1e-5, atol=1e-5)

    check()
    structure.kappas[-1] = np.array([[4, 58], [7, 52], [1, 91]], np.int32)
    maker.build(system, structure, STATIC)
    fill_nets(system.cpu)
    system.send_values()
    check()
    structure.kappas[0] = structure.kappas[0][::2].copy()
    maker.build(system, structure, STATIC)
    fill_nets(system.cpu)
    system.send_values()
    check()


def test_breakdown_is_said_and_block_jacobi_goes_on(maker: Maker, caplog: pytest.LogCaptureFixture) -> None:
    system = maker.of_scalars([2, 4, 2])  # indefinite, and positive along (1, 1)
    solver = maker.solver()
    with caplog.at_level(logging.WARNING, "yasps"):
        x, report = solver.solve(system.parts, system.vector(np.ones(2)), TWO_LEVEL)
    assert report.converged
    assert report.coarse_broke_down
    assert not report.two_level
    np.testing.assert_allclose(x.download(), [1 / 6, 1 / 6])
    assert "block Jacobi goes on alone" in caplog.text
    report = solver.solve(system.parts, system.vector(np.array([1.0, -1.0])), TWO_LEVEL)[1]
    assert report.reason is StopReason.NOT_POSITIVE_DEFINITE
    system.cpu[0].values[:] = [4, 1, 2]
    system.send_values()
    x, report = solver.solve(system.parts, system.vector(np.ones(2)), TWO_LEVEL)
    assert report.two_level, "what broke down before is forgotten"
    np.testing.assert_allclose(x.download(), [1 / 7, 3 / 7])


def test_what_is_solved_needs_no_coarse_space(maker: Maker, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor what cannot be: the host looks before it asks for one."""
    system = net_system(maker)
    monkeypatch.setattr(CudaCoarseSpace, "make", lambda *_: pytest.fail("made"))
    solver = maker.solver()
    assert solver.solve(system.parts, system.vector(np.zeros(system.size)), TWO_LEVEL)[1].iterations == 0
    report = solver.solve(system.parts, system.vector(np.full(system.size, np.nan)), TWO_LEVEL)[1]
    assert report.reason is StopReason.NOT_FINITE


def test_more_bodies_than_the_coarse_space_has_room_for(maker: Maker) -> None:
    """The largest take part, the others have block Jacobi alone."""
    count = 600
    pairs = np.arange(0, 100, dtype=np.int32).reshape(-1, 2)
    structure = Structure((count,), (1,), [pairs + 1])
    system = maker.random(structure, parts=1, definite=False)
    system.cpu[0].groups[0].values[:] = np.where((system.cpu[0].groups[0].rows == system.cpu[0].groups[0].cols), 3, -1)[
        :, None, None
    ]
    system.send_values()
    space = maker.solver()._coarse
    space._send(*aggregates_without(range(500, count), count))
    assert (space._unknown_of.download()[500:] == -1).all()
    assert (space._unknown_of.download()[:500] == np.arange(500)).all()
    np.testing.assert_array_equal(space._members.download(), np.arange(500))


def aggregates_without(left_out: range, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Each scalar but these is an aggregate: numbers, sizes, offsets."""
    numbers = np.arange(count, dtype=np.int32)
    of = np.where(np.isin(numbers, left_out), np.int32(-1), numbers)
    return of, np.ones(count, np.int32), numbers


def test_no_aggregates_of_no_unknowns(maker: Maker) -> None:
    """Memory that is not there is not asked about."""
    structure = Structure((1,), (3,), [])
    system = maker.random(structure, parts=1, definite=False)
    system.cpu[0].groups[0].values[0] = np.diag([1.0, 2.0, 4.0])
    system.send_values()
    x, report = maker.solver().solve(system.parts, system.vector(np.ones(3)), TWO_LEVEL)
    assert report.converged
    np.testing.assert_allclose(x.download(), [1.0, 0.5, 0.25])
