"""A compiled scene: objects emitted, compiled in parallel, linked, loaded and bound to the scene's numbers."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yasps.backend.codegen.object_text import Binding, ObjectCode
from yasps.backend.codegen.scene_code import SceneCode
from yasps.runtime.build.cache import file_name
from yasps.runtime.build.toolchain import Compiler, Source, compile_sources, link

_OVER_INSTANCES = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_long, ctypes.c_long, ctypes.c_void_p)
LINK_FLAGS = ("-Wl,-Bsymbolic",)


@dataclass(frozen=True)
class CompiledModule:
    """One line of the compile log."""

    name: str
    seconds: float
    cached: bool
    lines: int


class Program:
    """The machine code of one scene and the pointers it runs on.

    Several programs may share one loaded library: the library holds no state.
    """

    def __init__(self, code: SceneCode, compiler: Compiler, dump_to: Path | None = None) -> None:
        self.code = code
        self.codes: dict[str, ObjectCode] = code.codes
        if dump_to is not None:
            dump_sources(code, dump_to, "cpp")
        sources = sources_of(self.codes.values(), compiler)
        objects = compile_sources(sources, compiler.for_generated())
        names = {code.symbol: name for name, code in reversed(self.codes.items())}
        self.log = [
            CompiledModule(names[item.name], item.seconds, item.cached, source.text.count("\n"))
            for source, item in zip(sources, objects, strict=True)
        ]
        math_libraries = ("-lmvec", "-lm") if compiler.has_vector_math else ("-lm",)
        linked = link(objects, compiler, (*LINK_FLAGS, *math_libraries))
        self.log.append(CompiledModule("link", linked.seconds, linked.cached, 0))
        self._library = ctypes.CDLL(str(linked.path))
        self._arguments = {name: (ctypes.c_void_p * max(1, len(c.bindings)))() for name, c in self.codes.items()}
        self._functions: dict[tuple[str, str], int] = {}
        # Many objects read the same. Of each thing that is read: its array, and where the array's address stands.
        self._numbers: dict[Binding, int] = {}
        self._places: list[list[tuple[ctypes.Array[ctypes.c_void_p], int]]] = []
        self._elsewhere: list[tuple[ctypes.Array[ctypes.c_void_p], int, int]] = []
        self._slots: dict[tuple[str, Binding], int] = {}
        for name, emitted in self.codes.items():
            array = self._arguments[name]
            for k, binding in enumerate(emitted.bindings):
                self._slots[name, binding] = k
                if binding.kind == "arguments":
                    array[k] = ctypes.addressof(self._arguments[binding.name])
                else:
                    number = self._numbers.setdefault(binding, len(self._places))
                    if number == len(self._places):
                        self._places.append([])
                    self._places[number].append((array, k))
        self._bound: list[NDArray[Any] | None] = [None] * len(self._places)

    def bind(self, array_of: Callable[[Binding], NDArray[Any]]) -> None:
        """Points all objects to the scene's arrays, which are kept; again whenever one was replaced by another."""
        for pointers, k, number in self._elsewhere:
            bound = self._bound[number]
            assert bound is not None
            pointers[k] = bound.ctypes.data
        self._elsewhere.clear()
        for number, binding in enumerate(self._numbers):
            array = array_of(binding)
            if self._bound[number] is array:
                continue
            self._bound[number] = array
            address = array.ctypes.data
            for pointers, k in self._places[number]:
                pointers[k] = address

    def point(self, name: str, binding: Binding, address: int) -> None:
        """Points one object elsewhere, until the next `bind`."""
        k = self._slots[name, binding]
        self._arguments[name][k] = address
        self._elsewhere.append((self._arguments[name], k, self._numbers[binding]))

    def function(self, name: str, entry: str) -> int:
        """Address of an entry point of the object that defines `name`."""
        address = self._functions.get((name, entry))
        if address is None:
            symbol = getattr(self._library, f"{self.codes[name].symbol}_{entry}")
            address = ctypes.cast(symbol, ctypes.c_void_p).value
            assert address is not None
            self._functions[name, entry] = address
        return address

    def arguments(self, name: str) -> int:
        """Address of the object's pointer array."""
        return ctypes.addressof(self._arguments[name])

    def indices(self, name: str, count: int, capacity: int) -> NDArray[np.int32]:
        """An integer attribute (placement indices) of `capacity` entries on `count` instances, [count, capacity]."""
        out = np.zeros((count, capacity), np.int32)
        _OVER_INSTANCES(self.function(name, "batch"))(self.arguments(name), 0, count, out.ctypes.data)
        return out

    def branches(self, name: str, count: int) -> NDArray[np.int64] | None:
        """Which branches of UNIONs each of `count` instances of an energy takes: [count], equal for equal branches.

        None where its kernel does not ask. name: of the energy's derivatives.
        """
        if "branches" not in self.codes[name].entries:
            return None
        out = np.zeros(count, np.int64)
        _OVER_INSTANCES(self.function(name, "branches"))(self.arguments(name), 0, count, out.ctypes.data)
        return out


def sources_of(codes: Iterable[ObjectCode], compiler: Compiler) -> list[Source]:
    """What is compiled of these objects, by `compiler.for_generated()`: equal ones once, under their symbols."""
    unique = {code.symbol: code for code in codes}
    return [
        Source(symbol, code.text, compiler.derivative_flags if "derive" in code.entries else ())
        for symbol, code in unique.items()
    ]


def dump_sources(code: SceneCode, folder: Path, ending: str) -> None:
    """Writes the generated files, named after what they compute."""
    target = folder / "generated"
    target.mkdir(parents=True, exist_ok=True)
    for item in code.codes.values():
        (target / f"{file_name(item.name)}.{ending}").write_text(item.text, encoding="utf-8")
