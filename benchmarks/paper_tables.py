"""What the paper published: its tables 1 to 3 and 6 (RTX 4090, i9-13900F), for standing beside ours.

Its figures 19, 20, 22 to 28 and 30 give no numbers in the text but for those that the benchmarks' notes quote; figure
33 is computed from table 2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

MACHINE: Final = "the paper's GPU, an RTX 4090"


@dataclass(frozen=True)
class ClothsRow:
    """A row of table 1. Seconds of all frames; differentiation with projection and assembly; total is of the frames."""

    system: str
    vertices: int
    differentiation: float
    solver: float
    total: float
    newton: int
    cg: int
    frames: int


TABLE_1: Final[Sequence[ClothsRow]] = (
    ClothsRow("YASPS", 39_595, 53.25, 44.91, 139.31, 3_934, 597_428, 200),
    ClothsRow("YASPS, optimized", 39_595, 43.55, 44.82, 130.20, 3_939, 600_303, 200),
    ClothsRow("GIPC", 39_595, 25.46, 156.32, 199.06, 2_889, 160_751, 200),
    ClothsRow("YASPS", 49_796, 81.23, 68.91, 218.29, 5_132, 825_519, 200),
    ClothsRow("YASPS, optimized", 49_796, 65.17, 67.35, 201.26, 5_055, 811_759, 200),
    ClothsRow("GIPC", 49_796, 49.02, 264.09, 342.76, 3_313, 200_886, 200),
    ClothsRow("YASPS", 59_997, 124.64, 95.36, 328.51, 6_564, 1_036_455, 200),
    ClothsRow("YASPS, optimized", 59_997, 98.09, 93.83, 300.62, 6_448, 1_022_530, 200),
    ClothsRow("GIPC", 59_997, 92.13, 439.22, 586.46, 8_287, 655_328, 200),
    ClothsRow("STARK", 59_997, 29.1, 110.9, 141.90, 233, 122_357, 64),
)


@dataclass(frozen=True)
class MatRow:
    """A row of table 2: 2,000 frames. Seconds; memory in 1e6 bytes (the paper's MB), without that of its CCD."""

    vertices: int
    pairs: int
    collision: float
    differentiation: float
    solver: float
    least_memory: float
    most_memory: float


TABLE_2_FRAMES: Final = 2_000
TABLE_2: Final[Sequence[MatRow]] = (
    MatRow(10_000, 109_898, 172.69, 109.93, 30.58, 2027.75, 2086.87),
    MatRow(40_000, 467_006, 224.77, 356.51, 54.85, 2137.00, 2248.47),
    MatRow(90_000, 1_097_477, 305.79, 705.38, 120.90, 2361.39, 2766.01),
    MatRow(160_000, 2_014_214, 435.10, 1190.16, 248.65, 2562.66, 3290.43),
    MatRow(250_000, 3_301_877, 609.22, 1839.86, 439.90, 2858.42, 4053.27),
    MatRow(360_000, 4_545_714, 682.14, 2277.02, 733.69, 3290.37, 4920.97),
    MatRow(490_000, 6_204_614, 933.33, 3147.01, 1161.76, 3694.46, 5866.13),
    MatRow(640_000, 8_393_014, 1170.94, 4111.04, 1780.36, 4209.83, 6529.87),
    MatRow(810_000, 10_798_135, 1516.92, 5381.39, 2524.11, 4806.68, 8428.46),
    MatRow(1_000_000, 12_806_211, 2054.95, 6828.68, 3819.17, 5427.57, 9718.21),
)


@dataclass(frozen=True)
class BunniesRow:
    """A row of table 3. separate: Hessian and Jacobian apart (10.9). Seconds; the most memory in MB; stack in KB."""

    soft: int
    affine: int
    separate: bool
    collision: float
    differentiation: float
    solver: float
    most_memory: float
    stack: float


TABLE_3: Final[Sequence[BunniesRow]] = (
    BunniesRow(6, 0, False, 71.48, 137.36, 53.14, 2438.92, 8.72),
    BunniesRow(5, 1, False, 71.46, 188.78, 46.44, 10661.92, 43.53),
    BunniesRow(5, 1, True, 73.73, 192.48, 46.61, 5389.02, 21.28),
    BunniesRow(7, 0, False, 99.97, 192.31, 77.93, 2503.93, 8.72),
    BunniesRow(6, 1, False, 100.43, 257.92, 66.55, 10710.15, 43.53),
    BunniesRow(6, 1, True, 105.45, 277.91, 72.67, 5438.63, 21.28),
    BunniesRow(8, 0, False, 126.19, 246.42, 98.10, 5274.27, 8.72),
    BunniesRow(7, 1, False, 121.27, 331.57, 88.41, 10785.78, 43.53),
    BunniesRow(7, 1, True, 129.92, 329.18, 92.73, 5515.64, 21.28),
    BunniesRow(9, 0, False, 159.13, 313.58, 149.46, 11541.55, 8.72),
    BunniesRow(8, 1, False, 144.59, 387.55, 108.66, 10848.56, 43.53),
    BunniesRow(8, 1, True, 155.20, 392.04, 113.75, 5582.61, 21.28),
    BunniesRow(10, 0, False, 181.48, 358.41, 156.24, 2696.42, 8.72),
    BunniesRow(9, 1, False, 166.88, 434.80, 132.92, 10905.32, 43.53),
    BunniesRow(9, 1, True, 183.93, 462.10, 138.83, 5635.04, 21.28),
)


@dataclass(frozen=True)
class CageRow:
    """A column of table 6: 200 frames. Seconds; memory in MB."""

    differentiation: float
    solver: float
    newton: int
    cg: int
    most_memory: float
    files: int
    compile: float


TABLE_6_FRAMES: Final = 200
TABLE_6: Final[Mapping[str, CageRow]] = MappingProxyType(
    {
        "tet4": CageRow(143.35, 127.21, 2_428, 1_695_130, 15302.13, 595, 346.95),
        "hex8": CageRow(197.76, 114.55, 2_256, 1_535_411, 15820.91, 705, 458.60),
    }
)


def memory_growth(vertices: Sequence[int], least: Sequence[float]) -> list[float]:
    """Equation 11: how much the least memory grows for 10,000 vertices more, from each resolution to the next."""
    steps = zip(zip(vertices, least, strict=True), list(zip(vertices, least, strict=True))[1:], strict=False)
    return [1e4 * (m1 - m0) / (v1 - v0) for (v0, m0), (v1, m1) in steps]


def memory_of_pairs(least: Sequence[float], most: Sequence[float], pairs: Sequence[int]) -> list[float]:
    """Equation 12: memory beyond the least for 100,000 pairs, at each resolution; NaN without pairs."""
    return [
        1e5 * (high - low) / count if count else float("nan")
        for low, high, count in zip(least, most, pairs, strict=True)
    ]
