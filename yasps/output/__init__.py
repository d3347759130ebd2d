"""What a run shows: files, pictures, animations, progress."""

from yasps.output.animation import Animation
from yasps.output.exports import export_series
from yasps.output.html_page import Page, write_page
from yasps.output.motion_pictures import make_animation, make_picture
from yasps.output.picture_errors import PictureError, PicturesUnavailable, require_pictures
from yasps.output.pictures import PICTURES, ColorScale, FramePictures, Surface
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
from yasps.output.window import show_window

__all__ = [
    "DARK_PINK",
    "LIGHT_BLUE",
    "OBSTACLE_GREY",
    "PALETTE",
    "PICTURES",
    "Animation",
    "ColorScale",
    "FramePictures",
    "FrameProgress",
    "FrameRecorder",
    "OutputFileError",
    "Page",
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
    "export_series",
    "make_animation",
    "make_picture",
    "read_series",
    "require_pictures",
    "show_window",
    "write_page",
]
