"""The code of a scene for one kind of device: from the frontend's description through all passes to text."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from xdsl.dialects.builtin import ModuleOp

from yasps.backend.object_text import ObjectEmitter
from yasps.backend.scene_code import SceneCode
from yasps.backend.scene_view import SceneView
from yasps.frontend.attribute import Attribute
from yasps.frontend.emit import EnergyTerm, SceneEmitter
from yasps.frontend.errors import SceneError, UnsupportedSceneError
from yasps.frontend.scene_key import compiler_digest, text_without_sizes
from yasps.frontend.scene_lock import SceneLock
from yasps.passes.errors import CompileError
from yasps.passes.pipeline import run_pipeline
from yasps.runtime.toolchain import kept_text


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


class SceneSource:
    """What is compiled. `emitter`: knows the scene's parts by their symbols; `code`: what was generated."""

    def __init__(
        self, request: CompileRequest, emitter_of: Callable[[SceneView], ObjectEmitter], key: Sequence[str]
    ) -> None:
        """emitter_of: writes the device's language; key: what the code depends on apart from the scene.

        Raises UnsupportedSceneError.
        """
        self.emitter = SceneEmitter(request.scene_name)
        emitted = self.emitter.emit(request.energies, request.targets, request.outputs)
        self._unlowered: ModuleOp | None = emitted
        self._module: ModuleOp | None = None
        self.code = self._generate(emitter_of, key, request.dump_to, locations=request.dump_locations)

    @property
    def module(self) -> ModuleOp:
        """The scene's IR after all passes, which run now if the code came from the cache."""
        if self._module is None:
            self._module = self._lower(None, locations=False)
        return self._module

    def _lower(self, dump_to: Path | None, *, locations: bool) -> ModuleOp:
        assert self._unlowered is not None
        module, self._unlowered = self._unlowered, None
        try:
            return run_pipeline(module, dump_to, locations=locations)
        except CompileError as error:
            raise UnsupportedSceneError(str(error)) from error

    def _generate(
        self,
        emitter_of: Callable[[SceneView], ObjectEmitter],
        key: Sequence[str],
        dump_to: Path | None,
        *,
        locations: bool,
    ) -> SceneCode:
        """The generated code: of an equal scene, of whatever size, from the cache of compiled code."""
        if dump_to is not None:
            self._module = self._lower(dump_to, locations=locations)
            return SceneCode.of(self._module, emitter_of)

        def make() -> str:
            return SceneCode.of(self.module, emitter_of).to_text()

        assert self._unlowered is not None
        parts = [text_without_sizes(self._unlowered), *key, compiler_digest()]
        return SceneCode.from_text(kept_text("scene", parts, make))
