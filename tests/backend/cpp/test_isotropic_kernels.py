"""Kernels of isotropic energies against the interpreter, which projects by eigenvalues of the whole matrix."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mat_bodies import relative_error

from yasps import Attribute, NotFiniteError, Scene, identity, materials
from yasps.frontend.execution import scene_source
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.passes.pipeline import run_pipeline

Check = Callable[[Scene], CpuScene]
Energy = Callable[[Attribute], Attribute]


def stable(f: Attribute) -> Attribute:
    return materials.stable_neo_hookean(f, 2.0, 3.0, 0.7)


def st_venant_kirchhoff(f: Attribute) -> Attribute:
    e = 0.5 * (f.T * f - identity(f.shape[1]))
    return 2.0 * e.dot(e) + 1.5 * e.trace() * e.trace()


def cloth(f: Attribute) -> Attribute:
    return materials.baraff_witkin(f, 2.0, 3.0, 0.7)


def area_or_volume(f: Attribute) -> Attribute:
    """Stable Neo-Hookean, or with the change of area in place of det F."""
    if f.shape == (3, 3):
        return stable(f)
    change = (f.T * f).det().sqrt()
    return f.dot(f) - (f.dot(f) + 1).log() + 1.5 * (change - 1.3) ** 2


def elements(energy: Energy, count: int, noise: float, cols: int = 3, projection: str = "clamp") -> Scene:
    """`count` tets (3x3 F) or triangles (3x2) on shared points; noise around F = I, over all of it when it is large."""
    random = np.random.default_rng(count)
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    corners_of_each = cols + 1
    points, primitive = mesh.add_primitive("v", 11), mesh.add_primitive("e", count)
    rest = random.random((11, 3))
    indices = np.array([random.permutation(11)[:corners_of_each] for _ in range(count)])
    edges = (rest[indices[:, 1:]] - rest[indices[:, :1]]).swapaxes(1, 2)
    inverse = np.linalg.inv(edges[:, :cols])  # for a triangle, of its shadow in the plane
    points.add_attribute("x", 3, 1, value=rest + noise * random.standard_normal((11, 3)))
    corners = primitive.add_connectivity("corners", points, indices, corners_of_each)
    x = primitive.add_attribute("x", through=corners, source=points["x"])
    make = materials.deformation_gradient if cols == 3 else materials.triangle_deformation
    f = make(x, primitive.add_constant("inverse", cols, cols, value=inverse))
    scene.add_energy(primitive.add_attribute("energy", computed_attribute=energy(f)), projection=projection)
    scene.add_minimize_target(points["x"])
    return scene


@pytest.mark.parametrize("projection", ["clamp", "abs"])
@pytest.mark.parametrize("noise", [1e-2, 0.3, 1.0])
@pytest.mark.parametrize("cols", [3, 2])
@pytest.mark.parametrize("energy", [area_or_volume, st_venant_kirchhoff])
def test_agrees_with_the_interpreter(
    energy: Energy, cols: int, noise: float, projection: str, agrees_with_interpreter: Check
) -> None:
    agrees_with_interpreter(elements(energy, 21, noise, cols, projection))


@pytest.mark.parametrize("projection", ["clamp", "abs"])
def test_two_vectors(projection: str, agrees_with_interpreter: Check) -> None:
    """Cloth, which is isotropic in the images of warp and weft: at random, and then flat to a line."""
    scene = elements(cloth, 130, 0.4, 2, projection)
    agrees_with_interpreter(scene)
    scene.m.v["x"].update_value(scene.m.v["x"].value.reshape(-1, 3) * np.array([3.0, 0.0, 0.0]))
    agrees_with_interpreter(scene)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 130])
def test_counts_around_a_pack_and_a_batch(count: int, agrees_with_interpreter: Check) -> None:
    agrees_with_interpreter(elements(stable, count, 0.5))


def test_degenerate_deformations(agrees_with_interpreter: Check) -> None:
    """All points on a line, in a plane, mirrored."""
    scene = elements(st_venant_kirchhoff, 21, 0.0)
    x = scene.m.v["x"]
    rest = x.value.copy()
    for stretches in ((3, 0, 0), (0, 2, 0.5), (1, 1.1, -1), (-0.3, -0.3, 2)):
        x.update_value(rest.reshape(-1, 3) * np.array(stretches))
        agrees_with_interpreter(scene)


def test_a_stored_matrix(agrees_with_interpreter: Check) -> None:
    """F is itself the target: nothing computes it."""
    random = np.random.default_rng(0)
    for shape in ((3, 3), (9, 1)):
        scene = Scene("bodies")
        bodies = scene.add_mesh("m").add_primitive("b", 10)
        a = bodies.add_attribute("a", *shape, value=0.7 * random.standard_normal((10, *shape)))
        energy = st_venant_kirchhoff(a if shape == (3, 3) else a.reshape(3, 3))
        scene.add_energy(bodies.add_attribute("energy", computed_attribute=energy))
        scene.add_minimize_target(a)
        agrees_with_interpreter(scene)


@pytest.mark.parametrize(
    ("energy", "cols", "call"), [(stable, 3, "sink.project_isotropic("), (cloth, 2, "sink.project_two_vectors(")]
)
def test_with_and_without_the_proof(
    energy: Energy, cols: int, call: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The same Hessian to rounding, by another function of the runtime."""
    hessians, codes = [], []
    for name, without in (("with", ()), ("without", ("prove-isotropy",))):
        monkeypatch.setattr(scene_source, "run_pipeline", functools.partial(run_pipeline, without=without))
        scene = elements(energy, 50, 0.6, cols)
        monkeypatch.setenv("YASPS_DUMP_IR", str(tmp_path / name))  # and lower it now, code is not taken from the cache
        compiled = scene.compile()
        compiled.assemble()
        hessians.append(compiled.static_matrix.to_scipy().toarray())
        codes.append("".join(path.read_text() for path in (tmp_path / name).rglob("*.cpp")))
    assert call in codes[0]
    assert call not in codes[1]
    assert relative_error(hessians[0], hessians[1]) < 1e-12
    assert np.linalg.eigvalsh(hessians[0])[0] > -1e-12 * np.abs(hessians[0]).max()


def test_a_singular_energy_names_its_instance() -> None:
    scene = elements(lambda f: f.det().log() ** 2, 12, 0.0)
    x = scene.m.v["x"]
    x.update_value(0 * x.value.reshape(-1, 3))
    with pytest.raises(NotFiniteError, match="energy"):
        scene.compile().assemble()
