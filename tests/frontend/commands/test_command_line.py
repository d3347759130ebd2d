"""The command `yasps`, run in this process on a made-up package of examples, and once for real."""

import subprocess
import sys
import textwrap
from importlib import metadata

import pytest

from yasps.frontend.commands import command_line
from yasps.frontend.commands.command_line import main

EXAMPLES = {
    "falling_box": '''
        """A box falls on a plate.

        More words.
        """
        def main(arguments=None):
            print("box", arguments)
            return 3 if arguments else 0
    ''',
    "broken_step": '''
        """Raises what the arguments say."""
        from yasps import YaspsError
        from yasps import CompilerNotFoundError
        def main(arguments=None):
            raise {"user": YaspsError("The box has no vertices."), "stop": KeyboardInterrupt(),
                   "machine": CompilerNotFoundError("Install g++."), "bug": RuntimeError("a bug")}[arguments[0]]
    ''',
    "shared_helper": '"""No example: it has no main."""\nraise RuntimeError("must not be imported")\n',
}


@pytest.fixture
def examples(tmp_path, monkeypatch):
    package = tmp_path / "made_up_examples"
    package.mkdir()
    (package / "__init__.py").write_text("")
    for name, text in EXAMPLES.items():
        (package / f"{name}.py").write_text(textwrap.dedent(text).lstrip())
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(command_line, "EXAMPLES_PACKAGE", "made_up_examples")
    yield package
    for name in [name for name in sys.modules if name.startswith("made_up_examples")]:
        del sys.modules[name]


def test_an_example_gets_its_arguments_and_gives_its_status(examples, capsys):
    assert main(["run", "falling_box"]) == 0
    assert main(["run", "falling_box", "--frames", "3", "--help"]) == 3
    assert main(["run", "falling-box"]) == 0
    assert capsys.readouterr().out == "box []\nbox ['--frames', '3', '--help']\nbox []\n"


def test_examples_are_listed_without_importing_them(examples, capsys):
    assert main(["examples"]) == 0
    assert capsys.readouterr().out == (
        "broken_step  Raises what the arguments say.\nfalling_box  A box falls on a plate.\n"
    )


def test_the_picture_of_an_example_is_named(examples, capsys):
    (examples / "pictures").mkdir()
    (examples / "pictures" / "falling_box.jpg").touch()
    assert main(["examples"]) == 0
    assert capsys.readouterr().out == (
        "broken_step  Raises what the arguments say.\nfalling_box  A box falls on a plate.\n"
        f"             {examples / 'pictures' / 'falling_box.jpg'}\n"
    )


def test_an_unknown_example_suggests_a_known_one(examples, capsys):
    assert main(["run", "faling_box"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("yasps: error: There is no example 'faling_box'. Did you mean 'falling_box'?")
    assert "broken_step, falling_box" in error
    assert main(["run", "zzz"]) == 1
    error = capsys.readouterr().err
    assert "Did you mean" not in error
    assert "broken_step, falling_box" in error
    assert main(["run", "shared_helper"]) == 1


@pytest.mark.parametrize(("kind", "message"), [("user", "The box has no vertices."), ("machine", "Install g++.")])
def test_errors_of_the_user_are_one_line_unless_a_traceback_is_asked_for(examples, capsys, monkeypatch, kind, message):
    monkeypatch.delenv("YASPS_TRACEBACK", raising=False)
    assert main(["run", "broken_step", kind]) == 1
    assert capsys.readouterr().err == f"yasps: error: {message}\n"
    monkeypatch.setenv("YASPS_TRACEBACK", "1")
    assert main(["run", "broken_step", kind]) == 1
    error = capsys.readouterr().err
    assert "Traceback" in error
    assert error.endswith(f"yasps: error: {message}\n")


def test_errors_of_ours_keep_their_traceback(examples):
    with pytest.raises(RuntimeError, match="a bug"):
        main(["run", "broken_step", "bug"])


def test_ctrl_c_exits_with_130(examples, capsys):
    assert main(["run", "broken_step", "stop"]) == 130
    assert capsys.readouterr().err == "yasps: interrupted\n"


def test_a_file_runs_as_a_script(tmp_path, monkeypatch, capsys):
    (tmp_path / "neighbour_of_script.py").write_text("value = 7\n")
    script = tmp_path / "script.py"
    script.write_text(
        "import sys\nimport neighbour_of_script\nprint(__name__, sys.argv[1:], neighbour_of_script.value)\n"
    )
    argv, path = sys.argv[:], sys.path[:]
    monkeypatch.chdir(tmp_path)
    assert main(["run", "script.py", "--frames", "2"]) == 0
    assert main(["run", str(script)]) == 0
    assert capsys.readouterr().out == "__main__ ['--frames', '2'] 7\n__main__ [] 7\n"
    assert (sys.argv, sys.path) == (argv, path)
    del sys.modules["neighbour_of_script"]


def test_the_exit_status_of_a_script_is_kept(tmp_path):
    script = tmp_path / "script.py"
    script.write_text("raise SystemExit(5)\n")
    with pytest.raises(SystemExit) as stopped:
        main(["run", str(script)])
    assert stopped.value.code == 5


def test_a_missing_file_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["run", "nothing.py"]) == 1
    assert capsys.readouterr().err == f"yasps: error: There is no file 'nothing.py' (looked from '{tmp_path}').\n"


def test_info_prints_the_report(capsys):
    assert main(["info"]) == 0
    out = capsys.readouterr().out
    assert f"yasps             {metadata.version('yasps')}\n" in out
    assert "C++ compiler      " in out


def test_wrong_usage_exits_with_2(capsys):
    with pytest.raises(SystemExit) as stopped:
        main([])
    assert stopped.value.code == 2
    assert "usage: yasps" in capsys.readouterr().err


def test_the_version_as_a_process():
    done = subprocess.run(
        [sys.executable, "-m", "yasps.frontend.commands.command_line", "--version"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == f"yasps {metadata.version('yasps')}\n"
    assert done.stderr == ""
