"""What random scenes compute: energies, and points with kinks, as the text that a user would type.

Everything is smooth where it is drawn. Numbers of scenes have three digits, so what is compared with them is shifted by
odd ones: products of few such numbers never tie, and equal points don't either. Poles and branch cuts are out of reach
for any numbers.
"""

from __future__ import annotations


def shift(dimension: int, number: float = 0.1234567) -> str:
    """A column of one number that nothing ties with."""
    return f"np.full(({dimension}, 1), {number})"


def energies(y: str, z: str, dimension: int) -> list[str]:
    """Numbers from two column vectors of `dimension` entries."""
    return [*plain_energies(y, z), *kinked_energies(y, z, dimension), *angles(y, z)]


def plain_energies(y: str, z: str) -> list[str]:
    """Without comparisons."""
    return [
        f"(({y} - {z}).dot({y} - {z}) - 0.5) ** 2",
        f"{y}.dot({z})",
        f"9.8 * {y}[0] - {z}.sum()",
        f"(1.0 + {y}.dot({y})).log() * 2.0 + {z}[-1]",
        f"({y}.dot({z}) + 0.3 * {y}[0]).sin()",
        f"(0.5 * {y}.sum() - {z}.dot({z})).exp()",
        f"(0.25 + ({y} - 2.0 * {z}).dot({y} - 2.0 * {z})).sqrt() - {y}.dot({y})",
        f"({y} * {z}.T).trace() * {y}[0] + ({y} * {y}.T + 0.5 * {z} * {z}.T)[0, -1]",
        f"{z}[0]",
    ]


def kinked_energies(y: str, z: str, dimension: int) -> list[str]:
    """With comparisons, choices, extrema and absolute values."""
    d = shift(dimension)
    apart = f"(0.01 + ({y} - {z}).dot({y} - {z}))"
    return [
        # whole choices: both sides curved, one side constant, one chosen inside another, one not finite
        f"select({y}[0] < 0.0987654, {y}.dot({z}), {z}.dot({z}) ** 2 - {y}.sum())",
        f"select({apart} < 0.8765431, -(({apart} - 0.8765431) ** 2) * {apart}.log(), 0.0)",
        f"select({y}.sum() >= 0.0876543, select({z}[0] > 0.2345671, {y}.dot({z}), {z}[0] ** 3), {y}.dot({y}) ** 2)",
        f"select({y}[0] <= 0.0765432, (0.3 - {y}[0]).sqrt() * {z}[-1], {y}.dot({z}))",
        # entry by entry
        f"select({y} < {z} + {d}, {y}.hadamard({z}), {z}.sin()).sum()",
        f"(({y} > {d}) - 0.5 * ({z} <= {d})).dot({y}.hadamard({z}))",
        f"maximum({y}, {z}.hadamard({z}) - {d}).dot({y})",
        f"({y} - {z} + {d}).abs().sum() ** 2 + {z}[0]",
        # numbers
        f"minimum({y}.dot({y}), {z}.sum() + 0.1728394) * {z}[0]",
        f"maximum({y}.sum() - 0.1839405, 0.0) ** 3 + {y}.dot({z})",
        f"abs({y}.dot({z}) - 0.1940516) * {y}[-1]",
    ]


def angles(y: str, z: str) -> list[str]:
    """Angles and their functions."""
    return [
        f"atan2({y}.sum(), 1.5 + {z}.dot({z})) * {z}[0]",
        f"atan2(0.5 + {z}.dot({z}), {y}[0]) ** 2",
        f"atan2(-(0.5 + {y}.dot({z}) ** 2), {z}[-1] - {y}[0])",
        f"(0.9 * {y}.dot({z}) / ((1.0 + {y}.dot({y})) * (1.0 + {z}.dot({z}))).sqrt()).acos()",
        f"(0.9 * {y}.sin()).asin().dot({z})",
        f"(0.5 * ({y}.dot({z})).cos()).tan() + {y}[0]",
    ]


def kinked_points(q: str, dimension: int) -> list[str]:
    """Vectors from a vector of as many entries; all but the first from entries that are at most 1."""
    d = shift(dimension)
    return [
        f"select({q} < {d}, 0.5 * {q}, {q}.hadamard({q}))",
        f"select({q}[0] < 0.1357913, 0.5 * {q}, {q}.hadamard({q}))",
        f"(maximum({q}, {q}.hadamard({q}) - {d}) - 0.5 * minimum({q}, {d}))",
        f"({q} - {d}).abs()",
        f"{q}.tan()",
        f"((0.9 * {q}).asin() - 0.5 * (0.8 * {q}).acos())",
        f"atan2({q}, {shift(dimension, 1.5)} + {q})",
    ]


def kinked_mixtures(first: str, last: str, dimension: int) -> list[str]:
    """Vectors from two vectors of as many entries, which may be the same."""
    d = shift(dimension)
    return [
        f"select({first}[0] < {last}[0] + 0.1470258, {first}, 0.5 * {last})",
        f"select({first}.dot({last}) > 0.1593572, {first}.hadamard({last}), {first})",
        f"maximum({first}, {last} - {d})",
        f"minimum({first}, {last}.hadamard({last}) + {d})",
        f"({first} - {last} + {d}).abs()",
        f"atan2({first}, {shift(dimension, 1.5)} + {last}.hadamard({last}))",
        f"(0.9 * {first}.sin()).asin() + (0.5 * {last}.sin()).tan()",
    ]
