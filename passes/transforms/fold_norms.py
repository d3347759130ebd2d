"""`fold-norms`: what is smooth where a norm is 0 is written without the norm, as far as products show it.

With n = norm(x) and s = dot(x, x), of which n is the root:

    n n, n^2, c n / (d / n), sqrt(s)^2      s, and no n: even powers
    n / n, x / n n                          1, x
    s n, s^(3/2)                            n^3: one power of each norm
    sin(a n) / n                            a c_1(a^2 s)
    tan(a n) / n                            a c_1(a^2 s) / cos(a n)
    (1 - cos(a n)) / n^2                    a^2 c_2(a^2 s)
    (a n - sin(a n)) / n^3                  a^3 c_3(a^2 s)

c_k being the Stumpff functions (`mat.stumpff`), smooth at 0, where the quotients would be 0 / 0. Factors are found
through products, quotients, powers and what is linear in them, also if a matrix is made of the entries of x / n: so
Rodrigues' formula has no singularity, whichever way it is written. Where nothing of this is found, bodies stay as they
are. Other smooth functions of norms need no rewriting: see `norms`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

from xdsl.context import Context
from xdsl.dialects.builtin import ModuleOp
from xdsl.ir import Block, Region, SSAValue
from xdsl.passes import ModulePass

from yasps.dialects.mat import MatOp, algebra, elementwise, shape_of
from yasps.dialects.mat.base import constant_value, is_zero
from yasps.dialects.rel import AttributeOp, ReadOp, YieldOp
from yasps.passes.analysis.norms import LINEAR, PRODUCTS, SUMS
from yasps.passes.bodies import BodyBuilder, containers


@dataclass(frozen=True)
class FoldNorms(ModulePass):
    """See the module."""

    name = "fold-norms"

    def apply(self, ctx: Context, op: ModuleOp) -> None:
        for container in containers(op):
            for attribute in container.body.block.ops:
                if isinstance(attribute, AttributeOp) and attribute.body.blocks:
                    _fold(attribute)


def _fold(attribute: AttributeOp) -> None:
    body = attribute.body.block
    if not any(isinstance(op, algebra.NormOp) or _is_root(op) for op in body.ops):
        return
    b = BodyBuilder(Block())
    folding, values = _Folding(b), dict[SSAValue, SSAValue]()
    for op in body.ops:
        if isinstance(op, ReadOp):
            values[op.result] = b.read(op)
        elif isinstance(op, MatOp):
            values[op.result] = folding.copy(op, [values[v] for v in op.operands])
        elif isinstance(op, YieldOp):
            b.append(YieldOp(values[op.value]))
    if folding.has_folded:
        attribute.detach_region(attribute.body)
        attribute.add_region(Region(b.body))


Lazily = Callable[[], SSAValue]


@dataclass(frozen=True)
class _Product:
    """A value as powers of norms and of what vanishes with them, times the rest (1 if it is None), made on demand."""

    powers: Mapping[SSAValue, float]
    rest: Lazily | None


@dataclass(frozen=True)
class _Vanishing:
    """What is known of a value f(a n) of the order of n^degree near n = 0; a of None stands for 1."""

    degree: int
    vector: SSAValue
    """That n is the norm of."""
    a: Lazily | None
    quotient: Callable[[SSAValue], SSAValue]
    """f(a n) / (a n)^degree from (a n)^2."""


class _Folding:
    """Copies of operations, folded."""

    def __init__(self, b: BodyBuilder) -> None:
        self.b = b
        self.has_folded = False
        self._products: dict[SSAValue, _Product] = {}
        self._vanishing: dict[SSAValue, _Vanishing] = {}

    def copy(self, op: MatOp, operands: Sequence[SSAValue]) -> SSAValue:
        """The value of the operation on operands that are copies themselves."""
        product = self._product(op, operands)
        folded = None if product is None else self._folded(product)
        if folded is None:
            result = self.b.copy(op, operands)
        else:
            self.has_folded = True
            product, result = folded, self._made(folded)
        if product is not None and product.powers:
            self._products.setdefault(result, product)
        return result

    # -- products --------------------------------------------------------------------------------------------

    def _of(self, value: SSAValue) -> _Product:
        if value not in self._products:
            found = self._match(value)
            if found is not None:
                self._vanishing[value] = found
            is_factor = found is not None or _vector_of(value) is not None
            self._products[value] = _Product({value: 1.0}, None) if is_factor else _Product({}, lambda: value)
        return self._products[value]

    def _product(self, op: MatOp, operands: Sequence[SSAValue]) -> _Product | None:
        """The value of the operation as a product, if there are norms in it."""
        b, parts = self.b, [self._of(operand) for operand in operands]
        powers: Mapping[SSAValue, float]
        rest: Lazily | None
        if isinstance(op, (elementwise.SqrtOp, elementwise.PowOp)):
            (part,) = parts
            exponent = op.power if isinstance(op, elementwise.PowOp) else 0.5
            if shape_of(op.result) != (1, 1) or (exponent != int(exponent) and not _is_positive(part)):
                return None
            powers = {v: e * exponent for v, e in part.powers.items()}
            rest = part.rest and _then(lambda v: b.power(v, exponent), part.rest)
        elif isinstance(op, elementwise.DivideOp):
            powers, rest = _times(parts[0].powers, parts[1].powers, -1), parts[0].rest
            if parts[1].rest is not None:
                rest = _then(b.divide, rest or self._one, parts[1].rest)
        elif isinstance(op, PRODUCTS):
            powers, rests = _times(parts[0].powers, parts[1].powers), [part.rest for part in parts]
            rest = (rests[0] or rests[1]) if None in rests else self._rest(op, parts)
        elif isinstance(op, LINEAR):
            powers, rest = parts[0].powers, self._rest(op, parts)
        elif isinstance(op, SUMS):
            factored = [part for part, operand in zip(parts, operands, strict=True) if not is_zero(operand)]
            if not factored or any(part.powers != factored[0].powers for part in factored):
                return None
            powers, rest = factored[0].powers, self._rest(op, parts)
        else:
            return None
        return _Product(powers, rest) if powers else None

    def _one(self) -> SSAValue:
        return self.b.number(1.0)

    def _rest(self, op: MatOp, parts: Sequence[_Product]) -> Lazily:
        return _then(lambda *values: self.b.copy(op, values), *[part.rest or self._one for part in parts])

    # -- what vanishes with a norm ---------------------------------------------------------------------------

    def _match(self, value: SSAValue) -> _Vanishing | None:
        b, op = self.b, value.owner
        if shape_of(value) != (1, 1):
            return None
        if isinstance(op, elementwise.SinOp):
            return self._vanishes(1, op.operands[0], lambda s: b.stumpff(1, s))
        if isinstance(op, elementwise.TanOp):
            angle = op.operands[0]
            return self._vanishes(1, angle, lambda s: b.divide(b.stumpff(1, s), b.apply("cos", angle)))
        if not isinstance(op, elementwise.AddOp | elementwise.SubOp):
            return None
        terms = [_signed(op.operands[0], 1), _signed(op.operands[1], -1 if isinstance(op, elementwise.SubOp) else 1)]
        for (sign, first), (other_sign, second) in (terms, reversed(terms)):
            known, function = constant_value(first), second.owner
            if isinstance(function, elementwise.CosOp) and known is not None and known.item() == -sign * other_sign:
                return self._vanishes(2, function.operands[0], _with_sign(b, -other_sign, 2))
            if isinstance(function, elementwise.SinOp) and function.operands[0] is first and sign == -other_sign:
                return self._vanishes(3, first, _with_sign(b, sign, 3))
        return None

    def _vanishes(self, degree: int, angle: SSAValue, quotient: Callable[[SSAValue], SSAValue]) -> _Vanishing | None:
        """For a function of this angle, if that is a multiple of a norm."""
        product = self._of(angle)
        if list(product.powers.values()) != [1.0]:
            return None
        (norm,) = product.powers
        if not isinstance(norm.owner, algebra.NormOp):
            return None
        return _Vanishing(degree, norm.owner.operands[0], product.rest, quotient)

    # -- folding ---------------------------------------------------------------------------------------------

    def _folded(self, product: _Product) -> _Product | None:
        """The same with one even or odd power for each norm and nothing of the kind 0 / 0, or None if that it is."""
        b, rest = self.b, product.rest
        degrees: dict[SSAValue, float] = {}
        factors: dict[SSAValue, list[tuple[SSAValue, float]]] = {}
        for value, exponent in product.powers.items():
            vector = _vector_of(value)
            if vector is not None:
                degree = exponent if isinstance(value.owner, algebra.NormOp) else 2 * exponent
                degrees[vector] = degrees.get(vector, 0.0) + degree
                factors.setdefault(vector, []).append((value, exponent))
        powers = {v: e for v, e in product.powers.items() if v in self._vanishing}
        replaced = False
        for value in sorted(powers, key=lambda v: -self._vanishing[v].degree):
            vanishing, exponent = self._vanishing[value], powers[value]
            vector = vanishing.vector
            if degrees.get(vector, 0.0) * exponent >= 0 or exponent != int(exponent):
                continue
            degrees[vector] += vanishing.degree * exponent
            del powers[value]
            rest, replaced = self._times_quotient(rest, vanishing, exponent), True
        replaced = replaced or any(not _is_folded(found) for found in factors.values())
        if not replaced:
            return None
        for vector, degree in degrees.items():
            if degree != 0.0 and degree % 2 == 0:
                powers[b.dot(vector, vector)] = degree / 2
            elif degree != 0.0:
                powers[b.emit(algebra.NormOp, [vector])] = degree
        return _Product(powers, rest)

    def _times_quotient(self, rest: Lazily | None, vanishing: _Vanishing, exponent: float) -> Lazily:
        b = self.b

        def made() -> SSAValue:
            vector, a = vanishing.vector, vanishing.a and vanishing.a()
            square = b.dot(vector, vector)
            quotient = vanishing.quotient(square if a is None else b.scale(b.power(a, 2.0), square))
            if a is not None:
                quotient = b.scale(b.power(a, float(vanishing.degree)), quotient)
            factor = b.power(quotient, exponent)
            return factor if rest is None else b.scale(factor, rest())

        return cache(made)

    def _made(self, product: _Product) -> SSAValue:
        """The value of a product."""
        b = self.b
        numerator: SSAValue | None = None
        denominator: SSAValue | None = None
        for value, exponent in product.powers.items():
            power = b.power(value, abs(exponent))
            if exponent > 0:
                numerator = power if numerator is None else b.scale(numerator, power)
            else:
                denominator = power if denominator is None else b.scale(denominator, power)
        made = (product.rest or self._one)()
        if numerator is not None:
            made = b.scale(numerator, made)
        return made if denominator is None else b.divide(made, denominator)


def _is_root(op: object) -> bool:
    return isinstance(op, elementwise.SqrtOp) or (isinstance(op, elementwise.PowOp) and op.power % 1 != 0)


def _then(function: Callable[..., SSAValue], *operands: Lazily) -> Lazily:
    """Made once, however many products it is in."""
    return cache(lambda: function(*[operand() for operand in operands]))


def _with_sign(b: BodyBuilder, sign: int, order: int) -> Callable[[SSAValue], SSAValue]:
    return lambda s: b.stumpff(order, s) if sign > 0 else b.neg(b.stumpff(order, s))


def _times(a: Mapping[SSAValue, float], b: Mapping[SSAValue, float], sign: int = 1) -> dict[SSAValue, float]:
    """Exponents of a product, or of a quotient for a sign of -1. Those that become 0 stay, to be folded away."""
    return {**a, **{v: a.get(v, 0.0) + sign * e for v, e in b.items()}}


def _signed(value: SSAValue, sign: int) -> tuple[int, SSAValue]:
    """The value without minus signs, and its sign."""
    while isinstance(value.owner, elementwise.NegOp):
        sign, value = -sign, value.owner.operands[0]
    return sign, value


def _vector_of(value: SSAValue) -> SSAValue | None:
    """x, where the value is norm(x) or the dot product of x and itself."""
    op = value.owner
    if isinstance(op, algebra.NormOp) or (isinstance(op, algebra.DotOp) and op.operands[0] is op.operands[1]):
        return op.operands[0]
    if isinstance(op, algebra.MatmulOp) and shape_of(value) == (1, 1):
        for x, transposed in (op.operands, reversed(op.operands)):
            if isinstance(transposed.owner, algebra.TransposeOp) and transposed.owner.operands[0] is x:
                return x
    return None


def _is_positive(product: _Product) -> bool:
    """Is it powers of norms and nothing else, so that there are roots of it?"""
    return product.rest is None and bool(product.powers) and all(_vector_of(v) is not None for v in product.powers)


def _is_folded(factors: list[tuple[SSAValue, float]]) -> bool:
    """Are these powers of norm(x) and dot(x, x) one power that stays as it is?

    dot(x, x) to the power of 1.25 has finite second derivatives as norm(x)^2.5.
    """
    (value, exponent), *others = factors
    if others:
        return False
    if isinstance(value.owner, algebra.NormOp):
        return exponent % 2 != 0
    return exponent == int(exponent) and exponent != 0
