"""Folders and files that nobody else can have written, because what lies in them is loaded and run.

Trusted are the user and root. Whoever may write to a folder can put another file or folder in the place of one in it,
so every folder and link from the root of the file system on counts; a sticky folder (`/tmp`) keeps its entries safe.
"""

from __future__ import annotations

import os
import pwd
import stat
from pathlib import Path

_MOST_LINKS = 40
_WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH


class CacheFolderError(RuntimeError):
    """The folder for compiled code cannot be used: it cannot be written, or others could have written there."""


def make_private_folder(folder: Path) -> None:
    """Make the folder, and those above it that are missing, with rights for the user alone; a present one stays.

    Raises CacheFolderError when somebody else can write to it or could exchange it, OSError when it cannot be made.
    """
    for missing in reversed([place for place in (folder, *folder.parents) if not os.path.lexists(place)]):
        try:
            missing.mkdir(mode=0o700)
        except FileExistsError:
            continue  # another process was faster
    _check_way(folder)


def check_own_file(path: Path, state: os.stat_result) -> None:
    """Raise CacheFolderError for a file that another user owns, or that group or others can write."""
    if not _is_trusted(state):
        raise CacheFolderError(
            f"yasps runs the code that it keeps in {path.parent}, but {path.name} there belongs to {_owner(state)}. "
            "Delete it, or set the environment variable YASPS_CACHE to a folder of your own."
        )
    if state.st_mode & _WRITABLE_BY_OTHERS:
        raise CacheFolderError(
            f"yasps runs the code that it keeps in {path.parent}, but others than you can write to {path.name} there "
            f"(its rights are {stat.filemode(state.st_mode)}). Delete it: it will be made again."
        )


def _check_way(folder: Path) -> None:
    """Look at every folder and link that is gone through on the way to `folder`, and at itself."""
    place, ahead, links = Path("/"), list(folder.absolute().parts[1:]), 0
    while ahead:
        part = ahead.pop(0)
        if part == "..":
            place = place.parent
            continue
        entry = place / part
        state = entry.lstat()
        if not _is_trusted(state):
            raise CacheFolderError(
                f"yasps runs the code that it keeps in {folder}, but {entry} belongs to {_owner(state)}, who can put "
                "other code there. Set the environment variable YASPS_CACHE to a folder of your own."
            )
        if stat.S_ISLNK(state.st_mode):
            links += 1
            if links > _MOST_LINKS:
                raise CacheFolderError(f"{folder} for compiled code leads in a circle of links, at {entry}")
            target = Path(os.readlink(entry))
            place = Path("/") if target.is_absolute() else place
            ahead = [*(part for part in target.parts if part != "/"), *ahead]
            continue
        if not stat.S_ISDIR(state.st_mode):
            raise NotADirectoryError(f"{entry} is no folder")
        is_safe_on_the_way = bool(ahead) and state.st_mode & stat.S_ISVTX
        if state.st_mode & _WRITABLE_BY_OTHERS and not is_safe_on_the_way:
            raise CacheFolderError(
                f"yasps runs the code that it keeps in {folder}, but others than you can write to {entry} (its rights "
                f"are {stat.filemode(state.st_mode)}) and so put other code there. If you trust what is there: "
                f"`chmod go-w {entry}`; else set the environment variable YASPS_CACHE to a folder of your own."
            )
        place = entry


def _is_trusted(state: os.stat_result) -> bool:
    return state.st_uid in (os.geteuid(), 0)


def _owner(state: os.stat_result) -> str:
    try:
        return f"the user {pwd.getpwuid(state.st_uid).pw_name}"
    except KeyError:
        return f"the user number {state.st_uid}"
