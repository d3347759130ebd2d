"""The cache of compiled code: damage of every kind heals, nothing that others could have written is used."""

from __future__ import annotations

import ctypes
import os
import stat
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import pytest

from yasps import CacheFolderError
from yasps.runtime.build import private_folder, toolchain
from yasps.runtime.build.cache import cache_folder, keep, keep_text, kept_text, put_text, text_in
from yasps.runtime.build.cuda.toolchain import build_program, find_cuda
from yasps.runtime.build.toolchain import Compiler, Source, compile_sources, link

ANOTHER = 54321
"""The number of a user that does not exist."""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of its own for the test."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("YASPS_CACHE", str(folder))
    return folder


# -- damage ------------------------------------------------------------------------------------------------


def truncate(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


def fill_with_garbage(path: Path) -> None:
    path.write_bytes(b"\x7fELF garbage {")


def flip_one_bit(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def append(path: Path) -> None:
    with path.open("ab") as file:
        file.write(b"more")


def empty(path: Path) -> None:
    path.write_bytes(b"")


def remove(path: Path) -> None:
    path.unlink()


def put_a_folder_there(path: Path) -> None:
    path.unlink()
    path.mkdir()
    (path / "inside").write_text("in the way")


def put_a_link_there(path: Path) -> None:
    path.rename(path.with_name("elsewhere"))
    path.symlink_to(path.with_name("elsewhere"))


def put_a_pipe_there(path: Path) -> None:
    path.unlink()
    os.mkfifo(path, 0o600)


DAMAGES = [
    truncate,
    fill_with_garbage,
    flip_one_bit,
    append,
    empty,
    remove,
    put_a_folder_there,
    put_a_link_there,
    put_a_pipe_there,
]
SOURCE = Source("one", 'extern "C" int one() { return 1; }\n')


def fill(compiler: Compiler) -> tuple[int, str, bool]:
    """Everything the CPU's compiles put into the cache: what came out, and whether a library was linked anew."""
    objects = compile_sources([SOURCE], compiler)
    library = link(objects, compiler)
    text = kept_text("scene", ["parts"], lambda: '{"codes": {}}')
    assert toolchain._probe(compiler, "simple", "int main() { return 0; }\n", ())
    # dlopen knows libraries by their paths: a copy is what a new process would load.
    copy = library.path.with_name(f"copy-{len(list(library.path.parent.glob('copy-*')))}.so")
    copy.write_bytes(library.path.read_bytes())
    return ctypes.CDLL(str(copy)).one(), text, library.cached


@pytest.fixture(scope="module")
def plain(compiler: Compiler) -> Compiler:
    """The compiler, as fast as it can be."""
    return replace(compiler, flags=("-O0", "-fPIC"))


def test_a_whole_cache_is_used(cache: Path, plain: Compiler) -> None:
    assert fill(plain) == (1, '{"codes": {}}', False)
    files = {path.suffix for path in cache.iterdir() if not path.name.startswith("copy")}
    assert files == {".cpp", ".o", ".so", ".json", ".txt", ".sha256"}
    assert fill(plain) == (1, '{"codes": {}}', True)


@pytest.mark.parametrize("damage", DAMAGES)
def test_every_damage_of_every_file_heals(damage: Callable[[Path], None], cache: Path, plain: Compiler) -> None:
    wanted = fill(plain)[:2]
    kinds = [path for path in sorted(cache.iterdir()) if not path.name.startswith("copy")]
    assert len(kinds) == 9  # a source, an object, a library, a text, an answer, and the digests of four of them
    contents = {path: path.read_bytes() for path in kinds}
    for path in [*kinds, None]:
        for damaged in [path] if path is not None else kinds:  # one after the other, then all at once
            damage(damaged)
        assert fill(plain)[:2] == wanted
        assert all(p.read_bytes() == contents[p] for p in kinds if p.suffix != ".cpp"), path
        assert fill(plain) == (*wanted, True), "it is whole again"


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_made_again(damage: Callable[[Path], None], cache: Path) -> None:
    path = cache_folder() / "program.so"
    made: list[Path] = []

    def build(target: Path) -> None:
        target.write_bytes(b"code" * 100)
        made.append(target)

    for name in ("program.so", "program.so.sha256"):
        assert not keep(path, build)
        assert keep(path, build)
        damage(cache / name)
        assert not keep(path, build)
        assert path.read_bytes() == b"code" * 100
        path.unlink()
    assert not any(target.exists() for target in made)


def test_what_can_not_be_read_is_made_again(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = cache_folder() / "a.txt"
    put_text(path, "old")
    path.chmod(0)
    really = os.read

    def failing(descriptor: int, count: int) -> bytes:  # root may read everything; a broken disk fails for root too
        if os.fstat(descriptor).st_mode & 0o777 == 0:
            raise OSError(5, "Input/output error")
        return really(descriptor, count)

    monkeypatch.setattr(os, "read", failing)
    assert keep_text(path, lambda: "new") == "new"
    assert path.read_text() == "new"


def test_a_digest_that_claims_much_takes_no_memory(cache: Path) -> None:
    path = cache_folder() / "a.txt"
    put_text(path, "text")
    seal = path.with_name("a.txt.sha256")
    for claim in (f"{'0' * 64} {10**30}\n", f"{'0' * 64} -1\n", f"{'0' * 64} \u00b2\n", "\n", " ", "x"):
        seal.write_text(claim)
        seal.chmod(0o600)
        assert text_in(path) is None
    os.truncate(seal, 10**12)  # a hole: nothing on the disk
    assert text_in(path) is None


def test_writers_and_damage_at_the_same_time(cache: Path) -> None:
    """Nobody ever gets what nobody wrote."""
    path = cache_folder() / "a.txt"
    written = {str(k) * 5000 for k in range(4)}

    def work(k: int) -> set[str]:
        found = set()
        for round_ in range(60):
            if k == 0 and round_ % 3 == 0:
                path.write_text("damage")
                path.chmod(0o600)
            found.add(keep_text(path, lambda: str(k) * 5000))
        return found

    with ThreadPoolExecutor(4) as pool:
        found = set().union(*pool.map(work, range(4)))
    assert found <= written
    assert sorted(p.name for p in cache.iterdir()) == ["a.txt", "a.txt.sha256"], "temporary files are left"


def test_a_build_that_fails_leaves_nothing(cache: Path) -> None:
    path = cache_folder() / "a.so"

    def build(target: Path) -> None:
        target.write_bytes(b"half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        keep(path, build)
    assert list(cache.iterdir()) == []


@pytest.mark.parametrize("damage", DAMAGES)
def test_device_code_heals_too(damage: Callable[[Path], None], cache: Path) -> None:
    if find_spec("cuda") is None:
        pytest.skip("needs the packages of pip install 'yasps[cuda]'")
    cuda = find_cuda("sm_90")
    module = Source("halve", 'extern "C" __global__ void halve(double* p) { p[threadIdx.x] *= 0.5; }\n')
    first = build_program(cuda, [module])
    content, rows = first.cubin(), [row.functions for row in first.rows]
    kinds = [path for path in sorted(cache.iterdir()) if not path.name.startswith("probe")]
    assert {path.suffix for path in kinds} == {".cu", ".cubin", ".log", ".sha256"}
    assert build_program(cuda, [module]).cached
    for path in kinds:
        damage(path)
        again = build_program(cuda, [module])
        assert again.cubin() == content
        assert [row.functions for row in again.rows] == rows
    assert build_program(cuda, [module]).cached


# -- rights ------------------------------------------------------------------------------------------------


@pytest.fixture
def open_umask() -> Iterator[None]:
    """New files are everybody's to write unless somebody says otherwise."""
    before = os.umask(0)
    yield
    os.umask(before)


@pytest.mark.usefixtures("open_umask")
def test_the_folder_and_its_files_are_the_users_alone(
    tmp_path: Path, plain: Compiler, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("YASPS_CACHE", str(tmp_path / "a" / "b"))
    objects = compile_sources([SOURCE], plain)
    link(objects, plain)
    kept_text("scene", ["parts"], lambda: "{}")
    for folder in (tmp_path / "a", tmp_path / "a" / "b"):
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    rights = {path.suffix: stat.S_IMODE(path.stat().st_mode) for path in (tmp_path / "a" / "b").iterdir()}
    assert rights == dict.fromkeys([".cpp", ".o", ".so", ".json", ".sha256"], 0o600)


def test_a_folder_that_others_may_only_read_is_fine(cache: Path, plain: Compiler) -> None:
    cache.mkdir(mode=0o755)
    assert fill(plain)[0] == 1
    assert stat.S_IMODE(cache.stat().st_mode) == 0o755, "it is the user's to decide"


@pytest.mark.parametrize("mode", [0o775, 0o757, 0o777, 0o1777])
def test_a_folder_that_others_can_write_is_refused(mode: int, cache: Path, plain: Compiler) -> None:
    cache.mkdir()
    cache.chmod(mode)
    with pytest.raises(CacheFolderError, match=rf"others than you can write to {cache} .*`chmod go-w {cache}`"):
        compile_sources([SOURCE], plain)
    with pytest.raises(CacheFolderError, match="YASPS_CACHE"):
        kept_text("scene", ["parts"], lambda: "{}")
    assert list(cache.iterdir()) == []
    cache.chmod(0o700)
    assert fill(plain)[0] == 1


@pytest.mark.parametrize("mode", [0o775, 0o777])
def test_so_is_one_on_the_way(mode: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    way = tmp_path / "way"
    monkeypatch.setenv("YASPS_CACHE", str(way / "to" / "cache"))
    (way / "to" / "cache").mkdir(parents=True)
    way.chmod(mode)
    with pytest.raises(CacheFolderError, match=rf"others than you can write to {way} "):
        cache_folder()
    way.chmod(0o1777)  # sticky, as /tmp is: what lies in it cannot be exchanged
    assert cache_folder() == way / "to" / "cache"


def test_links_on_the_way_are_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    open_to_all = tmp_path / "open"
    (open_to_all / "cache").mkdir(parents=True)
    (tmp_path / "absolute").symlink_to(open_to_all / "cache")
    (tmp_path / "relative").symlink_to("absolute/../cache")
    (tmp_path / "circle").symlink_to("circle")
    for name in ("absolute", "relative"):
        monkeypatch.setenv("YASPS_CACHE", str(tmp_path / name))
        open_to_all.chmod(0o777)
        with pytest.raises(CacheFolderError, match=rf"others than you can write to {open_to_all} "):
            cache_folder()
        open_to_all.chmod(0o755)
        assert cache_folder() == tmp_path / name
    monkeypatch.setenv("YASPS_CACHE", str(tmp_path / "circle"))
    with pytest.raises(CacheFolderError, match="circle"):
        cache_folder()


def give_to_another(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets `path` belong to another user: by root that can be done; others play that user."""
    if os.geteuid() == 0:
        os.chown(path, ANOTHER, -1)
    else:
        monkeypatch.setattr(private_folder.os, "geteuid", lambda: ANOTHER)


@pytest.mark.parametrize("part", ["way", "way/cache", "way/link"])
def test_what_belongs_to_another_user_is_refused(part: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "way" / "cache").mkdir(parents=True)
    (tmp_path / "way" / "link").symlink_to("cache")
    monkeypatch.setenv("YASPS_CACHE", str(tmp_path / "way" / "link"))
    cache_folder()
    if os.geteuid() == 0 and part.endswith("link"):
        os.lchown(tmp_path / part, ANOTHER, -1)
    else:
        give_to_another(tmp_path / part, monkeypatch)
    with pytest.raises(CacheFolderError, match=r"belongs to the user .*YASPS_CACHE"):
        cache_folder()


def test_root_s_folders_are_trusted(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if os.geteuid() != 0:
        pytest.skip("only root has a folder of root's")
    cache.mkdir()
    monkeypatch.setattr(private_folder.os, "geteuid", lambda: ANOTHER)
    assert cache_folder() == cache


def test_a_file_that_others_can_write_is_refused(cache: Path) -> None:
    path = cache_folder() / "a.txt"
    for name in ("a.txt", "a.txt.sha256"):
        put_text(path, "text")
        (cache / name).chmod(0o620)
        with pytest.raises(CacheFolderError, match=rf"others than you can write to {name} .*Delete it"):
            keep_text(path, lambda: "text")
        (cache / name).chmod(0o640)
        assert keep_text(path, lambda: "never made") == "text"


def test_a_file_of_another_user_is_refused(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = cache_folder() / "a.txt"
    put_text(path, "text")
    give_to_another(path, monkeypatch)
    with pytest.raises(CacheFolderError, match=r"a\.txt.* there belongs to the user .*Delete it"):
        keep_text(path, lambda: "text")


def test_a_relative_folder_stays_where_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("YASPS_CACHE", "-x")  # no option of the compiler's either
    assert cache_folder() == tmp_path / "-x"


def test_no_command_goes_through_a_shell(tmp_path: Path, plain: Compiler, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / f"$(touch {tmp_path.name}); \"'& x"
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("YASPS_CACHE", str(folder))
    assert fill(plain)[0] == 1
    assert list(tmp_path.iterdir()) == [folder]
