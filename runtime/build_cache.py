"""The folder of compiled code that all processes of a user share, and the pool that fills it.

Everything in it is keyed by content: the source text, the flags, the compiler's version, the processor or device. A
file there is therefore never out of date and never changed, only replaced in one step by an equal one, so no locks are
needed. The folder is `YASPS_CACHE` where that is set, else the user's cache folder.
"""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

import platformdirs

_Result = TypeVar("_Result")


class CacheFolderError(RuntimeError):
    """The folder for compiled code cannot be written."""


def cache_folder() -> Path:
    """The folder of compiled code: YASPS_CACHE, else the user's cache folder; made when it is not there.

    Raises CacheFolderError when it cannot be made or written.
    """
    setting = os.environ.get("YASPS_CACHE")
    folder = Path(setting).expanduser() if setting else Path(platformdirs.user_cache_dir("yasps"))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CacheFolderError(_advice(folder, error)) from error
    return folder


def kept_text(name: str, parts: Sequence[str], make: Callable[[], str]) -> str:
    """A text that follows from `parts` alone: from the cache, else made and kept there.

    Raises CacheFolderError when the cache cannot be written.
    """
    path = cache_folder() / f"{safe_name(name)}-{digest_of(*parts)[:32]}.json"
    if is_filled(path):
        return path.read_text(encoding="utf-8")
    text = make()
    write_text(path, text)
    return text


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a temporary file and put it in place in one step, so that nobody sees half a file.

    Raises CacheFolderError when the folder of `path` cannot be written, and whatever `write` raises.
    """
    try:
        handle, temporary_name = tempfile.mkstemp(prefix=f".{path.stem[:40]}-", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise CacheFolderError(_advice(path.parent, error)) from error
    os.close(handle)
    temporary = Path(temporary_name)
    try:
        write(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """As `write_whole`, a whole text in UTF-8."""
    write_whole(path, lambda target: target.write_text(text, encoding="utf-8"))


def is_filled(path: Path) -> bool:
    """Whether the file is there with content; a crash of the machine can leave an empty one."""
    try:
        return path.stat().st_size > 0
    except FileNotFoundError:
        return False


def safe_name(name: str) -> str:
    """`name` with only characters that every file system takes, cut to 60."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", name)[:60] or "module"


def digest_of(*parts: str) -> str:
    """SHA-256 of the parts; lengths are part of it, so that no two lists of parts agree by accident."""
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode("utf-8")
        digest.update(f"{len(data)}:".encode())
        digest.update(data)
    return digest.hexdigest()


def in_parallel(tasks: Sequence[Callable[[], _Result]], jobs: int | None = None) -> list[_Result]:
    """What the tasks return, in their order; `jobs` run at a time (default: one per processor), begun in that order.

    Raises what the first that failed, in that order, raised.
    """
    workers = max(1, min(jobs or os.cpu_count() or 1, len(tasks)))
    if workers == 1:
        return [task() for task in tasks]
    with ThreadPoolExecutor(workers) as pool:
        futures = [pool.submit(task) for task in tasks]
    return [future.result() for future in futures]


def _advice(folder: Path, error: OSError) -> str:
    return (
        f"yasps keeps compiled code in {folder}, which cannot be written: {error}. "
        "Set the environment variable YASPS_CACHE to a folder that can."
    )
