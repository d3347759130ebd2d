"""What generated code depends on: the scene's IR without sizes and numbers, and the compiler itself."""

from __future__ import annotations

import functools
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

from xdsl.dialects.builtin import ModuleOp

from yasps.dialects.rel import PrimitiveOp, StorageOp
from yasps.passes.ir_text import unnamed_text_of
from yasps.runtime.build.cache import digest_of

SOURCES = ("dialects", "passes", "backend", "runtime", "frontend")
"""Folders of what has a part in the code that is made of a scene. Which files of the frontend have none is not worth a
list that may be wrong: the passes are run once more for nothing after a change of those."""
ENDINGS = (".py", ".h", ".cuh", ".cpp", ".cu")


def text_of_key(module: ModuleOp) -> str:
    """The IR as text without what kernels get when they run: numbers of instances, and numbers that `lift-constants`
    took out of formulas; nor with names of values, which are for people."""
    sizes = [(op, op.size) for op in module.walk() if isinstance(op, PrimitiveOp)]
    numbers = [(op, op.numbers) for op in module.walk() if isinstance(op, StorageOp)]
    for primitive, _ in sizes:
        primitive.size = None
    for storage, _ in numbers:
        storage.numbers = None
    try:
        return unnamed_text_of(module)
    finally:
        for primitive, size in sizes:
            primitive.size = size
        for storage, known in numbers:
            storage.numbers = known


@functools.cache
def compiler_digest() -> str:
    """Digest of the compiler's source files as they are when it is first asked for, and of xDSL's version."""
    return digest_of_sources(Path(str(files("yasps"))), version("xdsl"))


def digest_of_sources(package: Path, xdsl: str) -> str:
    """Digest of all source files in the folders SOURCES of the package, by their paths, and of xDSL's version."""
    parts = [xdsl]
    for folder in SOURCES:
        for path in sorted((package / folder).rglob("*")):
            if path.suffix in ENDINGS:
                parts += [path.relative_to(package).as_posix(), path.read_text(encoding="utf-8")]
    return digest_of(*parts)
