"""Headless pictures of surfaces (z is up), with pyvista off-screen; `animation` makes videos of them.

pyvista and imageio come with `pip install 'yasps[examples]'`. Off-screen rendering also needs the system's
EGL libraries; without them VTK does not raise but kills the process, so a subprocess tries first. Whatever is
missing is said by `PicturesUnavailable`, which a program can print and go on without pictures.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, cast

import numpy as np
import numpy.typing as npt

from yasps.frontend.language.arrays import plain_array, real_numbers
from yasps.output.camera import VIEW_ANGLE, box_corners, camera_position
from yasps.output.picture_errors import PictureError, quiet, require_pictures
from yasps.output.picture_ground import GroundLines, plane_square, shadow_texture
from yasps.output.recorded_bodies import DARKER, LIGHT_BLUE, RecordedPlane, dark_sectors
from yasps.output.sharp_edges import split_at_creases, vertex_normals

Points = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

PICTURES: Final = (".png", ".jpg", ".jpeg")
"""Endings of pictures."""
_BACKGROUND: Final = ("#e7eaef", "#fdfdfe")  # bottom, top
# (direction to the light, intensity): key, fill, and a light from behind that draws the outline.
_LIGHTS: Final = (((-0.5, -0.8, 1.5), 0.72), ((1.5, -0.8, 0.6), 0.30), ((0.2, 1.5, 0.9), 0.32))
_SURFACE: Final = {"ambient": 0.30, "diffuse": 0.78, "specular": 0.22, "specular_power": 22}
_PLANE_COLOR: Final = "#d4d8df"
_ARROW_COLOR: Final = "#b3261e"
_COLOR_MAP: Final = "viridis"
_GROUND_SIDE: Final = 4.0
"""Side of the ground's square in diagonals of the scene."""


@dataclass(frozen=True)
class Surface:
    """A triangle surface to show.

    Attributes:
        name: by which `FramePictures.move` knows it.
        vertices: [n, 3].
        triangles: vertex numbers from 0, [m, 3].
        color: a name ("lightskyblue") or "#rrggbb".
        smooth: normals vary over triangles, but for edges sharper than 40 degrees; False shows the facets.
        patterned: sectors of two tones, by which one sees it turn.
        open: it has a rim: what is behind its front is shown in a paler tone.
        opacity: 1 hides what is behind it; what is clearer than that casts no shadow.
    """

    name: str
    vertices: npt.ArrayLike
    triangles: npt.ArrayLike
    color: str = LIGHT_BLUE
    smooth: bool = True
    patterned: bool = False
    open: bool = False
    opacity: float = 1.0


@dataclass(frozen=True)
class ColorScale:
    """Values that surfaces are coloured by instead of their own colours, with a bar that says which is which.

    Attributes:
        title: above the bar, with the unit.
        low, high: values at the ends of the bar.
    """

    title: str
    low: float
    high: float


class FramePictures:
    """Draws surfaces on a light ground with a soft shadow; move them and draw again for every frame.

    Args:
        surfaces: at least one, with different names.
        ground_height: z of the ground; None for no ground.
        bounds: lowest and highest corner of what the camera must see, [2, 3]. Give the box of the whole
            motion for an animation; by default it is the box of the surfaces as given and of the ground below them.
        window_size: width and height in pixels, even numbers (videos need them).
        view_direction: from the scene towards the camera.
        planes: of half-spaces that are not the ground.
        scale: colours surfaces by the values that `move` gives them.
        window: make them in a window on the screen, which whoever calls shows; by default nobody sees one.

    Raises:
        PictureError: wrong shapes, NaN, vertex numbers out of range, unknown colours or sizes.
        PicturesUnavailable: see `require_pictures`.
    """

    def __init__(
        self,
        surfaces: Sequence[Surface],
        *,
        ground_height: float | None = 0.0,
        bounds: npt.ArrayLike | None = None,
        window_size: tuple[int, int] = (1280, 960),
        view_direction: tuple[float, float, float] = (0.35, -1.0, 0.32),
        planes: Sequence[RecordedPlane] = (),
        scale: ColorScale | None = None,
        window: bool = False,
    ) -> None:
        names = [surface.name for surface in surfaces]
        if not surfaces or len(set(names)) != len(names):
            raise PictureError(f"Pictures need surfaces with different names, got {names}.")
        if any(side < 2 or side % 2 for side in window_size):
            raise PictureError(f"window_size is {window_size}; width and height must be even and at least 2.")
        self._triangles = {surface.name: _checked_triangles(surface) for surface in surfaces}
        self._vertices = {surface.name: _checked_vertices(surface.name, surface.vertices, None) for surface in surfaces}
        self._casting = [surface.name for surface in surfaces if surface.opacity >= 1.0]
        self._ground_height = ground_height
        box = self._scene_box() if bounds is None else real_numbers(bounds, "bounds", PictureError)
        if box.shape != (2, 3) or not (box[0] <= box[1]).all():
            raise PictureError("bounds must hold the lowest and the highest corner, shape [2, 3].")
        self._middle = box.mean(axis=0)
        self._diagonal = float(np.linalg.norm(box[1] - box[0])) or 1.0
        self._scale = scale
        self._arrows: Any = None
        camera = camera_position(box_corners(box), view_direction, window_size[0] / window_size[1])
        if not window:
            require_pictures()
        with quiet():
            self._draw_first(surfaces, window_size, planes, window=window)
            self._place_camera(*camera)
            if not window:
                self.plotter.show(auto_close=False)

    def move(self, name: str, vertices: npt.ArrayLike, values: npt.ArrayLike | None = None) -> None:
        """Gives a surface new vertices, shape [n, 3] with the same n, and with a scale, values of them, [n].

        Raises:
            PictureError: unknown name, another number of vertices or values, or NaN.
        """
        if name not in self._vertices:
            raise PictureError(f"There is no surface '{name}'; there are {', '.join(self._vertices)}.")
        moved = _checked_vertices(name, vertices, len(self._vertices[name]))
        self._vertices[name] = moved
        mesh, (source, triangles) = self._meshes[name], self._shown[name]
        mesh.points[:] = moved[source]
        mesh.point_data["Normals"][:] = vertex_normals(moved[source], triangles)
        if values is not None and self._scale is not None:
            numbers = real_numbers(values, f"values of surface '{name}'", PictureError)
            if numbers.shape != (len(moved),):
                raise PictureError(f"Surface '{name}' has {len(moved)} vertices, got values {list(numbers.shape)}.")
            mesh.point_data["value"][:] = numbers[source]
        mesh.Modified()

    def look(self, eye: Points, focus: Points) -> None:
        """Moves the camera, and the part of the ground that is drawn with it; both [3]."""
        self._middle = np.asarray(focus, np.float64)
        self._place_camera(eye, focus)

    def show_arrows(self, points: Points, vectors: Points) -> None:
        """Draws arrows from points along vectors, whose lengths are those of the arrows; both [k, 3]."""
        import pyvista

        if self._arrows is not None:
            self.plotter.remove_actor(self._arrows, render=False)
            self._arrows = None
        if len(points) == 0:
            return
        cloud: Any = pyvista.PolyData(np.asarray(points, np.float64))
        cloud["vectors"], cloud["length"] = vectors, np.linalg.norm(vectors, axis=1)
        shape: Any = pyvista.Arrow(tip_length=0.3, tip_radius=0.09, shaft_radius=0.035, tip_resolution=12)
        arrows = cloud.glyph(orient="vectors", scale="length", factor=1.0, geom=shape)
        self._arrows = self.plotter.add_mesh(arrows, color=_ARROW_COLOR, render=False, **_SURFACE)

    def cast_shadows(self) -> None:
        """Draws the shadows of surfaces where they are now."""
        if self._ground is not None:
            self._ground.texture = self._shadow_texture()

    def image(self) -> Image:
        """The scene as it is now, [height, width, 3] in 0..255."""
        with quiet():
            self.cast_shadows()
            self.plotter.render()  # a screenshot alone shows the frame before
            return np.array(self.plotter.screenshot(None, return_img=True), dtype=np.uint8)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Writes the scene as it is now as `.png` or `.jpg`.

        Raises:
            PictureError: another ending, or the file can't be written.
        """
        import imageio.v3 as imageio

        path = Path(path)
        if path.suffix.lower() not in PICTURES:
            raise PictureError(f"A picture's file name ends in '.png' or '.jpg', got '{path.name}'.")
        try:
            imageio.imwrite(path, self.image())
        except OSError as error:
            raise PictureError(f"The picture '{path}' can't be written: {error}") from error
        return path

    def close(self) -> None:
        """Frees the window; no picture can be made afterwards."""
        with quiet():
            self.plotter.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _scene_box(self) -> Points:
        points = np.concatenate(list(self._vertices.values()))
        box = np.array([points.min(axis=0), points.max(axis=0)])
        if self._ground_height is not None:
            box[0, 2] = min(box[0, 2], self._ground_height)
            box[1, 2] = max(box[1, 2], self._ground_height)
        return box

    def _draw_first(
        self, surfaces: Sequence[Surface], size: tuple[int, int], planes: Sequence[RecordedPlane], *, window: bool
    ) -> None:
        import pyvista

        for surface in surfaces:
            try:
                pyvista.Color(surface.color)
            except ValueError as error:
                raise PictureError(
                    f"Surface '{surface.name}' has the unknown color '{surface.color}'; give a name or '#rrggbb'."
                ) from error
        plotter: Any = pyvista.Plotter(off_screen=not window, notebook=False, window_size=list(size), lighting="none")
        self.plotter = plotter
        plotter.set_background(_BACKGROUND[0], top=_BACKGROUND[1])
        self._meshes: dict[str, Any] = {}
        self._shown: dict[str, tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]] = {}
        for surface in surfaces:
            self._add_surface(surface)
        if self._scale is not None:
            plotter.add_scalar_bar(title=self._scale.title, **_BAR)
        self._ground: Any = None
        self._lines: GroundLines | None = None
        for plane in planes:
            square = plane_square(plane, self._middle, self._diagonal, self._ground_height)
            if square is not None:
                plotter.add_mesh(square, color=_PLANE_COLOR, **(_SURFACE | {"specular": 0.0}))
        if self._ground_height is not None:
            self._lines = GroundLines(self._ground_height, self._diagonal)
            plotter.add_mesh(self._lines.mesh, scalars="rgba", rgb=True, lighting=False, line_width=1.5)
            side = _GROUND_SIDE * self._diagonal
            self._square: Any = pyvista.Plane(i_size=side, j_size=side)
            self._ground = plotter.add_mesh(self._square, texture=self._shadow_texture(), lighting=False)
            self._flat = np.array(self._square.points)
        for direction, intensity in _LIGHTS:
            plotter.add_light(pyvista.Light(position=direction, intensity=intensity, light_type="scene light"))
        plotter.camera.view_angle = VIEW_ANGLE
        plotter.enable_anti_aliasing("ssaa", multi_samples=4)

    def _add_surface(self, surface: Surface) -> None:
        import pyvista

        source, triangles = split_at_creases(self._vertices[surface.name], self._triangles[surface.name])
        self._shown[surface.name] = source, triangles
        vertices = self._vertices[surface.name][source]
        mesh: Any = pyvista.PolyData.from_regular_faces(vertices, cast(Any, triangles))
        mesh.point_data["Normals"] = vertex_normals(vertices, triangles)
        mesh.point_data.active_normals_name = "Normals"
        look: dict[str, Any] = {"color": surface.color, **_SURFACE}
        if self._scale is not None:
            mesh.point_data["value"] = np.zeros(len(vertices))
            look = {"scalars": "value", "clim": (self._scale.low, self._scale.high), "cmap": _COLOR_MAP, **_SURFACE}
            look["show_scalar_bar"] = False
        elif surface.patterned:
            dark = dark_sectors(vertices[triangles].mean(axis=1))
            tones = np.array(pyvista.Color(surface.color).int_rgb) * np.where(dark, DARKER, 1.0)[:, None]
            mesh.cell_data["tone"] = np.round(tones).astype(np.uint8)
            look = {"scalars": "tone", "rgb": True, **_SURFACE}
        elif surface.open:
            back = 0.55 * np.array(pyvista.Color(surface.color).float_rgb) + 0.45
            look["backface_params"] = {"color": back.tolist(), **_SURFACE}
        actor = self.plotter.add_mesh(mesh, opacity=surface.opacity, **look)
        actor.prop.interpolation = "Phong" if surface.smooth else "Flat"
        self._meshes[surface.name] = mesh

    def _place_camera(self, eye: Points, focus: Points) -> None:
        self.plotter.camera_position = [tuple(eye), tuple(focus), (0.0, 0.0, 1.0)]
        # Depths have 24 bits: with a nearer plane, what lies behind a cloth in contact would show through it.
        nearest = max(1e-3 * self._diagonal, 0.02 * float(np.linalg.norm(np.subtract(eye, focus))))
        self.plotter.camera.clipping_range = (nearest, 40.0 * self._diagonal)
        if self._ground is not None and self._lines is not None:
            below = [*self._middle[:2], (self._ground_height or 0.0) - 1e-3 * self._diagonal]
            self._square.points[:] = self._flat + np.array(below)
            self._square.Modified()
            self._lines.move(self._middle)

    def _shadow_texture(self) -> Any:
        bodies = [(self._vertices[name], self._triangles[name]) for name in self._casting]
        side = _GROUND_SIDE * self._diagonal
        return shadow_texture(bodies, self._ground_height or 0.0, self._middle[:2], side, self._diagonal)


_BAR: Final = {
    "vertical": False,
    "position_x": 0.25,
    "position_y": 0.03,
    "width": 0.5,
    "height": 0.08,
    "title_font_size": 22,
    "label_font_size": 18,
    "color": "#30343c",
    "n_labels": 5,
    "fmt": "%.3g",
}


def _checked_vertices(name: str, values: npt.ArrayLike, expected: int | None) -> Points:
    vertices = real_numbers(values, f"surface '{name}'", PictureError, finite=False).copy()
    if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) != (expected or len(vertices)):
        raise PictureError(
            f"The vertices of surface '{name}' have shape {list(vertices.shape)}, expected [{expected or 'n'}, 3]."
        )
    if not np.isfinite(vertices).all():
        row = int(np.argwhere(~np.isfinite(vertices))[0, 0])
        raise PictureError(f"Vertex {row} of surface '{name}' is {vertices[row]}: the simulation has diverged.")
    return vertices


def _checked_triangles(surface: Surface) -> npt.NDArray[np.int64]:
    triangles: npt.NDArray[Any] = plain_array(
        surface.triangles, f"The triangles of surface '{surface.name}'", PictureError
    )
    if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu" or not len(triangles):
        raise PictureError(
            f"The triangles of surface '{surface.name}' have shape {list(triangles.shape)} and type "
            f"{triangles.dtype}, expected integers of shape [m, 3] with m > 0."
        )
    vertices = len(np.asarray(surface.vertices))
    if triangles.min() < 0 or triangles.max() >= vertices:
        raise PictureError(
            f"The triangles of surface '{surface.name}' name vertices {triangles.min()} to {triangles.max()}, but "
            f"there are vertices 0 to {vertices - 1}."
        )
    return triangles.astype(np.int64)
