"""Other people's projection onto the positive semidefinite cone: Eigen's eigenvalue solver and NumPy's."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.element_problem import FloatArray
from benchmarks.sympy_kernel import eigen_folder
from yasps.runtime.build.toolchain import Compiler, Source, compile_sources, link

#: In place of a width: matrices of any, somewhat slower.
ANY_WIDTH = -1

_TEXT = """\
#include <Eigen/Eigenvalues>

typedef Eigen::Matrix<double, @WIDTH@, @WIDTH@> Matrix;  // -1 is Eigen::Dynamic

extern "C" void @NAME@(long count, long width, const double* from, double* to) {
    Eigen::SelfAdjointEigenSolver<Matrix> solver(width);
    for (long k = 0; k < count; ++k) {
        const Eigen::Map<const Matrix> given(from + k * width * width, width, width);
        Eigen::Map<Matrix> projected(to + k * width * width, width, width);
        solver.compute(given);
        if (solver.eigenvalues()[0] >= 0.0)
            projected = given;
        else
            projected.noalias() = solver.eigenvectors() * solver.eigenvalues().cwiseMax(0.0).asDiagonal() *
                                  solver.eigenvectors().transpose();
    }
}
"""
_VERSION = """\
#include <Eigen/Core>
extern "C" int eigen_version() { return EIGEN_WORLD_VERSION * 10000 + EIGEN_MAJOR_VERSION * 100 + EIGEN_MINOR_VERSION; }
"""


@dataclass(frozen=True)
class EigenProjection:
    """Projects matrices of some widths, or of any."""

    version: str
    functions: Mapping[int, Callable[[int, int, int, int], None]]

    def project(self, matrices: FloatArray, result: FloatArray) -> None:
        """Writes the projection of symmetric matrices, [n, w, w], to `result` of the same shape.

        Raises KeyError for a width that was not compiled.
        """
        assert matrices.shape == result.shape
        assert matrices.flags.c_contiguous
        assert result.flags.c_contiguous
        count, width, _ = matrices.shape
        function = self.functions[width if width in self.functions else ANY_WIDTH]
        function(count, width, matrices.ctypes.data, result.ctypes.data)


def eigen_projection(compiler: Compiler, widths: Sequence[int]) -> EigenProjection:
    """Compiles Eigen's solver for these widths. Raises EigenNotFoundError."""
    flags = (f"-I{eigen_folder()}", "-DNDEBUG")
    names = {width: "eigen_project" if width == ANY_WIDTH else f"eigen_project_{width}" for width in widths}
    sources = [Source("benchmark.eigen_version", _VERSION)]
    for width, name in names.items():
        sources.append(Source(f"benchmark.{name}", _TEXT.replace("@WIDTH@", str(width)).replace("@NAME@", name)))
    objects = compile_sources(sources, compiler.with_flags(*flags))
    library = ctypes.CDLL(str(link(objects, compiler, ("-lm",)).path))
    number = int(library.eigen_version())
    functions: dict[int, Callable[[int, int, int, int], None]] = {}
    for width, name in names.items():
        function = library[name]
        function.argtypes = (ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p)
        function.restype = None
        functions[width] = function
    return EigenProjection(f"{number // 10000}.{number // 100 % 100}.{number % 100}", functions)


def numpy_projection(matrices: FloatArray) -> FloatArray:
    """The projection of symmetric matrices, [n, w, w]."""
    values, vectors = np.linalg.eigh(matrices)
    projected: FloatArray = (vectors * np.maximum(values, 0.0)[:, None, :]) @ vectors.swapaxes(1, 2)
    return projected
