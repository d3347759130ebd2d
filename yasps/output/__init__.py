"""What a run shows: files, pictures, animations, progress."""

from yasps.output.animation import Animation
from yasps.output.pictures import (
    DARK_PINK,
    LIGHT_BLUE,
    PALETTE,
    FramePictures,
    PictureError,
    PicturesUnavailable,
    Surface,
    require_pictures,
)
from yasps.output.progress import FrameProgress, TimeTable, TimeTableError
from yasps.output.recorder import FrameRecorder
from yasps.output.vtkhdf import OutputFileError, VtkHdfSeries

__all__ = [
    "DARK_PINK",
    "LIGHT_BLUE",
    "PALETTE",
    "Animation",
    "FramePictures",
    "FrameProgress",
    "FrameRecorder",
    "OutputFileError",
    "PictureError",
    "PicturesUnavailable",
    "Surface",
    "TimeTable",
    "TimeTableError",
    "VtkHdfSeries",
    "require_pictures",
]
