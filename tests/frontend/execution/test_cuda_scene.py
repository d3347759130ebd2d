"""Scenes on a device made of the host: the same results as on the processor, now and after every kind of change."""

from __future__ import annotations

import gc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from counting_device import CountingDevice
from cuda_on_host import HostDevice
from device_checks import on_device
from device_scenes import BODY, SCENES, close_pairs, contact, free, held, lever
from layered_scenes import ring_scene
from numpy.typing import NDArray
from small_scenes import dense_assembly, emit, mixed_union, soft_tets

from yasps import NotFiniteError, Scene, materials
from yasps.backend.cuda import program as cuda_program
from yasps.backend.reference.interpreter import Interpreter
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.frontend.execution.cuda_scene import CudaScene
from yasps.meshes import cloth_grid
from yasps.runtime.core.sink import THREADS

Array = NDArray[np.float64]
TOLERANCE = 1e-12
"""Of the largest entry."""
SOLVED = 1e-26
"""Relative squared residual: x has 10 digits then."""


@pytest.fixture(scope="module")
def device() -> HostDevice:
    """One for all scenes."""
    return HostDevice()


def assert_close(found: Any, wanted: Any, tolerance: float = TOLERANCE) -> None:
    found, wanted = np.asarray(found), np.asarray(wanted)
    assert found.shape == wanted.shape
    assert np.isfinite(found).all()
    assert np.abs(found - wanted).max(initial=0.0) <= tolerance * max(1e-300, np.abs(wanted).max(initial=0.0))


def hessian(scene: Scene, *, projected: bool = True) -> Array:
    return scene.hessian(projected=projected).to_scipy().toarray()


def assert_same_derivatives(scene: Scene, reference: Scene) -> None:
    """Energies, gradient and projected Hessian."""
    for name, values in reference.energy_values().items():
        assert_close(scene.energy_values()[name], values)
    assert scene.total_energy() == pytest.approx(reference.total_energy(), rel=TOLERANCE)
    assert_close(np.concatenate(scene.gradient()), np.concatenate(reference.gradient()))
    assert_close(hessian(scene), hessian(reference))


@pytest.mark.parametrize("name", SCENES)
def test_results_are_those_of_the_processor_and_of_the_interpreter(device: HostDevice, name: str) -> None:
    """The interpreter's only of the scene that has most kinds of layers: tests/backend compares the processor's."""
    reference, scene = SCENES[name](), on_device(SCENES[name](), device)
    assert_same_derivatives(scene, reference)
    assert_close(hessian(scene, projected=False), hessian(reference, projected=False))

    compiled = scene.compile()
    assert isinstance(compiled, CudaScene)
    if name == "nonlinear_contact":
        interpreter = Interpreter(compiled.module, emit(scene).data)
        gradient, matrix = dense_assembly(compiled.module, emit(scene).data)
        assert_close(np.concatenate(scene.gradient()), gradient)
        assert_close(hessian(scene), matrix)
        assert scene.total_energy() == pytest.approx(interpreter.total_energy(), rel=TOLERANCE)

    on_cpu = reference.compile()
    for unknown in range(sum(len(part) for part in scene.gradient())):
        assert compiled.changing_energies_at(unknown) == on_cpu.changing_energies_at(unknown)

    wanted, found = reference.solve(SOLVED, preconditioner="jacobi"), scene.solve(SOLVED, preconditioner="jacobi")
    assert wanted.report.converged
    assert found.report.converged
    for x, x_wanted in zip(found.directions, wanted.directions, strict=True):
        assert_close(x, x_wanted, 1e-9)
    assert abs(found.report.iterations - wanted.report.iterations) <= 0.1 * wanted.report.iterations + 2


@pytest.mark.parametrize("name", ["mixed_union", "levers", "nonlinear_contact"])
def test_deterministic_scenes_give_the_same_bits_in_any_order_of_threads(device: HostDevice, name: str) -> None:
    def results(given: HostDevice, deterministic: bool) -> list[Array]:
        scene = on_device(SCENES[name](), given, deterministic=deterministic)
        solution = scene.solve(1e-8)
        return [*solution.gradient, *solution.directions, hessian(scene), np.array([scene.total_energy()])]

    backwards = HostDevice(backwards=True)
    first, again = results(device, True), results(backwards, True)
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one, other)
    usual, turned = results(device, False), results(backwards, False)
    assert any(not np.array_equal(one, other) for one, other in zip(usual, turned, strict=True)), "nothing was shown"
    for one, other in zip(first, usual, strict=True):
        assert_close(one, other, 1e-2)  # of the directions, to the tolerance of the solver


def test_scenes_share_a_device() -> None:
    device = HostDevice()
    first, second = on_device(mixed_union(), device), on_device(mixed_union(projection="abs"), device)
    first_alone, second_alone = mixed_union(), mixed_union(projection="abs")
    for _ in range(2):
        assert_same_derivatives(first, first_alone)
        assert_same_derivatives(second, second_alone)
    taken = device.used
    del second
    gc.collect()
    assert 0 < device.used < taken, "what it took is given back"
    assert_same_derivatives(first, first_alone)
    del first
    gc.collect()
    assert device.used == 0


# -- what changed is copied, and nothing else --------------------------------------------------------------


def mirrors(scene: Scene) -> dict[int, str]:
    """Names of the scene's arrays by where they are on the device."""
    compiled = scene.compile()
    assert isinstance(compiled, CudaScene)
    return {mirror.array.address: f"{key.kind} {key.name}" for key, mirror in compiled._mirrors.items()}


def copied(device: CountingDevice, scene: Scene, work: Callable[[], object]) -> list[str]:
    """Which of the scene's arrays were copied to the device for this work."""
    device.uploads.clear()
    work()
    names = mirrors(scene)
    return sorted(names[address] for address in device.uploads if address in names)


def test_only_what_changed_is_copied_to_the_device() -> None:
    device = CountingDevice()
    scene, reference = on_device(mixed_union(), device), mixed_union()
    everything = copied(device, scene, scene.solve)
    assert len(everything) == len(set(everything)) == len(mirrors(scene))
    for work in (scene.total_energy, scene.gradient, scene.hessian, scene.solve, scene.energy_values):
        assert copied(device, scene, work) == []

    x = scene.soft.v["x"]
    x.update_value(x.value + 0.01)  # in place
    assert copied(device, scene, scene.solve) == ["storage soft.v.x"]
    reference.soft.v["x"].update_value(reference.soft.v["x"].value + 0.01)
    assert_same_derivatives(scene, reference)

    scene.stiff.body.update(A=np.eye(3), t=[1.0, 2.0, 3.0])  # other arrays
    assert copied(device, scene, scene.gradient) == ["storage stiff.body.A", "storage stiff.body.t"]
    reference.stiff.body.update(A=np.eye(3), t=[1.0, 2.0, 3.0])
    assert_same_derivatives(scene, reference)

    for part in (scene, reference):
        part.both.pp.connectivities["ends"].update_value([[0, 8], [2, 3], [9, 10]])
    assert copied(device, scene, scene.gradient) == ["indices both.pp.ends"]
    assert copied(device, scene, scene.gradient) == []
    assert_same_derivatives(scene, reference)


def test_little_comes_back() -> None:
    """A solve brings the gradient, the solution, and how derivatives and the solver ended."""
    device = CountingDevice()
    scene = on_device(mixed_union(), device)
    scene.solve()
    device.downloads.clear()
    solution = scene.solve()
    terms, size = len(scene.energies), sum(len(part) for part in solution.gradient)
    small = [count for count in device.downloads if count == 64]  # the state of the solver, after some iterations
    assert sorted(count for count in device.downloads if count != 64) == sorted([16 * terms, 8 * size, 8 * size])
    assert 1 <= len(small) <= 2 + solution.report.iterations // 24


def test_an_attribute_is_computed_on_the_device(device: HostDevice) -> None:
    scene, reference = on_device(mixed_union(), device), mixed_union()
    for attribute, wanted in ((scene.both.v["x"], reference.both.v["x"]), (scene.stiff.v["x"], reference.stiff.v["x"])):
        assert_close(attribute.compute().array, wanted.compute().array)
    scene.stiff.body["t"].update_value([5.0, 6.0, 7.0])
    reference.stiff.body["t"].update_value([5.0, 6.0, 7.0])
    assert_close(scene.both.v["x"].compute().array, reference.both.v["x"].compute().array)


# -- structures that change --------------------------------------------------------------------------------


@pytest.mark.parametrize("deterministic", [False, True])
def test_pairs_that_come_and_go(deterministic: bool) -> None:
    device = CountingDevice()
    bodies = (free, lever)
    scene = on_device(held(contact(*bodies, pairs=0), 1.0), device, deterministic=deterministic)
    reference = held(contact(*bodies, pairs=0), 1.0)
    for step, count in enumerate((0, 3, 300, 20, 0, 0, 150)):
        pairs = close_pairs(step, count, BODY * len(bodies))
        for part in (scene, reference):
            part.everything.pairs.connectivities["corners"].update_value(pairs)
        device.launches.clear()
        assert_same_derivatives(scene, reference)
        built = device.launches.count("yasps_structure_groups")
        assert built <= 1, "of the static part nothing changed"
    used = device.used
    scene.everything.pairs.connectivities["corners"].update_value(close_pairs(9, 10, BODY * len(bodies)))
    scene.solve(1e-4)
    scene.everything.pairs.connectivities["corners"].update_value(close_pairs(9, 300, BODY * len(bodies)))
    scene.solve(1e-4)
    grown = device.used
    scene.everything.pairs.connectivities["corners"].update_value(close_pairs(8, 290, BODY * len(bodies)))
    scene.solve(1e-4)
    assert used <= grown == device.used, "memory is kept when there are fewer pairs"


def test_threads_of_a_warp_take_the_same_branches() -> None:
    """They take the instances in the order in which the processor's kernel does, that of the last pairs."""
    device = CountingDevice()
    scene, reference = on_device(mixed_union(), device), mixed_union()
    for count in (100, 40):
        pairs = close_pairs(4, count, reference.both.v.num_instances)[:, :2]
        for part in (scene, reference):
            part.both.pp.connectivities["ends"].update_value(pairs)
        assert_same_derivatives(scene, reference)
        compiled, on_cpu = scene.compile(), reference.compile()
        assert isinstance(compiled, CudaScene)
        assert isinstance(on_cpu, CpuScene)
        symbol = next(term.symbol for term in on_cpu._terms if term.dynamic)
        wanted, placement = on_cpu.placements[symbol].ordered, compiled._placements[symbol]
        assert wanted is not None
        assert placement.is_sorted
        np.testing.assert_array_equal(placement.order.download(), wanted.order)
        assert (np.diff(wanted.order) < 0).any()
    device.launches.clear()
    scene.gradient()
    assert not [name for name in device.launches if name.endswith("_branches")], "sorted once for each structure"


@pytest.mark.parametrize(("deterministic", "limit"), [(False, "THREADS_WITH_WORKSPACE"), (True, "WORKSPACE")])
def test_threads_with_a_workspace_take_several_instances(
    device: HostDevice, deterministic: bool, limit: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There are only so many, because each has global memory of its own."""
    monkeypatch.setattr(cuda_program, f"MOST_{limit}", 100)
    scene = on_device(contact(free, lever, pairs=1000), device, deterministic=deterministic)
    assert any(code.workspace for code in scene.compile().code.codes.values())
    assert_same_derivatives(scene, contact(free, lever, pairs=1000))
    compiled = scene.compile()
    assert isinstance(compiled, CudaScene)
    most = max(code.workspace for code in compiled.code.codes.values())
    assert compiled.program._workspace.size == most * THREADS


def test_rows_of_variable_arity_that_grow(device: HostDevice) -> None:
    """Longer rows than the code was compiled for need a new compile; the same length or shorter ones do not."""
    scene = on_device(ring_scene("mean", nonlinear=True, projection="clamp"), device)
    reference = ring_scene("mean", nonlinear=True, projection="clamp")
    first = scene.compile()
    random = np.random.default_rng(0)
    for counts in ([1] * 7, [1, 2, 3, 4, 5, 1, 2], [2, 2, 2, 9, 1, 1, 3], [1] * 7):
        indices = random.integers(0, 7, sum(counts))
        for part in (scene, reference):
            part.mesh.vertices.connectivities["ring"].update_value(indices, counts)
        assert_same_derivatives(scene, reference)
        assert (scene.compile() is first) == (max(counts) <= 5 and not first.is_outgrown)


def test_a_new_energy_and_a_new_target_compile_everything_anew(device: HostDevice) -> None:
    scene, reference = on_device(soft_tets(), device), soft_tets()
    assert_same_derivatives(scene, reference)
    for part in (scene, reference):
        vertices = part.m.v
        pull = vertices.add_attribute("pull", 3, 1, value=np.arange(18.0))
        part.add_energy(vertices.add_attribute("spring", computed_attribute=(vertices["x"] - pull).norm() ** 4))
    assert_same_derivatives(scene, reference)
    assert list(scene.energy_values()) == ["m.t.elastic", "m.v.spring"]
    for part in (scene, reference):
        part.add_minimize_target(part.m.v["pull"])
    assert_same_derivatives(scene, reference)
    assert len(scene.gradient()) == 2


def test_primitives_without_instances(device: HostDevice) -> None:
    def make() -> Scene:
        scene = Scene("sparse")
        mesh = scene.add_mesh("m")
        points, nothing = mesh.add_primitive("points", 3), mesh.add_primitive("nothing", 0, is_dynamic=True)
        x = points.add_attribute("x", 2, 1, value=np.arange(6.0))
        y = nothing.add_attribute("x", 2, 1)
        union = mesh.add_primitive_union("both", [nothing, points])
        both_x = union.add_attribute("x")
        scene.add_energy(union.add_attribute("all", computed_attribute=both_x.norm()))
        scene.add_energy(nothing.add_attribute("none", computed_attribute=y.dot(y)))
        scene.add_energy(points.add_attribute("bowl", computed_attribute=x.dot(x) * x[0].exp()))
        pairs = mesh.add_primitive("pairs", 0, is_dynamic=True)
        ends = pairs.add_connectivity("ends", union, [], 2)
        both = pairs.add_attribute("both", through=ends, source=both_x)
        scene.add_energy(pairs.add_attribute("stretch", computed_attribute=(both.row(0) - both.row(1)).norm()))
        scene.add_minimize_target([y, x])
        return scene

    scene, reference = on_device(make(), device), make()
    assert_same_derivatives(scene, reference)
    assert [len(part) for part in scene.solve().directions] == [0, 6]


def test_a_scene_without_unknowns(device: HostDevice) -> None:
    def make() -> Scene:
        scene = Scene("empty")
        nothing = scene.add_mesh("m").add_primitive("nothing", 0, is_dynamic=True)
        y = nothing.add_attribute("x", 3, 1)
        scene.add_energy(nothing.add_attribute("none", computed_attribute=y.dot(y)))
        scene.add_minimize_target(y)
        return scene

    scene = on_device(make(), device)
    assert scene.total_energy() == 0.0
    solution = scene.solve()
    assert solution.report.converged
    assert [part.size for part in (*solution.gradient, *solution.directions)] == [0, 0]
    assert scene.hessian().to_scipy().shape == (0, 0)


# -- numbers that are none ---------------------------------------------------------------------------------


@pytest.mark.parametrize("instance", [0, 127, 128, 299])
def test_the_first_instance_that_is_not_finite_is_named(device: HostDevice, instance: int) -> None:
    """In the first and the last thread of a block; of several instances the first."""
    scene = Scene("s", device=device)
    points = scene.add_mesh("m").add_primitive("v", 300)
    x = points.add_attribute("x", 1, 1, value=np.full(300, 2.0))
    scene.add_energy(points.add_attribute("fine", computed_attribute=x * x))
    scene.add_energy(points.add_attribute("logarithm", computed_attribute=x.log() * x))
    scene.add_minimize_target(x)
    before = scene.gradient()[0]
    values = np.full(300, 2.0)
    values[instance:] = -1.0
    x.update_value(values)
    for work in (scene.gradient, scene.solve, scene.hessian):
        with pytest.raises(
            NotFiniteError, match=rf"energy m\.v\.logarithm is not finite \(nan\) on instance {instance};"
        ):
            work()
    assert np.isnan(scene.total_energy())
    x.update_value(np.full(300, 2.0))
    np.testing.assert_array_equal(scene.gradient()[0], before)


def test_an_infinite_hessian_is_reported(device: HostDevice) -> None:
    """The gradient of |x|^1.5 is finite at 0, where the second derivative is not."""
    scene = Scene("s", device=device)
    points = scene.add_mesh("m").add_primitive("v", 3)
    x = points.add_attribute("x", 1, 1, value=[1.0, 0.0, 4.0])
    scene.add_energy(points.add_attribute("steep", computed_attribute=x**1.5))
    scene.add_minimize_target(x)
    with pytest.raises(NotFiniteError, match=r"energy m\.v\.steep are not finite on instance 1;"):
        scene.solve()


@pytest.mark.nightly
def test_two_vectors_are_projected_without_them(device: HostDevice) -> None:
    """A thread takes the eigenvalues of the whole 6x6 Hessian, which a processor takes in the vectors' plane."""

    def cloth() -> Scene:
        mesh, scene = cloth_grid(divisions=(3, 3)), Scene("cloth")
        vertices = scene.add_mesh("m").add_primitive("v", len(mesh.vertices))
        moved = mesh.vertices + np.random.default_rng(0).uniform(-0.1, 0.1, mesh.vertices.shape)
        position = vertices.add_attribute("x", 3, 1, value=moved)
        triangles = scene.m.add_primitive("t", len(mesh.triangles))
        corners = triangles.add_connectivity("corners", vertices, mesh.triangles, 3)
        x = triangles.add_attribute("corner_positions", through=corners, source=position)
        inverse, area = materials.rest_triangles(mesh.vertices, mesh.triangles)
        f = materials.triangle_deformation(x, triangles.add_constant("inverse", 2, 2, value=inverse))
        energy = materials.baraff_witkin(f, 2.0, 1.0, triangles.add_constant("area", 1, 1, value=area))
        scene.add_energy(triangles.add_attribute("stretch", computed_attribute=energy))
        scene.add_minimize_target(position)
        return scene

    assert_same_derivatives(on_device(cloth(), device), cloth())
