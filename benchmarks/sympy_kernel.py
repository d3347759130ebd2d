"""The peer that a careful user writes without yasps: SymPy derives Psi(F) of a tet, `cse` and C, one element at a time;
Eigen projects the 9x9 Hessian; J^T H J is added to a block matrix in C++ too."""

from __future__ import annotations

import ctypes
import sysconfig
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.element_problem import LAMBDA, MU, Elements, FloatArray
from yasps.runtime.build.toolchain import Compiler, Source, compile_sources, link

PAIRS = [(a, b) for a in range(4) for b in range(a, 4)]

_TEMPLATE = """\
#include <Eigen/Eigenvalues>
#include <cmath>

typedef Eigen::Matrix<double, 9, 9> Matrix9;

// Gradient and upper triangle of the Hessian in F, row-major.
static void derive(const double* f, double mu, double lam, double volume, double* out) {
@NAMES@
@BODY@
}

extern "C" void sympy_tets(long count, const double* x, const int* corners, const double* inverse,
                           const double* volume, double mu, double lam, const long* position, long project,
                           double* gradient, double* blocks) {
    for (long t = 0; t < count; ++t) {
        const int* const corner = corners + 4 * t;
        const double* const m = inverse + 9 * t;
        double f[9], out[54];
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) {
                double sum = 0;
                for (int k = 0; k < 3; ++k) sum += (x[3 * corner[k + 1] + i] - x[3 * corner[0] + i]) * m[3 * k + j];
                f[3 * i + j] = sum;
            }
        derive(f, mu, lam, volume[t], out);
        Matrix9 h;
        int next = 9;
        for (int r = 0; r < 9; ++r)
            for (int c = r; c < 9; ++c) h(r, c) = h(c, r) = out[next++];
        if (project) {
            const Eigen::SelfAdjointEigenSolver<Matrix9> solver(h);
            h = solver.eigenvectors() * solver.eigenvalues().cwiseMax(0.0).asDiagonal() *
                solver.eigenvectors().transpose();
        }
        Eigen::Matrix<double, 9, 12> j = Eigen::Matrix<double, 9, 12>::Zero();
        for (int i = 0; i < 3; ++i)
            for (int c = 0; c < 3; ++c)
                for (int k = 0; k < 3; ++k) {
                    j(3 * i + c, 3 * (k + 1) + i) = m[3 * k + c];
                    j(3 * i + c, i) -= m[3 * k + c];
                }
        const Eigen::Matrix<double, 12, 1> g = j.transpose() * Eigen::Map<Eigen::Matrix<double, 9, 1>>(out);
        const Eigen::Matrix<double, 12, 12> full = j.transpose() * h * j;
        int pair = 0;
        for (int a = 0; a < 4; ++a) {
            for (int i = 0; i < 3; ++i) gradient[3 * corner[a] + i] += g[3 * a + i];
            for (int b = a; b < 4; ++b, ++pair) {
                const int low = corner[a] <= corner[b] ? a : b, high = a + b - low;
                double* const to = blocks + 9 * position[10 * t + pair];
                for (int r = 0; r < 3; ++r)
                    for (int c = 0; c < 3; ++c) to[3 * r + c] += full(3 * low + r, 3 * high + c);
            }
        }
    }
}
"""


class EigenNotFoundError(ImportError):
    """Eigen's headers are not there."""


@dataclass
class SympyTets:
    """Gradient [n, 3] and upper 3x3 blocks [k, 3, 3] of all tets, added up, with and without projection.

    block_rows, block_cols: the vertices of each block.
    """

    version: str
    elements: Elements
    block_rows: NDArray[np.int64]
    block_cols: NDArray[np.int64]
    positions: NDArray[np.int64]
    gradient: FloatArray
    blocks: FloatArray
    function: Any

    def assemble(self, x: FloatArray, project: bool) -> None:
        """Overwrites `gradient` and `blocks` with those at positions x [n, 3]."""
        self.gradient[:] = 0.0
        self.blocks[:] = 0.0
        arrays: list[NDArray[Any]] = [
            x,
            self.elements.corners,
            self.elements.constants["inverse"],
            self.elements.constants["volume"],
        ]
        assert all(array.flags.c_contiguous for array in arrays)
        inputs = [array.ctypes.data for array in arrays]
        results = [self.positions.ctypes.data, int(project), self.gradient.ctypes.data, self.blocks.ctypes.data]
        self.function(len(self.elements), *inputs, MU, LAMBDA, *results)

    def multiply(self, vector: FloatArray) -> FloatArray:
        """The symmetric matrix of the blocks times a vector [3 n]."""
        v = vector.reshape(-1, 3)
        result = np.zeros_like(v)
        np.add.at(result, self.block_rows, np.einsum("kij,kj->ki", self.blocks, v[self.block_cols]))
        above = self.block_rows != self.block_cols
        product = np.einsum("kij,ki->kj", self.blocks[above], v[self.block_rows[above]])
        np.add.at(result, self.block_cols[above], product)
        return result.reshape(-1)


def eigen_folder() -> Path:
    """Eigen's headers: of the wheel cmeel-eigen, or of the system. Raises EigenNotFoundError."""
    site = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix/include/eigen3"
    for folder in (site, Path("/usr/include/eigen3"), Path("/usr/local/include/eigen3")):
        if (folder / "Eigen/Eigenvalues").is_file():
            return folder
    raise EigenNotFoundError("no Eigen; to have it: pip install cmeel-eigen")


def sympy_tets(elements: Elements, compiler: Compiler) -> SympyTets:
    """Derives, writes and compiles. Raises ImportError without SymPy or Eigen."""
    eigen = eigen_folder()
    sympy: Any = import_module("sympy")
    source = Source("benchmark.sympy_tets", _text())
    objects = compile_sources([source], compiler.with_flags(f"-I{eigen}", "-DNDEBUG"))
    function = ctypes.CDLL(str(link(objects, compiler, ("-lm",)).path)).sympy_tets
    pointer, number = ctypes.c_void_p, ctypes.c_double
    function.argtypes = (ctypes.c_long, *[pointer] * 4, number, number, pointer, ctypes.c_long, pointer, pointer)
    function.restype = None
    corners = elements.corners.astype(np.int64)
    count = len(elements.vertices)
    keys = np.column_stack(
        [np.minimum(corners[:, a], corners[:, b]) * count + np.maximum(corners[:, a], corners[:, b]) for a, b in PAIRS]
    )
    unique, positions = np.unique(keys, return_inverse=True)
    return SympyTets(
        sympy.__version__,
        elements,
        unique // count,
        unique % count,
        np.ascontiguousarray(positions.reshape(-1, len(PAIRS)), np.int64),
        np.zeros((count, 3)),
        np.zeros((len(unique), 3, 3)),
        function,
    )


def _power(base: str, exponent: str) -> str:
    """base ** exponent in C."""
    product = "*".join([f"({base})"] * abs(int(exponent)))
    return f"({product})" if int(exponent) > 0 else f"(1.0/({product}))"


def statements(replacements: Sequence[tuple[Any, Any]], reduced: Sequence[Any]) -> list[str]:
    """What `cse` gives, in C: temporaries, then out[0], out[1], ... Small powers are products: pow() is far slower."""
    sympy: Any = import_module("sympy")
    powers = [
        (lambda base, exponent: exponent.is_Integer and 1 <= abs(exponent) <= 4, _power),
        (lambda base, exponent: exponent == sympy.Rational(1, 2), lambda base, exponent: f"sqrt({base})"),
        (lambda base, exponent: True, "pow"),
    ]
    printer = {"user_functions": {"Pow": powers}}
    lines = [f"    const double {s} = {sympy.ccode(e, **printer)};" for s, e in replacements]
    return lines + [f"    out[{k}] = {sympy.ccode(e, **printer)};" for k, e in enumerate(reduced)]


def _text() -> str:
    """The C++ file."""
    replacements, reduced = import_module("benchmarks.sympy_energies").derivatives("stable Neo-Hookean, F")
    lines = statements(replacements, reduced)
    names = [f"    const double f_{i}_{j} = f[{3 * i + j}];" for i in range(3) for j in range(3)]
    names += [f"    const double {name}_0_0 = {name};" for name in ("mu", "lam", "volume")]
    return _TEMPLATE.replace("@NAMES@", "\n".join(names)).replace("@BODY@", "\n".join(lines))
