"""A simulation as HTML, for notebooks: its bodies, contact, time, and a picture where the machine can draw."""

from __future__ import annotations

import base64
import tempfile
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from yasps.output import FrameRecorder, OutputFileError, PictureError, PicturesUnavailable, make_picture

if TYPE_CHECKING:
    from yasps.bodies import Body
    from yasps.simulation.simulation import Simulation

SIZE = (480, 360)
"""Of the picture, in pixels."""


def html_of(simulation: Simulation) -> str:
    """See `Simulation._repr_html_`."""
    head = "".join(f"<th>{word}</th>" for word in ("body", "kind", "vertices", "elements", "mass"))
    rows = "".join(_row(body) for body in simulation.bodies)
    picture = _picture(simulation)
    shown = "" if picture is None else f'<img src="data:image/png;base64,{picture}" width="{SIZE[0]}"/>'
    return (
        f"<div><b>simulation of {escape(simulation.scene.name)}</b>: frame {simulation.frame}, t = "
        f"{simulation.time:.6g} s, time step {simulation.time_step.value[0]:.6g} s, {_contact(simulation)}"
        f"<table><tr>{head}</tr>{rows}</table>{shown}</div>"
    )


def _row(body: Body) -> str:
    elements = ", ".join(f"{len(cells):,} {kind}" for kind, cells in body.cells.items())
    mass = "fixed" if body.stands_still else "driven" if body.is_fixed else f"{float(body.mass.value.sum()):.4g} kg"
    cells = (body.name, type(body).__name__, f"{len(body.rest):,}", elements, mass)
    return f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"


def _contact(simulation: Simulation) -> str:
    if simulation.contact is None:
        return "no contact"
    return f"{len(simulation.contact.active):,} close pairs below {simulation.activation_distance:.4g} m"


def _picture(simulation: Simulation) -> str | None:
    """A PNG of what is there now, in base64; None where nothing can be drawn."""
    with tempfile.TemporaryDirectory(prefix="yasps-") as folder:
        recorder = FrameRecorder(simulation, folder, "now", pictures=False)
        try:
            recorder.record(simulation)
            recorder.close()
            picture = make_picture(recorder.file, Path(folder) / "now.png", size=SIZE)
        except (OutputFileError, PictureError, PicturesUnavailable):
            return None
        return base64.b64encode(picture.read_bytes()).decode()
