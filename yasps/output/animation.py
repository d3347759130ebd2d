"""Short videos made of images, with imageio."""

import importlib.util
import os
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, cast

import numpy as np
import numpy.typing as npt

from yasps.output.picture_errors import PictureError, PicturesUnavailable

Image = npt.NDArray[np.uint8]

_WIDTH: Final = 640


class Animation:
    """A short video: `.mp4` where ffmpeg is there (imageio-ffmpeg brings it), otherwise a `.gif` of the same name; or a
    `.gif` or `.webp`, which web pages and READMEs show by themselves. A `.webp` has all colours and is the smaller.

    Use it as a context manager. Leaving it, also by an error, finishes the file with the images so far; without
    any image there is no file.

    A GIF or WebP is made smaller, to 640 pixels of width at most, and written only at the end.

    Args:
        path: ends in `.mp4`, `.gif` or `.webp`; its folder must exist.
        frames_per_second: of the video.

    Raises:
        PictureError: another ending, no such folder, or a speed that is not positive.
        PicturesUnavailable: imageio is not installed.
    """

    def __init__(self, path: str | os.PathLike[str], frames_per_second: float = 30.0) -> None:
        self.path = Path(path)
        if self.path.suffix not in (".mp4", ".gif", ".webp") or not self.path.parent.is_dir():
            raise PictureError(f"'{path}' must end in '.mp4', '.gif' or '.webp' and lie in a folder that exists.")
        if not 0 < frames_per_second < np.inf:
            raise PictureError(f"frames_per_second is {frames_per_second}, but must be positive.")
        if importlib.util.find_spec("imageio") is None:
            raise PicturesUnavailable("No animation: imageio is not installed. pip install 'yasps[examples]'")
        if self.path.suffix == ".mp4" and not _has_ffmpeg():
            self.path = self.path.with_suffix(".gif")
        self._frames_per_second = frames_per_second
        self._unfinished = self.path.with_name(f".unfinished-{self.path.name}")
        self._shape: tuple[int, ...] | None = None
        self._writer: Any = None

    def add(self, image: Image) -> None:
        """Appends an image [height, width, 3], all of one size with even sides.

        Raises:
            PictureError: another shape or type.
        """
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or any(s % 2 for s in image.shape[:2]):
            raise PictureError(
                f"An image of an animation is uint8 [height, width, 3] with even sides, got {image.dtype} "
                f"{list(image.shape)}."
            )
        if self._shape is not None and image.shape != self._shape:
            raise PictureError(f"The image has shape {list(image.shape)}, those before {list(self._shape)}.")
        if self._writer is None:
            open_writer = _open_mp4 if self.path.suffix == ".mp4" else _KeptImages
            self._writer = open_writer(self._unfinished, self._frames_per_second)
        self._shape = image.shape
        self._writer.append_data(image)

    def close(self) -> None:
        """Finishes the file; a second call does nothing."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None
            self._unfinished.replace(self.path)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _KeptImages:
    """Keeps the images of a GIF or WebP, and writes them when it is closed."""

    def __init__(self, path: Path, frames_per_second: float) -> None:
        self._path = path
        # GIF counts in hundredths of a second, and viewers slow down what is faster than 50 a second.
        self._milliseconds = max(20, 10 * round(100 / frames_per_second))
        self._images: list[Any] = []

    def append_data(self, image: Image) -> None:
        import PIL.Image

        shrink = -(-image.shape[1] // _WIDTH)
        small = PIL.Image.fromarray(image).reduce(shrink)
        self._images.append(small.quantize(256) if self._path.suffix == ".gif" else small)

    def close(self) -> None:
        first, *others = self._images
        how: dict[str, Any] = {"optimize": False} if self._path.suffix == ".gif" else {"quality": 90, "method": 4}
        first.save(self._path, save_all=True, append_images=others, duration=self._milliseconds, loop=0, **how)


def _open_mp4(path: Path, frames_per_second: float) -> Any:
    import imageio.v2 as imageio

    return imageio.get_writer(
        path,
        format=cast(Any, "FFMPEG"),
        mode="I",
        fps=frames_per_second,
        quality=8,
        macro_block_size=2,
        ffmpeg_log_level="error",
    )


def _has_ffmpeg() -> bool:
    try:
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError):
        return False
    return True
