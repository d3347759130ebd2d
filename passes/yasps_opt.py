"""`yasps-opt`: runs any pass on textual IR, as `mlir-opt` does."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from xdsl.ir import Dialect
from xdsl.passes import ModulePass
from xdsl.universe import Universe
from xdsl.xdsl_opt_main import xDSLOptMain

from yasps.dialects.mat import Mat
from yasps.dialects.rel import Rel
from yasps.passes.pipeline import PIPELINE


def _dialects() -> dict[str, Callable[[], Dialect]]:
    return {"rel": lambda: Rel, "mat": lambda: Mat}


def _passes() -> dict[str, Callable[[], type[ModulePass]]]:
    ours = [type(p) for p in PIPELINE if type(p).__module__.startswith("yasps")]
    return {p.name: (lambda p=p: p) for p in ours}  # type: ignore[misc]


UNIVERSE = Universe(all_dialects=_dialects(), all_passes=_passes())
"""Entry point `xdsl.universe`: stock `xdsl-opt` knows our dialects and passes too."""


class YaspsOptMain(xDSLOptMain):
    """`xdsl-opt` under our name; our dialects and passes reach both through `UNIVERSE`."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the command `yasps-opt`."""
    YaspsOptMain(description="yasps IR: runs passes on textual IR", args=arguments).run()  # type: ignore[no-untyped-call]


__all__ = ["UNIVERSE", "YaspsOptMain", "main"]
