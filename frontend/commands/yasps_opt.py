"""`yasps-opt`: runs passes on textual IR, as `mlir-opt` does, and says what a module amounts to in numbers.

Two dumps mean the same if `yasps-opt --interpret dump/data.npz` says the same of them.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser, ArgumentTypeError
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.sparse.linalg import norm as sparse_norm
from xdsl.dialects.builtin import ModuleOp
from xdsl.utils.exceptions import ParseError

from yasps.backend.reference.interpreter import Interpreter
from yasps.backend.reference.scene_data import (
    SceneData,
    SceneDataError,
    check_scene_data,
    load_scene_data,
    random_scene_data,
)
from yasps.dialects.rel import name_of
from yasps.passes.errors import CompileError
from yasps.passes.yasps_opt import DESCRIPTION, YaspsOptMain, damage_as_compile_error


class InterpretingOptMain(YaspsOptMain):
    """With `--interpret` and `--random`, which evaluate the module after the passes by the reference interpreter."""

    def register_all_arguments(self, arg_parser: ArgumentParser) -> None:
        """Those of the passes alone, and what the interpreter needs."""
        super().register_all_arguments(arg_parser)
        numbers = arg_parser.add_mutually_exclusive_group()
        numbers.add_argument(
            "--interpret",
            metavar="DATA",
            type=Path,
            help="Print what the module computes instead of the module, on the numbers of an .npz or .json file "
            "(scene.dump_ir writes data.npz).",
        )
        numbers.add_argument(
            "--random",
            metavar="N",
            type=_instances,
            help="The same on random numbers, with N instances of each primitive.",
        )
        arg_parser.add_argument("--seed", type=int, default=0, help="Of the random numbers; default 0.")

    def output_resulting_program(self, prog: ModuleOp) -> str:
        """The module as text, or what it computes."""
        if self.args.interpret is not None:
            data = load_scene_data(self.args.interpret)
        elif self.args.random is not None:
            data = random_scene_data(prog, self.args.random, self.args.seed)
        else:
            return super().output_resulting_program(prog)
        with damage_as_compile_error("interpreting the module"):
            return interpreted(prog, data)


def _instances(word: str) -> int:
    if not word.isdecimal() or int(word) < 1:
        raise ArgumentTypeError(f"{word!r} is not a number of instances, 1 or more")
    return int(word)


def interpreted(module: ModuleOp, data: SceneData) -> str:
    """A line for each energy (value, Euclidean norm of its gradient, Frobenius norm of its Hessian) and each output.

    Values are sums over all instances. Derivatives are there from `differentiate` on; Hessians are as the module has
    them, projected from `project-psd` on. Raises SceneDataError for numbers that don't fit the module.
    """
    check_scene_data(module, data)
    interpreter = Interpreter(module, data)
    scene = interpreter.scene
    derivatives = {name_of(op.attribute): op for op in scene.derivatives}
    lines = []
    for energy in scene.energies:
        name = name_of(energy.attribute)
        line = f"energy @{name}: value {interpreter.value(name).sum():.12g}"
        if derivatives:
            scene.derivatives = [derivatives[name]] if name in derivatives else []
            line += _norms(interpreter)
        lines.append(line)
    if len(scene.energies) > 1:
        line = f"all energies: value {interpreter.total_energy():.12g}"
        if derivatives:
            scene.derivatives = list(derivatives.values())
            line += _norms(interpreter)
        lines.append(line)
    outputs = [op.symbol for op in scene.attributes.values() if op.output is not None]
    lines += [f"output @{name}: norm {np.linalg.norm(interpreter.value(name)):.12g}" for name in outputs]
    return "\n".join(lines) + "\n" if lines else "nothing to compute: no energy, no output\n"


def _norms(interpreter: Interpreter) -> str:
    gradient, hessian = interpreter.assemble()
    return f", gradient {np.linalg.norm(gradient):.12g}, Hessian {sparse_norm(hessian):.12g}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of the command `yasps-opt`; returns the exit status. Errors about the input go to stderr, short."""
    try:
        InterpretingOptMain(description=DESCRIPTION, args=arguments).run()  # type: ignore[no-untyped-call]
    except (CompileError, ParseError, SceneDataError, OSError) as error:
        print(f"yasps-opt: {error}", file=sys.stderr)
        return 1
    return 0


__all__ = ["InterpretingOptMain", "interpreted", "main"]
