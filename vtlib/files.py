"""Files that are written at once, and read whole or not at all."""

import glob
import os
import tempfile
from pathlib import Path


class TornResult(RuntimeError):
    """Raised when a stored result cannot be trusted: cut short, altered, or not readable."""


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file at once: whoever reads it meanwhile has the old one or the new.

    What a killed process had half written of the same file is removed.
    """
    for half in path.parent.glob(f".{glob.escape(path.name)}.*.half"):
        half.unlink(missing_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".half")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(name, 0o644)
        os.replace(name, path)
    except BaseException as error:
        Path(name).unlink(missing_ok=True)
        if isinstance(error, OSError):
            error.filename = error.filename or str(path)  # a full disk does not say which
        raise
