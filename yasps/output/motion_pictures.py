"""Pictures and animations of a results file."""

from __future__ import annotations

import os
from pathlib import Path

from yasps.output.animation import Animation
from yasps.output.pictures import FramePictures, Surface
from yasps.output.series import read_series


def _open(file):
    series = read_series(file)
    surfaces = [
        Surface(b.name, series.positions(0)[b.vertices], b.triangles, b.color)
        for b in series.bodies
        if len(b.triangles)
    ]
    return series, FramePictures(surfaces, bounds=series.box(), window_size=(960, 720))


def make_picture(file: str | os.PathLike[str], path: str | os.PathLike[str]) -> Path:
    series, frames = _open(file)
    x = series.positions(-1)
    with frames:
        for b in series.bodies:
            if len(b.triangles):
                frames.move(b.name, x[b.vertices])
        return frames.save(path)


def make_animation(file: str | os.PathLike[str], path: str | os.PathLike[str]) -> Path:
    series, frames = _open(file)
    with frames, Animation(path) as animation:
        for x in list(series.all_positions())[::3]:
            for b in series.bodies:
                if len(b.triangles):
                    frames.move(b.name, x[b.vertices])
            animation.add(frames.image())
    return animation.path
