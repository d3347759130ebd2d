"""Pages of `yasps view`: what is in them, and where there is a Chromium, what they show."""

from __future__ import annotations

import base64
import json
import re
import zlib
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import Browser, chromium, differing
from results_files import Motion, cube, everything, record, rod, sheet

from yasps.output import OutputFileError, read_series, write_page


class Elements(HTMLParser):
    """Texts of the elements `script`, by their id or type, and addresses that the page names."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.scripts: dict[str, str] = {}
        self.addresses: list[str] = []
        self._open = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        given = dict(attributes)
        self.addresses += [str(given[name]) for name in ("src", "href") if name in given]
        self._open = str(given.get("id") or given.get("type")) if tag == "script" else ""

    def handle_data(self, data: str) -> None:
        if self._open:
            self.scripts[self._open] = self.scripts.get(self._open, "") + data


def numbers_of(page: Path) -> tuple[dict[str, Any], Any, Any, list[Any]]:
    """Description, integers, positions [frames, vertices, 3] and fields of a page, unpacked as html_page.py tells."""
    scripts = Elements(page.read_text(encoding="utf-8")).scripts
    told = json.loads(scripts["description"])
    data = zlib.decompress(base64.b64decode(scripts["data"]))
    integers = np.frombuffer(data, "<i4", told["integers"])
    frames, vertices = len(told["times"]), told["vertices"]
    rest = np.frombuffer(data, np.uint8, offset=4 * told["integers"])
    sizes = [3 * frames * vertices] * 2 + [frames * vertices] * len(told["fields"])
    assert len(rest) == sum(sizes)
    low, high, *fields = np.split(rest, np.cumsum(sizes)[:-1])
    steps = np.cumsum((low + 256 * high.astype(np.uint16)).reshape(frames, vertices, 3), axis=0, dtype=np.uint16)
    places = np.array(told["low"]) + steps * np.array(told["step"])
    return told, integers, places, [part.reshape(frames, vertices) for part in fields]


def test_a_page_holds_the_motion(tmp_path: Path) -> None:
    file = record(everything(), tmp_path, 9, fields=("velocity", "contact_force"))
    page = write_page(file, tmp_path / "a.html")
    series = read_series(file)
    told, integers, places, fields = numbers_of(page.path)
    assert page.frames == list(range(9)) == told["numbers"]
    assert page.megabytes == pytest.approx(page.path.stat().st_size / 1e6, rel=1e-3)
    np.testing.assert_allclose(told["times"], series.times)
    assert [body["name"] for body in told["bodies"]] == ["cube", "sheet", "rod", "wall"]
    assert told["ground"]["name"] == "floor"
    assert [plane["name"] for plane in told["planes"]] == ["slope"]

    def part(place: list[int]) -> Any:
        return integers[place[0] : place[0] + place[1]]

    for told_body in told["bodies"]:
        body = series.body(told_body["name"])
        triangles = part(told_body["source"])[part(told_body["triangles"])].reshape(-1, 3)
        edges = part(told_body["edges"]).reshape(-1, 2)
        for frame in range(9):
            x = series.positions(frame)[body.vertices]
            tolerance = 0.51 * max(told["step"])
            np.testing.assert_allclose(places[frame][triangles], x[body.triangles], rtol=0, atol=tolerance)
            np.testing.assert_allclose(places[frame][edges], x[body.edges], rtol=0, atol=tolerance)
        assert len(told_body["radii"]) == told_body["balls"][1]
    assert told["bodies"][2]["radii"] == [0.12] * 12
    speed = np.linalg.norm(series.field("velocity", 4), axis=1)
    one = next(k for k, field in enumerate(told["fields"]) if field["name"] == "velocity")
    of_cube = part(told["bodies"][0]["source"])
    shown = told["fields"][one]["low"] + fields[one][4][of_cube] / 255 * (np.ptp(speed))
    np.testing.assert_allclose(shown, np.sqrt(5), atol=np.sqrt(5) / 500)


def test_a_page_needs_nothing_else(tmp_path: Path) -> None:
    """No file and no address, and names can't end what they stand in."""
    motion = Motion(cube("</script><b onload=x>", (0.0, 0.0, 1.0)))
    page = write_page(record(motion, tmp_path, 2, "a & <b>"), tmp_path / "a.html").path.read_text(encoding="utf-8")
    elements = Elements(page)
    assert elements.addresses == []
    assert "default-src 'none'" in page
    assert json.loads(elements.scripts["description"])["bodies"][0]["name"] == "</script><b onload=x>"
    assert "<b" not in page.replace("<body", "").replace("<button", "").split('<script type="importmap"')[0]
    imports = json.loads(elements.scripts["importmap"])["imports"]
    assert set(imports) == {"three", "three-core", "orbit-controls"}
    for address in imports.values():
        text = base64.b64decode(address.removeprefix("data:text/javascript;base64,")).decode()
        named = re.findall(r"""\b(?:from|import)\s*["']([^"']+)["']""", re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL))
        assert set(named) <= set(imports)


class Fluttering(Motion):
    """A sheet that moves in a way that can't be told in short."""

    def __init__(self) -> None:
        super().__init__(sheet("sheet", (0.0, 0.0, 1.0), cells=60))
        self.random = np.random.default_rng(3)

    def step(self) -> None:
        super().step()
        for body in self.bodies:
            body.x = body.x + self.random.normal(0.0, 1e-3, body.x.shape)


def test_pages_that_would_be_too_large_have_fewer_frames(tmp_path: Path) -> None:
    file = record(Fluttering(), tmp_path, 40)
    whole = write_page(file, tmp_path / "a.html")
    assert len(whole.frames) == whole.total == 40
    few = write_page(file, tmp_path / "a.html", megabytes=0.8 * whole.megabytes)
    assert few.megabytes <= 0.8 * whole.megabytes
    assert 2 < len(few.frames) < 40
    assert (few.frames[0], few.frames[-1]) == (0, 39)
    told, _, places, _ = numbers_of(few.path)
    series = read_series(file)
    assert told["note"].startswith("40 frames, every")
    np.testing.assert_allclose(told["times"], series.times[few.frames])
    np.testing.assert_allclose(places[1].max(axis=0), series.positions(few.frames[1]).max(axis=0), atol=1e-4)
    assert write_page(file, tmp_path / "a.html", every=13).frames == [0, 13, 26, 39]
    with pytest.raises(OutputFileError, match=r"with 2 frames of 'motion\.vtkhdf' has .* MB, more than 0\.5"):
        write_page(file, tmp_path / "a.html", megabytes=0.5)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("a.htx", {}, "must end in '.html'"),
        ("no/a.html", {}, "can't be written"),
        ("a.html", {"every": 0}, "every is a whole number"),
        ("a.html", {"megabytes": float("nan")}, "megabytes is positive"),
    ],
)
def test_wrong_pages_are_refused(tmp_path: Path, name: str, options: Any, message: str) -> None:
    file = record(everything(), tmp_path, 2)
    with pytest.raises(OutputFileError, match=message):
        write_page(file, tmp_path / name, **options)


# -- in a browser ------------------------------------------------------------------------------------------

needs_chromium = pytest.mark.skipif(chromium() is None, reason="needs chromium and chromedriver")


def choose(browser: Browser, element: str, value: Any, event: str) -> None:
    """As a user does it."""
    browser.run(
        f"const one = document.getElementById('{element}'); one.value = '{value}'; "
        f"one.dispatchEvent(new Event('{event}', {{bubbles: true}}))"
    )


def pixels(image: Any, channel: int) -> Any:
    """Where one colour is much stronger than the others, [k, 2], in the part of the window without panels."""
    part = image[60:-60, :700].astype(int)
    others = np.delete(part, channel, axis=2).max(axis=2)
    return np.argwhere(part[..., channel] - others > 50)


@needs_chromium
def test_the_page_shows_and_plays_the_motion(tmp_path: Path) -> None:
    red, blue = "#ff1010", "#1010ff"
    motion = Motion(
        cube("moves", (-1.5, 0.0, 0.6)),
        cube("stays", (1.5, 0.0, 0.6)),
        rod("rod", [[0.0, 0.5 * i, 2.0] for i in range(5)], 0.1),
        velocities={"moves": (0.0, 0.0, 4.0)},
    )
    file = record(motion, tmp_path, 26, colors={"moves": red, "stays": blue, "rod": "#10ff10"})
    page = write_page(file, tmp_path / "a.html").path
    with Browser(tmp_path / "profile") as browser:
        browser.open(page)
        first = browser.picture()
        start, blue_before = pixels(first, 0), pixels(first, 2)
        assert min(len(start), len(blue_before), len(pixels(first, 1))) > 300
        assert start[:, 1].mean() < blue_before[:, 1].mean()  # x to the right
        assert browser.run("return document.getElementById('label').textContent") == "frame 0 of 25, 0.000 s"

        choose(browser, "slider", 25, "input")
        last = browser.picture()
        assert pixels(last, 0)[:, 0].mean() < start[:, 0].mean() - 50  # z up
        np.testing.assert_allclose(pixels(last, 2).mean(axis=0), blue_before.mean(axis=0), atol=3)
        assert browser.run("return document.getElementById('label').textContent") == "frame 25 of 25, 0.500 s"

        choose(browser, "colour", 0, "change")  # by velocity: yellow where it is fast, purple where nothing moves
        by_speed = browser.picture()
        assert differing(by_speed, last) > 1000
        assert len(pixels(by_speed, 0)) < 100
        assert browser.run("return document.getElementById('high').textContent") == "4.00"
        assert browser.run("return document.getElementById('unit').textContent") == "m/s"
        choose(browser, "colour", "", "change")
        assert differing(browser.picture(), last) < 50

        browser.run("document.querySelectorAll('#list input')[0].click()")
        hidden = browser.picture()
        assert len(pixels(hidden, 0)) == 0
        assert len(pixels(hidden, 2)) > 300
        browser.run("document.querySelectorAll('#list input')[0].click()")

        browser.run("document.getElementById('play').click()")  # from the end: begins anew
        assert browser.run("return document.getElementById('play').textContent") == "pause"
        until = (
            "return document.getElementById('play').textContent === 'play' && document.getElementById('slider').value"
        )
        assert browser.wait_for(until) == "25"
        browser.drag(300, 0)
        assert differing(browser.picture(), last) > 1000

        assert browser.log() == []
        assert browser.asked_for() == [page.resolve().as_uri()]
        (tmp_path / "page.png").write_bytes(browser.png())


@needs_chromium
def test_a_page_that_fails_says_so(tmp_path: Path) -> None:
    page = write_page(record(everything(), tmp_path, 2), tmp_path / "a.html").path
    text = page.read_text(encoding="utf-8")
    page.write_text(re.sub(r'(id="data">.{40})', r"\1QUJD", text), encoding="utf-8")
    with Browser(tmp_path / "profile") as browser:
        browser.open(page)
        assert "can't show the motion" in browser.run("return document.getElementById('problem').textContent")
