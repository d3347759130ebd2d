"""The passes in order, from the frontend's scene to one object for each file (architecture, section 4)."""

from __future__ import annotations

import gc
from collections.abc import Callable
from pathlib import Path

from xdsl.context import Context
from xdsl.dialects import arith, func, math
from xdsl.dialects.builtin import Builtin, ModuleOp
from xdsl.passes import ModulePass, PassPipeline
from xdsl.transforms.canonicalize import CanonicalizePass
from xdsl.transforms.common_subexpression_elimination import CommonSubexpressionElimination

from yasps.dialects.mat import Mat
from yasps.dialects.rel import Rel
from yasps.passes.differentiate import Differentiate
from yasps.passes.infer_indices import InferIndices
from yasps.passes.inline_references import InlineReferences
from yasps.passes.lower_to_scalar import LowerToScalar
from yasps.passes.outline_modules import OutlineModules
from yasps.passes.project_psd import ProjectPsd

PIPELINE: tuple[ModulePass, ...] = (
    CanonicalizePass(),
    InlineReferences(),
    CommonSubexpressionElimination(),
    Differentiate(),
    ProjectPsd(),
    InferIndices(),
    LowerToScalar(),
    OutlineModules(),
)


def make_context() -> Context:
    """An xDSL context that knows every dialect yasps uses."""
    context = Context()
    for dialect in (Builtin, func.Func, arith.Arith, math.Math, Rel, Mat):
        context.load_dialect(dialect)
    return context


def run_pipeline(
    module: ModuleOp, dump_to: Path | None = None, after: Callable[[str, ModuleOp], None] | None = None
) -> ModuleOp:
    """Runs every pass on the module, in place, and verifies after each.

    `dump_to`: folder for `00-frontend.mlir`, `01-canonicalize.mlir`, ...; `after` is called with each
    stage's name and module.
    """
    stage = 0

    def finished(previous: ModulePass | None, current: ModuleOp, following: ModulePass | None) -> None:
        nonlocal stage
        current.verify()
        name = "frontend" if previous is None else previous.name
        if dump_to is not None:
            dump_to.mkdir(parents=True, exist_ok=True)
            (dump_to / f"{stage:02d}-{name}.mlir").write_text(str(current) + "\n", encoding="utf-8")
        if after is not None:
            after(name, current)
        stage += 1

    thresholds = gc.get_threshold()
    relaxed = (100_000, 50, 50)  # many small long-lived objects: default collections double the time
    gc.set_threshold(*relaxed)
    try:
        PassPipeline(PIPELINE, finished).apply(make_context(), module)
    finally:
        if thresholds != relaxed:  # else another thread is compiling too and puts the old ones back
            gc.set_threshold(*thresholds)
    return module
