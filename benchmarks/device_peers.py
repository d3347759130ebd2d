"""Other people's sparse matrices on a GPU: cuSPARSE as CuPy and PyTorch call it."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse


@dataclass(frozen=True)
class GpuWork:
    """work: asks a library for one piece; synchronize: waits for it; to_host: the piece as NumPy's array."""

    name: str
    work: Callable[[], Any]
    synchronize: Callable[[], object]
    to_host: Callable[[Any], NDArray[np.float64]]

    def run(self, times: int) -> None:
        """So many pieces, and waits."""
        for _ in range(times):
            self.work()
        self.synchronize()

    def result(self) -> NDArray[np.float64]:
        """One piece."""
        return self.to_host(self.work())


def products_of(matrix: sparse.csr_array[np.float64], x: NDArray[np.float64]) -> tuple[list[GpuWork], list[str]]:
    """Products with a matrix on the GPU, and which libraries do not work here."""
    makers = {
        "cupy": lambda: [cupy_product(_cupy(), matrix, x)],
        "torch": lambda: torch_products(_torch(), "cuda", matrix, x),
    }
    return _working(makers)


def _working(makers: Mapping[str, Callable[[], list[GpuWork]]]) -> tuple[list[GpuWork], list[str]]:
    """What libraries do that work here, each done once, and why others do not."""
    found, missing = [], []
    for package, make in makers.items():
        try:
            made = make()
            for one in made:
                one.run(1)
        except (ImportError, RuntimeError) as error:
            missing.append(f"No rows for {package}: {' '.join(str(error).split())[:300]}.")
        else:
            found += made
    return found, missing


def cupy_product(cupy: Any, matrix: sparse.csr_array[np.float64], x: NDArray[np.float64]) -> GpuWork:
    """cuSPARSE's CSR through CuPy."""
    there, vector = import_module("cupyx.scipy.sparse").csr_matrix(sparse.csr_matrix(matrix)), cupy.asarray(x)
    return GpuWork(
        f"CuPy {cupy.__version__} CSR", lambda: there @ vector, cupy.cuda.runtime.deviceSynchronize, cupy.asnumpy
    )


def torch_products(
    torch: Any, place: str, matrix: sparse.csr_array[np.float64], x: NDArray[np.float64]
) -> list[GpuWork]:
    """cuSPARSE's CSR and BSR (of 3x3 blocks) through PyTorch."""
    vector = torch.from_numpy(x).to(place)
    blocks = matrix.tobsr((3, 3))
    parts = {
        "CSR": (torch.sparse_csr_tensor, matrix.indptr, matrix.indices, matrix.data),
        "BSR": (torch.sparse_bsr_tensor, blocks.indptr, blocks.indices, blocks.data),
    }
    wait = torch.cuda.synchronize if place == "cuda" else _nothing
    found = []
    for name, (make, starts, columns, values) in parts.items():
        arrays = [torch.from_numpy(np.ascontiguousarray(array)).to(place) for array in (starts, columns, values)]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that it is a beta version
            there = make(*arrays, size=matrix.shape)
        found.append(_torch_product(f"PyTorch {torch.__version__} {name}", there, vector, wait))
    return found


def _torch_product(name: str, there: Any, vector: Any, wait: Callable[[], object]) -> GpuWork:
    return GpuWork(name, lambda: there @ vector, wait, lambda result: result.cpu().numpy())


def _nothing() -> None:
    pass


def structures_of(count: int, corners: NDArray[np.int32]) -> tuple[list[GpuWork], list[str]]:
    """Which blocks there are, by other libraries on the GPU, and which do not work here."""
    return _working({"cupy": lambda: [cupy_structure(_cupy(), count, corners)]})


def cupy_structure(cupy: Any, count: int, corners: NDArray[np.int32]) -> GpuWork:
    """CuPy's COO to CSR of one entry for each pair of corners."""
    coo: Any = import_module("cupyx.scipy.sparse")
    n, slots = corners.shape
    rows = cupy.asarray(np.broadcast_to(corners[:, :, None], (n, slots, slots)).reshape(-1))
    cols = cupy.asarray(np.broadcast_to(corners[:, None, :], (n, slots, slots)).reshape(-1))
    ones = cupy.ones(rows.size, np.float32)

    def work() -> Any:
        return coo.coo_matrix((ones, (rows, cols)), shape=(count, count)).tocsr()

    name = f"CuPy {cupy.__version__} COO to CSR"
    return GpuWork(name, work, cupy.cuda.runtime.deviceSynchronize, lambda result: cupy.asnumpy(result.data))


def _cupy() -> Any:
    cupy: Any = import_module("cupy")
    if not cupy.is_available():
        raise ImportError("CuPy sees no GPU")
    return cupy


def _torch() -> Any:
    torch: Any = import_module("torch")
    if not torch.cuda.is_available():
        raise ImportError("PyTorch sees no GPU")
    return torch
