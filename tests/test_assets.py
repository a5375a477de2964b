"""The build's own helpers: browser scripts and the key of the execution cache."""

from __future__ import annotations

import base64
import hashlib
import io
import tarfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture
def assets(extension: Callable[[str], ModuleType]) -> ModuleType:
    """The fetcher of the browser scripts."""
    return extension("fetch_assets")


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """A small npm archive with one wanted, one unwanted and one malicious file."""
    path = tmp_path / "package.tgz"
    with tarfile.open(path, "w:gz") as tar:
        for name in ("package/dist/embed.js", "package/dist/embed-amd.js", "package/../../evil.js"):
            info = tarfile.TarInfo(name)
            info.size = 3
            tar.addfile(info, io.BytesIO(b"abc"))
    return path


def test_an_altered_archive_is_refused(assets: ModuleType, archive: Path) -> None:
    with pytest.raises(ValueError, match="SHA-512"):
        assets.check(archive, assets.PACKAGES[0])


def test_the_pinned_archive_is_accepted(assets: ModuleType, archive: Path) -> None:
    digest = base64.b64encode(hashlib.sha512(archive.read_bytes()).digest()).decode()
    assets.check(archive, replace(assets.PACKAGES[0], sha512=digest))


def test_only_the_wanted_files_are_unpacked(
    assets: ModuleType, archive: Path, tmp_path: Path
) -> None:
    target = tmp_path / "vendor"
    assets.unpack(archive, assets.PACKAGES[0], target)
    assert [path.name for path in tmp_path.rglob("*.js")] == ["embed.js"]
    assert (target / "embed.js").read_bytes() == b"abc"


def test_other_versions_count_as_absent(assets: ModuleType, tmp_path: Path) -> None:
    assert not assets.present(tmp_path)
    (tmp_path / "fetched").write_text("mathjax 2.7.9")
    assert not assets.present(tmp_path)
    (tmp_path / "fetched").write_text(assets.stamp_text())
    assert assets.present(tmp_path)


def test_no_npm_and_no_network_is_one_clear_error(
    assets: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    npm = tmp_path / "npm"
    npm.write_text("#!/bin/sh\necho 'network is unreachable' >&2\nexit 1\n")
    npm.chmod(0o755)
    monkeypatch.setattr(assets, "find_npm", lambda: str(npm))
    with pytest.raises(assets.AssetsUnavailable, match="network is unreachable"):
        assets.fetch(tmp_path / "vendor")
    assert not assets.present(tmp_path / "vendor")


@pytest.mark.parametrize("online", [False, True])
def test_a_book_without_its_scripts_is_not_built_unless_asked_for(
    extension: Callable[[str], ModuleType], assets: ModuleType, monkeypatch, capsys, online: bool
) -> None:
    build = extension("build")

    def unavailable() -> None:
        raise assets.AssetsUnavailable("network is unreachable")

    monkeypatch.setattr(build, "fetch", unavailable)
    assert build.have_assets(online) == online
    said = capsys.readouterr().out
    assert "network is unreachable" in said
    assert ("make book ONLINE=yes" in said) != online


@pytest.mark.parametrize(
    ("name", "matters"),
    [
        ("requirements.txt", True),
        ("vtlib/a.py", True),
        ("vtlib/b.cpp", True),
        ("book/results/runs.npz", True),
        ("README.md", False),
        ("vtlib/__pycache__/a.py", False),
    ],
)
def test_the_cache_key_follows_what_pages_depend_on(
    extension: Callable[[str], ModuleType], tmp_path: Path, name: str, matters: bool
) -> None:
    cache_key, path = extension("cache_key").cache_key, tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    keys = []
    for text in ("first", "second", "first"):
        path.write_text(text)
        keys.append(cache_key(tmp_path))
    assert keys[2] == keys[0]
    assert (keys[1] != keys[0]) == matters
