"""The passes in order, from the frontend's scene to one object for each file (architecture, section 4)."""

from __future__ import annotations

import gc
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

from xdsl.context import Context
from xdsl.dialects import arith, func, math
from xdsl.dialects.builtin import Builtin, ModuleOp
from xdsl.ir import Operation
from xdsl.passes import ModulePass, PassPipeline
from xdsl.transforms.canonicalize import CanonicalizePass
from xdsl.transforms.common_subexpression_elimination import CommonSubexpressionElimination
from xdsl.utils.exceptions import DiagnosticException

from yasps.dialects.mat import Mat
from yasps.dialects.rel import EnergyOp, Rel, name_of
from yasps.dialects.rel.declarations import Declaration
from yasps.dialects.rel.laws import BrokenLawError
from yasps.passes.bodies import containers
from yasps.passes.errors import RULE_BROKEN, CompileError, place_of, reason_of
from yasps.passes.ir_text import text_of
from yasps.passes.transforms.differentiate import Differentiate
from yasps.passes.transforms.fold_norms import FoldNorms
from yasps.passes.transforms.infer_indices import InferIndices
from yasps.passes.transforms.inline_references import InlineReferences
from yasps.passes.transforms.lift_constants import LiftConstants
from yasps.passes.transforms.lower_to_scalar import LowerToScalar
from yasps.passes.transforms.outline_modules import OutlineModules
from yasps.passes.transforms.project_psd import ProjectPsd
from yasps.passes.transforms.prove_isotropy import ProveIsotropy

PIPELINE: tuple[ModulePass, ...] = (
    CanonicalizePass(),
    InlineReferences(),
    CommonSubexpressionElimination(),
    LiftConstants(),
    FoldNorms(),
    Differentiate(),
    ProjectPsd(),
    ProveIsotropy(),
    InferIndices(),
    LowerToScalar(),
    OutlineModules(),
)
LIFTING = PIPELINE[: 1 + next(k for k, p in enumerate(PIPELINE) if isinstance(p, LiftConstants))]
"""The passes up to that after which the code that will come out no longer depends on numbers in formulas."""
OPTIONAL = frozenset({ProveIsotropy.name})
"""Passes that change how fast the result is, but not what it is."""


def make_context() -> Context:
    """An xDSL context that knows every dialect yasps uses."""
    context = Context()
    for dialect in (Builtin, func.Func, arith.Arith, math.Math, Rel, Mat):
        context.load_dialect(dialect)
    return context


def run_pipeline(
    module: ModuleOp,
    dump_to: Path | None = None,
    after: Callable[[str, ModuleOp], None] | None = None,
    *,
    locations: bool = False,
    without: Collection[str] = (),
    passes: Sequence[ModulePass] | None = None,
) -> ModuleOp:
    """Runs every pass on the module, in place, and verifies after each.

    dump_to: folder for `00-frontend.mlir`, `01-canonicalize.mlir`, ..., where `locations` says whether each attribute
    tells the line of Python that made it; after: called with each stage's name and module; without: names of OPTIONAL
    passes to leave out; passes: those to run, not all.

    Raises CompileError that names the pass, the attribute and that line, the dump of a stage that does not verify is
    there to read; ValueError for a pass that can't be left out.
    """
    if not OPTIONAL.issuperset(without):
        raise ValueError(f"only {', '.join(sorted(OPTIONAL))} can be left out, not {', '.join(sorted(without))}")
    passes = tuple(p for p in (PIPELINE if passes is None else passes) if p.name not in without)
    stage = 0
    verifier = Verifier()

    def dump(previous: ModulePass | None, current: ModuleOp, following: ModulePass | None) -> None:
        nonlocal stage
        name = "frontend" if previous is None else previous.name
        if dump_to is not None:
            dump_to.mkdir(parents=True, exist_ok=True)
            text = text_of(current, locations=locations)
            (dump_to / f"{stage:02d}-{name}.mlir").write_text(text, encoding="utf-8")
        verifier.verify(current, previous)
        if after is not None:
            after(name, current)
        stage += 1

    thresholds = gc.get_threshold()
    relaxed = (100_000, 50, 50)  # many small long-lived objects: default collections double the time
    gc.set_threshold(*relaxed)
    try:
        run_passes(PassPipeline(passes, dump), make_context(), module)
    finally:
        if thresholds != relaxed:  # else another thread is compiling too and puts the old ones back
            gc.set_threshold(*thresholds)
    return module


def run_passes(pipeline: PassPipeline, context: Context, module: ModuleOp) -> None:
    """Applies the passes in place, with the pipeline's callback between them; what they raise becomes a CompileError.

    It says which pass raised it, about which attribute, and where that was made, as far as these are known.
    """
    running: ModulePass | None = None

    def note_pass(previous: ModulePass | None, current: ModuleOp, following: ModulePass | None) -> None:
        nonlocal running
        if pipeline.callback is not None:
            pipeline.callback(previous, current, following)
        running = following

    try:
        PassPipeline(pipeline.passes, note_pass).apply(context, module)
    except RULE_BROKEN as error:
        if isinstance(error, CompileError) and error.during is not None:
            raise
        raise _explained(error, module, f"pass {running.name}" if running is not None else None) from error


class Verifier:
    """Verifies a module after each pass; of operations on matrices and numbers only one of all that look the same.

    Their laws are about their types and properties alone, and to verify one takes far longer than to see that it has
    been done.
    """

    def __init__(self) -> None:
        self._verified: set[tuple[object, ...]] = set()

    def verify(self, module: ModuleOp, made_by: ModulePass | None) -> None:
        """Raises CompileError where the module breaks a law; made_by: the pass it comes from, None for the input."""
        try:
            self._verify(module)
        except DiagnosticException as error:
            during = None if made_by is None else f"pass {made_by.name} broke a rule, which is a bug of yasps"
            raise _explained(error, module, during) from error

    def _verify(self, op: Operation) -> None:
        """The operation and those inside; first these, as the laws of a container rely on them."""
        if op.regions:
            for inner in (inner for region in op.regions for block in region.blocks for inner in block.ops):
                self._verify(inner)
            op.verify(verify_nested_ops=False)
        elif op.name.startswith(_LAWS_OF_TYPES):
            looks = _looks(op)
            if looks not in self._verified:
                op.verify()
                self._verified.add(looks)
        else:
            op.verify()


_LAWS_OF_TYPES = ("mat.", "arith.", "math.")


def _looks(op: Operation) -> tuple[object, ...]:
    """All that verification of such an operation looks at; an operand that was erased has a class of its own."""
    operands = [(type(operand), operand.type) for operand in op.operands]
    place = (op.parent is None, op.next_op is None)
    return (type(op), place, *operands, *op.result_types, *op.properties.items(), *op.attributes.items())


def _explained(error: Exception, module: ModuleOp, during: str | None) -> CompileError:
    """The error with all that can be found out about where it comes from."""
    if hasattr(error, "__notes__"):
        error.__notes__.clear()  # xDSL writes the whole module there, for every traceback to show
    if isinstance(error, CompileError) and error.symbol is not None:
        return CompileError(error.reason, during=during, symbol=error.symbol, place=error.place)
    reason = reason_of(error)
    op = error.declaration if isinstance(error, BrokenLawError) else _declaration_that_breaks_a_rule(module)
    if op is None:
        return CompileError(reason, during=during)
    place = place_of(_declarations(module).get(op.symbol, op))  # an object's definitions are declared in the scene
    return CompileError(reason, during=during, symbol=op.symbol, place=place)


def _declarations(module: ModuleOp) -> dict[str, Declaration]:
    """By symbol; of several the first, which stands in the scene."""
    ops = [op for container in containers(module) for op in container.body.block.ops]
    return {op.symbol: op for op in reversed(ops) if isinstance(op, Declaration)}


def _declaration_that_breaks_a_rule(module: ModuleOp) -> Declaration | None:
    """The first declaration that does not verify by itself: xDSL's error says what is wrong, but not with whom."""
    for op in (op for container in containers(module) for op in container.body.block.ops):
        try:
            op.verify()
        except DiagnosticException:
            if isinstance(op, EnergyOp):
                return _declarations(module).get(name_of(op.attribute))
            return op if isinstance(op, Declaration) else None
    return None
