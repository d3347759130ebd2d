"""`lower-to-scalar`: bodies become calls of straight-line scalar functions in `func`, `arith` and `math`.

Zeros, identities and symmetry are exploited while the hash-consed scalar graph is built; of symmetric matrices only the
upper triangle is asked for, so nothing else is computed. A body is cut in two at its projection, which is the
runtime's. What is computed from constants of the mesh or the scene alone is the same for all instances: it becomes a
function of its own, called `uniform`.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import cast

from xdsl.context import Context
from xdsl.dialects import arith, func, math
from xdsl.dialects.builtin import Float64Type, FloatAttr, IntegerAttr, IntegerType, ModuleOp, f64
from xdsl.ir import Attribute, Block, Operation, Region, SSAValue
from xdsl.passes import ModulePass

from yasps.dialects.mat import MatOp, Matrix, matrix_type, shape_of
from yasps.dialects.mat.builder import named
from yasps.dialects.mat.calculus import TWO_VECTORS, ProjectPsdOp
from yasps.dialects.rel import (
    ApplyOp,
    AttributeOp,
    Container,
    CurvatureOp,
    DataOp,
    DerivativeOp,
    JacobianOp,
    ProjectOp,
    ReadOp,
    StorageOp,
    YieldCurvatureOp,
    YieldDerivativeOp,
    YieldJacobianOp,
    YieldOp,
    YieldPullbackOp,
    name_of,
    packed_size,
)
from yasps.dialects.scalar.functions import FUNCTIONS
from yasps.dialects.scalar.graph import Node, ScalarGraph
from yasps.dialects.scalar.tidying import tidied
from yasps.passes.analysis.dependence import size_of
from yasps.passes.bodies import BodyBuilder, containers
from yasps.passes.calculus.finite_check import finite_check
from yasps.passes.errors import working_on

BINARY: dict[str, type[Operation]] = {
    "add": arith.AddfOp,
    "sub": arith.SubfOp,
    "mul": arith.MulfOp,
    "div": arith.DivfOp,
    "min": arith.MinimumfOp,
    "max": arith.MaximumfOp,
    "atan2": math.Atan2Op,
}
COMPARISONS = {"lt": "olt", "le": "ole", "ne": "one"}
"""Ordered predicates of `arith.cmpf`: false on NaN."""
UNARY: dict[str, type[Operation]] = {
    "neg": arith.NegfOp,
    **{function.name: function.operation for function in FUNCTIONS},
    "abs": math.AbsFOp,
}
_NO_FLAGS = arith.FastMathFlagsAttr("none")


@dataclass(frozen=True)
class LowerToScalar(ModulePass):
    """See the module."""

    name = "lower-to-scalar"

    def apply(self, ctx: Context, op: ModuleOp) -> None:
        for container in containers(op):
            for inner in list(container.body.block.ops):
                if isinstance(inner, AttributeOp):
                    with working_on(inner.symbol, inner):
                        if inner.body.blocks:
                            _lower_attribute(container, inner)
                elif isinstance(inner, DerivativeOp | JacobianOp | CurvatureOp):
                    with working_on(name_of_function(inner), inner):
                        if isinstance(inner, DerivativeOp):
                            _lower_derivative(container, inner)
                        elif isinstance(inner, JacobianOp):
                            _lower_jacobian(container, inner)
                        else:
                            _lower_curvature(container, inner)


class _Stage:
    """One scalar function under construction, on values read in a body."""

    def __init__(self) -> None:
        self.graph = ScalarGraph()
        self.inputs: list[SSAValue] = []
        self._entries: dict[SSAValue, list[Node]] = {}
        self._count = 0

    def add_input(self, value: SSAValue, symmetric_width: int | None = None, *, uniform: bool = False) -> None:
        """Makes all entries of the value inputs of the function; of a packed symmetric one, the whole matrix.

        uniform: they are the same for all instances.
        """
        size = size_of(value) if symmetric_width is None else packed_size(symmetric_width)
        nodes = [self.graph.input(self._count + k, uniform=uniform) for k in range(size)]
        self._count += size
        self.inputs.append(value)
        self._entries[value] = nodes if symmetric_width is None else _unpacked(nodes, symmetric_width)

    def entries(self, value: SSAValue) -> list[Node]:
        """Scalar nodes of all entries of a value, row-major; lowers what it needs, operands first."""
        stack = [value]
        while stack:
            current = stack[-1]
            if current in self._entries:
                stack.pop()
                continue
            op = cast(MatOp, current.owner)
            missing = [operand for operand in op.operands if operand not in self._entries]
            if missing:
                stack.extend(missing)
                continue
            self._entries[current] = op.lower(self.graph, *[self._entries[operand] for operand in op.operands])
            stack.pop()
        return self._entries[value]

    def upper(self, value: SSAValue) -> list[Node]:
        """The packed upper triangle of a symmetric value."""
        size = shape_of(value)[0]
        entries = self.entries(value)
        return [entries[i * size + j] for i in range(size) for j in range(i, size)]

    def used(
        self,
        graph: ScalarGraph,
        outputs: Sequence[Node],
        values: dict[SSAValue, SSAValue],
        given: Collection[Node] = (),
    ) -> tuple[list[SSAValue], list[Node]]:
        """What the outputs need besides the `given` nodes: inputs by their values now, and nodes of all entries."""
        needed = {n for n in graph.reachable(outputs, given) if graph.kinds[n] == "input" and n not in given}
        operands, nodes, position = [], [], 0
        for value in self.inputs:
            entries = [graph.input(position + k) for k in range(size_of(values[value]))]
            position += len(entries)
            if not needed.isdisjoint(entries):
                operands.append(values[value])
                nodes += entries
        return operands, nodes


def _unpacked(upper: Sequence[Node], width: int) -> list[Node]:
    start = [i * width - i * (i - 1) // 2 - i for i in range(width)]  # of row i, less i
    return [upper[start[min(i, j)] + max(i, j)] for i in range(width) for j in range(width)]


def _function(
    name: str, graph: ScalarGraph, arguments: Sequence[Node], outputs: Sequence[Node], element: Attribute
) -> func.FuncOp:
    """Writes the nodes the outputs need as a `func.func` of these nodes, from `element` to `element`."""
    inputs = [element] * len(arguments)
    block = Block(arg_types=inputs)
    values: dict[Node, SSAValue] = dict(zip(arguments, block.args, strict=True))
    for node in graph.reachable(outputs, values):
        if node in values:
            continue
        kind, operands = graph.kinds[node], [values[a] for a in graph.arguments[node]]
        if kind == "constant":
            op = _constant(graph.values[node], element)
        elif kind == "power":
            exponent = _constant(graph.values[node], f64)
            block.add_op(exponent)
            op = math.PowFOp(operands[0], exponent.results[0])
        elif kind in COMPARISONS:
            op = arith.CmpfOp(operands[0], operands[1], COMPARISONS[kind])
        elif kind == "select":
            op = arith.SelectOp(*operands)
        else:
            # Not by the constructor, which looks at each operand anew: that takes most of the time.
            op = (BINARY.get(kind) or UNARY[kind]).create(
                operands=operands, result_types=[element], properties={"fastmath": _NO_FLAGS}
            )
        block.add_op(op)
        values[node] = op.results[0]
    block.add_op(func.ReturnOp(*[values[node] for node in outputs]))
    return func.FuncOp(name, (inputs, [element] * len(outputs)), Region(block))


def _constant(value: float, element: Attribute) -> Operation:
    if isinstance(element, IntegerType):
        return arith.ConstantOp(IntegerAttr(int(value), element))
    return arith.ConstantOp(FloatAttr(value, cast(Float64Type, element)))


def _call(
    container: Container,
    b: BodyBuilder,
    name: str,
    *,
    stage: _Stage,
    values: dict[SSAValue, SSAValue],
    outputs: Sequence[Sequence[Node]],
    element: Float64Type | IntegerType = f64,
    shapes: Sequence[tuple[int, int]] | None = None,
) -> Sequence[SSAValue]:
    """Adds the stage's function to the container and a call of it to the body, with the inputs it uses.

    Before it the function and call of what is uniform among what it needs, if there is any.
    """
    graph, flat = tidied(stage.graph, [node for part in outputs for node in part])
    shared = graph.uniform_values(flat)
    operands, arguments = stage.used(graph, flat, values, shared)
    if shared:
        given, nodes = stage.used(graph, shared, values)
        container.body.block.add_op(_function(f"{name}_uniforms", graph, nodes, shared, element))
        once = ApplyOp(f"{name}_uniforms", given, [matrix_type((len(shared), 1), element)], uniform=True)
        once.results[0].name_hint = "uniforms"
        b.append(once)
        operands.append(once.results[0])
        arguments += shared
    container.body.block.add_op(_function(name, graph, arguments, flat, element))
    result_shapes = shapes or [(len(part), 1) for part in outputs]
    call = ApplyOp(name, operands, [matrix_type(shape, element) for shape in result_shapes])
    b.append(call)
    return call.results


Definition = AttributeOp | DerivativeOp | JacobianOp | CurvatureOp


def _reads(
    container: Container, definition: Definition, b: BodyBuilder, stages: Sequence[_Stage]
) -> dict[SSAValue, SSAValue]:
    """Copies the boundary reads into the new body and makes them inputs of the stages."""
    values: dict[SSAValue, SSAValue] = {}
    shared = _shared_constants(container, definition)
    for op in definition.body.block.ops:
        if isinstance(op, ReadOp):
            values[op.result] = b.read(op)
            for stage in stages:
                stage.add_input(op.result, uniform=isinstance(op, DataOp) and name_of(op.storage) in shared)
    return values


def _shared_constants(container: Container, definition: Definition) -> set[str]:
    """Constants that are the same for all instances: those of the mesh and the scene of the definition's owner."""
    storages = [op for op in container.body.block.ops if isinstance(op, StorageOp)]
    return {op.symbol for op in storages if op.constant is not None and op.owner != definition.owner}


def _replace_body(op: Definition, block: Block) -> None:
    op.detach_region(op.regions[0])
    op.add_region(Region(block))


def _lower_attribute(container: Container, attribute: AttributeOp) -> None:
    block = attribute.body.block
    terminator = block.last_op
    assert isinstance(terminator, YieldOp)
    if isinstance(terminator.value.owner, ReadOp):
        return  # a JOIN, UNION or plain data: nothing to compute
    b, stage = BodyBuilder(Block()), _Stage()
    values = _reads(container, attribute, b, [stage])
    type_ = cast(Matrix, terminator.value.type)
    outputs = [stage.entries(terminator.value)]
    shape = shape_of(terminator.value)
    name, element = f"{attribute.symbol}.value", type_.element_type
    (value,) = _call(container, b, name, stage=stage, values=values, outputs=outputs, element=element, shapes=[shape])
    b.append(YieldOp(value))
    _replace_body(attribute, b.body)


def _lower_derivative(container: Container, derivative: DerivativeOp) -> None:
    block = derivative.body.block
    terminator = block.last_op
    assert isinstance(terminator, YieldDerivativeOp)
    projection = next((op for op in block.ops if isinstance(op, ProjectPsdOp)), None)
    name = name_of_function(derivative)
    b, derive, pull = BodyBuilder(Block()), _Stage(), _Stage()
    values = _reads(container, derivative, b, [derive, pull])
    outputs = [derive.entries(terminator.gradient)]
    symmetric = terminator.hessian if projection is None else projection.operands[0]
    if symmetric is not None:
        outputs.append(derive.upper(symmetric))
    if projection is not None and len(projection.operands) == 2:
        outputs.append(derive.entries(projection.operands[1]))
    (energy,) = derive.entries(terminator.energy)
    outputs.insert(0, [finite_check(derive.graph, energy, [node for part in outputs for node in part])])
    results = _call(container, b, f"{name}.derive", stage=derive, values=values, outputs=outputs)
    for result, what in zip(results, ("energy", "gradient", "hessian", "deformation"), strict=False):
        result.name_hint = what
    hessian = results[2] if symmetric is not None else None
    if projection is not None:
        assert hessian is not None
        assert terminator.hessian is not None
        width = shape_of(projection.result)[0]
        deformation = results[3] if len(results) == 4 else None
        vectors = deformation is not None and shape_of(projection.operands[1]) == TWO_VECTORS
        project = ProjectOp(hessian, width, projection.mode.data, deformation, vectors=vectors)
        b.append(project)
        hessian = named(project.result, "projected")
        if terminator.hessian is not projection.result:
            pull.add_input(projection.result, width)
            values[projection.result] = hessian
            outputs = [pull.upper(terminator.hessian)]
            (hessian,) = _call(container, b, f"{name}.pull_back", stage=pull, values=values, outputs=outputs)
    b.append(YieldDerivativeOp(results[0], results[1], hessian, [values[v] for v in terminator.wrt]))
    _replace_body(derivative, b.body)


def name_of_function(op: DerivativeOp | JacobianOp | CurvatureOp) -> str:
    return op.attribute.root_reference.data


def _lower_jacobian(container: Container, jacobian: JacobianOp) -> None:
    block = jacobian.body.block
    terminator = block.last_op
    assert isinstance(terminator, YieldJacobianOp)
    rows, cols = shape_of(terminator.jacobian)
    b, stage = BodyBuilder(Block(arg_types=[matrix_type((rows, 1))])), _Stage()
    values = _reads(container, jacobian, b, [stage])
    cotangent = named(b.body.args[0], "cotangent")
    stage.add_input(cotangent)
    values[cotangent] = cotangent
    entries, v = stage.entries(terminator.jacobian), stage.entries(cotangent)
    outputs = [stage.graph.dot(entries[j::cols], v) for j in range(cols)]
    name = f"{name_of_function(jacobian)}.pull_back"
    (result,) = _call(container, b, name, stage=stage, values=values, outputs=[outputs])
    b.append(YieldPullbackOp(result, [values[value] for value in terminator.wrt]))
    _replace_body(jacobian, b.body)


def _lower_curvature(container: Container, curvature: CurvatureOp) -> None:
    block = curvature.body.block
    terminator = block.last_op
    assert isinstance(terminator, YieldCurvatureOp)
    b, stage = BodyBuilder(Block(arg_types=[block.args[0].type])), _Stage()
    values = _reads(container, curvature, b, [stage])
    stage.add_input(block.args[0])
    values[block.args[0]] = named(b.body.args[0], "cotangent")
    outputs = [stage.upper(terminator.hessian)]
    name = f"{name_of_function(curvature)}.second"
    (result,) = _call(container, b, name, stage=stage, values=values, outputs=outputs)
    b.append(YieldCurvatureOp(result, [values[value] for value in terminator.wrt]))
    _replace_body(curvature, b.body)
