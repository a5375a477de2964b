"""The build's own helpers: browser scripts and the key of the execution cache."""

import asyncio
import base64
import contextlib
import hashlib
import io
import math
import tarfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest.mock import Mock

import pytest
from nbformat.v4 import new_code_cell, new_notebook


@pytest.fixture
def assets(extension):
    return extension("fetch_assets")


def test_an_archive_that_is_not_the_pinned_one_is_refused(assets, monkeypatch):
    monkeypatch.setattr(assets, "urlopen", lambda *_, **__: io.BytesIO(b"abc"))
    digest = base64.b64encode(hashlib.sha512(b"abc").digest()).decode()
    assert assets.download("abc.tgz", digest) == b"abc"
    with pytest.raises(ValueError, match="SHA-512"):
        assets.download("abc.tgz", digest.lower())


def test_only_the_wanted_files_are_unpacked(assets, tmp_path):
    archive, target = io.BytesIO(), tmp_path / "vendor"
    with tarfile.open(fileobj=archive, mode="w:gz") as tar:
        for name in ("dist/embed.js", "dist/embed-amd.js", "../../evil.js"):
            tar.add(__file__, f"package/{name}")
    assets.unpack(archive.getvalue(), assets.PACKAGES["html-manager"][2], target)
    assert [*tmp_path.rglob("*.js")] == [target / "package/dist/embed.js"]
    assert (target / "package/dist/embed.js").read_text() == Path(__file__).read_text()


@pytest.mark.parametrize("online", [False, True])
def test_a_book_without_its_scripts_is_built_on_request_alone(
    assets, extension, monkeypatch, tmp_path, capsys, online
):
    build, run = extension("build"), Mock(return_value=Mock(returncode=0))
    monkeypatch.setattr(assets, "present", lambda: False)
    monkeypatch.setattr(assets, "urlopen", Mock(side_effect=OSError("network is unreachable")))
    monkeypatch.setattr(build.subprocess, "run", run)
    options = ["--results", str(tmp_path), *["--online"] * online]
    monkeypatch.setattr(build.sys, "argv", ["build.py", *options])
    with contextlib.nullcontext() if online else pytest.raises(SystemExit, match="ONLINE=yes"):
        build.main()
    assert "network is unreachable" in capsys.readouterr().out
    assert run.called == online


def test_the_cache_key_follows_what_pages_depend_on(extension, tmp_path):
    decisive = ["requirements.txt", "vtlib/b.cpp", "book/vtlab/c.h", "book/vtbook/a.py"]
    decisive += ["book/results/runs.npz", "book/published/curve.csv"]
    for name in (*decisive, "README.md", "vtlib/__pycache__/a.py"):
        path, keys = tmp_path / name, []
        path.parent.mkdir(parents=True, exist_ok=True)
        for text in ("first", "second", "first"):
            path.write_text(text)
            keys.append(extension("cache_key").cache_key(tmp_path))
        assert keys[2] == keys[0], name
        assert (keys[1] != keys[0]) == (name in decisive), name


def test_pages_run_side_by_side_and_one_that_fails_is_left_to_sphinx(extension, tmp_path):
    first = "import os, sys, warnings; warnings.warn('no')\n"
    first += "'torch' in sys.modules and os.listdir() == []"
    codes = first, "1 / 0", "import os; os.kill(os.getpid(), 9)"
    good, *bad = (new_notebook(cells=[new_code_cell(code)]) for code in codes)
    pages = {tmp_path / f"{i}.md": page for i, page in enumerate([good, *bad])}
    module = extension("in_parallel")
    with ThreadPoolExecutor() as threads:  # in this one a browser's loop may run
        seconds, *never = threads.submit(asyncio.run, module.run_all(pages, 60)).result()
    assert [seconds < math.inf, *never] == [True, math.inf, math.inf]
    assert good.cells[0].outputs[1].data["text/plain"] == "True"
    (warned,) = module.warnings_of(good)
    assert "UserWarning: no" in warned
    assert good.cells[0].metadata == {}  # or Sphinx would not find it in the cache
