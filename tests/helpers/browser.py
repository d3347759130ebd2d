"""A headless Chromium that tests look at pages with, through chromedriver and the W3C's WebDriver protocol."""

from __future__ import annotations

import base64
import io
import json
import shutil
import subprocess
import time
import urllib.error
import urllib.request
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

_ARGUMENTS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--window-size=1000,750"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--enable-unsafe-swiftshader", "--use-angle=swiftshader", "--hide-scrollbars", "--force-device-scale-factor=1"),
)


def chromium() -> str | None:
    """The browser's program, if it and its driver are here."""
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    return found if shutil.which("chromedriver") else None


_READY = "return document.body?.dataset.ready === 'yes' || document.getElementById('problem')?.hidden === false"


class Browser:
    """One page at a time. folder: new and empty, for the browser's profile."""

    def __init__(self, folder: Path) -> None:
        program = chromium()
        assert program is not None
        self._driver = subprocess.Popen(["chromedriver", "--port=0"], stdout=subprocess.PIPE, text=True)
        try:
            assert self._driver.stdout is not None
            for line in self._driver.stdout:
                if "on port " in line and "success" in line:
                    self._url = f"http://127.0.0.1:{line.rsplit('port ', 1)[1].strip().rstrip('.')}"
                    break
            options = {"binary": program, "args": [*_ARGUMENTS, f"--user-data-dir={folder}"]}
            wanted = {"goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL", "performance": "ALL"}}
            self._url += "/session/" + self._post("/session", {"capabilities": {"alwaysMatch": wanted}})["sessionId"]
        except BaseException:
            self._end_driver()
            raise

    def open(self, page: Path) -> None:
        """Opens a file and waits until it says that it is ready, or that it has a problem."""
        self._post("/url", {"url": page.resolve().as_uri()})
        self.wait_for(_READY)

    def wait_for(self, script: str) -> Any:
        """What `run` returns, as soon as that is something."""
        for _ in range(600):
            if found := self.run(script):
                return found
            time.sleep(0.1)
        raise AssertionError(f"the page did not come to `{script}` in a minute: {self.log()}")

    def drag(self, right: int, down: int) -> None:
        """Moves the mouse with its button held, from the middle of the window, by so many pixels."""
        move = {"type": "pointerMove", "duration": 50, "origin": "pointer", "x": right, "y": down}
        start = {"type": "pointerMove", "duration": 0, "x": 450, "y": 300}
        actions = [start, {"type": "pointerDown", "button": 0}, move, {"type": "pointerUp", "button": 0}]
        self._post("/actions", {"actions": [{"type": "pointer", "id": "mouse", "actions": actions}]})

    def run(self, script: str) -> Any:
        """What a function with this body returns in the page."""
        return self._post("/execute/sync", {"script": script, "args": []})

    def picture(self) -> Any:
        """What the window shows, [height, width, 3]."""
        import imageio.v3 as imageio

        return imageio.imread(io.BytesIO(self.png()))[..., :3]

    def png(self) -> bytes:
        with urllib.request.urlopen(self._url + "/screenshot") as answer:
            return base64.b64decode(json.load(answer)["value"])

    def log(self) -> list[str]:
        """What the console was told since the last call, but for what the screenshots themselves cause."""
        messages = [entry["message"] for entry in self._post("/se/log", {"type": "browser"})]
        return [message for message in messages if "GPU stall due to ReadPixels" not in message]

    def asked_for(self) -> list[str]:
        """Addresses that pages asked for since the last call."""
        events = [json.loads(entry["message"])["message"] for entry in self._post("/se/log", {"type": "performance"})]
        sent = [event["params"]["request"]["url"] for event in events if event["method"] == "Network.requestWillBeSent"]
        return [url for url in sent if not url.startswith(("data:", "chrome:"))]

    def _post(self, path: str, body: Any) -> Any:
        data = json.dumps(body).encode()
        request = urllib.request.Request(self._url + path, data, {"Content-Type": "application/json"})
        try:
            with urllib.request.urlopen(request) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as error:
            raise AssertionError(error.read().decode()[:2000]) from error

    def _end_driver(self) -> None:
        self._driver.terminate()
        self._driver.wait()
        if self._driver.stdout is not None:
            self._driver.stdout.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            request = urllib.request.Request(self._url, method="DELETE")
            urllib.request.urlopen(request).close()
        finally:
            self._end_driver()


def differing(one: Any, other: Any) -> int:
    """Pixels that clearly differ between two pictures."""
    return int((np.abs(one.astype(int) - other.astype(int)).max(axis=2) > 30).sum())
