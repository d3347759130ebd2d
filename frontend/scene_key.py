"""What generated code depends on: the scene's IR without its sizes, and the compiler itself."""

from __future__ import annotations

import functools
import hashlib
from importlib.metadata import version
from importlib.resources import files

from xdsl.dialects.builtin import ModuleOp

from yasps.dialects.rel import PrimitiveOp
from yasps.passes.ir_text import text_of

SOURCES = ("dialects", "dialects/mat", "dialects/rel", "passes", "backend")
"""Folders of what makes code from the frontend's IR."""


def text_without_sizes(module: ModuleOp) -> str:
    """The IR as text, without numbers of instances: kernels get these when they run."""
    sizes = [(op, op.size) for op in module.walk() if isinstance(op, PrimitiveOp)]
    for op, _ in sizes:
        op.size = None
    try:
        return text_of(module)
    finally:
        for op, size in sizes:
            op.size = size


@functools.cache
def compiler_digest() -> str:
    """Digest of the passes and emitters as their files are when it is first asked for, and of xDSL's version."""
    digest = hashlib.sha256(version("xdsl").encode())
    for folder in SOURCES:
        for path in sorted(files("yasps").joinpath(folder).iterdir(), key=lambda path: path.name):
            if path.name.endswith((".py", ".h")):
                digest.update(path.name.encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()
