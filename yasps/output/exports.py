"""Results files in the formats of other programs."""

from __future__ import annotations

import importlib
import importlib.util
import os
from pathlib import Path
from typing import Any, Final

import numpy as np

from yasps.output.series import Series, read_series
from yasps.output.shown_surfaces import shown_surfaces
from yasps.output.usd_file import write_usd
from yasps.output.vtkhdf_layout import OutputFileError

USD: Final = (".usd", ".usda", ".usdc")
GLTF: Final = (".glb",)
MESHES: Final = (".obj", ".ply", ".stl")
FORMATS: Final = (*USD, *GLTF, *MESHES)


def export_series(
    file: str | os.PathLike[str] | Series, path: str | os.PathLike[str], *, every: int = 1, frame: int | None = None
) -> list[Path]:
    """Writes a results file in the format that the ending of `path` names.

    - `.usd`, `.usda`, `.usdc`: the whole motion, see `write_usd`; needs `yasps[usd]`.
    - `.glb` (glTF): one frame, for slides and web pages; a mesh for each body, in its colour; needs `yasps[gltf]`.
    - `.obj`, `.ply`, `.stl`: a file for each frame, NAME_0000.obj and so on, with all surfaces as one mesh.

    Rods are curves with widths in USD and tubes elsewhere.

    Args:
        file: that a `FrameRecorder` wrote, or a series that is open.
        path: its folder must exist.
        every: take every so many-th frame.
        frame: this one alone, from 0; -1 is the last, which is also the default for `.glb`.

    Returns:
        The files that were written.

    Raises:
        OutputFileError: no such series, ending, folder or frame, or a library that is not installed.
    """
    path = Path(path)
    series = file if isinstance(file, Series) else read_series(file)
    ending = path.suffix.lower()
    if ending not in FORMATS:
        raise OutputFileError(f"'{path.name}' ends in none of {', '.join(FORMATS)}, by which the format is chosen.")
    if not path.parent.is_dir():
        raise OutputFileError(f"The folder '{path.parent}' for '{path.name}' does not exist. Make it first.")
    if every < 1:
        raise OutputFileError(f"every is a whole number from 1, got {every}.")
    if frame is None and ending in GLTF:
        frame = -1
    if frame is not None and not -len(series) <= frame < len(series):
        raise OutputFileError(f"'{series.path}' has the frames 0 to {len(series) - 1}, not {frame}.")
    frames = list(range(0, len(series), every)) if frame is None else [range(len(series))[frame]]
    try:
        if ending in USD:
            return [write_usd(series, path, frames)]
        if ending in GLTF:
            return [_write_gltf(series, path, frames[0])]
        return [_write_mesh(series, path.with_name(f"{path.stem}_{one:04d}{ending}"), one) for one in frames]
    except OSError as error:
        raise OutputFileError(f"'{path}' can't be written: {error}") from error


def _write_gltf(series: Series, path: Path, frame: int) -> Path:
    """One frame; glTF has y up, so all is turned about x."""
    if importlib.util.find_spec("trimesh") is None:
        raise OutputFileError("glTF needs trimesh, which is not installed. To get it: pip install 'yasps[gltf]'")
    trimesh: Any = importlib.import_module("trimesh")  # which has types for a part of itself
    scene: Any = trimesh.Scene()
    for surface in shown_surfaces(series, frame):
        color = [int(surface.body.color[k : k + 2], 16) for k in (1, 3, 5)]
        material = trimesh.visual.material.PBRMaterial(
            baseColorFactor=[*color, round(255 * surface.body.opacity)],
            alphaMode="OPAQUE" if surface.body.opacity == 1 else "BLEND",
            metallicFactor=0.0,
            roughnessFactor=0.7,
            doubleSided=surface.body.two_sided,
        )
        x, y, z = surface.vertices.T
        mesh = trimesh.Trimesh(
            np.stack([x, z, -y], axis=1),
            surface.triangles,
            visual=trimesh.visual.TextureVisuals(material=material),
            process=False,
        )
        scene.add_geometry(mesh, node_name=surface.body.name, geom_name=surface.body.name)
    path.write_bytes(scene.export(file_type="glb"))
    return path


def _write_mesh(series: Series, path: Path, frame: int) -> Path:
    import meshio

    surfaces = list(shown_surfaces(series, frame))
    starts = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
    triangles = [surface.triangles + start for surface, start in zip(surfaces, starts, strict=False)]
    vertices = np.concatenate([surface.vertices for surface in surfaces])
    mesh = meshio.Mesh(vertices, [("triangle", np.concatenate(triangles).astype(np.int32))])
    mesh.write(path, **({} if path.suffix == ".obj" else {"binary": True}))
    return path
