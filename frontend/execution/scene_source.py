"""The code of a scene for one kind of device: from the frontend's description through all passes to text."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from xdsl.dialects.builtin import ModuleOp
from xdsl.passes import ModulePass

from yasps.backend.codegen.object_text import ObjectEmitter
from yasps.backend.codegen.scene_code import SceneCode
from yasps.backend.codegen.scene_view import SceneView
from yasps.dialects.rel import StorageOp
from yasps.frontend.errors import SceneError, UnsupportedSceneError
from yasps.frontend.execution.emit import EnergyTerm, SceneEmitter
from yasps.frontend.execution.scene_key import compiler_digest, text_of_key
from yasps.frontend.language.attribute import Attribute
from yasps.frontend.language.nodes import FloatArray
from yasps.frontend.language.scene_lock import SceneLock
from yasps.passes.errors import CompileError
from yasps.passes.pipeline import LIFTING, PIPELINE, run_pipeline
from yasps.runtime.build.cache import digest_of, kept_text


@dataclass(frozen=True)
class CompileRequest:
    """What of a scene is compiled.

    dump_to: where the IR after every pass and the generated sources are written, if anywhere; with locations: with the
    line of Python that made each attribute. lock: of the scene, for what is compiled to do its work in.
    """

    scene_name: str
    energies: Sequence[EnergyTerm]
    targets: Sequence[Attribute]
    outputs: Sequence[Attribute] = ()
    dump_to: Path | None = None
    dump_locations: bool = False
    lock: SceneLock = field(default_factory=SceneLock)


def make_dump_folder(folder: str | Path) -> Path:
    """The folder that a scene's IR is written to. Raises SceneError where there can't be one."""
    try:
        path = Path(folder)
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError, TypeError) as error:  # a NUL in the name is a ValueError
        raise SceneError(
            f"the IR can't be written to {str(folder)!r}, which can't be made a folder: {error}"
        ) from error
    return path


_watcher: ContextVar[Callable[[CompileRequest], None] | None] = ContextVar("watcher", default=None)


@contextmanager
def watching_compiles(watcher: Callable[[CompileRequest], None]) -> Iterator[None]:
    """Inside, the watcher is told each scene that this thread is about to compile; what it raises goes to the user."""
    token = _watcher.set(watcher)
    try:
        yield
    finally:
        _watcher.reset(token)


class SceneSource:
    """What is compiled. `emitter`: knows the scene's parts by their symbols; `code`: what was generated.

    numbers: [1, n, 1] by symbol, those that `lift-constants` took out of the scene's formulas, which the code reads.
    """

    def __init__(
        self, request: CompileRequest, emitter_of: Callable[[SceneView], ObjectEmitter], key: Sequence[str]
    ) -> None:
        """emitter_of: writes the device's language; key: what the code depends on apart from the scene.

        Raises UnsupportedSceneError.
        """
        watcher = _watcher.get()
        if watcher is not None:
            watcher(request)
        self.emitter = SceneEmitter(request.scene_name)
        self._module = self.emitter.emit(request.energies, request.targets, request.outputs, keeps=True)
        self._left: Sequence[ModulePass] = PIPELINE
        """Passes that the module has not been through."""
        if request.dump_to is None:
            # An equal scene runs no pass; one with other numbers those up to lift-constants, to find its numbers.
            lifted = json.loads(kept_text("lifted", [text_of_key(self._module), compiler_digest()], self._lift))
            self.numbers = {
                symbol: np.array(numbers).reshape(1, -1, 1) for symbol, numbers in lifted["numbers"].items()
            }
            parts = [lifted["key"], *key, compiler_digest()]
            text = kept_text("scene", parts, lambda: SceneCode.of(self.module, emitter_of).to_text())
            self.code = SceneCode.from_text(text)
        else:
            self._run(PIPELINE, request.dump_to, locations=request.dump_locations)
            self.numbers = _numbers_of(self._module)
            self.code = SceneCode.of(self._module, emitter_of)

    @property
    def module(self) -> ModuleOp:
        """The scene's IR after all passes; most of them run now if the code came from the cache."""
        if self._left:
            self._run(self._left)
        return self._module

    def _lift(self) -> str:
        """Runs the passes up to lift-constants: the numbers of the scene, and a digest of it without them, as JSON."""
        self._run(LIFTING)
        numbers = {symbol: array.ravel().tolist() for symbol, array in _numbers_of(self._module).items()}
        return json.dumps({"numbers": numbers, "key": digest_of(text_of_key(self._module))})

    def _run(self, passes: Sequence[ModulePass], dump_to: Path | None = None, *, locations: bool = False) -> None:
        """Runs the first of the passes that are left."""
        self._left = self._left[len(passes) :]
        try:
            run_pipeline(self._module, dump_to, locations=locations, passes=passes)
        except CompileError as error:
            raise UnsupportedSceneError(str(error)) from error


def _numbers_of(module: ModuleOp) -> dict[str, FloatArray]:
    storages = [op for op in module.walk() if isinstance(op, StorageOp)]
    known = {op.symbol: op.known_numbers() for op in storages}
    return {symbol: numbers for symbol, numbers in known.items() if numbers is not None}
