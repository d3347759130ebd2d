"""Arrays that users give: every layout that is taken means what it says, and all others are refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from refusals import World, assert_refused, make_world

from yasps import Attribute, ConnectivityError, DataError, Scene, SceneError, ShapeMismatchError, YaspsError, constant
from yasps.backend.reference import scene_data
from yasps.contact import BarrierContact, CollisionGeometry
from yasps.materials import gravity, rest_shape, rest_triangles
from yasps.meshes import MeshError, TetrahedralMesh, stuff_isosurface
from yasps.meshes.tetrahedral_mesh import drop_unused_vertices
from yasps.output import FramePictures, OutputFileError, PictureError, Surface, VtkHdfSeries
from yasps.stepping import MovingPart, TimeStepper

Setter = Callable[[Any, int, tuple[int, int]], Attribute]


def at_first(values: Any, count: int, shape: tuple[int, int]) -> Attribute:
    return Scene("s").add_mesh("m").add_primitive("p", count).add_attribute("a", *shape, value=values)


def as_a_constant(values: Any, count: int, shape: tuple[int, int]) -> Attribute:
    return Scene("s").add_mesh("m").add_primitive("p", count).add_constant("a", *shape, value=values)


def later(values: Any, count: int, shape: tuple[int, int]) -> Attribute:
    attribute = Scene("s").add_mesh("m").add_primitive("p", count).add_attribute("a", *shape)
    attribute.update_value(values)
    return attribute


def by_update(values: Any, count: int, shape: tuple[int, int]) -> Attribute:
    primitive = Scene("s").add_mesh("m").add_primitive("p", count)
    attribute = primitive.add_attribute("a", *shape)
    primitive.update(a=values)
    return attribute


def on_a_dynamic_primitive(values: Any, count: int, shape: tuple[int, int]) -> Attribute:
    primitive = Scene("s").add_mesh("m").add_primitive("p", 0, is_dynamic=True)
    attribute = primitive.add_attribute("a", *shape)
    primitive.update(a=values)
    return attribute


STATIC: list[Setter] = [at_first, as_a_constant, later, by_update]
EVERYWHERE: list[Setter] = [*STATIC, on_a_dynamic_primitive]


@pytest.mark.parametrize("set_numbers", EVERYWHERE)
@pytest.mark.parametrize(
    ("count", "shape", "given"),
    [
        (3, (2, 2), (12,)),
        (3, (2, 2), (3, 4)),
        (3, (2, 2), (3, 2, 2)),
        (3, (2, 3), (3, 2, 3)),
        (5, (3, 1), (15,)),
        (5, (3, 1), (5, 3)),
        (5, (3, 1), (5, 3, 1)),
        (5, (3, 1), (5, 1, 3)),
        (4, (1, 1), (4,)),
        (4, (1, 1), (4, 1)),
        (4, (1, 1), (4, 1, 1)),
        (1, (2, 3), (6,)),
        (1, (2, 3), (1, 6)),
        (1, (2, 3), (1, 2, 3)),
    ],
)
def test_layouts_that_are_taken(
    set_numbers: Setter, count: int, shape: tuple[int, int], given: tuple[int, ...]
) -> None:
    numbers = np.arange(float(np.prod(given)))
    attribute = set_numbers(numbers.reshape(given), count, shape)
    np.testing.assert_array_equal(attribute.compute().array, numbers.reshape(count, *shape))


@pytest.mark.parametrize("set_numbers", STATIC)
@pytest.mark.parametrize(
    ("shape", "given"),
    [((3, 3), (3, 3)), ((2, 3), (2, 3)), ((3, 1), (1, 3)), ((3, 1), (3, 1)), ((1, 1), ()), ((1, 1), (1,))],
)
def test_one_instance_takes_its_matrix(set_numbers: Setter, shape: tuple[int, int], given: tuple[int, ...]) -> None:
    numbers = np.arange(float(np.prod(given)))
    attribute = set_numbers(numbers.reshape(given), 1, shape)
    np.testing.assert_array_equal(attribute.compute().array, numbers.reshape(1, *shape))


@pytest.mark.parametrize("set_numbers", EVERYWHERE)
@pytest.mark.parametrize(
    ("count", "shape", "given"),
    [
        (3, (2, 2), (4, 3)),
        (3, (2, 2), (2, 2, 3)),
        (3, (2, 2), (2, 6)),
        (3, (2, 2), (1, 12)),
        (3, (2, 3), (3, 3, 2)),
        (5, (3, 1), (3, 5)),
        (5, (3, 1), (3, 1, 5)),
        (4, (2, 6), (4, 3, 4)),
        (1, (2, 3), (3, 2)),
        (6, (2, 3), (3, 2)),
        (3, (2, 2), ()),
    ],
)
def test_other_layouts_are_refused(
    set_numbers: Setter, count: int, shape: tuple[int, int], given: tuple[int, ...]
) -> None:
    with pytest.raises(DataError) as caught:
        set_numbers(np.zeros(given), count, shape)
    message = str(caught.value)
    assert f"in shape {given}" in message
    rows, cols = shape
    n = "n" if set_numbers is on_a_dynamic_primitive else count
    assert f"({n}, {rows}, {cols})" in message  # what would be taken


def test_the_message_says_how_to_turn_the_array() -> None:
    with pytest.raises(DataError, match=r"last axis: give them as the first, e.g. by np.moveaxis\(array, -1, 0\)"):
        later(np.zeros((3, 5)), 5, (3, 1))
    with pytest.raises(DataError) as caught:
        later(np.zeros(7), 5, (3, 1))
    assert "last axis" not in str(caught.value)


@pytest.mark.parametrize("set_numbers", EVERYWHERE)
def test_how_an_array_lies_in_memory_makes_no_difference(set_numbers: Setter) -> None:
    numbers = np.arange(12.0).reshape(3, 2, 2)
    padded = np.zeros((6, 2, 4))
    padded[::2, :, ::2] = numbers
    same: list[Any] = [
        padded[::2, :, ::2],
        np.asfortranarray(numbers),
        numbers.astype(">f8"),
        numbers.astype("<f4"),
        numbers.astype(np.uint8),
        numbers.astype(">i2"),
        numbers[::-1].copy()[::-1],
        numbers.tolist(),
        np.ma.masked_array(numbers, mask=np.zeros_like(numbers, bool)),
        np.broadcast_to(numbers, (1, 3, 2, 2))[0],
    ]
    for array in same:
        np.testing.assert_array_equal(set_numbers(array, 3, (2, 2)).compute().array, numbers)


def test_numbers_are_copied() -> None:
    given = np.arange(6.0)
    for set_numbers in EVERYWHERE:
        attribute = set_numbers(given, 3, (2, 1))
        given[0] = 99.0
        assert attribute.value[0] == 0.0
        given[0] = 0.0


class OnGpu:
    """What arrays of other libraries look like, and refuse to be."""

    __cuda_array_interface__ = {"shape": (3,), "typestr": "<f8", "data": (0, True), "version": 3}  # noqa: RUF012

    def __array__(self, dtype: object = None, copy: object = None) -> Any:
        raise TypeError("Implicit conversion to a NumPy array is not allowed")


class NoArray:
    def __array__(self, dtype: object = None, copy: object = None) -> Any:
        raise RuntimeError("Can't call numpy() on Tensor that requires grad")


masked = np.ma.masked_array([1.0, 2.0, 3.0], mask=[False, True, False])
NO_NUMBERS: dict[str, tuple[Any, str]] = {
    "complex": (np.ones(3, complex), "complex128"),
    "text": (["1", "2", "3"], "<U1"),
    "bytes": ([b"1", b"2", b"3"], "S1"),
    "objects": (np.array([1.0, None, 2.0], object), "object"),
    "integers of any size": ([10**30, 1, 2], "object"),
    "dates": (np.zeros(3, "datetime64[s]"), "datetime64"),
    "records": (np.zeros(3, [("x", float)]), "real numbers"),
    "NaN": ([1.0, np.nan, 2.0], "entry 1 is nan"),
    "infinity": ([1.0, 2.0, -np.inf], "entry 2 is -inf"),
    "masked": (masked, "masked entries"),
    "a list of masked": ([masked[:1], masked[1:2], masked[2:]], "masked entries"),
    "the masked constant": ([1.0, np.ma.masked, 2.0], "masked entries"),
    "ragged": ([[1.0], [2.0, 3.0], [4.0]], "ragged"),
    "on a GPU": (OnGpu(), "on a GPU"),
    "no array": (NoArray(), "requires grad"),
    "a set": ({1.0, 2.0, 3.0}, "object"),
}


@pytest.mark.parametrize("set_numbers", EVERYWHERE)
@pytest.mark.parametrize(("values", "said"), NO_NUMBERS.values(), ids=NO_NUMBERS.keys())
def test_what_are_no_numbers_is_refused(set_numbers: Setter, values: Any, said: str) -> None:
    with pytest.raises(DataError, match=said):
        set_numbers(values, 3, (1, 1))


@pytest.mark.parametrize("name", ["complex", "text", "masked", "a list of masked", "NaN", "objects"])
def test_constants_of_expressions_are_checked_alike(name: str) -> None:
    with pytest.raises(DataError):
        constant(NO_NUMBERS[name][0])
    x = Scene("s").add_mesh("m").add_primitive("p", 2).add_attribute("x", 3, 1)
    with pytest.raises(DataError):
        gravity(x, 1.0, NO_NUMBERS[name][0])


# -- indices -----------------------------------------------------------------------------------------------------------

BAD_INDICES: dict[str, tuple[Any, str]] = {
    "(arity, n)": (np.zeros((4, 2), int), "(4, 2)"),
    "three axes": (np.zeros((2, 2, 2), int), "(2, 2, 2)"),
    "one number": (np.int64(3), "()"),
    "truth values": (np.zeros((2, 4), bool), "bool"),
    "whole floats": (np.zeros((2, 4)), "float64"),
    "NaN": (np.full((2, 4), np.nan), "float64"),
    "objects": (np.zeros((2, 4), object), "object"),
    "text": (np.full((2, 4), "1"), "<U1"),
    "complex": (np.zeros((2, 4), complex), "complex128"),
    "masked": (np.ma.masked_array(np.zeros((2, 4), int), mask=np.eye(2, 4, dtype=bool)), "masked entries"),
    "uint64 that int32 makes 0": (np.array([[0, 1, 2, 2**32]] * 2, np.uint64), "4294967296"),
    "int64 that int32 makes 1": (np.array([[0, 1, 2, 2**32 + 1]] * 2), "4294967297"),
    "the greatest uint64": (np.array([[0, 1, 2, 2**64 - 1]] * 2, np.uint64), "18446744073709551615"),
    "negative": (np.array([[0, 1, 2, -1]] * 2), "-1"),
    "ragged": ([[0, 1, 2, 3], [0]], "ragged"),
    "no array": (NoArray(), "requires grad"),
}


@pytest.mark.parametrize(("indices", "said"), BAD_INDICES.values(), ids=BAD_INDICES.keys())
@pytest.mark.parametrize("way", ["add", "update_value", "update"])
def test_what_are_no_indices_is_refused(way: str, indices: Any, said: str) -> None:
    def give(w: World) -> object:
        if way == "add":
            return w.tets.add_connectivity("c", w.points, indices, 4)
        return w.tet2point.update_value(indices) if way == "update_value" else w.tets.update(tet2point=indices)

    assert said in assert_refused(make_world(), give, ConnectivityError)


def test_indices_may_lie_anyhow() -> None:
    w = make_world()
    rows = np.array([[4, 3, 2, 1], [0, 2, 4, 1]])
    same: list[Any] = [
        rows,
        rows.ravel(),
        rows.tolist(),
        np.asfortranarray(rows),
        rows.astype(">i8"),
        rows.astype(np.uint8),
    ]
    for given in same:
        w.tet2point.update_value(np.zeros((2, 4), int))
        w.tet2point.update_value(given)
        np.testing.assert_array_equal(w.tet2point.indices, rows)


@pytest.mark.parametrize(
    ("indices", "counts", "said"),
    [
        ([0, 1], np.ma.masked_array([1, 1], mask=[True, False]), "masked"),
        (np.ma.masked_array([0, 1], mask=[True, False]), [1, 1], "masked"),
        ([], np.array([2**63, 2**63], np.uint64), "18446744073709551616"),  # 0 in uint64
        (np.array([0, 2**64 - 1], np.uint64), [1, 1], "index 18446744073709551615 of instance 1"),
        (np.array([0, 2**32]), [0, 2], "index 4294967296 of instance 1"),
        ([0, 1, -1], [0, 3], "index -1 of instance 1"),
        ([0.0, 1.0], [1, 1], "float64"),
        ([0, 1], [1.0, 1.0], "float64"),
        ([[0], [1]], [1, 1], r"\(2, 1\)"),
        ([0, 1], [[1], [1]], r"\(2, 1\)"),
    ],
)
def test_variable_arity_checks_indices_and_counts(indices: Any, counts: Any, said: str) -> None:
    w = make_world()
    with pytest.raises(ConnectivityError, match=said):
        w.tets.add_connectivity("c", w.points, indices, counts=counts)


def test_rows_too_long_for_memory_are_refused() -> None:
    w = make_world()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np, "full", _no_memory)
        with pytest.raises(ConnectivityError, match="don't fit into memory"):
            w.tets.add_connectivity("c", w.points, [0, 1], counts=[1, 1])


def _no_memory(*_: object, **__: object) -> Any:
    raise MemoryError


# -- counts ------------------------------------------------------------------------------------------------------------

COUNTS: dict[str, tuple[Callable[[World], object], type[YaspsError]]] = {
    "instances": (lambda w: w.body.add_primitive("p", 2**33), SceneError),
    "instances, just too many": (lambda w: w.body.add_primitive("p", 2**31), SceneError),
    "instances of a dynamic primitive": (lambda w: w.pairs.set_num_instances(2**31), SceneError),
    "arity": (lambda w: w.tets.add_connectivity("c", w.points, [], 2**31), ConnectivityError),
    "rows": (lambda w: w.points.add_attribute("a", 2**31, 1), ShapeMismatchError),
    "cols": (lambda w: w.points.add_constant("a", 1, 2**31), ShapeMismatchError),
    "rows times cols": (lambda w: w.points.add_attribute("a", 2**16, 2**16), ShapeMismatchError),
}


@pytest.mark.parametrize(("call", "error"), COUNTS.values(), ids=COUNTS.keys())
def test_counts_beyond_int32_are_refused(call: Callable[[World], object], error: type[YaspsError]) -> None:
    assert "2147483647" in assert_refused(make_world(), call, error)


def test_counts_that_meet_beyond_int32_are_refused() -> None:
    w = make_world()
    parts = [w.body.add_primitive(name, 2**30) for name in ("p", "q")]
    assert "2147483648" in assert_refused(w, lambda w: w.body.add_primitive_union("u", parts), SceneError)
    w.points.add_attribute("wide", 2, 2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("yasps.frontend.language.arrays.GREATEST_INDEX", 15)
        message = assert_refused(
            w,
            lambda w: w.tets.add_attribute("j", through=w.tet2point, source=w.points["wide"]),
            ShapeMismatchError,
        )
    assert "arity x entries of the source is 16" in message


def test_more_unknowns_than_can_be_indexed_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene("s")
    x = scene.add_mesh("m").add_primitive("p", 3).add_attribute("x", 3, 1)
    scene.add_energy(scene.m.p.add_attribute("e", computed_attribute=x.dot(x)))
    scene.add_minimize_target(x)
    monkeypatch.setattr("yasps.frontend.execution.compiled_scene.MOST_SCALARS", 8)
    with pytest.raises(SceneError, match="9 unknowns together, but at most 8"):
        scene.minimize_energy()
    monkeypatch.setattr("yasps.frontend.execution.compiled_scene.MOST_SCALARS", 9)
    scene.minimize_energy()


def test_numbers_that_no_machine_holds_are_refused() -> None:
    """NumPy says MemoryError for some sizes and ValueError for others."""
    w = make_world()
    many = w.body.add_primitive("many", 2**31 - 1)
    for side in (2**10, 2**15):
        with pytest.raises(DataError, match=r"body\.many.*GB, more than there is memory for"):
            many.add_attribute("a", side, side)
    assert many.attributes == {}


# -- everywhere else that arrays come in -------------------------------------------------------------------------------

CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
TET, FACES = np.array([[0, 1, 2, 3]]), np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
MASK = np.ma.masked_array(CORNERS, mask=np.eye(4, 3, dtype=bool))
MASKED_FACES = np.ma.masked_array(FACES, mask=np.eye(4, 3, dtype=bool))


def contact_with(**changed: Any) -> BarrierContact:
    scene = Scene("s")
    mesh = scene.add_mesh("m")
    vertices = mesh.add_primitive("v", 4)
    vertices.add_attribute("position", 3, 1, value=CORNERS)
    arguments: dict[str, Any] = {"triangles": FACES, "activation_distance": 0.01, "stiffness": 1.0, **changed}
    return BarrierContact(mesh, vertices, arguments.pop("triangles"), **arguments)


def stepper_with(acceleration: Any, time_step: Any = 0.01) -> TimeStepper:
    scene = Scene("s")
    vertices = scene.add_mesh("m").add_primitive("v", 4)
    x, predicted = vertices.add_attribute("x", 3, 1), vertices.add_constant("p", 3, 1)
    scene.add_minimize_target(x)
    part = MovingPart(x, predicted, vertices.add_constant("mass", 1, 1))
    return TimeStepper(scene, [part], time_step, accelerations={x: acceleration})


def pictures_of(vertices: Any, triangles: Any) -> FramePictures:
    return FramePictures([Surface("s", vertices, triangles)])


ELSEWHERE: dict[str, tuple[Callable[[], object], type[Exception]]] = {
    "points as (3, n)": (lambda: CollisionGeometry(CORNERS.T, FACES, 0.1), ValueError),
    "complex positions": (lambda: CollisionGeometry(CORNERS + 0j, FACES, 0.1), DataError),
    "positions in text": (lambda: CollisionGeometry(CORNERS.astype(str), FACES, 0.1), DataError),
    "masked positions": (lambda: CollisionGeometry(MASK, FACES, 0.1), DataError),
    "triangles as (3, m)": (lambda: CollisionGeometry(CORNERS, FACES.T[:, :2], 0.1), ValueError),
    "masked triangles": (lambda: CollisionGeometry(CORNERS, MASKED_FACES, 0.1), ConnectivityError),
    "masked fixed": (
        lambda: CollisionGeometry(CORNERS, FACES, 0.1, fixed=np.ma.masked_array([True] * 4, mask=[1, 0, 0, 0])),
        DataError,
    ),
    "masked group": (
        lambda: CollisionGeometry(CORNERS, FACES, 0.1, group=np.ma.masked_array([1] * 4, mask=[1, 0, 0, 0])),
        DataError,
    ),
    "two activation distances": (lambda: CollisionGeometry(CORNERS, FACES, np.ones(2)), DataError),  # type: ignore[arg-type]
    "stiffness of each vertex": (lambda: contact_with(stiffness=np.ones(4)), SceneError),
    "stiffness in text": (lambda: contact_with(stiffness="1e9"), SceneError),
    "infinite stiffness": (lambda: contact_with(stiffness=np.inf), SceneError),
    "tets as (4, m)": (lambda: rest_shape(CORNERS, TET.T), ShapeMismatchError),
    "tets as floats": (lambda: rest_shape(CORNERS, TET + 0.0), DataError),
    "a tet's negative vertex": (lambda: rest_shape(CORNERS, TET - 1), DataError),
    "a tet's vertex too far": (lambda: rest_shape(CORNERS, TET + 1), DataError),
    "triangles as truth values": (lambda: rest_triangles(CORNERS, FACES[:1] > 0), DataError),
    "masked vertices at rest": (lambda: rest_triangles(MASK, FACES), DataError),
    "complex vertices at rest": (lambda: rest_shape(CORNERS + 0j, TET), DataError),
    "a warp of two numbers": (lambda: rest_triangles(CORNERS, FACES, (1.0, 0.0)), ShapeMismatchError),
    "a masked mesh": (lambda: TetrahedralMesh(MASK, TET), MeshError),  # type: ignore[arg-type]
    "masked tets": (lambda: TetrahedralMesh(CORNERS, np.ma.masked_array(TET, mask=TET == 0)), MeshError),  # type: ignore[arg-type]
    "a ragged mesh": (lambda: TetrahedralMesh([[0.0], [1.0, 2.0]], TET), MeshError),  # type: ignore[arg-type]
    "an offset in text": (lambda: TetrahedralMesh(CORNERS, TET).translated(["1", "2", "3"]), MeshError),  # type: ignore[list-item,arg-type]
    "negative tets to drop": (lambda: drop_unused_vertices(CORNERS, TET - 1), MeshError),
    "a complex function": (
        lambda: stuff_isosurface(lambda x: (x @ x.T)[0] + 0j, (-1, -1, -1), (1, 1, 1), 0.5),
        MeshError,
    ),
    "an acceleration of two numbers": (lambda: stepper_with([0.0, -9.8]), DataError),
    "a complex acceleration": (lambda: stepper_with([0.0, 0.0, 1j]), DataError),
    "accelerations of all instances": (lambda: stepper_with(np.zeros((4, 3))), DataError),
    "two time steps": (lambda: stepper_with([0.0, 0.0, 1.0], [0.1, 0.1]), SceneError),
    "an infinite time step": (lambda: stepper_with([0.0, 0.0, 1.0], np.inf), SceneError),
    "complex vertices to show": (lambda: pictures_of(CORNERS + 0j, FACES), PictureError),
    "masked triangles to show": (lambda: pictures_of(CORNERS, MASKED_FACES), PictureError),
}


@pytest.mark.parametrize(("call", "error"), ELSEWHERE.values(), ids=ELSEWHERE.keys())
def test_other_places_take_no_such_arrays(call: Callable[[], object], error: type[Exception]) -> None:
    with pytest.raises(error):
        call()


def test_an_acceleration_holds_for_every_instance() -> None:
    stepper = stepper_with(np.array([[0.0], [0.0], [-9.8]]))
    (flight,) = stepper._flight([np.zeros(12)], falls=True)
    np.testing.assert_allclose(flight.reshape(4, 3), [[0.0, 0.0, -9.8e-4]] * 4, rtol=1e-14)


def test_a_series_takes_no_masked_or_overflowing_data(tmp_path: Any) -> None:
    series = VtkHdfSeries(tmp_path / "a.vtkhdf", 4, {"triangle": FACES})
    with pytest.raises(OutputFileError, match="masked"):
        series.write_frame(0.0, MASK)
    with pytest.raises(OutputFileError, match="18446744073709551615"):
        series.write_frame(0.0, CORNERS, point_data={"a": np.full(4, 2**64 - 1, np.uint64)})
    with pytest.raises(OutputFileError, match="masked"):
        VtkHdfSeries(tmp_path / "b.vtkhdf", 4, {"triangle": MASKED_FACES})


def test_indices_of_a_file_are_not_cut_to_int32(tmp_path: Any) -> None:
    np.savez(tmp_path / "data.npz", **{"connectivities/c": np.array([[0, 2**32 + 1]])})
    with pytest.raises(scene_data.SceneDataError, match="int32"):
        scene_data.load_scene_data(tmp_path / "data.npz")
