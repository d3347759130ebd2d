"""Other people's symmetric sparse matrix-vector products: Eigen's and that of Intel's MKL."""

from __future__ import annotations

import ctypes
import site
import sys
from ctypes.util import find_library
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from benchmarks.sympy_kernel import eigen_folder
from yasps.runtime.build.toolchain import Compiler, Source, compile_sources, link

FloatArray = NDArray[np.float64]

_EIGEN = """\
#include <Eigen/SparseCore>

extern "C" void eigen_product(long n, long entries, const int* starts, const int* columns, const double* values,
                              const double* x, double* y) {
    const Eigen::Map<const Eigen::SparseMatrix<double, Eigen::RowMajor>> upper(n, n, entries, starts, columns, values);
    const Eigen::Map<const Eigen::VectorXd> from(x, n);
    Eigen::Map<Eigen::VectorXd> to(y, n);
    to.noalias() = upper.selfadjointView<Eigen::Upper>() * from;
}
"""


class EigenProduct:
    """y = H x from the upper triangle, entry by entry."""

    def __init__(self, matrix: sparse.csr_array[np.float64], compiler: Compiler) -> None:
        """`matrix` has both triangles. Raises EigenNotFoundError."""
        with_eigen = compiler.with_flags(f"-I{eigen_folder()}", "-DNDEBUG")
        objects = compile_sources([Source("benchmark.eigen_product", _EIGEN)], with_eigen)
        self._function = ctypes.CDLL(str(link(objects, compiler, ("-lm",)).path)).eigen_product
        self._function.argtypes = (ctypes.c_long, ctypes.c_long, *[ctypes.c_void_p] * 5)
        self._function.restype = None
        upper = sparse.triu(matrix, format="csr")
        self._starts, self._columns = upper.indptr.astype(np.int32), upper.indices.astype(np.int32)
        self._values = upper.data
        self.y = np.empty(matrix.shape[0])

    def multiply(self, x: FloatArray) -> FloatArray:
        """The product, in `y`."""
        arrays = (self._starts, self._columns, self._values, x, self.y)
        self._function(self.y.size, self._values.size, *(array.ctypes.data for array in arrays))
        return self.y


class MklNotFoundError(ImportError):
    """Intel's MKL is not installed."""


class _Description(ctypes.Structure):
    """`matrix_descr` of mkl_spblas.h."""

    _fields_ = [("type", ctypes.c_int), ("mode", ctypes.c_int), ("diag", ctypes.c_int)]


# From mkl_spblas.h.
_ZERO_BASED, _ROW_MAJOR = 0, 101
_NO_TRANSPOSE, _SYMMETRIC, _UPPER, _NON_UNIT = 10, 21, 41, 50
_CALLS_EXPECTED = 1000


class MklProduct:
    """y = H x from the 3x3 blocks of the upper triangle, on `threads` threads."""

    def __init__(self, matrix: sparse.csr_array[np.float64], threads: int) -> None:
        """`matrix` has both triangles. Raises MklNotFoundError."""
        self._library = mkl_library()
        self.threads = threads
        full = matrix.tobsr((3, 3))
        rows = np.repeat(np.arange(len(full.indptr) - 1), np.diff(full.indptr))
        upper = full.indices >= rows
        starts = np.concatenate([[0], np.cumsum(np.bincount(rows[upper], minlength=len(full.indptr) - 1))])
        self._starts = starts.astype(np.int32)
        self._columns = full.indices[upper].astype(np.int32)
        self._values = np.ascontiguousarray(full.data[upper])
        self.y = np.empty(matrix.shape[0])
        self._handle = ctypes.c_void_p()
        self._description = _Description(_SYMMETRIC, _UPPER, _NON_UNIT)
        count = len(self._starts) - 1
        self._call(
            "mkl_sparse_d_create_bsr",
            ctypes.byref(self._handle),
            ctypes.c_int(_ZERO_BASED),
            ctypes.c_int(_ROW_MAJOR),
            ctypes.c_int(count),
            ctypes.c_int(count),
            ctypes.c_int(3),
            ctypes.c_void_p(self._starts.ctypes.data),
            ctypes.c_void_p(self._starts.ctypes.data + self._starts.itemsize),
            ctypes.c_void_p(self._columns.ctypes.data),
            ctypes.c_void_p(self._values.ctypes.data),
        )
        self._library.MKL_Set_Num_Threads(ctypes.c_int(threads))
        hint = (ctypes.c_int(_NO_TRANSPOSE), self._description, ctypes.c_int(_CALLS_EXPECTED))
        self._call("mkl_sparse_set_mv_hint", self._handle, *hint)
        self._call("mkl_sparse_optimize", self._handle)

    def multiply(self, x: FloatArray) -> FloatArray:
        """The product, in `y`."""
        self._library.MKL_Set_Num_Threads(ctypes.c_int(self.threads))
        self._call(
            "mkl_sparse_d_mv",
            ctypes.c_int(_NO_TRANSPOSE),
            ctypes.c_double(1.0),
            self._handle,
            self._description,
            ctypes.c_void_p(x.ctypes.data),
            ctypes.c_double(0.0),
            ctypes.c_void_p(self.y.ctypes.data),
        )
        return self.y

    def _call(self, name: str, *arguments: object) -> None:
        status = getattr(self._library, name)(*arguments)
        if status != 0:
            raise RuntimeError(f"{name} of MKL returned status {status}")


def mkl_library() -> ctypes.CDLL:
    """MKL's single library, of the wheel `mkl` or of the system. Raises MklNotFoundError."""
    found = find_library("mkl_rt")
    names = [found] if found else []
    for folder in (sys.prefix, site.USER_BASE):
        if folder is not None:
            names += sorted(str(path) for path in Path(folder, "lib").glob("libmkl_rt.so*"))
    for name in names:
        try:
            return ctypes.CDLL(name)
        except OSError:
            continue
    raise MklNotFoundError("no MKL; to have it: pip install mkl")
