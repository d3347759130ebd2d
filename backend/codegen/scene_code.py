"""All generated code of a scene and what must be known to run it: what a second start needs instead of the passes."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass

from xdsl.dialects.builtin import ModuleOp

from yasps.backend.codegen.object_text import Binding, ObjectCode, ObjectEmitter
from yasps.backend.codegen.scene_view import SceneView
from yasps.dialects.rel import name_of


@dataclass(frozen=True)
class DerivativeCode:
    """Where an energy's derivatives are computed and placed.

    symbol: the object with the entry `derive`; indices: the integer attribute with the placement indices, or None when
    nothing is to be placed; capacity: how many of these an instance has.
    """

    symbol: str
    indices: str | None
    capacity: int


@dataclass(frozen=True)
class SceneCode:
    """codes: by the symbol of the definition; derivatives: by the energy's symbol; arities: of the connectivities."""

    codes: dict[str, ObjectCode]
    derivatives: dict[str, DerivativeCode]
    arities: dict[str, int]

    @staticmethod
    def of(module: ModuleOp, emitter_of: Callable[[SceneView], ObjectEmitter]) -> SceneCode:
        """Emits the code of a module after `outline-modules`."""
        scene = SceneView(module)
        emitter = emitter_of(scene)
        emitter.emit_all()
        derivatives = {}
        for op in scene.derivatives:
            indices = name_of(op.indices) if op.indices is not None else None
            capacity = scene.size(indices) if indices is not None else 0
            derivatives[name_of(op.attribute)] = DerivativeCode(op.symbol, indices, capacity)
        return SceneCode(
            {name: code for name, code in emitter.codes.items() if code.entries},
            derivatives,
            {name: op.arity.value.data for name, op in scene.connectivities.items()},
        )

    def to_text(self) -> str:
        """As JSON."""
        return json.dumps(asdict(self))

    @staticmethod
    def from_text(text: str) -> SceneCode:
        """What `to_text` wrote."""
        fields = json.loads(text)
        codes = {}
        for name, code in fields["codes"].items():
            bindings = tuple(Binding(**binding) for binding in code["bindings"])
            codes[name] = ObjectCode(**{**code, "bindings": bindings, "entries": tuple(code["entries"])})
        derivatives = {name: DerivativeCode(**derivative) for name, derivative in fields["derivatives"].items()}
        return SceneCode(codes, derivatives, fields["arities"])
