"""`yasps-opt`: runs any pass on textual IR, as `mlir-opt` does."""

from __future__ import annotations

import re
from argparse import ArgumentParser
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from typing import IO

from xdsl.dialects.builtin import ModuleOp
from xdsl.ir import Dialect
from xdsl.passes import ModulePass, PassPipeline
from xdsl.universe import Universe
from xdsl.utils.exceptions import ParseError, ShrinkException
from xdsl.xdsl_opt_main import xDSLOptMain

from yasps.dialects.mat import Mat
from yasps.dialects.rel import Rel
from yasps.passes.errors import CompileError
from yasps.passes.ir_text import text_of
from yasps.passes.pipeline import PIPELINE, Verifier, run_passes

DESCRIPTION = "Runs passes on the textual IR of yasps."


def _dialects() -> dict[str, Callable[[], Dialect]]:
    return {"rel": lambda: Rel, "mat": lambda: Mat}


def _passes() -> dict[str, Callable[[], type[ModulePass]]]:
    ours = [type(p) for p in PIPELINE if type(p).__module__.startswith("yasps")]
    return {p.name: (lambda p=p: p) for p in ours}  # type: ignore[misc]


UNIVERSE = Universe(all_dialects=_dialects(), all_passes=_passes())
"""Entry point `xdsl.universe`: stock `xdsl-opt` knows our dialects and passes too."""


_COMMENT_OR_STRING = re.compile(r"""//[^\n]*|"(?:[^"\\\n\v\f]|\\(?:["nt\\]|[0-9A-Fa-f]{2}))*(?P<end>"?)""")


def check_strings_end(text: str) -> None:
    """Raises CompileError for a string that does not end, over which xDSL's lexer takes time exponential in its length
    (0.74.0)."""
    for match in _COMMENT_OR_STRING.finditer(text):
        if match["end"] == "":
            line = text.count("\n", 0, match.start()) + 1
            raise CompileError(f"line {line}: the string {match.group()[:40]} does not end")


@contextmanager
def damage_as_compile_error(while_doing: str) -> Iterator[None]:
    """What parsers, passes and the interpreter trip over in IR that was never meant becomes a CompileError.

    Laws are checked before passes run, but text can break more rules than there are checks.
    """
    try:
        yield
    except (CompileError, ParseError, ShrinkException):
        raise
    except Exception as error:
        told = f"{type(error).__name__}: {error}".splitlines()[0].rstrip(": ")
        raise CompileError(f"{while_doing}: this is no module that yasps could have made ({told})") from error


class YaspsOptMain(xDSLOptMain):
    """`xdsl-opt` under our name; our dialects and passes reach both through `UNIVERSE`.

    What passes and verifiers raise is a CompileError, and `--locations` prints the place of each attribute.
    """

    def register_all_arguments(self, arg_parser: ArgumentParser) -> None:
        """Those of `xdsl-opt`, and `--locations`."""
        super().register_all_arguments(arg_parser)
        arg_parser.add_argument(
            "--locations",
            default=False,
            action="store_true",
            help="Print behind each attribute the line of Python that made it, where the input says so.",
        )

    def setup_pipeline(self) -> None:
        """As upstream, with our verifier between the passes: its errors name the attribute."""
        try:
            super().setup_pipeline()  # type: ignore[no-untyped-call]
        except ValueError as error:  # of an unknown pass
            raise CompileError(str(error)) from error
        theirs, verifier = self.pipeline.callback, Verifier()

        def callback(previous: ModulePass | None, module: ModuleOp, following: ModulePass | None) -> None:
            if not self.args.disable_verify:
                verifier.verify(module, previous)
            if theirs is not None:
                theirs(previous, module, following)

        self.pipeline = PassPipeline(self.pipeline.passes, callback)

    def prepare_input(self) -> tuple[list[tuple[IO[bytes], int]], str]:
        """As upstream; raises CompileError for a file that does not end in `.mlir`."""
        try:
            return super().prepare_input()
        except ValueError as error:
            raise CompileError(str(error)) from error

    def parse_chunk(self, chunk: IO[bytes], file_extension: str, start_offset: int = 0) -> ModuleOp | None:
        """As upstream; raises CompileError for what is no text, and ParseError."""
        with damage_as_compile_error("reading the input"):
            if file_extension == "mlir":
                content = chunk.read()
                chunk.close()
                check_strings_end(content.decode("utf-8"))
                chunk = BytesIO(content)
            return super().parse_chunk(chunk, file_extension, start_offset)

    def apply_passes(self, prog: ModuleOp) -> None:
        """Applies the passes in order; raises CompileError."""
        with damage_as_compile_error("running the passes"):
            run_passes(self.pipeline, self.ctx, prog)

    def output_resulting_program(self, prog: ModuleOp) -> str:
        """The module as text."""
        otherwise = self.args.print_op_generic or self.args.print_debuginfo or self.args.print_no_properties
        if self.args.target == "mlir" and not otherwise:
            return text_of(prog, locations=self.args.locations)
        return super().output_resulting_program(prog)


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs passes on textual IR; the command `yasps-opt` (frontend/commands/yasps_opt.py) is this and more.

    Raises CompileError, and xDSL's ParseError for text that is no IR.
    """
    YaspsOptMain(description=DESCRIPTION, args=arguments).run()  # type: ignore[no-untyped-call]


__all__ = ["DESCRIPTION", "UNIVERSE", "YaspsOptMain", "main"]
