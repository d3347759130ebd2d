"""Damaged files of every kind that comes from outside: a typed error, and no more memory than there are bytes."""

from __future__ import annotations

import io
import pickle
import tracemalloc
import zipfile
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from damage import damaged
from hypothesis import given
from hypothesis import strategies as st
from profiles import examples
from results_files import everything, record
from small_scenes import emit, shared_targets

from yasps.backend.reference.scene_data import SceneDataError, load_scene_data, save_scene_data
from yasps.frontend.commands.yasps_opt import main
from yasps.meshes import MeshError, TetrahedralMesh, box, mesh_file, read_tetrahedral_mesh
from yasps.output import OutputFileError, VtkHdfSeries, read_series
from yasps.passes.pipeline import run_pipeline

LITTLE = 20_000_000
"""Bytes: no file here has more than a few thousand."""


# -- textual IR --------------------------------------------------------------------------------------------

OPTIONS = [
    [],
    ["-p", "canonicalize"],
    ["--random", "2"],
    ["-p", "differentiate,project-psd"],
    ["-p", "canonicalize,inline-references,cse,differentiate,project-psd", "--random", "3"],
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for files that are damaged again and again."""
    return tmp_path_factory.mktemp("damaged")


@pytest.fixture(scope="module")
def texts(folder: Path) -> list[bytes]:
    """IR before and after the passes."""
    run_pipeline(emit(shared_targets()).module, folder / "ir")
    return [path.read_bytes() for path in sorted((folder / "ir").glob("0[0139]-*.mlir"))]


@pytest.fixture(scope="module")
def numbers(folder: Path) -> dict[str, bytes]:
    """The numbers of a scene, by the ending of the file."""
    found = {}
    for ending in (".npz", ".json"):
        save_scene_data(folder / f"good{ending}", emit(shared_targets()).data)
        found[ending] = (folder / f"good{ending}").read_bytes()
    return found


def run_opt(path: Path, options: list[str]) -> tuple[int, str, str]:
    """Exit status and what was said."""
    output, errors = io.StringIO(), io.StringIO()
    with redirect_stdout(output), redirect_stderr(errors):
        status = main([str(path), *options])
    return status, output.getvalue(), errors.getvalue()


@given(data=st.data())
@examples(ci=20, nightly=3000)
def test_yasps_opt_takes_damaged_ir(data: st.DataObject, folder: Path, texts: list[bytes]) -> None:
    path = folder / "x.mlir"
    path.write_bytes(data.draw(damaged(data.draw(st.sampled_from(texts)))))
    status, output, errors = run_opt(path, data.draw(st.sampled_from(OPTIONS)))
    assert status in (0, 1)
    assert (status == 0) == bool(output)
    assert (status == 1) == errors.startswith("yasps-opt: ")
    assert "Traceback" not in errors


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rel.scene", 'rel.scene @"' + "a" * 200, "line 2: the string"),
        ("rel.scene", "\udcff", "reading the input"),
        (": 3x1", ": 300000x1000000", "1048576 entries"),
        ("arity 2", "arity 1000000000000", "of arity 1000000000000"),
        ("rel.scene", "(" * 5000, "claims.mlir:2:"),
        ("size 4", "size 4000000000000", None),
    ],
)
def test_ir_that_claims_much_is_refused(
    old: str, new: str, message: str | None, folder: Path, texts: list[bytes]
) -> None:
    text = texts[0].decode()
    assert old in text
    path = folder / "claims.mlir"
    path.write_bytes(text.replace(old, new, 1).encode(errors="surrogateescape"))
    tracemalloc.start()
    try:
        status, _, errors = run_opt(path, ["--random", "2"])
        assert tracemalloc.get_traced_memory()[1] < LITTLE
    finally:
        tracemalloc.stop()
    assert status == (0 if message is None else 1)
    assert message is None or message in errors


def test_random_numbers_have_a_limit(folder: Path) -> None:
    path = folder / "many.mlir"
    path.write_text(
        "rel.scene @s { rel.mesh @m in @s\n rel.primitive @m.v in @m dynamic\n"
        "rel.connectivity @m.v.all from @m.v to @m.v arity 1000000000000 }"
    )
    assert run_opt(path, ["--random", "2"])[2] == (
        "yasps-opt: the module needs 2000000000000 random numbers; at most 100000000 are drawn\n"
    )


# -- the numbers of a scene --------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", [".npz", ".json"])
@given(data=st.data())
@examples(ci=60, nightly=5000)
def test_damaged_numbers(data: st.DataObject, ending: str, folder: Path, numbers: dict[str, bytes]) -> None:
    path = folder / f"x{ending}"
    path.write_bytes(data.draw(damaged(numbers[ending])))
    with suppress(SceneDataError):
        found = load_scene_data(path)
        assert all(0 <= size < 2**31 for size in found.sizes.values())


class _Code:
    """What would run if it were unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return (pytest.fail, ("code of a file was run",))


def header(shape: str, kind: str = "<f8") -> bytes:
    """The beginning of an array in a file."""
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (header("(1000000000000,)") + b"\0" * 8, "says that it is float64"),
        (header("(-1,)") + b"\0" * 8, "says that it is float64"),
        (header("(1000000000000, 1000000000000, 1000000000000)") + b"\0" * 8, "says that it is float64"),
        (header("(1,)", "|O") + pickle.dumps(_Code()), "is not an .npz file of plain arrays"),
        (header("(1,)", "|V8") + b"\0" * 8, "is no array of float64"),
        (header("(1,)", "<c16") + b"\0" * 16, "is no array of float64"),
        (b"\x93NUMPY\x09\x00", "is not an .npz file of plain arrays"),
        (b"", "is not an .npz file of plain arrays"),
        (pickle.dumps(_Code()), "is not an .npz file of plain arrays"),
    ],
)
def test_arrays_that_are_none(content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "data.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("storages/x.npy", content)
    tracemalloc.start()
    try:
        with pytest.raises(SceneDataError, match=message):
            load_scene_data(path)
        assert tracemalloc.get_traced_memory()[1] < LITTLE
    finally:
        tracemalloc.stop()


def test_an_archive_that_claims_much(tmp_path: Path) -> None:
    """One entry of zeros, named a thousand times over."""
    path = tmp_path / "data.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("storages/x.npy", b"\0" * 1_000_000)
        archive.filelist.extend(archive.filelist * 1000)
    with pytest.raises(SceneDataError, match=r"claim to be \d+ bytes of numbers"):
        load_scene_data(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("storages/x.npy", header("(1,)") + b"\0" * 8)
    with pytest.raises(SceneDataError, match="another way than NumPy"):
        load_scene_data(path)


@pytest.mark.parametrize(
    "numbers",
    [
        '{"sizes": {"m": -1}}',
        '{"sizes": {"m": 3000000000}}',
        '{"sizes": {"m": []}}',
        '{"sizes": {"m": [1, 2]}}',
        '{"sizes": {"m": ' + "1" * 5000 + "}}",
        f'{{"sizes": {{"m": {10**40}}}}}',
        '{"storages": {"x": [{}]}}',
        '{"storages": {"x": [1, null]}}',
        '{"storages":' * 100_000,
    ],
)
def test_json_that_is_no_scene(numbers: str, tmp_path: Path) -> None:
    path = tmp_path / "data.json"
    path.write_text(numbers)
    with pytest.raises(SceneDataError, match=r"data\.json"):
        load_scene_data(path)


# -- meshes ------------------------------------------------------------------------------------------------

BOX = box(divisions=(1, 1, 1))
FORMATS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "vtk text": (".vtk", "vtk", {"binary": False}),
    "vtk": (".vtk", "vtk", {}),
    "vtu": (".vtu", "vtu", {}),
    "gmsh": (".msh", "gmsh", {}),
    "gmsh text": (".msh", "gmsh", {"binary": False}),
    "gmsh 2": (".msh", "gmsh22", {"binary": False}),
    "medit": (".mesh", "medit", {}),
    "abaqus": (".inp", "abaqus", {}),
    "tecplot": (".dat", "tecplot", {}),
}


@pytest.fixture(scope="module")
def meshes(folder: Path) -> dict[str, bytes]:
    """A mesh in several formats."""
    found = {}
    for name, (ending, kind, options) in FORMATS.items():
        path = folder / f"good{ending}"
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            meshio.write(path, meshio.Mesh(BOX.vertices, [("tetra", BOX.tets)]), file_format=kind, **options)
        found[name] = path.read_bytes()
    return found


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Readers have less time than users would give them."""
    monkeypatch.setattr(mesh_file, "_SECONDS", (2, 0))


@given(data=st.data())
@examples(ci=6, nightly=1000)
def test_damaged_meshes(data: st.DataObject, folder: Path, meshes: dict[str, bytes]) -> None:
    name = data.draw(st.sampled_from(sorted(FORMATS)))
    path = folder / f"x{FORMATS[name][0]}"
    path.write_bytes(data.draw(damaged(meshes[name])))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mesh_file, "_SECONDS", (3, 0))
        with suppress(MeshError):
            assert isinstance(read_tetrahedral_mesh(path, flip_inverted=True), TetrahedralMesh)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("vtk text", ("POINTS 8", "POINTS 1000000000000"), "claim to hold more than fits"),
        ("vtk text", ("CELLS 7 ", "CELLS 8 "), "Cannot read a mesh"),
        ("vtk text", ("int64\n0\n4\n6\n", "int64\n1000000000000\n4\n6\n"), "use a vertex that does not exist"),
        ("vtk text", ("double\n-0.5", "double\nnan"), "not finite"),
        ("gmsh 2", ("$Nodes\n8", "$Nodes\n1000000000000"), "Cannot read a mesh"),
        ("medit", ("Tetrahedra\n6", "Tetrahedra\n0"), "Cannot read a mesh|has no tetrahedra"),
        ("tecplot", ("NODES = 8", "NODES = 900"), r"did not end well \(signal"),
    ],
)
@pytest.mark.usefixtures("impatient")
def test_meshes_that_claim_much(
    name: str, change: tuple[str, str], message: str, folder: Path, meshes: dict[str, bytes]
) -> None:
    text = meshes[name].decode()
    assert change[0] in text
    path = folder / f"claims{FORMATS[name][0]}"
    path.write_text(text.replace(*change, 1))
    with pytest.raises(MeshError, match=message):
        read_tetrahedral_mesh(path)


# -- output ------------------------------------------------------------------------------------------------


@given(data=st.data())
@examples(ci=15, nightly=1000)
def test_a_series_in_a_damaged_file(data: st.DataObject, folder: Path) -> None:
    path = folder / "x.vtkhdf"
    with VtkHdfSeries(path, 8, {"tetra": BOX.tets}) as series:
        series.write_frame(0.0, BOX.vertices)
        path.write_bytes(data.draw(damaged(path.read_bytes())))
        with suppress(OutputFileError):
            series.write_frame(1.0, BOX.vertices)


@given(data=st.data())
@examples(ci=15, nightly=1000)
def test_a_damaged_results_file(data: st.DataObject, folder: Path) -> None:
    """It is read, refused, or found to be wrong when its frames are."""
    path = record(everything(), folder, 2, "results")
    path.write_bytes(data.draw(damaged(path.read_bytes())))
    with suppress(OutputFileError):
        series = read_series(path)
        for frame in range(len(series)):
            assert np.isfinite(series.positions(frame)).all()
            assert [len(series.field(name, frame)) for name in series.fields] == [series.number_of_points] * len(
                series.fields
            )
    with suppress(OutputFileError):
        record(everything(), folder, 2, "results", resume=True)
