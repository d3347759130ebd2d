"""A results file as one HTML page that works offline: three.js draws it (yasps/output/viewer/).

The page's `description` says in JSON what there is; its `data` is base64 of zlib of

1. integers of 4 bytes, `integers` of them: for each body, at the places [first, count] that the description names,
   `source` (the vertex of each corner of the surface), `triangles`, `edges` of rods and `balls` (their ends and loose
   vertices);
2. positions of the vertices that are seen, [frames, vertices, 3], rounded to 65536 steps in their box and told as
   differences to the frame before, modulo 2^16: first all low bytes, then all high bytes;
3. for each field, its size at each vertex, [frames, vertices], rounded to 256 steps between `low` and `high`.

All numbers are little-endian, as all machines are that run browsers.
"""

from __future__ import annotations

import base64
import html
import json
import os
import zlib
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from yasps.output.motion_pictures import cameras, ground_body, level_height, seen_box, sizes
from yasps.output.picture_ground import round_spacing
from yasps.output.recorded_bodies import DARKER, RecordedBody, dark_sectors
from yasps.output.series import Series, read_series
from yasps.output.sharp_edges import split_at_creases
from yasps.output.vtkhdf_layout import OutputFileError

Ids = NDArray[np.int64]
Floats = NDArray[np.float64]

_VIRIDIS: Final = (
    *("#440154", "#482878", "#3e4989", "#31688e", "#26828e"),
    *("#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725"),
)
_MODULES: Final = {
    "three": "three/three.module.min.js",
    "three-core": "three/three.core.min.js",
    "orbit-controls": "three/OrbitControls.js",
}
"""Of three.js, by the names under which they find each other."""
_COMPRESSION: Final = 6
"""Of zlib: 9 takes 2.5 times as long for 1.6 %."""
_THIN: Final = 2e-3
"""Radius of rods without one, in diagonals of the scene."""


@dataclass(frozen=True)
class Page:
    """A page that was written.

    Attributes:
        path: of the file.
        frames: numbers of the frames in it.
        total: how many the results file has.
        megabytes: its size.
    """

    path: Path
    frames: list[int]
    total: int
    megabytes: float


def write_page(
    file: str | os.PathLike[str] | Series, path: str | os.PathLike[str], *, megabytes: float = 20.0, every: int = 1
) -> Page:
    """Writes a page that shows a results file in a browser, without any network.

    Args:
        file: that a `FrameRecorder` wrote, or a series that is open.
        path: ends in `.html`.
        megabytes: of the page at most; frames are left out until it is no larger, evenly but for the last.
        every: take every so many-th frame to begin with.

    Raises:
        OutputFileError: no such series, another ending, a page that can't be written, or one that is larger with
            two frames.
    """
    path = Path(path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise OutputFileError(f"The page '{path.name}' must end in '.html'.")
    if every < 1 or not megabytes > 0:
        raise OutputFileError(f"every is a whole number from 1 and megabytes is positive, got {every} and {megabytes}.")
    series = file if isinstance(file, Series) else read_series(file)
    bodies = [body for body in series.bodies if body.count and body is not ground_body(series)]
    seen = _SeenVertices(series, bodies)
    while True:
        frames = list(dict.fromkeys([*range(0, len(series), every), len(series) - 1]))
        text = _page_text(series, bodies, seen, frames).encode()
        if len(text) <= 1e6 * megabytes:
            break
        if len(frames) <= 2:
            raise OutputFileError(
                f"A page with {len(frames)} frames of '{series.path.name}' has {len(text) / 1e6:.2f} MB, more than "
                f"{megabytes:g}. Allow it more megabytes, or export the file as USD."
            )
        every = max(every + 1, int(every * len(text) / (1e6 * megabytes)))
    try:
        path.write_bytes(text)
    except OSError as error:
        raise OutputFileError(f"The page '{path}' can't be written: {error}") from error
    return Page(path, frames, len(series), len(text) / 1e6)


class _SeenVertices:
    """The vertices that surfaces, rods and loose vertices have, renumbered from 0; inner ones are left out."""

    def __init__(self, series: Series, bodies: list[RecordedBody]) -> None:
        used = [
            body.first + np.concatenate([body.triangles.ravel(), body.edges.ravel(), body.points]).astype(np.int64)
            for body in bodies
        ]
        self.ids: Ids = np.unique(np.concatenate([np.empty(0, np.int64), *used]))
        if not len(self.ids):
            raise OutputFileError(f"'{series.path}' has no surface, rod or loose vertex to show.")

    def number(self, vertices: NDArray[Any]) -> Ids:
        """Numbers in the page of vertices of the file."""
        return np.asarray(np.searchsorted(self.ids, vertices), np.int64)


def _page_text(series: Series, bodies: list[RecordedBody], seen: _SeenVertices, frames: list[int]) -> str:
    integers: list[NDArray[Any]] = []

    def placed(numbers: NDArray[Any]) -> tuple[int, int]:
        first = sum(part.size for part in integers)
        integers.append(np.asarray(numbers, "<i4").ravel())
        return first, numbers.size

    box = seen_box(series, frames, replace(series.view, camera="whole"))
    diagonal = float(np.linalg.norm(box[1] - box[0])) or 1.0
    x = series.positions(frames[0])
    told: dict[str, Any] = {"bodies": [_told_body(body, x, seen, placed, _THIN * diagonal) for body in bodies]}
    data, about = _told_motion(series, seen, frames)
    ground = ground_body(series)
    height = None if ground is None else level_height(series, ground)
    eye, focus = cameras(series, frames, replace(series.view, camera="whole"), 4 / 3, height)[0]
    told |= about | {"darker": DARKER}
    told |= {
        "times": [float(series.times[frame]) for frame in frames],
        "numbers": frames,
        "note": f"{len(series)} frames, every {frames[1]}th here" if len(frames) > 1 and frames[1] > 1 else "",
        "integers": sum(part.size for part in integers),
        "colour_map": _VIRIDIS,
        "diagonal": diagonal,
        "middle": box.mean(axis=0).tolist(),
        "camera": {"eye": eye.tolist(), "focus": focus.tolist()},
        "planes": [_told_plane(body, box) for body in series.bodies if body.plane is not None and body is not ground],
        "ground": ground and {"name": ground.name, "height": height, "spacing": round_spacing(diagonal / 5)},
    }
    packed = zlib.compress(b"".join([*(part.tobytes() for part in integers), *data]), _COMPRESSION)
    viewer = resources.files("yasps.output") / "viewer"
    modules = {name: (viewer / file).read_text(encoding="utf-8") for name, file in _MODULES.items()}
    modules["three"] = modules["three"].replace('"./three.core.min.js"', '"three-core"')  # there is no folder here
    imports = {name: f"data:text/javascript;base64,{_base64(text.encode())}" for name, text in modules.items()}
    filled = {
        "title": html.escape(series.name),
        # In an element `script`, "<" could begin its end.
        "description": json.dumps(told).replace("<", "\\u003c"),
        "importmap": json.dumps({"imports": imports}),
        "data": _base64(packed),
        "script": (viewer / "viewer.js").read_text(encoding="utf-8"),
    }
    pieces = (viewer / "page.html").read_text(encoding="utf-8").split("{{")
    return pieces[0] + "".join(filled[name] + rest for name, rest in (piece.split("}}", 1) for piece in pieces[1:]))


def _told_body(body: RecordedBody, x: Floats, seen: _SeenVertices, placed: Any, thin: float) -> dict[str, Any]:
    source, triangles, number_dark = np.empty(0, np.int64), np.empty((0, 3), np.int64), 0
    if len(body.triangles):
        source, triangles = split_at_creases(x[body.vertices], body.triangles.astype(np.int64))
        if body.is_driven:
            dark = dark_sectors(x[body.vertices][body.triangles].mean(axis=1))
            triangles, number_dark = np.concatenate([triangles[~dark], triangles[dark]]), int(dark.sum())
    balls = np.unique(np.concatenate([body.edges.ravel(), body.points]))
    radii = np.where(body.radii[balls] > 0, body.radii[balls], thin)
    return {
        "name": body.name,
        "color": body.color,
        "opacity": body.opacity,
        "open": body.two_sided,
        "source": placed(seen.number(body.first + source)),
        "triangles": placed(triangles),
        "dark": number_dark,
        "edges": placed(seen.number(body.first + body.edges)),
        "balls": placed(seen.number(body.first + balls)),
        "radii": [float(f"{radius:.6g}") for radius in radii],
    }


def _told_motion(series: Series, seen: _SeenVertices, frames: list[int]) -> tuple[list[bytes], dict[str, Any]]:
    """Bytes of positions and fields, and what the page must know to read them."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    ends = {name: [np.inf, -np.inf] for name in series.fields}
    for frame in frames:
        x = series.positions(frame)[seen.ids]
        low, high = np.minimum(low, x.min(axis=0)), np.maximum(high, x.max(axis=0))
        for name, (least, most) in ends.items():
            values = sizes(series.field(name, frame)[seen.ids])
            ends[name] = [min(least, float(values.min())), max(most, float(values.max()))]
    step = np.where(high > low, (high - low) / 65535, 1.0)
    steps = np.empty((len(frames), len(seen.ids), 3), np.uint16)  # an eighth of the positions
    shares = np.empty((len(series.fields), len(frames), len(seen.ids)), np.uint8)
    for k, frame in enumerate(frames):
        steps[k] = np.round((series.positions(frame)[seen.ids] - low) / step)
        for number, (name, (least, most)) in enumerate(ends.items()):
            values = sizes(series.field(name, frame)[seen.ids])
            shares[number, k] = np.round(255 * (values - least) / (most - least)) if most > least else 0
    steps[1:] -= steps[:-1].copy()
    data = [(steps & 255).astype(np.uint8).tobytes(), (steps >> 8).astype(np.uint8).tobytes(), shares.tobytes()]
    fields = [
        {"name": name, "unit": series.units.get(name, ""), "low": least, "high": most}
        for name, (least, most) in ends.items()
    ]
    about = {"vertices": len(seen.ids), "low": low.tolist(), "step": step.tolist(), "fields": fields}
    return data, about


def _told_plane(body: RecordedBody, box: Floats) -> dict[str, Any]:
    """A square of a half-space's plane, near the scene."""
    assert body.plane is not None
    normal, point, middle = np.array(body.plane.normal), np.array(body.plane.point), box.mean(axis=0)
    foot = middle - ((middle - point) @ normal) * normal
    side = min(body.plane.size, 1.6 * float(np.linalg.norm(box[1] - box[0])))
    return {"name": body.name, "normal": body.plane.normal, "middle": foot.tolist(), "size": side}


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")
