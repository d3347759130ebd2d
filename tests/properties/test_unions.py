"""UNIONs of targets and constants are read and written like targets; others through what their members compute."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cuda_on_host import HostDevice
from scene_checks import check_device_kernels, check_kernels
from small_scenes import emit
from union_scenes import COUNT, UnionScene

from yasps import NotFiniteError, Scene
from yasps.backend.codegen.object_text import ObjectCode
from yasps.backend.codegen.preludes import without_preludes
from yasps.backend.codegen.scene_view import SceneView
from yasps.backend.cpp.object import CppEmitter
from yasps.backend.cuda.object import CudaEmitter
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.frontend.execution.instance_order import grouped
from yasps.passes.pipeline import run_pipeline
from yasps.runtime.core.library import Runtime
from yasps.runtime.matrix.ordering import FEWEST_BLOCKS

DIRECT = {
    "several, one without vertices": {"members": ("pinned", "free", "empty", "moved", "free")},
    "nested": {"members": ("pinned", "free", "pinned", "free"), "nested": True},
    "computed of constants": {"members": ("computed", "free")},
}
"""Unions whose members are, at each instance, targets or constants."""
PARAMETERISED = {
    "none free": {"members": ("affine", "pinned", "of a union"), "projection": "clamp"},
    "nested": {"members": ("affine", "pinned", "free", "empty", "of a union"), "nested": True},
    "one after another": {"members": ("affine",), "projection": "clamp"},
}
"""Unions with members that are computed from targets."""


@pytest.mark.parametrize("kind", DIRECT)
def test_unions_of_targets_and_constants(kind: str, runtime: Runtime) -> None:
    """Energy, gradient, Hessian: interpreter and complex steps."""
    check_kernels(UnionScene(**DIRECT[kind]).scene, runtime)


def test_unions_of_targets_and_constants_on_devices(device: HostDevice) -> None:
    members = ("pinned", "free", "pinned", "free")
    check_device_kernels(UnionScene(members, nested=True, projection="clamp").scene, device)


@pytest.mark.parametrize("kind", DIRECT)
def test_nothing_is_pulled_back_to_targets_and_constants(kind: str) -> None:
    """Derivatives call no other object, but for values that are computed; objects that nobody calls are not made."""
    view = SceneView(run_pipeline(emit(UnionScene(**DIRECT[kind]).scene).module))
    for emitter in (CppEmitter(view, True), CudaEmitter(view)):
        emitter.emit_all()
        assert not [code.name for code in emitter.codes.values() if "_pull(" in called_by(code)]
        assert ("outer.v.x" in emitter.codes) == ("computed" in DIRECT[kind]["members"])


def called_by(code: ObjectCode) -> str:
    """The text of a derivative's object without the common preludes; of others nothing."""
    return without_preludes(code.text) if "derive" in code.entries else ""


@pytest.mark.parametrize("kind", PARAMETERISED)
def test_unions_of_parameterisations(kind: str, runtime: Runtime) -> None:
    """Packs of several branches, of one, with less than 8 instances; static energies and those whose instances change,
    of pairs that share unknowns."""
    compiled = check_kernels(UnionScene(**PARAMETERISED[kind]).scene, runtime)
    several = len(PARAMETERISED[kind]["members"]) > 1
    for energy in ("static", "dynamic"):
        assert (compiled.placements[f"springs.{energy}.energy"].ordered is not None) == several


def test_deterministic_scenes_do_not_depend_on_the_number_of_threads(runtime: Runtime) -> None:
    results = []
    for threads in (1, 3):
        made = UnionScene(("affine", "pinned", "of a union"), projection="clamp", deterministic=True)
        results.append(derivatives_of(made.scene, replace(runtime, threads=threads)))
    (gradient, hessian), (other_gradient, other_hessian) = results
    assert np.array_equal(gradient, other_gradient)
    assert np.array_equal(hessian, other_hessian)


def test_the_order_of_instances_is_seen_by_kernels_alone(runtime: Runtime) -> None:
    """Placement indices, energies and errors are of the user's instances, also after their number has changed."""
    made = UnionScene(("free", "affine"), projection="clamp")
    made.scene._runtime = runtime
    springs, compiled = made.scene.springs.dynamic, made.scene.compile()
    assert isinstance(compiled, CpuScene)
    for ends in ([[0, 3], [1, 0], [4, 4], [5, 2], [2, 1]], [[3, 0], [0, 1]], [], [[5, 5], [0, 0], [4, 5]]):
        springs.ends.update_value(ends)
        check_kernels(made.scene, runtime)
        compiled = made.scene.compile()
        (term,) = (term for term in compiled._terms if term.symbol == "springs.dynamic.energy")
        kappas = compiled.placement_indices(term)
        assert len(kappas) == len(ends)
        for kappa, pair in zip(kappas, ends, strict=True):
            for slot, vertex in enumerate(pair):
                places = kappa[2 * slot : 2 * slot + 2]
                assert (places > 0).sum() == (1 if vertex < COUNT else 2)
                assert vertex >= COUNT or places[0] == 1 + 3 * vertex
    made.targets[0].update_value(np.array([[1e200] * 3, [0.0] * 3, [0.0] * 3]))
    springs.ends.update_value([[4, 5], [1, 2], [4, 0], [2, 2]])
    made.scene.springs.static.ends.update_value([[4, 4]] * made.scene.springs.static.num_instances)
    with pytest.raises(NotFiniteError, match=r"springs\.dynamic\.energy.* on instance 2 "):
        compiled.assemble()


@pytest.mark.parametrize("branches", [[2, 0, 1, 0, 2], [1 << 40, 3, 1 << 40, 3, 5]])
@pytest.mark.parametrize("order", [None, [4, 3, 2, 1, 0]])
def test_equal_branches_come_together_in_the_order_they_had(branches: list[int], order: list[int] | None) -> None:
    given = None if order is None else np.array(order, np.int64)
    found = grouped(np.array(branches, np.int64), given)
    before = range(5) if order is None else order
    assert found is not None
    assert found.tolist() == sorted(before, key=lambda k: branches[k])


def test_instances_of_one_branch_keep_their_order() -> None:
    assert grouped(np.array([7, 7, 7]), None) is None
    assert grouped(np.array([0, 7, 7]), None) is None
    assert grouped(np.array([], np.int64), None) is None


def derivatives_of(scene: Scene, runtime: Runtime) -> tuple[np.ndarray, np.ndarray]:
    scene._runtime = runtime
    compiled = scene.compile()
    assert isinstance(compiled, CpuScene)
    gradient = compiled.assemble()
    return gradient, (compiled.static_matrix.to_scipy() + compiled.dynamic_matrix.to_scipy()).toarray()


def test_the_general_path_finds_the_same(runtime: Runtime) -> None:
    """Another member, which no spring reaches, makes a union one that has to be pulled back."""
    members, most = ("free", "pinned"), 2 * COUNT
    gradient, hessian = derivatives_of(UnionScene(members, projection="clamp").scene, runtime)
    general = UnionScene((*members, "affine"), projection="clamp", most=most)
    size = len(gradient)
    other_gradient, other_hessian = derivatives_of(general.scene, runtime)
    assert len(other_gradient) > size == 3 * COUNT
    np.testing.assert_allclose(other_gradient[:size], gradient, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(other_hessian[:size, :size], hessian, rtol=1e-13, atol=1e-13)


def test_instances_keep_their_order_where_a_union_leads_back_to_them() -> None:
    """A pin's own spring reads its constant and, through a union with the pins, that of another: not in one order."""
    count = FEWEST_BLOCKS + 100
    random = np.random.default_rng(2)
    scene = Scene("pins", threads=1)
    mesh = scene.add_mesh("m")
    free, pins = mesh.add_primitive("free", count), mesh.add_primitive("pins", count)
    position = free.add_attribute("x", 1, 1, value=random.normal(size=count))
    anchor = pins.add_constant("x", 1, 1, value=random.normal(size=count))
    union = mesh.add_primitive_union("all", [free, pins])
    ends = np.column_stack([random.permutation(count), count + random.permutation(count)])
    both = pins.add_attribute(
        "both", through=pins.add_connectivity("ends", union, ends, 2), source=union.add_attribute("x")
    )
    stretch = both.row(0) - 2 * both.row(1) - anchor
    scene.add_energy(pins.add_attribute("energy", computed_attribute=stretch * stretch))
    scene.add_minimize_target(position)
    x, a = position.value.ravel(), anchor.value.ravel()
    wanted = np.zeros(count)
    wanted[ends[:, 0]] = 2 * (x[ends[:, 0]] - 2 * a[ends[:, 1] - count] - a)
    assert np.allclose(scene.compile().assemble(), wanted, rtol=1e-12, atol=1e-12)
