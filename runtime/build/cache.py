"""The folder of compiled code that all processes of a user share, and the pool that fills it.

Everything in it is keyed by content: the source text, the flags, the compiler's version, the processor or device. A
file there is therefore never out of date and never changed, only replaced in one step by an equal one, so no locks are
needed. The folder is `YASPS_CACHE` where that is set, else the user's cache folder.

Beside each file lie its SHA-256 and size, which are compared before it is used: what a full disk, a crash or a bad copy
left of it is made again, and never loaded. Two processes that make the same file at the same time may leave one's file
with the other's digest; where these differ it is made once more. Whatever others could have written is refused.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

import platformdirs

from yasps.runtime.build.private_folder import CacheFolderError, check_own_file, make_private_folder

__all__ = [
    "CacheFolderError",
    "cache_folder",
    "digest_of",
    "file_name",
    "in_parallel",
    "keep",
    "keep_text",
    "kept_text",
    "put",
    "put_text",
    "safe_name",
    "text_in",
    "write_text",
]

_Result = TypeVar("_Result")

_LONGEST_SEAL = 100


def cache_folder() -> Path:
    """The folder of compiled code: YASPS_CACHE, else the user's cache folder; made, for the user alone, when it is not
    there.

    Raises CacheFolderError when it cannot be made, or when others can write to it or to a folder on the way to it.
    """
    setting = os.environ.get("YASPS_CACHE")
    folder = Path(os.path.expanduser(setting or platformdirs.user_cache_dir("yasps"))).absolute()
    try:
        make_private_folder(folder)
    except OSError as error:
        raise CacheFolderError(_advice(folder, error)) from error
    return folder


def kept_text(name: str, parts: Sequence[str], make: Callable[[], str]) -> str:
    """A text that follows from `parts` alone: from the cache, else made and kept there.

    Raises CacheFolderError when the cache cannot be used.
    """
    return keep_text(cache_folder() / f"{safe_name(name)}-{digest_of(*parts)[:32]}.json", make)


def keep_text(path: Path, make: Callable[[], str]) -> str:
    """The text of a file of the cache; where it is not there as it was put, it is made and put there now.

    Raises CacheFolderError when the cache cannot be used, and whatever `make` raises.
    """
    text = text_in(path)
    if text is None:
        text = make()
        put_text(path, text)
    return text


def keep(path: Path, build: Callable[[Path], object]) -> bool:
    """Have a file of the cache: whether it is there as it was put. If not, `build` writes it now, to a path that it is
    given.

    Raises CacheFolderError when the cache cannot be used, and whatever `build` raises.
    """
    if _whole_content(path) is not None:
        return True
    put(path, build)
    return False


def text_in(path: Path) -> str | None:
    """The text of a file of the cache, if it is there as it was put. Raises CacheFolderError for another user's."""
    content = _whole_content(path)
    return None if content is None else content.decode()


def put_text(path: Path, text: str) -> None:
    """As `put`, a whole text."""
    put(path, lambda target: _write(target, text))


def put(path: Path, build: Callable[[Path], object]) -> None:
    """Let `build` write a file, to a path that it is given, and put it in its place in the cache with its digest.

    Raises CacheFolderError when the folder of `path` cannot be written, and whatever `build` raises.
    """
    seal = ""

    def build_and_seal(target: Path) -> None:
        nonlocal seal
        build(target)
        seal = _seal(target.read_bytes())

    _replace(path, build_and_seal)
    _replace(_seal_path(path), lambda target: _write(target, seal))


def write_text(path: Path, text: str) -> None:
    """Write a whole text to a file that is for compilers and people to read; no digest is kept of it.

    Raises CacheFolderError when the folder of `path` cannot be written.
    """
    _replace(path, lambda target: _write(target, text))


def safe_name(name: str) -> str:
    """`name` with only characters that every file system takes, cut to 60."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", name)[:60] or "module"


def file_name(name: str) -> str:
    """A file's or folder's name for something that may have any name: that one where every file system takes it, else
    a cut one with a digest, so that no two are the same."""
    if re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,199}", name):
        return name
    return f"{safe_name(name).lstrip('.')}-{digest_of(name)[:16]}"


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


def _seal_path(path: Path) -> Path:
    return path.with_name(f"{path.name}.sha256")


def _seal(content: bytes) -> str:
    return f"{hashlib.sha256(content).hexdigest()} {len(content)}\n"


def _whole_content(path: Path) -> bytes | None:
    """What the file holds, if that is what was written to it, else None. Raises CacheFolderError for another's."""
    seal = _read(_seal_path(path), _LONGEST_SEAL)
    size = seal.partition(b" ")[2].strip() if seal is not None else b""
    if seal is None or not size.isdigit():
        return None
    content = _read(path, int(size) + 1)
    return content if content is not None and _seal(content).encode() == seal else None


def _read(path: Path, most: int) -> bytes | None:
    """At most so many bytes of a file; None for what is missing, unreadable, a link or no file at all."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return None
    try:
        state = os.fstat(descriptor)
        if not stat.S_ISREG(state.st_mode):
            return None
        check_own_file(path, state)
        parts, left = [], min(most, state.st_size)
        while left and (part := os.read(descriptor, left)):
            parts.append(part)
            left -= len(part)
        return b"".join(parts)
    except OSError:
        return None
    finally:
        os.close(descriptor)


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise CacheFolderError(_advice(path.parent, error)) from error


def _replace(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a temporary file and put it in place in one step, so that nobody sees half a file."""
    try:
        handle, temporary_name = tempfile.mkstemp(prefix=f".{path.stem[:40]}-", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise CacheFolderError(_advice(path.parent, error)) from error
    os.close(handle)
    temporary = Path(temporary_name)
    try:
        write(temporary)
        try:
            temporary.chmod(0o600)  # linkers make a new file, with the rights that the umask leaves
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            os.replace(temporary, path)
        except OSError as error:
            raise CacheFolderError(_advice(path.parent, error)) from error
    finally:
        temporary.unlink(missing_ok=True)


def _advice(folder: Path, error: Exception) -> str:
    return (
        f"yasps keeps compiled code in {folder}, which cannot be written: {error}. "
        "Set the environment variable YASPS_CACHE to a folder that can."
    )
