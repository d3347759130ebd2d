"""Whether pictures can be made here, and what is wrong with what they are made of."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from yasps import YaspsError

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


def require_packages() -> None:
    """Returns if pyvista and imageio are installed. Raises PicturesUnavailable."""
    missing = [name for name in ("pyvista", "imageio") if importlib.util.find_spec(name) is None]
    if missing:
        raise PicturesUnavailable(
            f"No pictures: {' and '.join(missing)} not installed. To get them: pip install 'yasps[examples]'"
        )


def require_pictures(probe: str = _PROBE) -> None:
    """Returns if pictures can be made here; takes about half a second, in a subprocess.

    Args:
        probe: Python code that renders a window and prints "rendered"; only tests need another one.

    Raises:
        PicturesUnavailable: a package or a system library is missing; the message names what to install.
    """
    require_packages()
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


@contextmanager
def quiet() -> Iterator[None]:
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
