"""The generated kernels compute what the interpreter does: values, gradients, projected Hessians."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from mat_bodies import relative_error
from small_scenes import SCENES, mixed_union, soft_tets

from yasps import Attribute, Scene, concat_rows
from yasps.frontend.execution.cpu_scene import CpuScene
from yasps.runtime.build.toolchain import find_compiler
from yasps.runtime.core.library import load_runtime

Check = Callable[[Scene], CpuScene]
COUNTS = (0, 1, 7, 8, 9, 17)
"""Around the 8 instances of a pack."""


@pytest.mark.parametrize("projection", ["clamp", "abs", "none"])
@pytest.mark.parametrize("name", SCENES)
def test_scenes(name: str, projection: str, agrees_with_interpreter: Check) -> None:
    agrees_with_interpreter(SCENES[name](projection))


def test_instance_counts_around_a_pack(agrees_with_interpreter: Check) -> None:
    """One scene, its contacts growing and shrinking."""
    scene = mixed_union(pairs=[])
    random = np.random.default_rng(0)
    for count in (*COUNTS, *reversed(COUNTS)):
        first = random.integers(0, 11, count)
        second = (first + random.integers(1, 11, count)) % 11  # never a point with itself: distance 0
        scene.both.pp.ends.update_value(np.stack([first, second], axis=1))
        compiled = agrees_with_interpreter(scene)
        assert compiled.energies()["both.pp.barrier"].shape == (count,)


@pytest.mark.parametrize("count", COUNTS[1:])
def test_counts_of_static_primitives(count: int, agrees_with_interpreter: Check) -> None:
    random = np.random.default_rng(count)
    scene = Scene("s")
    points = scene.add_mesh("m").add_primitive("v", count)
    points.add_constant("c", 2, 1, value=random.random((count, 2)))
    x = points.add_attribute("x", 2, 1, value=random.random((count, 2)))
    d = x - points["c"]
    scene.add_energy(points.add_attribute("e", computed_attribute=d.dot(d) * d.dot(d) - d[0] * d[1]))
    scene.add_minimize_target(x)
    compiled = agrees_with_interpreter(scene)
    assert compiled.static_matrix.size == 2 * count


def test_duplicates_in_a_connectivity(agrees_with_interpreter: Check) -> None:
    """Several slots of one instance are the same point, and instances repeat."""
    random = np.random.default_rng(2)
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    points, elements = mesh.add_primitive("v", 4), mesh.add_primitive("e", 9)
    points.add_attribute("x", 3, 1, value=random.random((4, 3)))
    indices = random.integers(0, 4, (9, 4))
    indices[0], indices[1], indices[2] = [1, 1, 1, 1], [0, 2, 0, 2], [2, 0, 0, 2]
    corners = elements.add_connectivity("corners", points, indices, 4)
    x = elements.add_attribute("x", through=corners, source=points["x"])
    energy = (x.row(0) - 2.0 * x.row(1)).dot(x.row(2)) ** 2 + (1.0 + x.row(3).dot(x.row(0))).sin()
    scene.add_energy(elements.add_attribute("e", computed_attribute=energy))
    scene.add_minimize_target(points["x"])
    agrees_with_interpreter(scene)


def test_both_slots_on_one_affine_body(agrees_with_interpreter: Check) -> None:
    agrees_with_interpreter(mixed_union(pairs=[[0, 1], [2, 0], [3, 4]]))


def test_both_slots_on_one_point(agrees_with_interpreter: Check) -> None:
    """A self pair is at distance 0, where a barrier has no value: a smooth energy instead."""
    random = np.random.default_rng(4)
    other = Scene("self")
    mesh = other.add_mesh("m")
    body, points, free = mesh.add_primitive("b", 1), mesh.add_primitive("p", 3), mesh.add_primitive("f", 2)
    body.add_attribute("A", 2, 2, value=random.random((2, 2)))
    points.add_constant("r", 2, 1, value=random.random((3, 2)))
    owner = points.add_connectivity("owner", body, [0, 0, 0], 1)
    a = points.add_attribute("A", through=owner, source=body["A"]).resize(2, 2)
    points.add_attribute("x", computed_attribute=a * points["r"])
    free.add_attribute("x", 2, 1, value=random.random((2, 2)))
    union = mesh.add_primitive_union("u", [points, free])
    union.add_attribute("x")
    pairs = mesh.add_primitive("pairs", 5)
    ends = pairs.add_connectivity("ends", union, [[0, 0], [4, 4], [1, 2], [3, 1], [2, 2]], 2)
    x = pairs.add_attribute("x", through=ends, source=union["x"])
    energy = (x.row(0).dot(x.row(1)) + x.row(0)[0]).exp()
    other.add_energy(pairs.add_attribute("e", computed_attribute=energy))
    other.add_minimize_target([body["A"], free["x"]])
    agrees_with_interpreter(other)


def test_an_empty_dynamic_primitive(agrees_with_interpreter: Check) -> None:
    compiled = agrees_with_interpreter(mixed_union(pairs=[]))
    assert compiled.dynamic_matrix.to_scipy().nnz == 0


def test_union_of_a_union_with_a_constant_member(agrees_with_interpreter: Check) -> None:
    random = np.random.default_rng(6)
    scene = Scene("s")
    mesh, other = scene.add_mesh("m"), scene.add_mesh("o")
    free, fixed, cage = mesh.add_primitive("free", 3), mesh.add_primitive("fixed", 2), other.add_primitive("cage", 2)
    free.add_attribute("x", 2, 1, value=random.random((3, 2)))
    fixed.add_constant("x", 2, 1, value=random.random((2, 2)))
    cage.add_attribute("x", 2, 1, value=random.random((2, 2)))
    inside = other.add_primitive("inside", 4)
    inside.add_constant("w", 1, 2, value=random.random((4, 2)))
    corners = inside.add_connectivity("corners", cage, random.integers(0, 2, (4, 2)), 2)
    joined = inside.add_attribute("corners_x", through=corners, source=cage["x"])
    inside.add_attribute("x", computed_attribute=(inside["w"] * joined).T)
    first = mesh.add_primitive_union("first", [fixed, free])
    first.add_attribute("x")
    second = other.add_primitive_union("second", [inside, first])
    second.add_attribute("x")
    pairs = other.add_primitive("pairs", 10)
    ends = pairs.add_connectivity("ends", second, random.integers(0, 9, (10, 3)), 3)
    x = pairs.add_attribute("x", through=ends, source=second["x"])
    bend = x.row(0) + x.row(1) - 2.0 * x.row(2)
    scene.add_energy(pairs.add_attribute("e", computed_attribute=(1.0 + bend.dot(bend)).sqrt() - x.row(0)[0] ** 3))
    scene.add_energy(second.add_attribute("own", computed_attribute=second["x"].dot(second["x"]) ** 2))
    scene.add_minimize_target([free["x"], cage["x"]])
    agrees_with_interpreter(scene)


@pytest.mark.parametrize("projection", ["none", "clamp", "abs"])
def test_a_nonlinear_parameterisation(projection: str, agrees_with_interpreter: Check) -> None:
    """Points in polar coordinates about a moving centre, behind a UNION and a JOIN: the curvature term of eq. 3."""
    random = np.random.default_rng(11)
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    centre = mesh.add_attribute("centre", 2, 1, value=[0.3, -0.2])
    polar, free = mesh.add_primitive("polar", 5), mesh.add_primitive("free", 4)
    r = polar.add_attribute("r", 2, 1, value=random.uniform(0.5, 1.5, (5, 2)))
    polar.add_attribute("x", computed_attribute=r[0] * concat_rows([r[1].cos(), r[1].sin()]) + centre)
    free.add_attribute("x", 2, 1, value=random.random((4, 2)))
    union = mesh.add_primitive_union("u", [polar, free])
    x = union.add_attribute("x")
    pairs = mesh.add_primitive("p", 11)
    first = random.integers(0, 9, 11)
    second = (first + random.integers(1, 9, 11)) % 9
    ends = pairs.add_connectivity("ends", union, np.stack([first, second], axis=1), 2)
    pair = pairs.add_attribute("x", through=ends, source=x)
    stretch = (pair.row(0) - pair.row(1)).norm() - 0.7
    scene.add_energy(pairs.add_attribute("spring", computed_attribute=stretch * stretch), projection=projection)
    scene.add_energy(union.add_attribute("gravity", computed_attribute=9.8 * x[1]), projection=projection)
    scene.add_minimize_target([free["x"], r, centre])
    agrees_with_interpreter(scene)


def test_new_numbers_and_moved_arrays_are_seen(agrees_with_interpreter: Check) -> None:
    scene = soft_tets()
    before = scene.compile()
    x = scene.m.v["x"]
    x.update_value(x.value + 0.1)
    assert agrees_with_interpreter(scene) is before


FUNCTIONS: dict[str, Callable[[Attribute], Attribute]] = {
    "sqrt": lambda x: x.sqrt(),
    "exp": lambda x: x.exp(),
    "log": lambda x: x.log(),
    "sin": lambda x: x.sin(),
    "cos": lambda x: x.cos(),
    "pow": lambda x: x**1.7,
}


@pytest.mark.parametrize("vector_math", [True, False], ids=["vector-math", "lane-by-lane"])
def test_functions_of_the_c_library(vector_math: bool) -> None:
    """Each function by libmvec, where there is one, and lane by lane, against NumPy."""
    compiler = find_compiler()
    if vector_math and not compiler.has_vector_math:
        pytest.skip("this C library has no vector functions")
    scene = Scene("s")
    count = 13
    points = scene.add_mesh("m").add_primitive("v", count)
    x = points.add_attribute("x", 1, 1, value=np.random.default_rng(9).uniform(0.3, 3.0, count))
    for name, function in FUNCTIONS.items():
        scene.add_energy(points.add_attribute(name, computed_attribute=function(x)), projection="none")
    scene.add_minimize_target(x)
    scene._runtime = load_runtime(replace(compiler, has_vector_math=vector_math))
    compiled = scene.compile()
    values = compiled.energies()
    for name in FUNCTIONS:
        wanted = x.value**1.7 if name == "pow" else getattr(np, name)(x.value)
        assert relative_error(values[f"m.v.{name}"], wanted) < 4e-15, name
    text = "".join(code.text for code in compiled.program.codes.values())
    assert ("_ZGV" in text) is vector_math
    v = x.value
    slope = 0.5 / np.sqrt(v) + np.exp(v) + 1 / v + np.cos(v) - np.sin(v) + 1.7 * v**0.7
    assert relative_error(compiled.assemble(), slope) < 1e-14


@pytest.mark.parametrize("threads", [1, 3])
def test_the_number_of_threads_changes_rounding_at_most(threads: int) -> None:
    results = []
    for n in (threads, 2):
        scene = Scene("s", threads=n)
        mesh = scene.add_mesh("m")
        points, springs = mesh.add_primitive("v", 40), mesh.add_primitive("s", 300)
        points.add_attribute("x", 3, 1, value=np.random.default_rng(7).random((40, 3)))
        indices = np.random.default_rng(8).permuted(np.tile(np.arange(40), (300, 1)), axis=1)[:, :2]
        ends = springs.add_connectivity("ends", points, indices, 2)
        pair = springs.add_attribute("x", through=ends, source=points["x"])
        scene.add_energy(springs.add_attribute("e", computed_attribute=(pair.row(0) - pair.row(1)).norm() ** 3))
        scene.add_minimize_target(points["x"])
        compiled = scene.compile()
        results.append((compiled.assemble(), compiled.static_matrix.to_scipy().toarray()))
        again = compiled.assemble()
        assert np.array_equal(again, results[-1][0])  # and with the same number nothing at all
    for first, second in zip(*results, strict=True):
        assert relative_error(first, second) < 1e-13


def test_constant_entries_of_a_hessian_that_is_expanded(agrees_with_interpreter: Check) -> None:
    """GCC 12 compiled the transposition of packs wrongly where an entry is a constant; see `hidden` in the prelude."""
    random = np.random.default_rng(216)
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    frames, points = mesh.add_primitive("f", 1), mesh.add_primitive("v", 4)
    a = frames.add_attribute("A", 2, 2, value=random.uniform(-1, 1, (1, 2, 2)))
    b = frames.add_attribute("b", 2, 1, value=random.uniform(-1, 1, (1, 2, 1)))
    r = points.add_constant("r", 2, 1, value=random.uniform(-1, 1, (4, 2, 1)))
    frame = points.add_connectivity("frame", frames, [[0]] * 4, 1)
    joined = points.add_attribute("A", through=frame, source=a).reshape(2, 2)
    x = points.add_attribute("x", computed_attribute=joined @ r + points.add_attribute("b", through=frame, source=b).T)
    pairs = mesh.add_primitive("p", 1)
    ends = pairs.add_connectivity("ends", points, [[0, 2]], 2)
    p = pairs.add_attribute("x", through=ends, source=x)
    y, z = p.row(0).T, p.row(1).T
    energy = pairs.add_attribute("E", computed_attribute=(1.0 + y.dot(y)).log() * 2.0 + z[1])
    scene.add_energy(energy, projection="clamp")
    scene.add_minimize_target([a, b])
    agrees_with_interpreter(scene)


@pytest.mark.parametrize("size", [1, 2, 4])
def test_blocks_of_other_sizes_than_3x3_are_turned_where_they_lie_below_the_diagonal(size: int) -> None:
    """a[0]^2 b[-1] over pairs in both orders and of one vertex with itself: its blocks are not symmetric."""
    values = np.random.default_rng(3).uniform(0.5, 1.5, (4, size))
    pairs = np.array([[0, 1], [2, 0], [3, 1], [1, 2], [2, 2], [3, 0], [1, 3], [0, 2], [2, 3], [3, 3]])
    scene = Scene("blocks", threads=1)
    mesh = scene.add_mesh("m")
    vertices, edges = mesh.add_primitive("v", len(values)), mesh.add_primitive("e", len(pairs))
    position = vertices.add_attribute("x", size, 1, value=values)
    ends = edges.add_connectivity("ends", vertices, pairs, 2)
    a, b = edges.add_attribute("both", through=ends, source=position)
    energy = a[0] ** 2 * b[-1] if size > 1 else a**2 * b
    scene.add_energy(edges.add_attribute("energy", computed_attribute=energy), projection="none")
    scene.add_minimize_target(position)
    wanted = np.zeros((values.size, values.size))
    for i, j in pairs:
        first, last = i * size, j * size + size - 1
        wanted[first, first] += 2 * values[j, -1]
        wanted[first, last] += 2 * values[i, 0]
        wanted[last, first] += 2 * values[i, 0]
    np.testing.assert_allclose(scene.hessian(projected=False).to_scipy().toarray(), wanted, rtol=1e-14, atol=1e-14)
