"""Rules of operations: values, derivatives, what is linear."""

from __future__ import annotations

from mutation import Mutation

EXPRESSIONS = ("tests/properties/test_expressions.py",)
SPECTRAL = ("tests/dialects/test_spectral.py",)
FUNCTIONS = ("tests/frontend/language/test_functions.py",)

MUTATIONS = (
    Mutation(
        "cross: a sign in the pullback",
        "dialects/mat/algebra.py",
        "return (b.cross(y, cotangent), b.cross(cotangent, x))",
        "return (b.cross(y, cotangent), b.cross(x, cotangent))",
        EXPRESSIONS,
    ),
    Mutation(
        "matmul: a term of the pushforward",
        "dialects/mat/algebra.py",
        "return b.total((dx and b.matmul(dx, y), dy and b.matmul(x, dy)))",
        "return b.total((dx and b.matmul(dx, y),))",
        EXPRESSIONS,
    ),
    Mutation(
        "cofactor 3x3: a sign of its derivative",
        "dialects/mat/algebra.py",
        "b.cross(b.row(matrix, after), b.row(direction, last)),",
        "b.cross(b.row(direction, last), b.row(matrix, after)),",
        EXPRESSIONS,
    ),
    Mutation(
        "divide: a sign in the pullback",
        "dialects/mat/elementwise.py",
        "return (to_matrix, b.neg(b.dot(to_matrix, self.result)))",
        "return (to_matrix, b.dot(to_matrix, self.result))",
        EXPRESSIONS,
    ),
    Mutation(
        "pow: the exponent of its derivative",
        "dialects/mat/elementwise.py",
        "b.power(self.operands[0], self.power - 1.0))",
        "b.power(self.operands[0], self.power - 2.0))",
        EXPRESSIONS,
    ),
    Mutation(
        "hadamard: said to be linear in both operands",
        "dialects/mat/elementwise.py",
        """        return inputs[0] * inputs[1]

    def is_linear(self, active: Sequence[bool]) -> bool:
        return sum(active) <= 1

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        x, y""",
        """        return inputs[0] * inputs[1]

    def is_linear(self, active: Sequence[bool]) -> bool:
        return True

    def pushforward(self, b: MatBuilder, tangents: Sequence[SSAValue | None]) -> SSAValue | None:
        x, y""",
        EXPRESSIONS,
    ),
    Mutation(
        "select: its pull-back exchanges the two sides",
        "dialects/mat/comparison.py",
        "b.select(condition, cotangent, zero), b.select(condition, zero, cotangent))",
        "b.select(condition, zero, cotangent), b.select(condition, cotangent, zero))",
        EXPRESSIONS,
    ),
    Mutation(
        "minimum: the derivative of the greater",
        "dialects/mat/comparison.py",
        "return b.less(self.operands[1], self.operands[0])",
        "return b.less(self.operands[0], self.operands[1])",
        EXPRESSIONS,
    ),
    Mutation(
        "maximum: the derivative of the second at a tie",
        "dialects/mat/comparison.py",
        "return b.less(self.operands[0], self.operands[1])",
        "return b.less_equal(self.operands[0], self.operands[1])",
        EXPRESSIONS,
    ),
    Mutation(
        "abs: slope 1 for negative numbers",
        "dialects/mat/comparison.py",
        "b.neg(one), ",
        "one, ",
        EXPRESSIONS,
    ),
    Mutation(
        "comparisons: <= lowered as <",
        "dialects/mat/comparison.py",
        "s.compare(self.predicate.data, a, b)",
        's.compare("lt", a, b)',
        EXPRESSIONS,
    ),
    Mutation(
        "acos: the sign of its derivative",
        "dialects/scalar/functions.py",
        "lambda b, x, y: b.neg(_arcsine_derivative(b, x))",
        "lambda b, x, y: _arcsine_derivative(b, x)",
        EXPRESSIONS,
    ),
    Mutation(
        "atan2: a sign in the pullback",
        "dialects/mat/trigonometry.py",
        "return (b.hadamard(by_y, cotangent), b.neg(b.hadamard(by_x, cotangent)))",
        "return (b.hadamard(by_y, cotangent), b.hadamard(by_x, cotangent))",
        EXPRESSIONS,
    ),
    Mutation(
        "congruence: its pull-back of a column pairs it with itself",
        "dialects/mat/calculus.py",
        "return s.dot(columns[a], applied[b])",
        "return s.dot(columns[a], applied[a])",
        ("tests/properties/test_scenes.py::test_passes",),
    ),
    Mutation(
        "Jacobi's method: one sweep too few",
        "dialects/mat/spectral.py",
        "SWEEPS = {2: 1, 3: 5}",
        "SWEEPS = {2: 1, 3: 4}",
        SPECTRAL,
    ),
    Mutation(
        "Jacobi's method: the larger eigenvalue first",
        "dialects/mat/spectral.py",
        "s.sub(m[q, q], m[p, p]), s.neg(s.mul(s.constant(2.0), m[p, q]))",
        "s.sub(m[p, p], m[q, q]), s.mul(s.constant(2.0), m[p, q])",
        SPECTRAL,
    ),
    Mutation(
        "polar: an axis of its tangent turns the other way",
        "dialects/mat/spectral.py",
        "for i, j in ((2, 1), (0, 2), (1, 0))]",
        "for i, j in ((2, 1), (2, 0), (1, 0))]",
        SPECTRAL,
    ),
    Mutation(
        "divided differences: the mean twice",
        "passes/calculus/divided_differences.py",
        "b.number(float(0.5 * weight))",
        "b.number(float(weight))",
        SPECTRAL,
    ),
    Mutation(
        "divided differences: no quotient",
        "passes/calculus/divided_differences.py",
        "return b.select(is_explained, b.select(is_apart, mean, b.select(is_even, mean, quotient)), quotient)",
        "return mean",
        SPECTRAL,
    ),
    Mutation(
        "divided differences: no mean",
        "passes/calculus/divided_differences.py",
        "return b.select(is_explained, b.select(is_apart, mean, b.select(is_even, mean, quotient)), quotient)",
        "return quotient",
        SPECTRAL,
    ),
    Mutation(
        "a single one of two equal eigenvalues has a gradient",
        "dialects/mat/spectral.py",
        "factors = [s.add(slope, infinite) for slope in inputs[1]]",
        "factors = list(inputs[1])",
        SPECTRAL,
    ),
)
