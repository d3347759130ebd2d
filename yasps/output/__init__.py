"""What a run shows: files, pictures, animations, progress."""

from yasps.output.animation import Animation
from yasps.output.pictures import (
    FramePictures,
    PictureError,
    PicturesUnavailable,
    Surface,
    require_pictures,
)
from yasps.output.progress import FrameProgress, TimeTable, TimeTableError
from yasps.output.recorded_bodies import (
    DARK_PINK,
    LIGHT_BLUE,
    OBSTACLE_GREY,
    PALETTE,
    RecordedBody,
    RecordedPlane,
)
from yasps.output.recorder import FrameRecorder
from yasps.output.series import Series, read_series
from yasps.output.view import View
from yasps.output.vtkhdf import VtkHdfSeries
from yasps.output.vtkhdf_layout import OutputFileError

__all__ = [
    "DARK_PINK",
    "LIGHT_BLUE",
    "OBSTACLE_GREY",
    "PALETTE",
    "Animation",
    "FramePictures",
    "FrameProgress",
    "FrameRecorder",
    "OutputFileError",
    "PictureError",
    "PicturesUnavailable",
    "RecordedBody",
    "RecordedPlane",
    "Series",
    "Surface",
    "TimeTable",
    "TimeTableError",
    "View",
    "VtkHdfSeries",
    "read_series",
    "require_pictures",
]
