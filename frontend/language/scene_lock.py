"""One thread at a time in a scene: its arrays, matrices and solver vectors are shared by everything it does.

A process that is forked while another thread is in a scene gets a copy of it in the middle of its work, and a GPU's
memory does not come along at all: such scenes say so in the child, at first use.
"""

from __future__ import annotations

import functools
import os
import threading
import weakref
from collections.abc import Callable
from types import TracebackType
from typing import Any, TypeVar, cast

from yasps.frontend.errors import SceneError
from yasps.runtime.device.protocol import Device

Method = TypeVar("Method", bound=Callable[..., Any])

_ADVICE = (
    "Start processes by multiprocessing's 'spawn' or 'forkserver' and make the scene in them, or fork before the scene "
    "is used"
)


class SceneLock:
    """A lock that the same thread may take again, for `with`."""

    def __init__(self) -> None:
        """Free."""
        self._lock = threading.RLock()
        self._refusal: str | None = None
        self.has_device = False
        """Is a GPU in use under it?"""
        _locks.add(self)

    def __enter__(self) -> None:
        """Waits for other threads. Raises SceneError in a forked process that can't use the scene."""
        self._lock.acquire()
        if self._refusal is not None:
            self._lock.release()
            raise SceneError(self._refusal)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.release()

    def after_fork_in_child(self) -> None:
        """Notes what the process that was copied had been doing."""
        if self.has_device:
            self._refusal = f"this process was forked from one that used a GPU, which can't be used here. {_ADVICE}"
        if self._lock.acquire(blocking=False):
            self._lock.release()
        else:  # the thread that holds it does not exist here and will never release it
            self._lock = threading.RLock()
            self._refusal = f"this process was forked while another thread was at work in this scene. {_ADVICE}"


_locks: weakref.WeakSet[SceneLock] = weakref.WeakSet()
_of_devices: weakref.WeakKeyDictionary[Device, SceneLock] = weakref.WeakKeyDictionary()


def lock_of(device: object) -> SceneLock:
    """The lock of a new scene: its own, or that of all scenes on the same `Device`, which does one thing at a time."""
    if isinstance(device, str):
        return SceneLock()
    lock = _of_devices.setdefault(cast(Device, device), SceneLock())
    lock.has_device = True
    return lock


def one_thread_at_a_time(method: Method) -> Method:
    """The method, within the lock `self._lock` of the scene."""

    @functools.wraps(method)
    def within(self: Any, *arguments: Any, **keywords: Any) -> Any:
        with self._lock:
            return method(self, *arguments, **keywords)

    return cast(Method, within)


def _after_fork_in_child() -> None:
    for lock in list(_locks):
        lock.after_fork_in_child()


os.register_at_fork(after_in_child=_after_fork_in_child)
