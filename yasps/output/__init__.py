"""What a run shows: files, pictures, animations, progress."""

from yasps.output.animation import Animation
from yasps.output.motion_pictures import make_animation, make_picture
from yasps.output.picture_errors import PictureError, PicturesUnavailable, require_pictures
from yasps.output.pictures import ColorScale, FramePictures, Surface
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
    "ColorScale",
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
    "make_animation",
    "make_picture",
    "read_series",
    "require_pictures",
]
