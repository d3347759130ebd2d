"""The `mat` dialect: algebra on small dense matrices inside attribute bodies (architecture, section 3).

Values are `tensor<RxCxf64>` (or `xi32` for placement indices), one for every instance of a primitive. Each operation
holds in one class its shape law, its NumPy meaning, its derivative rule and its scalar code; the classes stand in
`elementwise`, `trigonometry`, `comparison`, `algebra`, `spectral`, `structure` and `calculus`.
"""

from typing import cast

from xdsl.dialect_interfaces.constant_materialization import ConstantMaterializationInterface
from xdsl.dialects.builtin import DenseIntOrFPElementsAttr
from xdsl.ir import Attribute, Dialect, Operation

from yasps.dialects.mat import algebra, calculus, comparison, elementwise, spectral, structure, trigonometry
from yasps.dialects.mat.base import (
    Batch,
    MatOp,
    Matrix,
    NotDifferentiableError,
    Shape,
    ShapeError,
    matrix_type,
    shape_of,
    spell,
)
from yasps.dialects.mat.builder import MatBuilder

OPERATIONS: tuple[type[MatOp], ...] = (
    *elementwise.OPS,
    *trigonometry.OPS,
    *comparison.OPS,
    *algebra.OPS,
    *spectral.OPS,
    *structure.OPS,
    *calculus.OPS,
)


class _MaterializeConstant(ConstantMaterializationInterface):
    def materialize_constant(self, value: Attribute, type: Attribute) -> Operation | None:
        if not isinstance(value, DenseIntOrFPElementsAttr):
            return None
        return structure.ConstantOp([], cast(Matrix, type), {"value": value})


Mat = Dialect("mat", list(OPERATIONS), [], [_MaterializeConstant()])

__all__ = [
    "OPERATIONS",
    "Batch",
    "Mat",
    "MatBuilder",
    "MatOp",
    "Matrix",
    "NotDifferentiableError",
    "Shape",
    "ShapeError",
    "matrix_type",
    "shape_of",
    "spell",
]
