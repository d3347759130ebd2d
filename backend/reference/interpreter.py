"""The meaning of the IR in NumPy, at every level, for all instances at once: the reference everything is tested by.

Derivatives of the whole scene are put together here by another way than the compiler's: the derivative of every
attribute with respect to all unknowns is one sparse matrix, and Hessians are contracted with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from xdsl.dialects import arith, func, math
from xdsl.dialects.builtin import FloatAttr, IntegerAttr, ModuleOp
from xdsl.ir import Block, Operation, SSAValue

from yasps.backend.codegen.scene_view import SceneView
from yasps.backend.reference.scene_data import SceneData
from yasps.dialects.mat import MatOp, shape_of
from yasps.dialects.mat.base import Batch
from yasps.dialects.mat.comparison import absolute, is_less, is_less_equal, maximum, minimum
from yasps.dialects.mat.trigonometry import arctan2
from yasps.dialects.rel import (
    ApplyOp,
    AttributeOp,
    Container,
    CurvatureOp,
    DataOp,
    DerivativeOp,
    JacobianOp,
    JoinOp,
    ProjectOp,
    ReadOp,
    RefOp,
    TargetIndexOp,
    UnionOp,
    YieldCurvatureOp,
    YieldDerivativeOp,
    YieldJacobianOp,
    YieldOp,
    YieldPullbackOp,
    name_of,
)
from yasps.dialects.scalar.functions import FUNCTIONS

SCALAR_OPERATIONS: dict[type[Operation], Callable[..., Any]] = {
    arith.AddfOp: np.add,
    arith.SubfOp: np.subtract,
    arith.MulfOp: np.multiply,
    arith.DivfOp: np.divide,
    arith.NegfOp: np.negative,
    **{function.operation: function.evaluate for function in FUNCTIONS},
    math.PowFOp: np.power,
    math.Atan2Op: arctan2,
    math.AbsFOp: absolute,
    arith.MinimumfOp: minimum,
    arith.MaximumfOp: maximum,
    arith.SelectOp: np.where,
}
COMPARISONS: dict[str, Callable[..., Any]] = {
    "olt": is_less,
    "ole": is_less_equal,
    "one": lambda a, b: is_less(a, b) | is_less(b, a),
}
"""Meaning of `arith.cmpf` by its predicate."""


class Interpreter:
    """Evaluates one module on one set of numbers. Results are cached: make a new one for new numbers."""

    def __init__(self, module: ModuleOp, data: SceneData) -> None:
        self.scene = SceneView(module)
        self.data = data
        self.functions = {
            op.sym_name.data: op
            for container in module.body.block.ops
            if isinstance(container, Container)
            for op in container.body.block.ops
            if isinstance(op, func.FuncOp)
        }
        self.starts: dict[str, int] = {}
        unknowns = 0
        for target in self.scene.targets:
            self.starts[target] = unknowns
            unknowns += len(data.storages[target]) * self.scene.size(target)
        self.unknowns = unknowns
        self._values: dict[str, Batch] = {}

    # -- values --------------------------------------------------------------------------------------------

    def value(self, name: str) -> Batch:
        """A storage or attribute on all instances, [instances, rows, columns]."""
        if name in self.data.storages:
            return self.data.storages[name]
        if name not in self._values and name in self.scene.storages:
            numbers = self.scene.storages[name].known_numbers()
            if numbers is None:
                raise KeyError(f"the numbers have no storage @{name}")
            self._values[name] = numbers
        if name not in self._values:
            attribute = self.scene.attributes[name]
            values = self.run(attribute, {})
            terminator = attribute.body.block.last_op
            assert isinstance(terminator, YieldOp)
            result = values[terminator.value]
            self._values[name] = np.broadcast_to(result, (self.count(attribute), *result.shape[1:]))
        return self._values[name]

    def total_energy(self) -> Any:
        """Sum of all energies over all instances."""
        return sum(self.value(name_of(energy.attribute)).sum() for energy in self.scene.energies)

    def count(self, op: AttributeOp | DerivativeOp | JacobianOp | CurvatureOp) -> int:
        """Instances of the owner."""
        return self.data.sizes.get(name_of(op.owner), 1)

    def run(
        self, op: AttributeOp | DerivativeOp | JacobianOp | CurvatureOp, values: dict[SSAValue, Batch]
    ) -> dict[SSAValue, Batch]:
        """Values of everything in a body; arrays of one instance stand for all."""
        with np.errstate(all="ignore"):
            for inner in op.body.block.ops:
                if isinstance(inner, ReadOp):
                    values[inner.result] = self.read(inner, name_of(op.owner), self.count(op))
                elif isinstance(inner, MatOp):
                    values[inner.result] = inner.evaluate(*[values[v] for v in inner.operands])
                elif isinstance(inner, ApplyOp):
                    self.apply(inner, values)
                elif isinstance(inner, ProjectOp):
                    values[inner.result] = _project_packed(values[inner.packed], inner)
        return values

    def read(self, op: ReadOp, owner: str, count: int) -> Batch:
        """A boundary read on all instances of the owner."""
        if isinstance(op, DataOp):
            return self.value(name_of(op.storage))
        if isinstance(op, RefOp):
            return self.value(name_of(op.attribute))
        if isinstance(op, JoinOp):
            source = self.value(name_of(op.source))
            indices = self.data.connectivities[name_of(op.connectivity)]
            if np.any(indices < 0):
                gathered = np.where((indices >= 0)[:, :, None, None], source[indices], 0)
            else:
                gathered = source[indices]
            if op.reduction is None:
                return gathered.reshape(len(indices), *shape_of(op.result))
            return cast(Batch, gathered.sum(axis=1) * self.share(op)[:, None, None])
        if isinstance(op, UnionOp):
            rows, cols = shape_of(op.result)
            parts = [self.value(name_of(member)) for member in op.members]
            padded = [np.pad(part, ((0, 0), (0, 0), (0, cols - part.shape[2]))) for part in parts]
            return np.concatenate(padded).reshape(-1, rows, cols)
        assert isinstance(op, TargetIndexOp)
        target = name_of(op.target)
        storage = self.scene.storages[target]
        instances = np.arange(count if name_of(storage.owner) == owner else 1)
        return cast(Batch, (self.starts[target] + self.scene.size(target) * instances + 1)[:, None, None])

    def share(self, op: JoinOp) -> NDArray[Any]:
        """Weight [instances] of every term of a JOIN of variable arity."""
        counts = (self.data.connectivities[name_of(op.connectivity)] >= 0).sum(axis=1)
        return 1.0 / counts if op.reduction == "mean" else np.ones(len(counts))

    def apply(self, op: ApplyOp, values: dict[SSAValue, Batch]) -> None:
        """Calls a scalar function on all instances."""
        function = self.functions[name_of(op.function)]
        flat = [values[v][:, i, j] for v in op.inputs for i in range(shape_of(v)[0]) for j in range(shape_of(v)[1])]
        results = run_function(function, flat)
        start = 0
        for value in op.values:
            rows, cols = shape_of(value)
            entries = np.broadcast_arrays(*results[start : start + rows * cols])
            values[value] = np.stack(entries, axis=-1).reshape(len(entries[0]), rows, cols)
            start += rows * cols

    # -- derivatives ---------------------------------------------------------------------------------------

    def local_derivative(self, derivative: DerivativeOp) -> tuple[Batch, Batch | None]:
        """Gradients [instances, n] and Hessians [instances, n, n] with respect to the boundary inputs."""
        values = self.run(derivative, {})
        terminator = derivative.body.block.last_op
        assert isinstance(terminator, YieldDerivativeOp)
        count = self.count(derivative)
        gradient = values[terminator.gradient]
        n = gradient.shape[1]
        gradient = np.broadcast_to(gradient, (count, n, 1))[:, :, 0]
        if terminator.hessian is None:
            return gradient, None
        hessian = values[terminator.hessian]
        if hessian.shape[2] == 1 and n > 1:
            hessian = _unpack(hessian[:, :, 0], n)
        upper = np.triu(hessian)
        return gradient, np.broadcast_to(upper + np.triu(upper, 1).swapaxes(1, 2), (count, n, n))

    def assemble(self) -> tuple[NDArray[Any], sparse.csr_array]:
        """Gradient [unknowns] and Hessian of all energies with respect to all targets, without the index functions."""
        gradient: NDArray[Any] = np.zeros(self.unknowns)
        hessian = sparse.csr_array((self.unknowns, self.unknowns))
        for derivative in self.scene.derivatives:
            local_gradient, local_hessian = self.local_derivative(derivative)
            inputs = self.stacked_inputs(derivative, len(local_gradient))
            gradient = gradient + inputs.T @ local_gradient.ravel()
            if derivative.curved is not None:
                hessian = hessian + self.curved_hessian(derivative, local_gradient, local_hessian, inputs)
            elif local_hessian is not None:
                hessian = hessian + inputs.T @ _block_diagonal(local_hessian) @ inputs
        return gradient, sparse.csr_array(hessian)

    def gradient(self) -> NDArray[Any]:
        """Gradient [unknowns] of all energies with respect to all targets."""
        gradient: NDArray[Any] = np.zeros(self.unknowns)
        for derivative in self.scene.derivatives:
            local_gradient, _ = self.local_derivative(derivative)
            gradient = gradient + self.stacked_inputs(derivative, len(local_gradient)).T @ local_gradient.ravel()
        return gradient

    def curved_hessian(
        self, derivative: DerivativeOp, gradient: Batch, hessian: Batch | None, inputs: sparse.csr_array
    ) -> sparse.csr_array:
        """Hessian of an energy with nonlinear inputs, projected instance by instance unless that is switched off."""
        total = sparse.csr_array((self.unknowns, self.unknowns), dtype=gradient.dtype)
        count, n = gradient.shape
        mode = derivative.projection.data
        groups = [np.arange(count)] if mode == "none" else [np.array([k]) for k in range(count)]
        for instances in groups:
            rows = inputs[(instances[:, None] * n + np.arange(n)).ravel()]
            part = self.curvature_of_inputs(
                derivative, np.where(np.isin(np.arange(count), instances)[:, None], gradient, 0)
            )
            if hessian is not None:
                part = part + rows.T @ _block_diagonal(hessian[instances]) @ rows
            total = total + (part if mode == "none" else _projected(sparse.csr_array(part), mode))
        return sparse.csr_array(total)

    def curvature_of_inputs(self, op: DerivativeOp | JacobianOp, cotangents: Batch) -> sparse.csr_array:
        """Second term of eq. 3: curvature behind all boundary inputs, for cotangents [instances, n] of them."""
        total = sparse.csr_array((self.unknowns, self.unknowns), dtype=cotangents.dtype)
        start = 0
        for read in self.scene.wrt(op):
            rows, cols = shape_of(read.result)
            part = cotangents[:, start : start + rows * cols]
            start += rows * cols
            if isinstance(read, JoinOp):
                source = name_of(read.source)
                indices = self.data.connectivities[name_of(read.connectivity)]
                at_source = np.zeros((len(self.value(source)), self.scene.size(source)), cotangents.dtype)
                if read.reduction is not None:
                    instance, slot = np.nonzero(indices >= 0)
                    np.add.at(at_source, indices[instance, slot], (part * self.share(read)[:, None])[instance])
                else:
                    np.add.at(at_source, indices.ravel(), part.reshape(-1, self.scene.size(source)))
                total = total + self.source_curvature(source, at_source)
            elif isinstance(read, RefOp):
                total = total + self.source_curvature(name_of(read.attribute), part)
        return sparse.csr_array(total)

    def source_curvature(self, name: str, cotangents: Batch) -> sparse.csr_array:
        """Hessian of <cotangents, source> with respect to all unknowns; cotangents [instances, entries]."""
        total = sparse.csr_array((self.unknowns, self.unknowns), dtype=cotangents.dtype)
        if self.scene.is_union(name):
            start = 0
            for member in self.scene.union_members(name):
                count = len(self.value(member))
                total = total + self.source_curvature(member, cotangents[start : start + count])
                start += count
        elif name in self.scene.jacobians:
            op = self.scene.jacobians[name]
            if name in self.scene.curvatures:
                inputs = self.stacked_inputs(op, self.count(op))
                total = total + inputs.T @ _block_diagonal(self.curvature(name, cotangents)) @ inputs
            behind = (cotangents[:, None, :] @ self.jacobian(op))[:, 0, :]
            total = total + self.curvature_of_inputs(op, behind)
        return sparse.csr_array(total)

    def curvature(self, name: str, cotangents: Batch) -> Batch:
        """Hessians [instances, q, q] of <v, h> for a nonlinear attribute h and cotangents v [instances, p]."""
        op = self.scene.curvatures[name]
        terminator = op.body.block.last_op
        assert isinstance(terminator, YieldCurvatureOp)
        hessian = self.run(op, {op.body.block.args[0]: cotangents[:, :, None]})[terminator.hessian]
        width = sum(rows * cols for rows, cols in (shape_of(v) for v in terminator.wrt))
        full = _unpack(hessian[:, :, 0], width) if hessian.shape[1:] != (width, width) else hessian
        upper = np.triu(full)
        symmetric = upper + np.triu(upper, 1).swapaxes(1, 2)
        return np.broadcast_to(symmetric, (len(cotangents), width, width))

    def stacked_inputs(self, op: DerivativeOp | JacobianOp, count: int) -> sparse.csr_array:
        """Derivative of all boundary inputs of all instances with respect to all unknowns."""
        parts = [self.read_derivative(read, name_of(op.owner), count) for read in self.scene.wrt(op)]
        widths = [part.shape[0] // max(count, 1) for part in parts]
        stacked = sparse.vstack(parts, format="csr")
        # from [input, instance, entry] to [instance, input, entry]
        offsets = np.cumsum([0, *[width * count for width in widths]])
        order = [
            offset + instance * width + np.arange(width)
            for instance in range(count)
            for offset, width in zip(offsets, widths, strict=False)
        ]
        return sparse.csr_array(stacked[np.concatenate(order)] if order else stacked)

    def read_derivative(self, read: ReadOp, owner: str, count: int) -> sparse.csr_array:
        """Derivative of a boundary read on all instances, [instances * entries, unknowns]."""
        if isinstance(read, JoinOp):
            source = name_of(read.source)
            indices = self.data.connectivities[name_of(read.connectivity)]
            if read.reduction is not None:
                instance, slot = np.nonzero(indices >= 0)
                terms = _take(self.source_derivative(source), indices[instance, slot], self.scene.size(source))
                size = self.scene.size(source)
                rows = (instance[:, None] * size + np.arange(size)).ravel()
                weights = np.repeat(self.share(read)[instance], size)
                shape = (len(indices) * size, terms.shape[0])
                total = sparse.csr_array((weights, (rows, np.arange(len(rows)))), shape=shape)
                return sparse.csr_array(total @ terms)
            return _take(self.source_derivative(source), indices.ravel(), self.scene.size(source))
        if isinstance(read, RefOp):
            return self.source_derivative(name_of(read.attribute))
        assert isinstance(read, DataOp)
        name = name_of(read.storage)
        whole = self.source_derivative(name)
        own = name_of(self.scene.storages[name].owner) == owner
        return whole if own else _take(whole, np.zeros(count, np.int64), self.scene.size(name))

    def source_derivative(self, name: str) -> sparse.csr_array:
        """Derivative of a storage or attribute on all its instances with respect to all unknowns."""
        size = self.scene.size(name)
        if name in self.starts:
            rows = len(self.data.storages[name]) * size
            columns = self.starts[name] + np.arange(rows)
            return sparse.csr_array((np.ones(rows), (np.arange(rows), columns)), shape=(rows, self.unknowns))
        if self.scene.is_union(name):
            parts = [self.source_derivative(member) for member in self.scene.union_members(name)]
            return sparse.csr_array(sparse.vstack(parts, format="csr"))
        if name in self.scene.jacobians:
            op = self.scene.jacobians[name]
            return sparse.csr_array(_block_diagonal(self.jacobian(op)) @ self.stacked_inputs(op, self.count(op)))
        return sparse.csr_array((len(self.value(name)) * size, self.unknowns))

    def jacobian(self, op: JacobianOp) -> Batch:
        """Jacobians [instances, p, q]; from J^T v for unit vectors v after `lower-to-scalar`."""
        terminator = op.body.block.last_op
        assert isinstance(terminator, YieldJacobianOp | YieldPullbackOp)
        count = self.count(op)
        if isinstance(terminator, YieldJacobianOp):
            result = self.run(op, {})[terminator.jacobian]
            return np.broadcast_to(result, (count, *result.shape[1:]))
        given = op.body.block.args[0]
        p, _ = shape_of(given)
        rows = [self.run(op, {given: np.eye(p)[None, :, k : k + 1]})[terminator.cotangent][:, :, 0] for k in range(p)]
        return np.stack([np.broadcast_to(row, (count, row.shape[1])) for row in rows], axis=1)


def run_function(function: func.FuncOp, inputs: Sequence[NDArray[Any]]) -> list[NDArray[Any]]:
    """Evaluates a scalar function on arrays."""
    block: Block = function.body.block
    values: dict[SSAValue, Any] = dict(zip(block.args, inputs, strict=True))
    for op in block.ops:
        if isinstance(op, func.ReturnOp):
            return [np.atleast_1d(values[v]) for v in op.arguments]
        if isinstance(op, arith.ConstantOp):
            attribute = op.value
            assert isinstance(attribute, FloatAttr | IntegerAttr)
            values[op.result] = attribute.value.data
        elif isinstance(op, arith.CmpfOp):
            compare = COMPARISONS[arith.CMPF_COMPARISON_OPERATIONS[op.predicate.value.data]]
            values[op.result] = compare(values[op.lhs], values[op.rhs])
        else:
            values[op.results[0]] = SCALAR_OPERATIONS[type(op)](*[values[v] for v in op.operands])
    raise ValueError(f"@{function.sym_name.data} does not return")


def _projected(matrix: sparse.csr_array, mode: str) -> sparse.csr_array:
    """A symmetric matrix with few nonzero rows, projected."""
    used = np.unique(matrix.nonzero()[0])
    dense = matrix[used][:, used].toarray()
    values, vectors = np.linalg.eigh(np.triu(dense) + np.triu(dense, 1).T)
    values = np.abs(values) if mode == "abs" else np.maximum(values, 0.0)
    projected = (vectors * values) @ vectors.T
    rows, cols = np.meshgrid(used, used, indexing="ij")
    return sparse.csr_array((projected.ravel(), (rows.ravel(), cols.ravel())), shape=matrix.shape)


def _unpack(packed: Batch, width: int) -> Batch:
    full = np.zeros((len(packed), width, width), packed.dtype)
    full[:, *np.triu_indices(width)] = packed
    return full


def _project_packed(packed: Batch, op: ProjectOp) -> Batch:
    width = op.width.value.data
    full = _unpack(packed[:, :, 0], width)
    values, vectors = np.linalg.eigh(full + np.triu(full, 1).swapaxes(1, 2))
    values = np.abs(values) if op.mode.data == "abs" else np.maximum(values, 0.0)
    projected = (vectors * values[:, None, :]) @ vectors.swapaxes(1, 2)
    return cast(Batch, projected[:, *np.triu_indices(width)][:, :, None])


def _block_diagonal(blocks: Batch) -> sparse.csr_array:
    """[n, p, q] blocks along the diagonal of an (n p) x (n q) matrix."""
    count, rows, cols = blocks.shape
    pointers = np.arange(count + 1)
    matrix = sparse.bsr_array(
        (np.ascontiguousarray(blocks), np.arange(count), pointers), shape=(count * rows, count * cols)
    )
    return sparse.csr_array(matrix.tocsr())


def _take(matrix: sparse.csr_array, instances: NDArray[Any], size: int) -> sparse.csr_array:
    """Rows of these instances, `size` rows each."""
    rows = (instances[:, None].astype(np.int64) * size + np.arange(size)).ravel()
    return sparse.csr_array(matrix[rows])
