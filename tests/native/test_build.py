"""The kernels' compilation, where there is no compiler."""

import os
import subprocess
import sys

import pytest

from vtlib import native
from vtlib.native import build


def test_on_systems_for_which_none_are_compiled_there_are_no_kernels(monkeypatch):
    monkeypatch.setattr("platform.system", lambda: "FreeBSD")
    assert native.level.__wrapped__() is None


@pytest.mark.parametrize("what", [["vtlab.native"], ["vtlab.native", "page"]])
def test_without_a_compiler_one_line_says_what_follows(tmp_path, what):
    (tmp_path / "ziglang.py").write_text("raise SystemExit('no compiler')")
    code = "import runpy; from vtlib.native import build; build.FLAGS += ('-g',); "
    code += f"runpy.run_module({what[0]!r}, run_name='__main__')"  # other flags: not compiled yet
    command, page = [sys.executable, "-c", code, *what[1:]], "page" in what
    hidden = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, env=hidden)
    (line,) = (done.stdout + done.stderr).splitlines()
    assert line.startswith("the page's kernel cannot be" if page else "the kernels cannot be")
    assert line.endswith("; torch computes instead") == (not page)
    assert done.returncode == 1


def test_what_does_not_compile_is_named_and_no_library_of_older_sources_stands_for_it(tmp_path):
    source = tmp_path / "kernel.cpp"
    source.write_text("extern int one;\n")
    before = build.library(source, "baseline")
    assert before == build.library(source, "baseline")
    source.write_text("#error not yet\n")
    assert build.library(source, "baseline") != before
    with pytest.raises(RuntimeError, match=r"kernel\.cpp:1:2: error: not yet"):
        build.compile_library(source)
