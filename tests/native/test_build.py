"""The kernels' compilation, where there is no compiler."""

import os
import subprocess
import sys

import pytest

from vtlib import native


def test_on_systems_for_which_none_are_compiled_there_are_no_kernels(monkeypatch):
    monkeypatch.setattr("platform.system", lambda: "FreeBSD")
    assert native.level.__wrapped__() is None


@pytest.mark.parametrize("what", [["vtlib.native"], ["vtlab.native"], ["vtlab.native", "page"]])
def test_without_a_compiler_one_line_says_what_follows(tmp_path, what):
    (tmp_path / "ziglang.py").write_text("raise SystemExit('no compiler')")
    command, page = [sys.executable, "-m", *what], "page" in what
    hidden = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(command, capture_output=True, text=True, env=hidden)
    (line,) = (done.stdout + done.stderr).splitlines()
    assert line.startswith("the page's kernel cannot be" if page else "the kernels cannot be")
    assert line.endswith("; torch computes instead") == (not page)
    assert done.returncode == page
