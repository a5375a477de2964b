"""Stored runs: one .npz of plain arrays and one .json of provenance, written once and verified.

The .json is written last and holds the digest of the .npz, so a file cut short or altered is
noticed when it is read, and a pair is either complete or absent.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import platform
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch

from vtlib.checks import one_line

Arrays = dict[str, np.ndarray]
Note = dict[str, Any]  # plain JSON values


class TornResult(RuntimeError):
    """Raised when a stored result cannot be trusted: cut short, altered, or not readable."""


def results_folder() -> Path:
    """Where the book's stored runs lie: book/results beside the package of a checkout.

    The environment's VTLIB_RESULTS names another folder, for a book of runs computed anew.
    """
    here = Path(__file__).resolve().parent.parent / "book" / "results"
    return Path(os.environ.get("VTLIB_RESULTS", here))


def save(path: Path, arrays: Arrays, provenance: Note) -> None:
    """Write arrays to path.npz and provenance to path.json, atomically and only once.

    Writing equal arrays again does nothing. Raises FileExistsError when another result is there.
    """
    if objects := [name for name, array in arrays.items() if np.asarray(array).dtype.hasobject]:
        raise ValueError(f"{path} cannot hold objects, only plain arrays: {', '.join(objects)}")
    if exists(path):
        if same_arrays(load(path)[0], arrays):
            return
        raise FileExistsError(f"{path} holds another result: move it away before computing anew")
    json.dumps(provenance)
    buffer = io.BytesIO()
    # NumPy's types know only the options among the names
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    data = buffer.getvalue()
    note = {**provenance, "sha256": hashlib.sha256(data).hexdigest()}
    path.parent.mkdir(parents=True, exist_ok=True)
    _write(path.with_name(path.name + ".npz"), data)
    text = json.dumps(note, indent=1, sort_keys=True) + "\n"
    _write(path.with_name(path.name + ".json"), text.encode())


def load(path: Path) -> tuple[Arrays, Note]:
    """Arrays and provenance of a stored result.

    Raises FileNotFoundError when there is none, TornResult when it is not what was written.
    """
    npz, note = path.with_name(path.name + ".npz"), path.with_name(path.name + ".json")
    if not note.exists():
        raise FileNotFoundError(f"no stored result at {path}")
    try:
        provenance = json.loads(note.read_text())
        if not (isinstance(provenance, dict) and isinstance(provenance.get("sha256"), str)):
            raise TornResult(f"{note} is no provenance: it must be an object with a text sha256")
        data = npz.read_bytes()
        if hashlib.sha256(data).hexdigest() != provenance["sha256"]:
            raise TornResult(f"{npz} is not the file that was stored: its digest differs")
        with np.load(io.BytesIO(data), allow_pickle=False) as stored:
            return dict(stored), provenance
    except TornResult:
        raise
    except Exception as error:  # a damaged file fails in as many ways as its readers have
        raise TornResult(f"{path} cannot be read: {one_line(error)}") from error


def provenance(path: Path) -> Note:
    """The provenance of a stored result, whose arrays are not read."""
    note: Note = json.loads(path.with_name(path.name + ".json").read_text())
    return note


def exists(path: Path) -> bool:
    """Whether a complete result is stored at path."""
    return path.with_name(path.name + ".json").exists()


def remove(path: Path) -> None:
    """Delete a stored result, provenance first, so that no half of it is ever taken for whole."""
    for ending in (".json", ".npz"):
        path.with_name(path.name + ending).unlink(missing_ok=True)


def same_arrays(a: Arrays, b: Arrays) -> bool:
    """Whether two results hold the same arrays, bit for bit."""
    return a.keys() == b.keys() and all(_bits(a[k]) == _bits(b[k]) for k in a)


def _bits(array: np.ndarray) -> tuple[str, tuple[int, ...], bytes]:
    array = np.asarray(array)
    return array.dtype.str, array.shape, array.tobytes()


def machine(device: str = "cpu") -> dict[str, str]:
    """Versions and processor, and the device unless it is that, for the provenance of a result."""
    beside = {} if device == "cpu" else {"device": torch.cuda.get_device_name(device)}
    return {
        **beside,
        "python": platform.python_version(),
        "torch": torch.__version__,
        "numpy": np.__version__,
        "system": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or "unknown"
    return next(
        (x.split(":", 1)[1].strip() for x in lines if x.startswith("model name")), "unknown"
    )


def _write(path: Path, data: bytes) -> None:
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(name, 0o644)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
