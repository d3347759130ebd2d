"""When memory, graphs and the like go back to the driver: never while a graph is recorded.

What a recording sees becomes a part of its graph or ends it with an error. So nothing may reach the driver by chance
meanwhile: Python's garbage collection is off, and what is given up all the same waits until no recording is going on.
"""

from __future__ import annotations

import gc
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Disposal:
    """What is given up in this process, by any thread."""

    def __init__(self) -> None:
        # Reentrant: work that is done may let objects go that give up something themselves.
        self._lock = threading.RLock()
        self._recordings = 0
        self._collects = False
        self._waiting: deque[Callable[[], object]] = deque()

    def give_up(self, work: Callable[[], object]) -> None:
        """Does this work, which must not raise, now or after the recordings that are going on.

        Not when the process ends: then it gives everything back itself, and the driver may be gone already.
        """
        if not sys.is_finalizing():
            self._waiting.append(work)
            self._work_off()

    @contextmanager
    def recording(self) -> Iterator[None]:
        """Inside, nothing is given up and no garbage is collected."""
        with self._lock:
            if self._recordings == 0:
                self._collects = gc.isenabled()
                gc.disable()
            self._recordings += 1
        try:
            yield
        finally:
            with self._lock:
                self._recordings -= 1
                if self._recordings == 0 and self._collects:
                    gc.enable()
            self._work_off()

    def _work_off(self) -> None:
        with self._lock:
            while self._waiting and self._recordings == 0:
                self._waiting.popleft()()


DISPOSAL = Disposal()
"""The one of this process."""
