"""Breaks derivative and index rules one by one and says which property tests notice. Not a test: run it by hand.

    python tests/properties/mutation_check.py [number ...]

Each is made in a temporary copy of the project, where property tests run without shrinking: expressions for the
rules of operations, scenes for the rest. A rule nobody misses when it is wrong is a rule that is not tested.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("yasps", "dialects", "passes", "frontend", "backend", "runtime", "examples", "tests", "pyproject.toml")
MOST_SECONDS = 900


@dataclass(frozen=True)
class Mutation:
    """One line made wrong."""

    title: str
    file: str
    right: str
    wrong: str
    tests: str = "tests/properties"


MUTATIONS = (
    Mutation(
        "cross: a sign in the pullback",
        "dialects/mat/algebra.py",
        "return (b.cross(y, cotangent), b.cross(cotangent, x))",
        "return (b.cross(y, cotangent), b.cross(x, cotangent))",
        "tests/properties/test_expressions.py",
    ),
    Mutation(
        "matmul: a term of the pushforward",
        "dialects/mat/algebra.py",
        "return b.total((dx and b.matmul(dx, y), dy and b.matmul(x, dy)))",
        "return b.total((dx and b.matmul(dx, y),))",
        "tests/properties/test_expressions.py",
    ),
    Mutation(
        "cofactor 3x3: a sign of its derivative",
        "dialects/mat/algebra.py",
        "b.cross(b.row(matrix, after), b.row(direction, last)),",
        "b.cross(b.row(direction, last), b.row(matrix, after)),",
        "tests/properties/test_expressions.py",
    ),
    Mutation(
        "divide: a sign in the pullback",
        "dialects/mat/elementwise.py",
        "return (to_matrix, b.neg(b.dot(to_matrix, self.result)))",
        "return (to_matrix, b.dot(to_matrix, self.result))",
        "tests/properties/test_expressions.py",
    ),
    Mutation(
        "pow: the exponent of its derivative",
        "dialects/mat/elementwise.py",
        "b.power(self.operands[0], self.power - 1.0))",
        "b.power(self.operands[0], self.power - 2.0))",
        "tests/properties/test_expressions.py",
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
        "tests/properties/test_expressions.py",
    ),
    Mutation(
        "select: its pull-back exchanges the two sides",
        "dialects/mat/comparison.py",
        "b.select(condition, cotangent, zero), b.select(condition, zero, cotangent))",
        "b.select(condition, zero, cotangent), b.select(condition, cotangent, zero))",
        "tests/properties/test_expressions.py",
    ),
    Mutation(
        "a choice between numbers: the guards of its sides exchanged",
        "passes/derivatives.py",
        "guard_first, guard_second = guards.split(",
        "guard_second, guard_first = guards.split(",
        "tests/properties/test_expressions.py",
    ),
    Mutation(
        "minimum: the derivative of the greater",
        "dialects/mat/comparison.py",
        "return b.less(self.operands[1], self.operands[0])",
        "return b.less(self.operands[0], self.operands[1])",
        "tests/properties/test_expressions.py",
    ),
    Mutation(
        "maximum: the derivative of the second at a tie",
        "dialects/mat/comparison.py",
        "return b.less(self.operands[0], self.operands[1])",
        "return b.less_equal(self.operands[0], self.operands[1])",
        "tests/properties/test_expressions.py",
    ),
    Mutation(
        "abs: slope 1 at 0",
        "dialects/mat/comparison.py",
        "b.select(b.less(zero, x), one, zero))",
        "one)",
        "tests/properties/test_expressions.py",
    ),
    Mutation(
        "comparisons: <= lowered as <",
        "dialects/mat/comparison.py",
        "s.compare(self.predicate.data, a, b)",
        's.compare("lt", a, b)',
        "tests/properties/test_expressions.py",
    ),
    Mutation(
        "acos: the sign of its derivative",
        "dialects/mat/trigonometry.py",
        "return b.neg(_arcsine_derivative(b, self.operands[0]))",
        "return _arcsine_derivative(b, self.operands[0])",
        "tests/properties/test_expressions.py",
    ),
    Mutation(
        "atan2: a sign in the pullback",
        "dialects/mat/trigonometry.py",
        "return (b.hadamard(by_y, cotangent), b.neg(b.hadamard(by_x, cotangent)))",
        "return (b.hadamard(by_y, cotangent), b.hadamard(by_x, cotangent))",
        "tests/properties/test_expressions.py",
    ),
    Mutation(
        "reverse mode: cotangents of several uses not added",
        "passes/derivatives.py",
        "parts.setdefault(op.operands[k], []).append(part)",
        "parts[op.operands[k]] = [part]",
        "tests/properties/test_expressions.py",
    ),
    Mutation(
        "infer-indices: a union's capacity is its smallest member's",
        "passes/infer_indices.py",
        "capacity = max(",
        "capacity = min(",
        "tests/properties/test_scenes.py",
    ),
    Mutation(
        "kernels: a target's placement index off by one instance's",
        "backend/object_text.py",
        'return [f"{out}[0] = (int)({start}[0]{offset} + 1);"]',
        'return [f"{out}[0] = (int)({start}[0]{offset} + 2);"]',
        "tests/properties/test_scenes.py",
    ),
    Mutation(
        "kernels: a union's branches all start at 0 in the pull-back",
        "backend/object_text.py",
        "const long j = i - {offsets}[{k}]; (void)j; {statement(member)}",
        "const long j = i - {offsets}[0]; (void)j; {statement(member)}",
        "tests/properties/test_scenes.py",
    ),
    Mutation(
        "kernels: transpose flag ignored in add_block",
        "backend/kernel_prelude.h",
        "} else if (position & 1) {",
        "} else if (position & 0) {",
        "tests/properties/test_scenes.py",
    ),
    Mutation(
        "runtime: no flag for two slots that are one block",
        "runtime/block_matrix.cpp",
        "(a != b && i_block == j_block ? 2u : 0u)",
        "(a < 0 && i_block == j_block ? 2u : 0u)",
        "tests/properties/test_scenes.py",
    ),
    Mutation(
        "curvature: what lies behind a nonlinear layer is dropped",
        "backend/cpp_curvature.py",
        "if any(text.scene.is_curved(slot.source) for slot in slots):\n        lines += transposed",
        "if False:\n        lines += transposed",
        "tests/properties/test_scenes.py",
    ),
    Mutation(
        "congruence: its pull-back of a column pairs it with itself",
        "dialects/mat/calculus.py",
        "return s.dot(columns[a], applied[b])",
        "return s.dot(columns[a], applied[a])",
        "tests/properties/test_scenes.py",
    ),
    Mutation(
        "project-psd: abs and clamp exchanged in the scalar code",
        "passes/lower_to_scalar.py",
        "projection.mode.data",
        '("abs" if projection.mode.data == "clamp" else "clamp")',
        "tests/properties/test_scenes.py",
    ),
    Mutation(
        "device: blocks of a slot with itself are expanded from both sides",
        "backend/cuda_expand.py",
        'begin = "s" if other is one else "0"',
        'begin = "0"',
        "tests/properties/test_scenes.py::test_kernels_of_devices",
    ),
    Mutation(
        "device: what lies behind a nonlinear layer is dropped",
        "backend/cuda_expand.py",
        "return [*lines, *transposed, *behind] if behind else lines",
        "return lines",
        "tests/properties/test_scenes.py::test_layers_of_layers_on_devices",
    ),
    Mutation(
        "device: two slots that are the same unknowns add a block once",
        "backend/cuda_prelude.cuh",
        "both ? b[r * C + c] + b[c % R * C + r % C] : b[r * C + c]",
        "b[r * C + c]",
        "tests/properties/test_scenes.py::test_kernels_of_devices",
    ),
    Mutation(
        "device: merged slots add an entry of the diagonal once",
        "backend/cuda_dense_prelude.cuh",
        "r != c && to[r] == to[c] ? 2.0 * value : value",
        "value",
        "tests/properties/test_scenes.py::test_kernels_of_devices",
    ),
    Mutation(
        "device: means are not divided in the pull-back",
        "backend/cuda_object.py",
        'if slot.reduction == "mean":\n            lines += ["    if (from)"',
        'if slot.reduction == "sum":\n            lines += ["    if (from)"',
        "tests/properties/test_scenes.py::test_kernels_of_devices",
    ),
)


def run(mutation: Mutation, folder: Path) -> tuple[list[str], str]:
    """Names of the tests that fail, and what pytest said last."""
    path = folder / mutation.file
    text = path.read_text(encoding="utf-8")
    if text.count(mutation.right) != 1:
        return [], f"NOT APPLIED: the text occurs {text.count(mutation.right)} times in {mutation.file}"
    path.write_text(text.replace(mutation.right, mutation.wrong), encoding="utf-8")
    environment = {
        **os.environ,
        "PYTHONPATH": str(folder),
        "YASPS_HYPOTHESIS_PROFILE": "mutation",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    try:
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-rf", "-p", "no:cacheprovider", "--tb=line", mutation.tests],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=MOST_SECONDS,
            check=False,
        )
    finally:
        path.write_text(text, encoding="utf-8")
    failed = list(dict.fromkeys(re.findall(r"^FAILED \S+::(\w+)", done.stdout, re.MULTILINE)))
    if done.returncode < 0:  # kernels that read out of bounds
        failed.append(f"a crash by signal {-done.returncode}")
    return failed, done.stdout.strip().splitlines()[-1] if done.stdout.strip() else done.stderr[-300:]


def main() -> int:
    """Prints a table; the exit status is the number of mutations that nobody noticed."""
    chosen = [MUTATIONS[int(k) - 1] for k in sys.argv[1:]] or list(MUTATIONS)
    unnoticed = 0
    with tempfile.TemporaryDirectory(prefix="yasps-mutations-") as temporary:
        folder = Path(temporary)
        for name in FOLDERS:
            source = ROOT / name
            if source.is_dir():
                shutil.copytree(source, folder / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(source, folder / name)
        print("| broken rule | noticed by |\n|---|---|", flush=True)
        for mutation in chosen:
            failed, said = run(mutation, folder)
            unnoticed += not failed
            print(f"| {mutation.title} | {', '.join(failed) or f'**nobody** ({said})'} |", flush=True)
    return unnoticed


if __name__ == "__main__":
    sys.exit(main())
