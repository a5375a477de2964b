"""Stored results: written once and whole; what was not written, or otherwise, is never read."""

import hashlib
import io
import json
import os
import tempfile
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vtlib.experiments import store

PROPERTY = settings(deadline=None, derandomize=True, max_examples=60)
ARRAYS = {
    "run": np.arange(3),
    "learning": np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4),
    "solved": np.array([True, False, True]),
    "gaps": np.array([np.nan, np.inf, -0.0]),
    "none": np.zeros((3, 0, 4)),
    "names": np.array(["GVT", "NT", "λ"]),
}
NOTE = {"seconds": 1.5, "config": {"algorithm": {"lambda_": 1e-6}}, "label": "λ"}


with tempfile.TemporaryDirectory() as made:
    store.save(Path(made, "x"), ARRAYS, NOTE)
    store.save(Path(made, "y"), {**ARRAYS, "run": np.arange(1, 4)}, NOTE)
    NPZ, JSON, OTHER = (Path(made, name).read_bytes() for name in ("x.npz", "x.json", "y.npz"))


def read_pair(npz, note):
    """What is read where these two files lie; None for a file that is missing."""
    with tempfile.TemporaryDirectory() as folder:
        if npz is not None:
            Path(folder, "x.npz").write_bytes(npz)
        Path(folder, "x.json").write_bytes(note)
        return store.read(Path(folder, "x"))[0]


def assert_torn(npz, note):
    with pytest.raises(store.TornResult) as caught:
        read_pair(npz, note)
    assert len(str(caught.value).splitlines()) == 1


def files(folder):
    return {p.name: (p.read_bytes(), p.stat().st_mtime_ns) for p in folder.iterdir()}


def test_what_is_saved_is_read(tmp_path):
    path = tmp_path / "deep" / "down" / "1-MGVT-lambda-1e-06-psi-0.5"
    assert not store.exists(path)
    store.save(path, ARRAYS, NOTE)
    assert store.exists(path)
    arrays, note = store.read(path)
    assert store.same_arrays(arrays, ARRAYS)
    assert {key: note[key] for key in NOTE} == NOTE == {k: store.provenance(path)[k] for k in NOTE}
    assert {p.name for p in path.parent.iterdir()} == {f"{path.name}.npz", f"{path.name}.json"}
    assert all(p.stat().st_mode & 0o777 == 0o644 for p in path.parent.iterdir())
    assert not store.exists(path.with_name("1-MGVT-lambda-1e-06-psi-0"))
    with np.load(f"{path}.npz", allow_pickle=False) as plain:  # readable without vtlib
        assert set(plain) == set(ARRAYS)


@pytest.mark.parametrize(
    "change",
    [
        {"run": np.arange(1, 4)},
        {"run": np.arange(4)},
        {"run": np.arange(3, dtype=np.int32)},
        {"gaps": np.array([np.nan, np.inf, 0.0])},
        {"more": np.zeros(1)},
    ],
)
def test_the_same_again_touches_nothing_and_another_result_is_refused(tmp_path, change):
    store.save(tmp_path / "x", ARRAYS, NOTE)
    before = files(tmp_path)
    store.save(tmp_path / "x", {k: v.copy() for k, v in ARRAYS.items()}, {"seconds": 9.0})
    with pytest.raises(FileExistsError, match="x holds another result: move it away"):
        store.save(tmp_path / "x", {**ARRAYS, **change}, NOTE)
    assert files(tmp_path) == before


@PROPERTY
@given(st.integers(0, len(NPZ) - 1), st.integers(1, 255), st.binary(max_size=40))
def test_an_npz_that_was_altered_is_torn(at, mask, more):
    flipped = bytearray(NPZ)
    flipped[at] ^= mask
    for npz in (None, OTHER, bytes(flipped), NPZ[:at], NPZ + b"x" + more):
        assert_torn(npz, JSON)


@PROPERTY
@given(st.integers(0, len(JSON) - 2), st.integers(1, 255))  # nobody misses the last line end
def test_a_json_that_was_altered_is_torn_or_the_arrays_are_right(at, mask):
    assert_torn(NPZ, JSON[:at])
    flipped = bytearray(JSON)
    flipped[at] ^= mask
    try:
        arrays = read_pair(NPZ, bytes(flipped))
    except store.TornResult:
        return
    assert store.same_arrays(arrays, ARRAYS)


@pytest.mark.parametrize(
    "note",
    [b"{}", b"[]", b"null", b"1", b'"sha256"', b'{"sha256": 3}', b"\xff\xfe{", b"[" * 100_000, b""],
)
def test_a_json_that_is_no_provenance_is_torn(note):
    assert_torn(NPZ, note)


@pytest.mark.parametrize("write", [np.save, np.savez])
def test_a_pickle_is_refused(write):
    buffer = io.BytesIO()
    write(buffer, np.array([{}], dtype=object))
    digest = hashlib.sha256(buffer.getvalue()).hexdigest()
    assert_torn(buffer.getvalue(), json.dumps({"sha256": digest}).encode())


def test_what_the_files_cannot_hold_leaves_no_result(tmp_path):
    with pytest.raises(ValueError, match="x cannot hold objects, only plain arrays: a"):
        store.save(tmp_path / "x", {"a": np.array([{}], dtype=object)}, {})
    with pytest.raises(TypeError):
        store.save(tmp_path / "x", ARRAYS, {"seconds": np.float32(1)})
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("step", ["fsync", "chmod", "replace"])
@pytest.mark.parametrize("call", [0, 1])
def test_an_error_while_saving_leaves_no_result_and_no_litter(tmp_path, monkeypatch, step, call):
    full = OSError(28, "No space left on device")
    outcomes = [getattr(os, step), Mock(side_effect=full)] if call else [Mock(side_effect=full)]
    with monkeypatch.context() as patched:
        patched.setattr(os, step, lambda *given: outcomes.pop(0)(*given))
        with pytest.raises(OSError, match="No space"):
            store.save(tmp_path / "x", ARRAYS, NOTE)
    assert not store.exists(tmp_path / "x")
    assert not [name for name in files(tmp_path) if name.startswith(".")]
    store.save(tmp_path / "x", ARRAYS, NOTE)
    assert store.same_arrays(store.read(tmp_path / "x")[0], ARRAYS)
