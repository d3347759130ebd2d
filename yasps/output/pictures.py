"""Headless pictures of surfaces (z is up), with pyvista off-screen; `animation` makes videos of them.

pyvista and imageio come with `pip install 'yasps[examples]'`. Off-screen rendering also needs the system's
EGL libraries; without them VTK does not raise but kills the process, so a subprocess tries first. Whatever is
missing is said by `PicturesUnavailable`, which a program can print and go on without pictures.
"""

import importlib.util
import os
import subprocess
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, cast

import numpy as np
import numpy.typing as npt

from yasps import YaspsError
from yasps.frontend.language.arrays import plain_array, real_numbers
from yasps.output.recorded_bodies import LIGHT_BLUE
from yasps.output.sharp_edges import split_at_creases, vertex_normals
from yasps.output.soft_shadow import soft_shadow

Points = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

_BACKGROUND: Final = ("#e7eaef", "#fdfdfe")  # bottom, top
_VIEW_ANGLE: Final = 30.0  # degrees, over the height of the picture
_MARGIN: Final = 1.12  # free space around the scene
# (direction to the light, intensity): key, fill, and a light from behind that draws the outline.
_LIGHTS: Final = (((-0.5, -0.8, 1.5), 0.72), ((1.5, -0.8, 0.6), 0.30), ((0.2, 1.5, 0.9), 0.32))
_SHADOW_RGB: Final = (52, 58, 78)

_LIBRARIES: Final = "libegl1 libegl-mesa0 libgl1-mesa-dri libgl1 libglx-mesa0 libxrender1"
_PROBE: Final = """
import vtkmodules.vtkRenderingOpenGL2
from vtkmodules.vtkCommonCore import vtkLogger
vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
from vtkmodules.vtkRenderingCore import vtkRenderWindow
window = vtkRenderWindow()
window.SetOffScreenRendering(True)
window.SetSize(8, 8)
window.Render()
print("rendered" if window.SupportsOpenGL() else "no OpenGL")
"""
_PROBE_SECONDS: Final = 60


class PictureError(YaspsError):
    """A surface or a file name that no picture can be made of."""


class PicturesUnavailable(YaspsError):  # noqa: N818 - a state of the machine, not a mistake
    """Pictures can't be made on this machine; the message says what to install."""


@dataclass(frozen=True)
class Surface:
    """A triangle surface to show.

    Attributes:
        name: by which `FramePictures.move` knows it.
        vertices: [n, 3].
        triangles: vertex numbers from 0, [m, 3].
        color: a name ("lightskyblue") or "#rrggbb".
        smooth: normals vary over triangles, but for edges sharper than 40 degrees; False shows the facets.
    """

    name: str
    vertices: npt.ArrayLike
    triangles: npt.ArrayLike
    color: str = LIGHT_BLUE
    smooth: bool = True


def require_pictures(probe: str = _PROBE) -> None:
    """Returns if pictures can be made here; takes about half a second, in a subprocess.

    Args:
        probe: Python code that renders a window and prints "rendered"; only tests need another one.

    Raises:
        PicturesUnavailable: a package or a system library is missing; the message names what to install.
    """
    missing = [name for name in ("pyvista", "imageio") if importlib.util.find_spec(name) is None]
    if missing:
        raise PicturesUnavailable(
            f"No pictures: {' and '.join(missing)} not installed. To get them: pip install 'yasps[examples]'"
        )
    try:
        tried = subprocess.run(
            [sys.executable, "-c", probe],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=_PROBE_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        outcome = f"no answer in {_PROBE_SECONDS} s"
    else:
        if tried.returncode == 0 and "rendered" in tried.stdout:
            return
        last = (tried.stderr.strip().splitlines() or [tried.stdout.strip()])[-1]
        outcome = f"exit status {tried.returncode}" + (f": {last}" if last else "")
    raise PicturesUnavailable(
        f"No pictures: VTK can't render off-screen here ({outcome}). Most likely the system's EGL libraries are "
        f"missing. On Debian or Ubuntu: apt-get install {_LIBRARIES}"
    )


class FramePictures:
    """Draws surfaces on a light ground with a soft shadow; move them and draw again for every frame.

    Args:
        surfaces: at least one, with different names.
        ground_height: z of the ground; None for no ground.
        bounds: lowest and highest corner of what the camera must see, [2, 3]. Give the box of the whole
            motion for an animation; by default it is the box of the surfaces as given and of the ground below them.
        window_size: width and height in pixels, even numbers (videos need them).
        view_direction: from the scene towards the camera.

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
    ) -> None:
        names = [surface.name for surface in surfaces]
        if not surfaces or len(set(names)) != len(names):
            raise PictureError(f"Pictures need surfaces with different names, got {names}.")
        if any(side < 2 or side % 2 for side in window_size):
            raise PictureError(f"window_size is {window_size}; width and height must be even and at least 2.")
        self._triangles = {surface.name: _checked_triangles(surface) for surface in surfaces}
        self._vertices = {surface.name: _checked_vertices(surface.name, surface.vertices, None) for surface in surfaces}
        self._ground_height = ground_height
        self._bounds = self._scene_box() if bounds is None else real_numbers(bounds, "bounds", PictureError)
        if self._bounds.shape != (2, 3) or not (self._bounds[0] <= self._bounds[1]).all():
            raise PictureError("bounds must hold the lowest and the highest corner, shape [2, 3].")
        self._diagonal = float(np.linalg.norm(self._bounds[1] - self._bounds[0])) or 1.0
        camera = camera_position(self._bounds, view_direction, window_size[0] / window_size[1])
        require_pictures()
        with _quiet():
            self._draw_first(surfaces, window_size, camera)

    def move(self, name: str, vertices: npt.ArrayLike) -> None:
        """Gives a surface new vertices, shape [n, 3] with the same n.

        Raises:
            PictureError: unknown name, another number of vertices, or NaN.
        """
        if name not in self._vertices:
            raise PictureError(f"There is no surface '{name}'; there are {', '.join(self._vertices)}.")
        moved = _checked_vertices(name, vertices, len(self._vertices[name]))
        self._vertices[name] = moved
        mesh, (source, triangles) = self._meshes[name], self._shown[name]
        mesh.points[:] = moved[source]
        mesh.point_data["Normals"][:] = vertex_normals(moved[source], triangles)
        mesh.Modified()

    def image(self) -> Image:
        """The scene as it is now, [height, width, 3] in 0..255."""
        with _quiet():
            if self._ground is not None:
                self._ground.texture = self._shadow_texture()
            self._plotter.render()  # a screenshot alone shows the frame before
            return np.array(self._plotter.screenshot(None, return_img=True), dtype=np.uint8)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Writes the scene as it is now as `.png` or `.jpg`.

        Raises:
            PictureError: another ending, or the file can't be written.
        """
        import imageio.v3 as imageio

        path = Path(path)
        if path.suffix.lower() not in (".png", ".jpg", ".jpeg"):
            raise PictureError(f"A picture's file name ends in '.png' or '.jpg', got '{path.name}'.")
        try:
            imageio.imwrite(path, self.image())
        except OSError as error:
            raise PictureError(f"The picture '{path}' can't be written: {error}") from error
        return path

    def close(self) -> None:
        """Frees the window; no picture can be made afterwards."""
        with _quiet():
            self._plotter.close()

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
        self, surfaces: Sequence[Surface], window_size: tuple[int, int], camera: tuple[Points, Points]
    ) -> None:
        import pyvista

        for surface in surfaces:
            try:
                pyvista.Color(surface.color)
            except ValueError as error:
                raise PictureError(
                    f"Surface '{surface.name}' has the unknown color '{surface.color}'; give a name or '#rrggbb'."
                ) from error
        plotter: Any = pyvista.Plotter(off_screen=True, window_size=list(window_size), lighting="none")
        plotter.set_background(_BACKGROUND[0], top=_BACKGROUND[1])
        self._meshes: dict[str, Any] = {}
        self._shown: dict[str, tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]] = {}
        for surface in surfaces:
            source, triangles = split_at_creases(self._vertices[surface.name], self._triangles[surface.name])
            self._shown[surface.name] = source, triangles
            vertices = self._vertices[surface.name][source]
            mesh: Any = pyvista.PolyData.from_regular_faces(vertices, cast(Any, triangles))
            mesh.point_data["Normals"] = vertex_normals(vertices, triangles)
            mesh.point_data.active_normals_name = "Normals"
            actor = plotter.add_mesh(
                mesh, color=surface.color, ambient=0.30, diffuse=0.78, specular=0.22, specular_power=22
            )
            actor.prop.interpolation = "Phong" if surface.smooth else "Flat"
            self._meshes[surface.name] = mesh
        self._ground: Any = None
        if self._ground_height is not None:
            low, high = self._bounds
            centre = (*((low + high) / 2)[:2], self._ground_height - 1e-3 * self._diagonal)
            plane = pyvista.Plane(center=centre, i_size=self._ground_side, j_size=self._ground_side)
            self._ground = plotter.add_mesh(plane, texture=self._shadow_texture(), lighting=False)
        for direction, intensity in _LIGHTS:
            plotter.add_light(pyvista.Light(position=direction, intensity=intensity, light_type="scene light"))
        eye, focus = camera
        plotter.camera.view_angle = _VIEW_ANGLE
        plotter.camera_position = [tuple(eye), tuple(focus), (0.0, 0.0, 1.0)]
        plotter.enable_anti_aliasing("ssaa", multi_samples=4)
        plotter.show(auto_close=False)
        self._plotter = plotter

    @property
    def _ground_side(self) -> float:
        return 4.0 * self._diagonal

    def _shadow_texture(self) -> Any:
        import pyvista

        centre = self._bounds.mean(axis=0)[:2]
        bodies = [(self._vertices[name], self._triangles[name]) for name in self._vertices]
        shadow = soft_shadow(bodies, self._ground_height or 0.0, centre, self._ground_side, self._diagonal)
        image = np.empty((*shadow.shape, 4), dtype=np.uint8)
        image[..., :3] = _SHADOW_RGB
        image[..., 3] = np.round(255 * shadow)
        to_texture: Any = pyvista.numpy_to_texture
        texture = to_texture(np.ascontiguousarray(image[::-1]))
        texture.interpolate = True
        return texture


def camera_position(bounds: Points, view_direction: tuple[float, float, float], aspect: float) -> tuple[Points, Points]:
    """The eye and the point it looks at, as near as the whole box allows.

    A corner with coordinates (x, y, z) along (right, up, towards the eye) from the centre is in the picture
    at distance d if |x| <= (d - z) tan(a_x) and |y| <= (d - z) tan(a_y), with a the half angles of view.

    Args:
        bounds: lowest and highest corner, [2, 3].
        view_direction: from the scene towards the eye, not vertical.
        aspect: width / height of the picture.

    Raises:
        PictureError: the direction is zero or vertical.
    """
    towards = real_numbers(view_direction, "view_direction", PictureError).copy()
    if towards.shape != (3,):
        raise PictureError(f"view_direction is {view_direction}; it must be three numbers.")
    right = np.cross([0.0, 0.0, 1.0], towards)
    if not np.linalg.norm(right) > 1e-6 * np.linalg.norm(towards):
        raise PictureError(f"view_direction is {view_direction}; it must not be zero or vertical (z is up).")
    towards /= np.linalg.norm(towards)
    right /= np.linalg.norm(right)
    up = np.cross(towards, right)
    centre = bounds.mean(axis=0)
    corners = np.array([[x, y, z] for x in bounds[:, 0] for y in bounds[:, 1] for z in bounds[:, 2]]) - centre
    tan_y = np.tan(np.radians(_VIEW_ANGLE / 2)) / _MARGIN
    depth = corners @ towards
    distance = max(
        (depth + abs(corners @ right) / (tan_y * aspect)).max(), (depth + abs(corners @ up) / tan_y).max(), 1e-6
    )
    return centre + distance * towards, centre


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


@contextmanager
def _quiet() -> Iterator[None]:
    """Keeps warnings of VTK and pyvista from the terminal; the settings are put back afterwards."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkObject

    shown, verbosity = vtkObject.GetGlobalWarningDisplay(), vtkLogger.GetCurrentVerbosityCutoff()
    vtkObject.SetGlobalWarningDisplay(0)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        vtkObject.SetGlobalWarningDisplay(shown)
        vtkLogger.SetStderrVerbosity(verbosity)
