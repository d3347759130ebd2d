"""What a results file says of its bodies besides their positions: names, colours, surfaces, half-spaces."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from yasps.output.vtkhdf_layout import OutputFileError

PALETTE: Final = ("#86c5f4", "#c2185b", "#f2b134", "#5c9e6b", "#8e6bbf", "#d9754a")
"""Colours of bodies, in turn."""
LIGHT_BLUE, DARK_PINK = PALETTE[:2]
OBSTACLE_GREY: Final = "#a9adb6"
"""Colour of what stands still."""

DARKER: Final = 0.72
"""How much darker every other sector of a body is that moves as it is told: one sees it turn."""

Ids = NDArray[np.int32]
Floats = NDArray[np.float64]


class Shown(Protocol):
    """A body, as far as output is concerned."""

    name: str
    triangles: Ids
    edges: Ids
    points: Ids
    cells: Mapping[str, Ids]

    @property
    def is_fixed(self) -> bool:
        """Whether no energy moves it."""

    @property
    def stands_still(self) -> bool:
        """Whether its vertices never move."""

    def positions(self) -> Floats:
        """[n, 3]."""

    def radii(self) -> Floats:
        """Of its vertices, [n]."""


class Plane(Protocol):
    """The boundary of a half-space."""

    @property
    def normal(self) -> tuple[float, float, float]:
        """Unit vector out of the half-space."""

    @property
    def point(self) -> tuple[float, float, float]:
        """Of the plane."""


class SquareShape(Protocol):
    """A square that stands for a plane."""

    vertices: Floats


@runtime_checkable
class ShownHalfSpace(Protocol):
    """A body without vertices: all that is below a plane."""

    plane: Plane
    shape: SquareShape


@dataclass(frozen=True)
class RecordedPlane:
    """The boundary of a half-space."""

    normal: tuple[float, float, float]
    """Unit vector out of the half-space."""
    point: tuple[float, float, float]
    """[m]"""
    size: float
    """Side of the square that stands for it [m]."""


@dataclass(frozen=True, eq=False)
class RecordedBody:
    """A body of a results file."""

    name: str
    kind: str
    """Name of its class, such as "SoftBody"."""
    color: str
    """"#rrggbb"."""
    opacity: float
    """1 hides what is behind it, less lets it through."""
    stands_still: bool
    """Whether its vertices never move."""
    is_driven: bool
    """Whether it moves as it is told, by no energy."""
    first: int
    """Its first vertex among those of all bodies."""
    count: int
    """How many vertices it has; none for a half-space."""
    triangles: Ids
    """Its surface, [m, 3], numbered from 0 in the body, as all below."""
    edges: Ids
    """Those of rods, in no triangle, [k, 2]."""
    points: Ids
    """Loose vertices, [l]."""
    radii: Floats
    """Half the thickness at each vertex [m], [count]."""
    plane: RecordedPlane | None = None
    """Of a half-space."""

    @property
    def vertices(self) -> slice:
        """Its rows in arrays over the vertices of all bodies."""
        return slice(self.first, self.first + self.count)

    @property
    def two_sided(self) -> bool:
        """Whether its surface has a rim, so that both sides are to be seen."""
        sides = np.sort(self.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        return bool(len(sides)) and bool((np.unique(sides, axis=0, return_counts=True)[1] == 1).any())


def dark_sectors(middles: Floats) -> NDArray[np.bool_]:
    """Which triangles with these middles, [m, 3], are in a dark sector as seen from the middle of all, [m]: octants, or
    quadrants of what is flat along an axis."""
    off = middles - 0.5 * (middles.min(axis=0) + middles.max(axis=0))
    reach = np.abs(off).max(axis=0)
    thick = reach > 0.2 * reach.max()
    return np.asarray((off[:, thick] > 1e-9 * reach.max()).sum(axis=1) % 2 == 1)


def recorded_bodies(bodies: Sequence[Shown], colors: Mapping[str, str] | None = None) -> list[RecordedBody]:
    """What is to be kept of bodies, in their order.

    colors: name -> "#rrggbb", or "#rrggbbaa" with the opacity, instead of the palette's in turn, or grey for what
    stands still. Raises OutputFileError for a colour of no body or in another form.
    """
    colors = dict(colors or {})
    for name, color in colors.items():
        if name not in {body.name for body in bodies} or not re.fullmatch("#([0-9a-fA-F]{2}){3,4}", color):
            known = ", ".join(body.name for body in bodies)
            raise OutputFileError(
                f"colors has {name!r}: {color!r}; it takes '#rrggbb' or '#rrggbbaa' for the bodies {known}."
            )
    found, first = [], 0
    palette = itertools.cycle(PALETTE)
    for body in bodies:
        plane = None
        if isinstance(body, ShownHalfSpace):
            side = float(np.linalg.norm(body.shape.vertices[1] - body.shape.vertices[0]))
            plane = RecordedPlane(body.plane.normal, body.plane.point, side)
        color = OBSTACLE_GREY if body.stands_still else next(palette)
        color = colors.get(body.name, color)
        radii = np.array(body.radii(), np.float64)
        found.append(
            RecordedBody(
                name=body.name,
                kind=type(body).__name__,
                color=color[:7],
                opacity=int(color[7:] or "ff", 16) / 255,
                stands_still=body.stands_still,
                is_driven=body.is_fixed and not body.stands_still,
                first=first,
                count=len(radii),
                triangles=np.asarray(body.triangles, np.int32).reshape(-1, 3),
                edges=np.asarray(body.edges, np.int32).reshape(-1, 2),
                points=np.asarray(body.points, np.int32).reshape(-1),
                radii=radii,
                plane=plane,
            )
        )
        first += len(radii)
    return found


_PLAIN: Final = ("name", "kind", "stands_still", "is_driven", "first", "count")
_ARRAYS: Final = {"triangles": (3, np.int32), "edges": (2, np.int32), "points": (1, np.int32), "radii": (1, np.float64)}
"""Arrays of all bodies, one body after the other: columns and type."""


def as_datasets(bodies: Sequence[RecordedBody], more: Mapping[str, Any]) -> dict[str, NDArray[Any] | str]:
    """The bodies as a text in JSON, with `more`, and arrays beside it."""
    told = []
    for body in bodies:
        entry = {name: getattr(body, name) for name in _PLAIN}
        entry |= {f"number_of_{name}": len(getattr(body, name)) for name in _ARRAYS}
        if body.plane is not None:
            entry["plane"] = {"normal": body.plane.normal, "point": body.plane.point, "size": body.plane.size}
        told.append(entry)
    datasets: dict[str, NDArray[Any] | str] = {"description": json.dumps({"bodies": told, **more}, indent=1)}
    for name, (columns, dtype) in _ARRAYS.items():
        parts = [np.asarray(getattr(body, name), dtype).reshape(-1, columns) for body in bodies]
        datasets[name] = np.concatenate([np.empty((0, columns), dtype), *parts])
    return datasets


def told_look(bodies: Sequence[RecordedBody], view: Mapping[str, Any]) -> str:
    """How all of it looks as a text in JSON: colours, opacities, the view."""
    return json.dumps({"colors": [[body.color, body.opacity] for body in bodies], "view": view})


def from_datasets(
    description: Mapping[str, Any], look: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> list[RecordedBody]:
    """The bodies of a file. Raises KeyError, TypeError or ValueError for what is no description of bodies."""
    found = []
    begin = dict.fromkeys(_ARRAYS, 0)
    for entry, (color, opacity) in zip(description["bodies"], look["colors"], strict=True):
        parts: dict[str, Any] = {}
        for name, (columns, dtype) in _ARRAYS.items():
            count = int(entry[f"number_of_{name}"])
            rows = np.asarray(arrays[name][begin[name] : begin[name] + count], dtype)
            if rows.shape != (count, columns):
                raise ValueError(f"{name} of body {entry['name']!r} are missing")
            if name != "radii" and count and not 0 <= rows.min() <= rows.max() < int(entry["count"]):
                raise ValueError(f"{name} of body {entry['name']!r} name vertices that it does not have")
            begin[name] += count
            parts[name] = rows if columns > 1 else rows[:, 0]
        plane = entry.get("plane")
        if plane is not None:
            normal, point = (tuple(float(x) for x in plane[part]) for part in ("normal", "point"))
            if len(normal) != 3 or len(point) != 3:
                raise ValueError(f"the plane of body {entry['name']!r} is none")
            plane = RecordedPlane(normal, point, float(plane["size"]))
        if not re.fullmatch("#[0-9a-fA-F]{6}", color) or not 0 <= opacity <= 1:
            raise ValueError(f"the colour of body {entry['name']!r} is none")
        found.append(
            RecordedBody(
                name=str(entry["name"]),
                kind=str(entry["kind"]),
                color=str(color),
                opacity=float(opacity),
                stands_still=bool(entry["stands_still"]),
                is_driven=bool(entry["is_driven"]),
                first=int(entry["first"]),
                count=int(entry["count"]),
                plane=plane,
                **parts,
            )
        )
    return found
