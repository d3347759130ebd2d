"""A results file as USD, which Blender, Houdini, Maya and Omniverse open: time-sampled points, a prim for each body."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yasps.output.recorded_bodies import RecordedBody
from yasps.output.series import Series
from yasps.output.shown_surfaces import plane_corners, thin_radius
from yasps.output.tubes import polylines
from yasps.output.vtkhdf_layout import OutputFileError

Floats = NDArray[np.float64]
Shape = tuple[Any, RecordedBody, NDArray[np.int64]]


def write_usd(series: Series, path: Path, frames: list[int]) -> Path:
    """Writes frames to a `.usd`, `.usda` (text) or `.usdc` file.

    Units are metres, z is up, and the number of time codes a second is that of the frames, so that they have whole
    numbers. Under the prim /World each body is a Mesh of its surface, or BasisCurves with widths for rods and Points
    for loose vertices; a half-space is a square. Colours are `displayColor`; there are no normals, so that the program
    that opens the file takes those of the moved surface.

    Raises:
        OutputFileError: usd-core is not installed, or the file can't be written.
    """
    if importlib.util.find_spec("pxr") is None:
        raise OutputFileError("USD needs usd-core, which is not installed. To get it: pip install 'yasps[usd]'")
    from pxr import Tf, Usd, UsdGeom

    unfinished = path.with_name(f"unfinished-{path.name}")
    try:
        stage: Any = Usd.Stage.CreateNew(str(unfinished))
        world = UsdGeom.Xform.Define(stage, "/World")
        stage.SetDefaultPrim(world.GetPrim())
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        times = series.times[frames]
        pace = _frames_per_second(times)
        codes = np.round(times * pace, 6).tolist()
        stage.SetTimeCodesPerSecond(pace)
        stage.SetFramesPerSecond(pace)
        stage.SetStartTimeCode(codes[0])
        stage.SetEndTimeCode(codes[-1])
        stage.GetRootLayer().comment = f"{series.name}, {len(frames)} frames, by yasps"
        taken: set[str] = set()
        prims = []
        for body in series.bodies:
            name = Tf.MakeValidIdentifier(body.name)
            while name in taken:
                name += "_"
            taken.add(name)
            prims += _define(stage, f"/World/{name}", body, thin_radius(series))
        for code, frame in zip(codes, frames, strict=True):
            x = series.positions(frame)
            for prim, body, rows in prims:
                if frame == frames[0] and body.stands_still:
                    _place(prim, x[body.vertices][rows], Usd.TimeCode.Default())
                elif not body.stands_still:
                    _place(prim, x[body.vertices][rows], Usd.TimeCode(code))
        stage.GetRootLayer().Save()
        del stage
        unfinished.replace(path)
    except (Tf.ErrorException, OSError) as error:
        raise OutputFileError(f"'{path}' can't be written: {error}") from error
    finally:
        unfinished.unlink(missing_ok=True)
    return path


def _define(
    stage: Any, path: str, body: RecordedBody, thin: float
) -> list[tuple[Any, RecordedBody, NDArray[np.int64]]]:
    """Prims of a body, each with the vertices of the body that are its points."""
    from pxr import UsdGeom, Vt

    found: list[tuple[Any, RecordedBody, NDArray[np.int64]]] = []
    if body.plane is not None:
        square = UsdGeom.Mesh.Define(stage, path)
        square.CreateFaceVertexCountsAttr([4])
        square.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
        square.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        square.CreateDoubleSidedAttr(True)
        square.CreateDisplayColorAttr([_linear(body.color)])
        _place(square, plane_corners(body.plane), None)
    radii = np.where(body.radii > 0, body.radii, thin)
    parts = [
        ("surface", len(body.triangles), UsdGeom.Mesh),
        ("rods", len(body.edges), UsdGeom.BasisCurves),
        ("points", len(body.points), UsdGeom.Points),
    ]
    parts = [part for part in parts if part[1]]
    if len(parts) > 1:
        UsdGeom.Xform.Define(stage, path)
    for name, _, kind in parts:
        prim = kind.Define(stage, path if len(parts) == 1 else f"{path}/{name}")
        prim.CreateDisplayColorAttr([_linear(body.color)])
        prim.CreateDisplayOpacityAttr([body.opacity])
        if name == "surface":
            rows = np.unique(body.triangles).astype(np.int64)
            corners = np.searchsorted(rows, body.triangles).ravel().astype(np.int32)
            prim.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(body.triangles), 3, np.int32)))
            prim.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(corners))
            prim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
            prim.CreateDoubleSidedAttr(body.two_sided)
        elif name == "rods":
            chains = polylines(body.edges)
            rows = np.concatenate(chains)
            prim.CreateTypeAttr(UsdGeom.Tokens.linear)
            prim.CreateCurveVertexCountsAttr([len(chain) for chain in chains])
        else:
            rows = body.points.astype(np.int64)
        if name != "surface":
            prim.CreateWidthsAttr(Vt.FloatArray.FromNumpy((2 * radii[rows]).astype(np.float32)))
            prim.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
        found.append((prim, body, rows))
    return found


def _place(prim: Any, points: Floats, code: Any) -> None:
    """Points of a prim and their box; code None: for all times."""
    from pxr import Usd, Vt

    code = Usd.TimeCode.Default() if code is None else code
    prim.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)), code)
    widths = prim.GetWidthsAttr().Get() if hasattr(prim, "GetWidthsAttr") else None
    margin = 0.5 * max(widths) if widths else 0.0
    box = np.stack([points.min(axis=0) - margin, points.max(axis=0) + margin]).astype(np.float32)
    prim.GetExtentAttr().Set(Vt.Vec3fArray.FromNumpy(box), code)


def _frames_per_second(times: Floats) -> float:
    """A whole number if the frames have one but for rounding; 24 for a single frame."""
    if len(times) == 1:
        return 24.0
    pace = 1.0 / float(np.median(np.diff(times)))
    return float(round(pace)) if abs(pace - round(pace)) < 1e-6 * pace else pace


def _linear(color: str) -> tuple[float, float, float]:
    """A colour "#rrggbb", which is sRGB, in the linear numbers that USD has (IEC 61966-2-1)."""
    srgb = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    r, g, b = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4).tolist()
    return r, g, b
