"""Programs: which objects there are, what the cache shares, and what is reported when something is wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_scenes import mixed_union, shared_targets, soft_tets, stable_neo_hookean

from yasps import CompilerNotFoundError, NotFiniteError, Scene
from yasps.backend.codegen.program import sources_of
from yasps.backend.codegen.scene_view import SceneView
from yasps.backend.cpp.object import CppEmitter
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.runtime.build.toolchain import DERIVATIVE_FLAGS, find_compiler


def _text_of(compiled: CpuScene, name: str) -> str:
    return compiled.program.codes[name].text


# -- sharing -----------------------------------------------------------------------------------------------


def _two_bodies() -> Scene:
    """Two meshes of tetrahedra with the same energy."""
    scene = soft_tets(name="two")
    mesh = scene.add_mesh("second")
    random = np.random.default_rng(2)
    vertices, tets = mesh.add_primitive("points", 5), mesh.add_primitive("cells", 2)
    rest = random.random((5, 3))
    vertices.add_constant("X", 3, 1, value=rest)
    vertices.add_attribute("y", 3, 1, value=rest + 0.1 * random.random((5, 3)))
    corners = tets.add_connectivity("vs", vertices, [[0, 1, 2, 3], [1, 2, 3, 4]], 4)
    energy = stable_neo_hookean(tets, corners, vertices["y"], vertices["X"])
    scene.add_energy(tets.add_attribute("psi", computed_attribute=energy))
    scene.add_minimize_target(vertices["y"])
    return scene


def test_energies_of_equal_text_are_one_object() -> None:
    compiled = _two_bodies().compile()
    codes = compiled.program.codes
    for first, second in (("m.t.elastic", "second.cells.psi"), ("m.v.x.kappa", "second.points.y.kappa")):
        assert codes[first].symbol == codes[second].symbol
        assert codes[first].bindings != codes[second].bindings
    assert codes["m.t.elastic.derivative"].symbol == codes["second.cells.psi.derivative"].symbol
    names = [module.name for module in compiled.report.modules]
    assert not {"m.t.elastic", "second.cells.psi"} <= set(names)


def test_shared_objects_read_their_own_numbers() -> None:
    scene = _two_bodies()
    energies = scene.energy_values()
    alone = soft_tets().energy_values()["m.t.elastic"]
    assert np.array_equal(energies["m.t.elastic"], alone)
    assert energies["second.cells.psi"].shape == (2,)
    assert not np.isclose(energies["second.cells.psi"][0], alone[0])


def test_equal_scenes_of_different_names_share_the_cache() -> None:
    soft_tets(name="first").compile()
    again = soft_tets(name="second", stretch=0.1).compile()
    assert all(module.cached for module in again.report.modules)
    assert again.report.compiled == 0


def test_scenes_of_one_name_side_by_side_do_not_meet() -> None:
    """Same structure, so the same library is loaded twice; each has its own pointers."""
    first, second = soft_tets(stretch=0.3), soft_tets(stretch=0.1)
    a, b = first.total_energy(), second.total_energy()
    assert abs(a - b) > 1e-3
    assert first.total_energy() == a
    gradients = [scene.gradient()[0] for scene in (first, second, first)]
    assert np.array_equal(gradients[0], gradients[2])
    assert not np.allclose(gradients[0], gradients[1])
    second.m.v["x"].update_value(first.m.v["x"].value)
    assert second.total_energy() == a


def test_texts_name_nothing_of_the_scene() -> None:
    """What is generated depends on structure alone; the cache could not be shared otherwise."""
    compiled = mixed_union().compile()
    for name, code in compiled.program.codes.items():
        for word in ("mixed", "stiff", "soft", "both.", "barrier", "swell"):
            assert word not in code.text, name


def test_text_is_the_same_when_emitted_twice() -> None:
    modules = [mixed_union().compile().module for _ in range(2)]
    texts = [[code.text for code in CppEmitter(SceneView(module), True).emit_all()] for module in modules]
    assert texts[0] == texts[1]


def test_files_include_no_headers() -> None:
    for code in shared_targets().compile().program.codes.values():
        assert "#include" not in code.text


def test_every_object_has_the_entries_it_is_wanted_for() -> None:
    program = mixed_union().compile().program
    assert program.codes["both.v.x"].entries == ("value_lanes", "pull_lanes")
    assert program.codes["both.pp.barrier"].entries == ("batch",)
    assert program.codes["both.pp.barrier.derivative"].entries == ("derive", "branches")
    assert program.codes["stiff.v.x.jacobian"].entries == ("pull_lanes",)
    for name, code in program.codes.items():
        for entry in code.entries:
            assert program.function(name, entry) != 0


def test_kernels_of_derivatives_alone_have_further_flags() -> None:
    compiler = replace(find_compiler(), is_clang=False)
    codes = mixed_union().compile().program.codes.values()
    derivatives = {code.symbol for code in codes if "derive" in code.entries}
    flags = {source.name: source.flags for source in sources_of(codes, compiler)}
    assert derivatives
    assert flags == {code.symbol: DERIVATIVE_FLAGS if code.symbol in derivatives else () for code in codes}
    assert not any(source.flags for source in sources_of(codes, replace(compiler, is_clang=True)))  # it knows few


def test_generated_sources_are_dumped_under_the_users_names(tmp_path: Path) -> None:
    scene = soft_tets()
    scene.dump_ir(tmp_path)
    generated = {path.name for path in (tmp_path / "generated").iterdir()}
    assert {"m.t.elastic.cpp", "m.t.elastic.derivative.cpp", "m.v.x.kappa.cpp"} <= generated
    assert (tmp_path / "00-frontend.mlir").exists()


def test_the_dump_folder_of_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("YASPS_DUMP_IR", str(tmp_path))
    soft_tets(name="watched").compile()
    assert (tmp_path / "watched" / "11-outline-modules.mlir").exists()


# -- outputs -------------------------------------------------------------------------------------------------


def test_values_of_every_kind_of_attribute_on_all_instances() -> None:
    """Computed, JOINed and UNITED attributes with several entries, more instances than a pack."""
    random = np.random.default_rng(3)
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    a, b = mesh.add_primitive("a", 11), mesh.add_primitive("b", 6)
    numbers = {name: random.random((count, 2, 3)) for name, count in (("a", 11), ("b", 6))}
    for primitive in (a, b):
        primitive.add_constant("y", 2, 3, value=numbers[primitive.name])
    a.add_attribute("x", computed_attribute=a["y"] * np.diag([1.0, 2.0, 3.0]) + 1.0 * a["y"])
    b.add_attribute("x", computed_attribute=-b["y"])
    union = mesh.add_primitive_union("u", [b, a])
    x = union.add_attribute("x")
    pairs = mesh.add_primitive("p", 9)
    indices = random.integers(0, 17, (9, 2))
    ends = pairs.add_connectivity("ends", union, indices, 2)
    joined = pairs.add_attribute("x", through=ends, source=x)
    wanted_a = numbers["a"] * np.array([2.0, 3.0, 4.0])
    wanted = np.concatenate([-numbers["b"], wanted_a])
    assert np.allclose(a["x"].compute().array, wanted_a, rtol=1e-15)
    assert np.allclose(x.compute().array, wanted, rtol=1e-15)
    assert np.allclose(joined.compute().array, wanted[indices].reshape(9, 2, 6), rtol=1e-15)
    total = pairs.add_attribute("total", computed_attribute=joined.sum() * joined)
    factors = wanted[indices].sum(axis=(1, 2, 3))[:, None, None]
    assert np.allclose(total.compute().array, factors * wanted[indices].reshape(9, 2, 6), rtol=1e-14)


# -- errors ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("instance", [0, 7, 8, 12])
def test_what_is_not_finite_is_reported_with_energy_and_instance(instance: int) -> None:
    """log of a negative number, in the first pack, on its last lane and in the second."""
    scene = Scene("s")
    points = scene.add_mesh("m").add_primitive("v", 13)
    x = points.add_attribute("x", 1, 1, value=np.full(13, 2.0))
    scene.add_energy(points.add_attribute("fine", computed_attribute=x * x))
    scene.add_energy(points.add_attribute("logarithm", computed_attribute=x.log() * x))
    scene.add_minimize_target(x)
    scene.gradient()
    values = np.full(13, 2.0)
    values[instance] = -1.0
    x.update_value(values)
    with pytest.raises(NotFiniteError, match=rf"energy m\.v\.logarithm is not finite \(nan\) on instance {instance};"):
        scene.minimize_energy()
    assert np.isnan(scene.total_energy())
    x.update_value(np.full(13, 2.0))
    assert np.isfinite(scene.gradient()[0]).all()


def test_the_first_bad_instance_is_named() -> None:
    scene = mixed_union(pairs=[[0, 7], [1, 9], [6, 6], [5, 5]])  # a point with itself: log 0
    with pytest.raises(NotFiniteError, match=r"both\.pp\.barrier is not finite \(inf\) on instance 2"):
        scene.solve()


def test_a_missing_compiler_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("YASPS_CXX", "no-such-compiler -O3")
    scene = soft_tets()
    with pytest.raises(CompilerNotFoundError, match="YASPS_CXX names the C\\+\\+ compiler 'no-such-compiler -O3'"):
        scene.gradient()
    monkeypatch.delenv("YASPS_CXX")
    assert len(scene.gradient()) == 1  # the failure left nothing behind
