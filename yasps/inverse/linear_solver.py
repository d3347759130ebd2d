"""Solutions with the exact Hessian of a step, which may be indefinite, or without symmetry."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

from yasps import FloatArray, NotConvergedError

LARGE = 60_000
"""Unknowns from which on MINRES solves symmetric systems."""
MINRES_TOLERANCE = 1e-13
"""Of MINRES, relative."""
MINRES_ITERATIONS = 20_000
ACCURATE = 1e-6
"""Relative residual above which a solution is none."""


class StepSolver:
    """Solves A x = b and A^T x = b for one matrix of a step; A [n, n]. Raises NotConvergedError."""

    def __init__(self, matrix: sparse.csc_array[np.float64], where: str, *, is_symmetric: bool) -> None:
        """where: which step, for messages."""
        self._matrix, self._where, self._is_symmetric = matrix, where, is_symmetric
        self._factors: linalg.SuperLU | None = None
        if is_symmetric and matrix.shape[0] > LARGE:
            self._scale = 1 / np.sqrt(np.maximum(np.abs(matrix.diagonal()), np.finfo(np.float64).tiny))
            return
        # Pivots on the diagonal keep a symmetric matrix sparse; partial pivoting takes over where one is small.
        try:
            if is_symmetric:
                self._factors = linalg.splu(
                    matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options={"SymmetricMode": True}
                )
            else:
                self._factors = linalg.splu(matrix)
        except RuntimeError as error:
            raise NotConvergedError(
                f"the Hessian at {where} is singular ({error}): something there is held by no energy, so its place does"
                " not follow from the parameters"
            ) from None

    def solve(self, b: FloatArray, *, transposed: bool = False) -> FloatArray:
        """x for columns b, [n, columns]. Raises NotConvergedError if the solution is not accurate."""
        matrix = self._matrix.T if transposed else self._matrix
        x = self._solve_once(b, transposed=transposed)
        x = x + self._solve_once(b - matrix @ x, transposed=transposed)
        left = np.linalg.norm(b - matrix @ x, axis=0)
        if not np.isfinite(x).all() or (left > ACCURATE * np.linalg.norm(b, axis=0)).any():
            raise NotConvergedError(
                f"the linear system at {self._where} has no accurate solution (residual {left.max():.3g}): its Hessian"
                " is nearly singular"
            )
        return x

    def _solve_once(self, b: FloatArray, *, transposed: bool) -> FloatArray:
        if self._factors is not None:
            return np.asarray(self._factors.solve(b, trans="T") if transposed else self._factors.solve(b))  # type: ignore[call-overload]
        return np.stack([self._by_minres(column) for column in b.T], axis=1)

    def _by_minres(self, b: FloatArray) -> FloatArray:
        """With the roots of the diagonal on both sides."""
        if not b.any():
            return np.zeros_like(b)
        scaling = sparse.diags_array(self._scale)
        x, info = linalg.minres(
            scaling @ self._matrix @ scaling, self._scale * b, rtol=MINRES_TOLERANCE, maxiter=MINRES_ITERATIONS
        )
        if info > 0:
            raise NotConvergedError(f"MINRES at {self._where} did not converge in {MINRES_ITERATIONS} iterations")
        return np.asarray(self._scale * x)
