"""One scene from several threads, and in processes that were forked: right results, or an error that says what to do.

Without the lock of a scene, or the note of a fork, these tests would hang: they run in processes that can be stopped.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import textwrap
import threading
from pathlib import Path

import numpy as np
import pytest
from spring_chain import spring_chain

from yasps import Scene, SceneError
from yasps.frontend.language.scene_lock import SceneLock
from yasps.runtime.solvers.options import SolveOptions

HELPERS = Path(__file__).parents[2] / "helpers"

BEGINNING = f"""
import os
import sys
import threading
import warnings

import numpy as np

sys.path.insert(0, {str(HELPERS)!r})
from spring_chain import spring_chain
from yasps import SceneError

warnings.filterwarnings("ignore", category=DeprecationWarning)  # Python 3.12 and newer warn of every such fork


def in_child(work):
    \"\"\"The exit status of a forked process that does the work.\"\"\"
    child = os.fork()
    if child == 0:
        try:
            work()
            os._exit(0)
        except BaseException as error:
            print(f"{{type(error).__name__}}: {{error}}", flush=True)
            os._exit(1)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])

"""


def printed_by(program: str, folder: Path) -> str:
    """What a script prints, which is stopped after three minutes."""
    path = folder / "script.py"
    path.write_text(BEGINNING + textwrap.dedent(program))
    with subprocess.Popen([sys.executable, path], stdout=subprocess.PIPE, text=True, start_new_session=True) as process:
        try:
            output, _ = process.communicate(timeout=180)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)  # its children too
            raise
    assert process.returncode == 0
    return output


def test_threads_solve_one_scene(tmp_path: Path) -> None:
    program = """
        scene = spring_chain()
        x = scene.m.points["x"]
        start, wanted = x.value, scene.minimize_energy()[0]
        energy, length = scene.total_energy(), scene.m.springs["pair"].compute().array.sum()
        found = []

        def solve(thread):
            for _ in range(20):
                found.append(np.array_equal(scene.minimize_energy()[0], wanted))
                found.append(scene.total_energy() == energy)
                found.append(scene.m.springs["pair"].compute().array.sum() == length)

        def move(thread):
            for step in range(20):
                with scene.lock:
                    x.update_value(start * (1 + 0.1 * thread + step))
                    found.append(np.array_equal(x.value, start * (1 + 0.1 * thread + step)))
                    assert scene.total_energy() != energy
                    x.update_value(start)

        threads = [threading.Thread(target=work, args=(k,)) for k, work in enumerate((solve, move, solve, move))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        print(len(found), all(found))
    """
    assert printed_by(program, tmp_path) == "160 True\n"


def test_a_used_scene_goes_on_after_a_fork(tmp_path: Path) -> None:
    program = """
        scene = spring_chain()
        (wanted,) = scene.minimize_energy()
        assert scene.runtime.thread_count(None) == 2

        def solve():
            assert scene.runtime.thread_count(None) == 1
            assert np.allclose(scene.minimize_energy()[0], wanted, rtol=1e-6)
            fresh = spring_chain(threads=4)
            assert np.allclose(fresh.minimize_energy()[0], wanted, rtol=1e-6)

        def solve_in_grandchild():
            assert in_child(solve) == 0

        print(in_child(solve), in_child(solve_in_grandchild))
        assert np.array_equal(scene.minimize_energy()[0], wanted)
        assert scene.runtime.thread_count(None) == 2
    """
    assert printed_by(program, tmp_path) == "0 0\n"


def test_a_fork_before_the_first_use_keeps_all_threads(tmp_path: Path) -> None:
    program = """
        scene = spring_chain()

        def solve():
            scene.minimize_energy()
            assert scene.runtime.thread_count(None) == 2

        print(in_child(solve))
    """
    assert printed_by(program, tmp_path) == "0\n"


def test_a_fork_while_another_thread_is_at_work_is_told(tmp_path: Path) -> None:
    program = """
        scene, other = spring_chain(), spring_chain()
        inside, done = threading.Event(), threading.Event()

        def work():
            with scene.lock:
                inside.set()
                done.wait()

        thread = threading.Thread(target=work)
        thread.start()
        inside.wait()
        print(in_child(scene.minimize_energy), in_child(other.total_energy))
        done.set()
        thread.join()
        scene.minimize_energy()
        with scene.lock:
            print(in_child(scene.minimize_energy))
    """
    error, statuses, own = printed_by(program, tmp_path).splitlines()
    assert error.startswith("SceneError: this process was forked while another thread was at work in this scene.")
    assert "spawn" in error
    assert (statuses, own) == ("1 0", "0")


@pytest.mark.parametrize("method", ["fork", "forkserver", "spawn"])
def test_every_start_method_of_multiprocessing(method: str, tmp_path: Path) -> None:
    program = f"""
        import multiprocessing


        def energy(factor):
            scene = spring_chain()
            scene.m.points["x"].update_value(factor * scene.m.points["x"].value)
            scene.minimize_energy()
            return scene.total_energy()


        if __name__ == "__main__":
            here = energy(2.0)
            with multiprocessing.get_context("{method}").Pool(1) as pool:
                assert np.allclose(pool.map(energy, [2.0, 1.0]), [here, energy(1.0)], rtol=1e-12)
            print("equal")
    """
    assert printed_by(program, tmp_path) == "equal\n"


class _NoDevice:
    """Stands for a GPU that nothing is asked of."""


def test_scenes_of_one_device_take_turns() -> None:
    device = _NoDevice()
    first, second, third = (Scene(name, device=d) for name, d in (("a", device), ("b", device), ("c", _NoDevice())))  # type: ignore[arg-type]
    assert first.lock is second.lock
    assert first.lock is not third.lock
    assert Scene("a").lock is not Scene("a").lock


def test_a_forked_scene_on_a_gpu_is_told() -> None:
    scene = Scene("a", device=_NoDevice())  # type: ignore[arg-type]
    scene.lock.after_fork_in_child()
    with pytest.raises(SceneError, match=r"forked from one that used a GPU.*'spawn' or 'forkserver'"):
        scene.total_energy()
    unused = Scene("a", device="cuda")
    unused.lock.after_fork_in_child()
    with unused.lock:
        pass


def test_everything_that_works_on_a_scene_takes_its_lock(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    scene = spring_chain(length=10)
    x, stretch, ends = scene.m.points["x"], scene.m.springs["stretch"], scene.m.springs.ends
    compiled = scene.compile()
    calls = {
        "compile": scene.compile,
        "solve": scene.solve,
        "minimize_energy": scene.minimize_energy,
        "gradient": scene.gradient,
        "hessian": scene.hessian,
        "total_energy": scene.total_energy,
        "energy_values": scene.energy_values,
        "evaluate": lambda: scene.evaluate(stretch),
        "value": lambda: x.value,
        "compute": stretch.compute,
        "update_value": lambda: x.update_value(x.value),
        "update": lambda: scene.m.points.update(x=x.value),
        "indices": lambda: ends.indices,
        "connectivity.update_value": lambda: ends.update_value(ends.indices),
        "assemble": compiled.assemble,
        "update_structure": compiled.update_structure,
        "solve_linear": lambda: compiled.solve_linear(np.ones(30), SolveOptions(1e-4, 1)),
        "multiply": lambda: compiled.multiply(np.ones(30)),
        "compiled.total_energy": compiled.total_energy,
        "compiled.energies": compiled.energies,
        "compiled.hessian": compiled.hessian,
        "data": compiled.data,
        "bind": compiled.bind,
        "dump_ir": lambda: scene.dump_ir(tmp_path),
        "add_constant": lambda: scene.add_constant("c", 1, 1),
        "add_attribute": lambda: scene.add_attribute("a", 1, 1),
        "add_mesh": lambda: scene.add_mesh("other"),
        "add_primitive": lambda: scene.m.add_primitive("p", 1),
        "add_connectivity": lambda: scene.m.p.add_connectivity("to", scene.m.points, [0], 1),
        "add_primitive_union": lambda: scene.m.add_primitive_union("u", [scene.m.p, scene.m.points]),
        "add_energy": lambda: scene.add_energy(scene["a"]),
        "add_minimize_target": lambda: scene.add_minimize_target(scene["a"]),
    }
    taken: list[SceneLock] = []
    enter = SceneLock.__enter__

    def noting(lock: SceneLock) -> None:
        taken.append(lock)
        enter(lock)

    monkeypatch.setattr(SceneLock, "__enter__", noting)
    for name, call in calls.items():
        taken.clear()
        call()
        assert taken, name
        assert set(taken) == {scene.lock}, name


def test_the_lock_is_used_as_the_documents_say() -> None:
    text = (HELPERS.parents[1] / "docs" / "language.md").read_text(encoding="utf-8")
    (code,) = [code for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "scene.lock" in code]
    scene = spring_chain(length=10)
    x = scene.m.points["x"]
    before = scene.total_energy()
    exec(code, {"scene": scene, "x": x})
    assert scene.total_energy() < before


def test_a_truncated_library_is_linked_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A new process that loaded half a library would end by a bus error."""
    before = spring_chain().total_energy()  # the cache is filled then
    copy = tmp_path / "cache"
    shutil.copytree(os.environ["YASPS_CACHE"], copy, ignore=shutil.ignore_patterns(".*"))
    libraries = list(copy.glob("*.so"))
    for path in libraries:
        os.truncate(path, path.stat().st_size // 2)
    copy.chmod(0o700)
    monkeypatch.setenv("YASPS_CACHE", str(copy))
    assert float(printed_by("print(repr(spring_chain().total_energy()))", tmp_path)) == pytest.approx(before, rel=1e-12)
    assert len(list(copy.glob("*.o"))) > 0


def test_others_wait_for_the_lock() -> None:
    scene = spring_chain(length=10)
    x = scene.m.points["x"]
    before = x.value
    thread = threading.Thread(target=lambda: x.update_value(2 * before))
    with scene.lock:
        thread.start()
        thread.join(0.1)
        assert thread.is_alive()
        assert np.array_equal(x.value, before)
    thread.join()
    assert np.array_equal(x.value, 2 * before)
