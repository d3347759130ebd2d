"""Finding the compiler, the cache of objects and the errors."""

from __future__ import annotations

import ctypes
import os
import platform
from dataclasses import replace
from pathlib import Path

import pytest

from yasps import CacheFolderError, CompilationError, CompilerNotFoundError
from yasps.runtime.build import toolchain
from yasps.runtime.build.cache import put_text
from yasps.runtime.build.toolchain import Compiler, Source, compile_sources, find_compiler, link
from yasps.runtime.core.library import runtime_sources

ONE = Source("one", 'extern "C" int one() { return 1; }\n')
TWO = Source("energies/two: b", 'extern "C" int one();\nextern "C" int two() { return one() + one(); }\n')


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of its own for the test."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("YASPS_CACHE", str(folder))
    return folder


def test_compiles_links_and_caches(compiler: Compiler, cache: Path) -> None:
    objects = compile_sources([ONE, TWO], compiler)
    library = link(objects, compiler)
    assert [item.name for item in objects] == ["one", "energies/two: b"]
    assert not any(item.cached for item in objects)
    assert not library.cached
    assert ctypes.CDLL(str(library.path)).two() == 2
    assert library.path.parent == cache

    again = compile_sources([TWO, ONE], compiler, jobs=1)
    assert all(item.cached for item in again)
    assert [item.path for item in again] == [objects[1].path, objects[0].path]
    assert link(objects, compiler).cached
    assert not [path for path in cache.iterdir() if path.name.startswith(".")], "temporary files are left"


@pytest.mark.usefixtures("cache")
def test_the_surroundings_are_part_of_the_key(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Other headers, libraries or another C library make other code of the same text with the same compiler."""
    keys = [find_compiler().key()]
    for variable in ("CPATH", "CPLUS_INCLUDE_PATH", "LIBRARY_PATH"):
        with monkeypatch.context() as patch:
            patch.setenv(variable, str(tmp_path))
            keys.append(find_compiler().key())
    monkeypatch.setattr(platform, "libc_ver", lambda: ("glibc", "2.99"))
    keys.append(find_compiler().key())
    assert len(set(keys)) == len(keys)


@pytest.mark.usefixtures("cache")
def test_key_depends_on_everything(compiler: Compiler) -> None:
    variants = [
        compiler,
        compiler.with_flags("-DX=1"),
        replace(compiler, version="g++ 99"),
        replace(compiler, target="another processor"),
        replace(compiler, command=("/another/g++",)),
    ]
    assert len({variant.key() for variant in variants}) == len(variants)
    text = 'extern "C" int x() { return X; }\n'
    first = compile_sources([Source("x", text)], compiler.with_flags("-DX=1"))[0]
    second = compile_sources([Source("x", text)], compiler.with_flags("-DX=2"))[0]
    assert first.path != second.path
    assert ctypes.CDLL(str(link([first], compiler).path)).x() == 1
    assert ctypes.CDLL(str(link([second], compiler).path)).x() == 2


@pytest.mark.usefixtures("cache")
def test_a_source_may_have_flags_of_its_own(compiler: Compiler) -> None:
    text = 'extern "C" int x() { return X; }\n'
    own = compile_sources([Source("x", text, (f"-DX={value}",)) for value in (1, 2)], compiler.with_flags("-DX=0"))
    assert [ctypes.CDLL(str(link([item], compiler).path)).x() for item in own] == [1, 2]
    assert compile_sources([Source("x", text, ("-DX=2",))], compiler.with_flags("-DX=0"))[0].path == own[1].path


def test_an_empty_object_left_by_a_crash_is_rebuilt(compiler: Compiler, cache: Path) -> None:
    path = compile_sources([ONE], compiler)[0].path
    path.write_bytes(b"")
    assert not compile_sources([ONE], compiler)[0].cached
    assert path.stat().st_size > 0
    assert path.parent == cache


@pytest.mark.usefixtures("cache")
def test_compile_error_names_module_source_and_reason(compiler: Compiler) -> None:
    broken = Source("spring", "int f() { return undeclared_thing; }\n")
    with pytest.raises(CompilationError, match="'spring' did not compile") as caught:
        compile_sources([ONE, broken], compiler)
    assert "undeclared_thing" in str(caught.value)
    assert caught.value.source is not None
    assert caught.value.source.read_text() == broken.text
    assert compile_sources([ONE], compiler)[0].cached, "the good module is kept"


@pytest.mark.usefixtures("cache")
def test_long_compiler_messages_are_cut(compiler: Compiler) -> None:
    text = "".join(f"int f{i}() {{ return missing_{i}; }}\n" for i in range(50))
    with pytest.raises(CompilationError, match="more lines") as caught:
        compile_sources([Source("long", text)], compiler)
    assert "missing_0" in str(caught.value)
    assert "missing_49" not in str(caught.value)
    assert "missing_49" in caught.value.output


@pytest.mark.usefixtures("cache")
def test_link_error_names_the_modules(compiler: Compiler) -> None:
    objects = compile_sources([ONE], compiler)
    with pytest.raises(CompilationError, match="one"):
        link(objects, compiler, ["-lno_such_library_for_yasps"])


def test_no_compiler_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("YASPS_CXX", raising=False)
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(CompilerNotFoundError, match=r"apt-get install g\+\+") as caught:
        find_compiler()
    assert isinstance(caught.value, RuntimeError)
    assert "dnf install gcc-c++" in str(caught.value)
    assert "xcode-select --install" in str(caught.value)


@pytest.mark.usefixtures("cache")
def test_environment_chooses_the_compiler(compiler: Compiler, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    chosen = tmp_path / "my-compiler"
    chosen.symlink_to(compiler.path)
    monkeypatch.setenv("CXX", "/no/such/compiler")
    with pytest.raises(CompilerNotFoundError, match=r"CXX names .*'/no/such/compiler'"):
        find_compiler()
    monkeypatch.setenv("YASPS_CXX", f"{chosen} -DVIA_ENVIRONMENT")
    assert find_compiler().command == (str(chosen), "-DVIA_ENVIRONMENT")


@pytest.mark.usefixtures("cache")
def test_a_compiler_that_fails_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    script = tmp_path / "broken-cxx"
    script.write_text("#!/bin/sh\necho no licence >&2\nexit 3\n")
    script.chmod(0o755)
    monkeypatch.setenv("YASPS_CXX", str(script))
    with pytest.raises(CompilerNotFoundError, match="no licence"):
        find_compiler()


def test_probes_run_once(cache: Path) -> None:
    first = find_compiler()
    answers = sorted(cache.glob("probe-*.txt"))
    assert len(answers) == 2
    assert find_compiler() == first
    # The cached answer is what counts from then on.
    put_text(cache / next(path.name for path in answers if "vector-math" in path.name), "no\n")
    assert not find_compiler().has_vector_math


def test_a_probe_that_does_not_link_answers_no(compiler: Compiler, cache: Path) -> None:
    assert not toolchain._probe(compiler, "missing", "int main() { return 0; }\n", ("-lno_such_library",))
    assert not toolchain._probe(compiler, "failing", "int main() { return 1; }\n", ())
    assert toolchain._probe(compiler, "working", "int main() { return 0; }\n", ())
    assert len(list(cache.glob("probe-*.txt"))) == 3


@pytest.mark.usefixtures("cache")
def test_a_compiler_that_has_gone_is_reported(compiler: Compiler) -> None:
    with pytest.raises(CompilationError, match=r"'one' did not compile.*\n.*/no/such/compiler cannot be started"):
        compile_sources([ONE], replace(compiler, command=("/no/such/compiler",)))


def test_cache_that_cannot_be_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compiler: Compiler) -> None:
    blocker = tmp_path / "file"
    blocker.write_text("in the way")
    monkeypatch.setenv("YASPS_CACHE", str(blocker / "cache"))
    with pytest.raises(CacheFolderError, match="YASPS_CACHE"):
        compile_sources([ONE], compiler)


def test_runtime_sources_are_self_contained() -> None:
    sources = runtime_sources()
    assert {"runtime.block_matrix", "runtime.pcg", "runtime.projection"} <= {source.name for source in sources}
    for source in sources:
        assert "struct yasps_sink" in source.text
        assert '#include "' not in source.text


def test_default_cache_is_the_users(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("YASPS_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    folder = toolchain.cache_folder()
    assert folder.is_relative_to(tmp_path)
    assert "yasps" in folder.parts
    assert os.access(folder, os.W_OK)
