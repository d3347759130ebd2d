"""`yasps explain`: what the compiler makes of each energy of a scene, without compiling it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from xdsl.dialects.builtin import ModuleOp
from xdsl.ir import SSAValue

from yasps.dialects.mat import shape_of, spell
from yasps.dialects.mat.calculus import ISOTROPIC_WIDTHS, TWO_VECTORS, ProjectPsdOp
from yasps.dialects.rel import (
    ApplyOp,
    AttributeOp,
    DerivativeOp,
    ProjectOp,
    ReadOp,
    YieldDerivativeOp,
    name_of,
)
from yasps.frontend.errors import UnsupportedSceneError
from yasps.frontend.execution.emit import SceneEmitter
from yasps.frontend.execution.scene_source import CompileRequest, watching_compiles
from yasps.passes.analysis.dependence import size_of
from yasps.passes.analysis.derivative_summary import DerivativeSummary
from yasps.passes.analysis.isotropy import are_two_vectors, is_deformation, obstacle
from yasps.passes.errors import CompileError
from yasps.passes.ir_text import text_of
from yasps.passes.pipeline import run_pipeline
from yasps.passes.transforms.outline_modules import OutlineModules
from yasps.passes.transforms.prove_isotropy import ProveIsotropy

BYTES_OF_A_NUMBER = 8


class _Enough(BaseException):
    """The scene is explained: what else the script does is not needed."""


@dataclass
class _Findings:
    """What stages of the pipeline say about each energy, by its symbol."""

    before: dict[str, DerivativeSummary] = field(default_factory=dict)
    """At `prove-isotropy`, with the cut."""
    isotropy: dict[str, str] = field(default_factory=dict)
    after: dict[str, DerivativeSummary] = field(default_factory=dict)
    """At the end, with the operations on numbers."""
    places: dict[str, int] = field(default_factory=dict)
    numbers: dict[str, int] = field(default_factory=dict)

    def take(self, stage: str, module: ModuleOp) -> None:
        """Called after each pass."""
        derivatives = [op for op in module.walk() if isinstance(op, DerivativeOp)]
        if stage == ProveIsotropy.name:
            for op in derivatives:
                self.before[name_of(op.attribute)] = DerivativeSummary.of(op)
                self.isotropy[name_of(op.attribute)] = _isotropy(op)
        elif stage == OutlineModules.name:
            widths = {op.symbol: op.matrix_type.get_shape()[1] for op in module.walk() if isinstance(op, AttributeOp)}
            for op in derivatives:
                energy = name_of(op.attribute)
                self.after[energy] = DerivativeSummary.of(op)
                self.numbers[energy] = _local_numbers(op)
                if op.indices is not None:
                    self.places[energy] = widths[name_of(op.indices)]


def explain(request: CompileRequest) -> str:
    """A paragraph for each energy: the line that made it, inputs, cut, projection, isotropy, blocks, operations, size.

    Raises UnsupportedSceneError for a scene that can't be compiled.
    """
    emitter, findings = SceneEmitter(request.scene_name), _Findings()
    module = emitter.emit(request.energies, request.targets, request.outputs)
    try:
        run_pipeline(module, after=findings.take)
    except CompileError as error:
        raise UnsupportedSceneError(str(error)) from error
    paragraphs = [f"scene {request.scene_name}, {len(request.energies)} energies"]
    for term in request.energies:
        energy, where = emitter.symbol_of(term.attribute), term.attribute.where
        lines = [f"energy {energy}, made at {where.file}:{where.line}"]
        lines += [f"  {word:<11} {text}" for word, text in _about(findings, energy)]
        paragraphs.append("\n".join(lines))
    return "\n\n".join(paragraphs)


def explain_first_scene(run: Callable[[], object]) -> str | None:
    """Explains the first scene with energies that is compiled while `run` runs, which ends there; None if none is."""
    explained: list[str] = []

    def explain_and_stop(request: CompileRequest) -> None:
        if request.energies:
            explained.append(explain(request))
            raise _Enough

    try:
        with watching_compiles(explain_and_stop):
            run()
    except _Enough:
        return explained[0]
    return None


def _about(findings: _Findings, energy: str) -> list[tuple[str, str]]:
    before = findings.before.get(energy)
    if before is None:
        return [("inputs", "none that lead to a target: it has no derivatives")]
    places = findings.places.get(energy, 0)
    operations = ", ".join(f"{name} {count}" for name, count in findings.after[energy].operations.items())
    return [
        ("inputs", ", ".join(before.inputs)),
        ("cut", ", ".join(before.cut) or "none that is a value of its own"),
        ("projection", f"{before.projection}: {before.projects}"),
        ("isotropy", findings.isotropy[energy]),
        ("blocks", f"at most {places * (places + 1) // 2}, between {places} places of unknowns, for an instance"),
        ("operations", f"{operations}, on numbers"),
        ("local", f"{findings.numbers[energy] * BYTES_OF_A_NUMBER} bytes for an instance"),
    ]


def _isotropy(derivative: DerivativeOp) -> str:
    block = derivative.body.block
    terminator = block.last_op
    assert isinstance(terminator, YieldDerivativeOp)
    projection = next((op for op in block.ops if isinstance(op, ProjectPsdOp)), None)
    if projection is None:
        return "not looked for: nothing is projected at a cut"
    if len(projection.operands) > 1:
        if shape_of(projection.operands[1]) == TWO_VECTORS:
            return "proven in two vectors"
        return f"proven in a {_spelled(projection.operands[1])} matrix"
    cut = list(terminator.cut)
    width = shape_of(projection.result)[0]
    is_matrix = width in ISOTROPIC_WIDTHS and len(cut) == 1 and is_deformation(block, cut[0])
    if not is_matrix and not are_two_vectors(cut):
        return "not looked for: the cut is no matrix of 3x3 or 3x2 and not two vectors"
    stop = obstacle(block, terminator.energy, cut, terminator.wrt)
    return f"not proven: stopped by {text_of(stop).strip()}" if stop is not None else "not proven"


def _local_numbers(derivative: DerivativeOp) -> int:
    """Numbers that a kernel holds for one instance: what it reads, and results of its scalar functions."""
    kept = (ReadOp, ApplyOp, ProjectOp)
    return sum(size_of(result) for op in derivative.body.block.ops if isinstance(op, kept) for result in op.results)


def _spelled(value: SSAValue) -> str:
    rows, cols = shape_of(value)
    return spell((rows, cols)) if cols > 1 else spell((3, rows // 3))
