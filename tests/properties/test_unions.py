"""UNIONs of targets and constants are read and written like targets; others through what their members compute."""

from __future__ import annotations

import numpy as np
import pytest
from cuda_on_host import HostDevice
from scene_checks import check_device_kernels, check_kernels
from small_scenes import emit
from union_scenes import COUNT, UnionScene

from yasps import Scene
from yasps.backend.codegen.object_text import ObjectCode
from yasps.backend.codegen.preludes import without_preludes
from yasps.backend.codegen.scene_view import SceneView
from yasps.backend.cpp.object import CppEmitter
from yasps.backend.cuda.object import CudaEmitter
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.passes.pipeline import run_pipeline
from yasps.runtime.core.library import Runtime
from yasps.runtime.matrix.ordering import FEWEST_BLOCKS

DIRECT = {
    "free and pinned": {"members": ("free", "pinned")},
    "several, one without vertices": {"members": ("pinned", "free", "empty", "moved", "free")},
    "nested": {"members": ("pinned", "free", "pinned", "free"), "nested": True},
    "computed of constants": {"members": ("computed", "free")},
}
"""Unions whose members are, at each instance, targets or constants."""


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
