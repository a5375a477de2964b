"""Fetch the browser scripts that the pages use, so that a built book asks no third party.

The packages come from npm's registry with their version pinned and their SHA-512 checked; only the
files that a page loads, and the licences, are unpacked into ``book/_static/vendor``. This is an
extension of Sphinx, too, by which the pages load them from there.
"""

from __future__ import annotations

import base64
import hashlib
import io
import re
import shutil
import tarfile
from pathlib import Path
from typing import Any
from urllib.request import urlopen

VENDOR = Path(__file__).resolve().parents[1] / "_static" / "vendor"
REGISTRY = "https://registry.npmjs.org"


# An archive of each, its SHA-512, and the files to keep of it (a pattern).
PACKAGES = {
    "html-manager": (
        "@jupyter-widgets/html-manager/-/html-manager-1.0.15.tgz",
        "5thBIV6ymNgmPVOHvzx+gGy8ZSKmSazhtGw4/c4xJDVzRhG9PTeQsRjF3FUTopvFi//SABeNz1yp47bCrJ3CQA==",
        r"dist/(embed\.js(\.LICENSE\.txt)?|[0-9a-f]+\.woff2)|LICENSE",
    ),
    "mathjax": (
        "mathjax/-/mathjax-3.2.2.tgz",
        "Bt+SSVU8eBG27zChVewOicYs7Xsdt40qm4+UpHyX7k0/O9NliPc+x77k1/FEsPsjKPZGJvtRZM1vO+geW0OhGw==",
        r"es5/(tex-svg\.js|input/tex/extensions/[a-z0-9]+\.js)|LICENSE",
    ),
}


def present() -> bool:
    """Whether the scripts of these very versions are already there."""
    stamp = VENDOR / "fetched"
    return stamp.is_file() and stamp.read_text() == str(PACKAGES)


def download(archive: str, sha512: str) -> bytes:
    """An archive; ``ValueError`` unless it is byte for byte the one that was pinned."""
    print(f"    {archive}")
    with urlopen(f"{REGISTRY}/{archive}", timeout=60) as answer:
        content = answer.read()
    digest = base64.b64encode(hashlib.sha512(content).digest()).decode()
    if digest != sha512:
        raise ValueError(f"{archive}: SHA-512 is {digest}, expected {sha512}")
    return content


def unpack(archive: bytes, keep: str, target: Path) -> None:
    """Write the wanted files of an archive below ``target``."""
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        wanted = [x for x in tar if x.isfile() and re.fullmatch(f"package/(?:{keep})", x.name)]
        tar.extractall(target, wanted)


def fetch() -> None:
    """Put the scripts in place unless they are; raises ``OSError`` without a network."""
    if present():
        return
    archives = {name: download(*pinned) for name, (*pinned, _) in PACKAGES.items()}
    shutil.rmtree(VENDOR, ignore_errors=True)
    for name, archive in archives.items():
        unpack(archive, PACKAGES[name][2], VENDOR / name)
    (VENDOR / "fetched").write_text(str(PACKAGES))


def use_local_assets(app: Any, config: Any) -> None:
    """Replace the public addresses that Sphinx and myst-nb would write into the pages."""
    if present():
        config.mathjax_path = "vendor/mathjax/package/es5/tex-svg.js"
        config.nb_ipywidgets_js = {"vendor/html-manager/package/dist/embed.js": {}}


def setup(app: Any) -> dict[str, Any]:
    """Register with Sphinx, early enough for mathjax and myst-nb to see the settings."""
    app.connect("config-inited", use_local_assets, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
