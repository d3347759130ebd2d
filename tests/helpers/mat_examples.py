"""Examples of every `mat` operation: what the generated tests of the dialect run on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from mat_bodies import block_of
from xdsl.dialects.builtin import DenseArrayBase, FloatAttr, IntegerAttr, StringAttr, f64, i64
from xdsl.ir import Attribute, Block

from yasps.dialects.mat import (
    Batch,
    MatOp,
    Shape,
    algebra,
    calculus,
    comparison,
    elementwise,
    matrix_type,
    spectral,
    structure,
    trigonometry,
)
from yasps.dialects.mat.base import dense

INSTANCES = 5


def plain(random: np.random.Generator, shape: Shape) -> Batch:
    """Any numbers."""
    return random.standard_normal((INSTANCES, *shape))


def positive(random: np.random.Generator, shape: Shape) -> Batch:
    """Numbers of (0.5, 2)."""
    return random.uniform(0.5, 2.0, (INSTANCES, *shape))


def large(random: np.random.Generator, shape: Shape) -> Batch:
    """Numbers of (4.5, 60)."""
    return random.uniform(4.5, 60.0, (INSTANCES, *shape))


def small(random: np.random.Generator, shape: Shape) -> Batch:
    """Numbers of (-0.8, 0.8): the domain of asin and acos, and inside one branch of tan."""
    return random.uniform(-0.8, 0.8, (INSTANCES, *shape))


def truth(random: np.random.Generator, shape: Shape) -> Batch:
    """Zeros and ones, of both kinds."""
    return (np.arange(INSTANCES * shape[0] * shape[1]).reshape(INSTANCES, *shape) % 2).astype(float)


def regular(random: np.random.Generator, shape: Shape) -> Batch:
    """Well-conditioned square matrices."""
    return np.eye(shape[0]) + 0.2 * random.standard_normal((INSTANCES, *shape))


def symmetric(random: np.random.Generator, shape: Shape) -> Batch:
    """Symmetric, indefinite matrices."""
    half = random.standard_normal((INSTANCES, *shape))
    return half + half.swapaxes(1, 2)


Sampler = Callable[[np.random.Generator, Shape], Batch]


@dataclass(frozen=True)
class Example:
    """An operation on operands of these shapes, each drawn by its sampler (all by the first if there is one)."""

    op_class: type[MatOp]
    shapes: tuple[Shape, ...]
    samplers: tuple[Sampler, ...] = (plain,)
    properties: dict[str, Attribute] = field(default_factory=dict)
    rational: bool = True
    """Its meaning needs only + - * / and works on exact numbers."""

    @property
    def label(self) -> str:
        """A name for the test."""
        sizes = "-".join(f"{r}x{c}" for r, c in self.shapes)
        extra = "-".join(str(v) for v in self.properties.values())
        return "-".join(part for part in (self.op_class.word(), sizes, extra[:30]) if part)

    def build(self, extra: tuple[Shape, ...] = ()) -> tuple[Block, MatOp]:
        """A block with the operation on its arguments, and further arguments after those."""
        block = block_of((*self.shapes, *extra))
        shape = self.op_class.infer(self.shapes, self.properties)
        op = self.op_class(block.args[: len(self.shapes)], matrix_type(shape), self.properties)
        block.add_op(op)
        return block, op

    def draw(self, seed: int = 0) -> list[Batch]:
        """Operands."""
        random = np.random.default_rng(seed)
        samplers = self.samplers * len(self.shapes) if len(self.samplers) == 1 else self.samplers
        return [sampler(random, shape) for sampler, shape in zip(samplers, self.shapes, strict=True)]


def integers(*values: int) -> DenseArrayBase:
    """An array of integers as a property."""
    return DenseArrayBase.from_list(i64, list(values))


def _functions() -> list[Example]:
    samplers = {-np.inf: plain, 0.0: positive, -1.0: small}  # by the lower end of the domain
    made = []
    for name, op_class in elementwise.TABLED.items():
        sampler = small if name == "tan" else samplers[op_class.FUNCTION.domain[0]]
        made += [Example(op_class, (shape,), (sampler,), rational=False) for shape in ((1, 1), (2, 3))]
    return made


def _powers() -> list[Example]:
    made = []
    for exponent in (-2.0, -1.0, 0.0, 1.0, 2.0, 3.0, 7.0, 0.5, -1.5, 2.25):
        whole = exponent == int(exponent)
        made.append(
            Example(
                elementwise.PowOp,
                ((2, 2),),
                (plain if exponent > 0 and whole else positive,),
                {"exponent": FloatAttr(exponent, f64)},
                whole,
            )
        )
    return made


def _same(op_class: type[MatOp], *shapes: Shape) -> list[Example]:
    """Two operands of one shape."""
    return [Example(op_class, (shape, shape)) for shape in shapes]


def _one(op_class: type[MatOp], *shapes: Shape, sampler: Sampler = plain, rational: bool = True) -> list[Example]:
    return [Example(op_class, (shape,), (sampler,), rational=rational) for shape in shapes]


SQUARES: tuple[Shape, ...] = ((1, 1), (2, 2), (3, 3), (4, 4))
NUMBERS = dense(np.array([[1.5, -2.0, 0.0], [0.25, 3.0, 1e-7]]), matrix_type((2, 3)))

ALL: list[Example] = [
    *_same(elementwise.AddOp, (1, 1), (2, 3)),
    *_same(elementwise.SubOp, (1, 1), (2, 3)),
    *_one(elementwise.NegOp, (1, 1), (2, 3)),
    *_same(elementwise.HadamardOp, (1, 1), (2, 3)),
    Example(elementwise.ScaleOp, ((1, 1), (2, 3))),
    Example(elementwise.ScaleOp, ((1, 1), (1, 1))),
    Example(elementwise.DivideOp, ((2, 3), (1, 1)), (plain, positive)),
    Example(elementwise.DivideOp, ((1, 2), (1, 1)), (plain, positive)),
    Example(elementwise.DivideOp, ((1, 1), (1, 1)), (plain, positive)),
    *_functions(),
    *_powers(),
    Example(algebra.MatmulOp, ((2, 3), (3, 4))),
    Example(algebra.MatmulOp, ((1, 3), (3, 1))),
    Example(algebra.MatmulOp, ((3, 1), (1, 3))),
    *_one(algebra.TransposeOp, (1, 1), (2, 3), (4, 1)),
    *_same(algebra.DotOp, (1, 1), (3, 1), (2, 3)),
    *_same(algebra.CrossOp, (3, 1), (1, 3)),
    *_one(algebra.TraceOp, *SQUARES),
    *_one(algebra.SumOp, (1, 1), (2, 3)),
    *_one(algebra.NormOp, (1, 1), (3, 1), (2, 3), rational=False),
    *_one(algebra.DetOp, *SQUARES),
    *_one(algebra.CofactorOp, *SQUARES, sampler=regular),
    *_one(algebra.InverseOp, *SQUARES, sampler=regular),
    *_one(spectral.EigenvaluesOp, (2, 2), (3, 3), rational=False),
    Example(spectral.SpectralOp, ((2, 2), (2, 1), (1, 1)), (symmetric, plain, plain), rational=False),
    Example(spectral.SpectralOp, ((3, 3), (3, 1), (3, 1)), rational=False),
    Example(spectral.SpectralTangentOp, ((2, 2), (1, 1), (2, 2)), (symmetric, plain, symmetric), rational=False),
    Example(spectral.SpectralTangentOp, ((3, 3), (3, 1), (3, 3)), rational=False),
    *_one(spectral.PolarOp, (3, 3), rational=False),
    Example(structure.ConstantOp, (), properties={"value": NUMBERS}),
    Example(structure.IdentityOp, (), properties={"size": integers(3)}),
    Example(structure.ReshapeOp, ((2, 3),), properties={"shape": integers(3, 2)}),
    Example(structure.ReshapeOp, ((2, 3),), properties={"shape": integers(1, 6)}),
    Example(structure.BlockOp, ((3, 4),), properties={"block": integers(1, 2, 2, 1)}),
    Example(structure.BlockOp, ((3, 4),), properties={"block": integers(0, 0, 3, 4)}),
    Example(structure.EmbedOp, ((2, 1),), properties={"place": integers(1, 2, 3, 4)}),
    Example(structure.EmbedOp, ((2, 2),), properties={"place": integers(0, 0, 2, 2)}),
    Example(structure.ConcatRowsOp, ((2, 3),)),
    Example(structure.ConcatRowsOp, ((2, 3), (1, 3), (3, 3))),
    Example(structure.ConcatColsOp, ((2, 1),)),
    Example(structure.ConcatColsOp, ((2, 1), (2, 3), (2, 2))),
    *_one(calculus.StopGradientOp, (1, 1), (2, 3)),
    Example(calculus.GivenDerivativeOp, ((1, 1), (1, 6), (2, 3))),
    Example(calculus.GivenDerivativeOp, ((2, 2), (4, 5), (3, 1), (1, 2))),
    Example(calculus.OverNormOp, ((1, 1), (1, 1), (1, 1)), (plain, positive, plain)),
    Example(calculus.OverNormOp, ((2, 3), (1, 1), (2, 3)), (plain, positive, plain)),
    Example(calculus.CongruenceOp, ((3, 3), (3, 2)), (symmetric, plain)),
    Example(calculus.CongruenceOp, ((2, 2), (2, 4)), (symmetric, plain)),
    *[
        Example(calculus.ProjectPsdOp, (shape,), (symmetric,), {"mode": StringAttr(mode)}, rational=False)
        for shape in ((1, 1), (4, 4))
        for mode in calculus.PROJECTION_MODES
    ],
    Example(trigonometry.Atan2Op, ((1, 1), (1, 1)), rational=False),
    Example(trigonometry.Atan2Op, ((2, 3), (2, 3)), rational=False),
    Example(trigonometry.HypotOp, ((1, 1), (1, 1)), rational=False),
    Example(trigonometry.HypotOp, ((2, 3), (2, 3)), rational=False),
    *[
        Example(trigonometry.StumpffOp, (shape,), (sampler,), {"order": IntegerAttr(order, i64)}, rational=False)
        for order in range(6)
        for shape, sampler in (((2, 3), positive), ((1, 2), large))
    ],
    *[
        Example(comparison.CompareOp, (shape, shape), properties={"predicate": StringAttr(predicate)})
        for shape in ((1, 1), (2, 3))
        for predicate in comparison.PREDICATES
    ],
    Example(comparison.SelectOp, ((1, 1), (1, 1), (1, 1)), (truth, plain, plain)),
    Example(comparison.SelectOp, ((1, 1), (2, 3), (2, 3)), (truth, plain, plain)),
    Example(comparison.SelectOp, ((2, 3), (2, 3), (2, 3)), (truth, plain, plain)),
    *_same(comparison.MinOp, (1, 1), (2, 3)),
    *_same(comparison.MaxOp, (1, 1), (2, 3)),
    *_one(comparison.AbsOp, (1, 1), (2, 3)),
]
