"""Stored results: written once and whole, and nothing that was not written is ever read."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vtlib import store

PROPERTY = settings(deadline=None, derandomize=True, max_examples=60)
ARRAYS = {
    "run": np.arange(3),
    "learning": np.linspace(0, 1, 12, dtype=np.float32).reshape(3, 4),
    "solved": np.array([True, False, True]),
    "gaps": np.array([np.nan, np.inf, -0.0]),
    "none": np.zeros((3, 0, 4)),
}
NOTE = {"seconds": 1.5, "config": {"algorithm": {"lambda_": 1e-6}}, "label": "λ"}


def written(arrays: store.Arrays = ARRAYS) -> tuple[bytes, bytes]:
    """The two files of a stored result."""
    with tempfile.TemporaryDirectory() as folder:
        store.save(Path(folder, "x"), arrays, NOTE)
        return Path(folder, "x.npz").read_bytes(), Path(folder, "x.json").read_bytes()


NPZ, JSON = written()


def load_pair(npz: bytes | None, note: bytes) -> tuple[store.Arrays, dict[str, Any]]:
    """What is read where these two files lie; None for a file that is missing."""
    with tempfile.TemporaryDirectory() as folder:
        if npz is not None:
            Path(folder, "x.npz").write_bytes(npz)
        Path(folder, "x.json").write_bytes(note)
        return store.load(Path(folder, "x"))


def note_for(npz: bytes) -> bytes:
    return json.dumps({"sha256": hashlib.sha256(npz).hexdigest()}).encode()


def assert_same(a: store.Arrays, b: store.Arrays) -> None:
    assert a.keys() == b.keys()
    for key in a:
        assert a[key].dtype == b[key].dtype
        np.testing.assert_array_equal(a[key], b[key], strict=True)


def files(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir()}


def test_what_is_saved_is_loaded(tmp_path):
    path = tmp_path / "deep" / "down" / "1-MGVT-lambda-1e-06-psi-0.5"
    assert not store.exists(path)
    store.save(path, ARRAYS, NOTE)
    assert store.exists(path)
    arrays, note = store.load(path)
    assert_same(arrays, ARRAYS)
    assert {key: note[key] for key in NOTE} == NOTE
    assert {p.name for p in path.parent.iterdir()} == {f"{path.name}.npz", f"{path.name}.json"}
    assert all(p.stat().st_mode & 0o777 == 0o644 for p in path.parent.iterdir())


@settings(PROPERTY, max_examples=25)
@given(
    st.dictionaries(
        st.text("abc_", min_size=1, max_size=4),
        st.tuples(
            st.sampled_from(["f4", "f8", "i8", "?", "u1"]),
            st.lists(st.integers(0, 3), max_size=3),
            st.integers(0, 99),
        ),
        max_size=4,
    )
)
def test_any_plain_arrays_come_back(shapes):
    rng = np.random.default_rng(0)
    arrays = {
        name: np.asarray(seed * rng.standard_normal(shape)).astype(kind)
        for name, (kind, shape, seed) in shapes.items()
    }
    npz, note = written(arrays)
    assert_same(load_pair(npz, note)[0], arrays)


def test_names_that_differ_by_an_ending_are_different_results(tmp_path):
    store.save(tmp_path / "psi-0", {"a": np.zeros(1)}, {})
    store.save(tmp_path / "psi-0.5", {"a": np.ones(1)}, {})
    assert store.load(tmp_path / "psi-0")[0]["a"] == 0
    assert store.load(tmp_path / "psi-0.5")[0]["a"] == 1


def test_saving_the_same_again_touches_nothing(tmp_path):
    store.save(tmp_path / "x", ARRAYS, NOTE)
    before = {p.name: (p.read_bytes(), p.stat().st_mtime_ns) for p in tmp_path.iterdir()}
    store.save(tmp_path / "x", {k: v.copy() for k, v in ARRAYS.items()}, {"seconds": 9.0})
    after = {p.name: (p.read_bytes(), p.stat().st_mtime_ns) for p in tmp_path.iterdir()}
    assert after == before


@pytest.mark.parametrize(
    "change",
    [
        {"run": np.arange(1, 4)},
        {"run": np.arange(4)},
        {"gaps": np.array([np.nan, np.inf, np.nan])},
        {"more": np.zeros(1)},
    ],
    ids=["a value", "a shape", "a gap", "a name"],
)
def test_another_result_is_refused_and_the_old_one_stays(tmp_path, change):
    store.save(tmp_path / "x", ARRAYS, NOTE)
    before = files(tmp_path)
    with pytest.raises(FileExistsError, match="x holds another result: move it away"):
        store.save(tmp_path / "x", {**ARRAYS, **change}, NOTE)
    assert files(tmp_path) == before


@pytest.mark.parametrize(
    ("a", "b"),
    [(np.float32([1, 2]), np.float64([1, 2])), (np.array([0.0]), np.array([-0.0]))],
    ids=["type", "sign of zero"],
)
def test_same_arrays_is_meant_bit_for_bit(a, b):
    assert store.same_arrays({"a": a}, {"a": a.copy()})
    assert not store.same_arrays({"a": a}, {"a": b})


def test_text_is_compared(tmp_path):
    names = {"names": np.array(["GVT", "NT"])}
    store.save(tmp_path / "x", names, {})
    store.save(tmp_path / "x", names, {})


def test_nothing_stored(tmp_path):
    with pytest.raises(FileNotFoundError, match="no stored result at"):
        store.load(tmp_path / "x")


def test_an_npz_alone_is_no_result_and_is_replaced(tmp_path):
    (tmp_path / "x.npz").write_bytes(NPZ[:100])
    assert not store.exists(tmp_path / "x")
    with pytest.raises(FileNotFoundError):
        store.load(tmp_path / "x")
    store.save(tmp_path / "x", ARRAYS, NOTE)
    assert_same(store.load(tmp_path / "x")[0], ARRAYS)


def test_a_json_alone_is_torn_and_is_not_replaced_silently(tmp_path):
    (tmp_path / "x.json").write_bytes(JSON)
    with pytest.raises(store.TornResult):
        store.load(tmp_path / "x")
    with pytest.raises(store.TornResult):
        store.save(tmp_path / "x", ARRAYS, NOTE)
    assert files(tmp_path) == {"x.json": JSON}


def test_the_pair_of_another_result_is_torn():
    other, _ = written({**ARRAYS, "run": np.arange(1, 4)})
    with pytest.raises(store.TornResult, match="digest differs"):
        load_pair(other, JSON)


@PROPERTY
@given(st.integers(0, len(NPZ) - 1))
def test_an_npz_cut_short_is_torn(length):
    with pytest.raises(store.TornResult):
        load_pair(NPZ[:length], JSON)


@PROPERTY
@given(st.integers(0, len(NPZ) - 1), st.integers(1, 255))
def test_an_npz_with_a_flipped_byte_is_torn(at, mask):
    flipped = bytearray(NPZ)
    flipped[at] ^= mask
    with pytest.raises(store.TornResult):
        load_pair(bytes(flipped), JSON)


@PROPERTY
@given(st.binary(min_size=1, max_size=40))
def test_an_npz_with_bytes_behind_its_end_is_torn(more):
    with pytest.raises(store.TornResult):
        load_pair(NPZ + more, JSON)


@PROPERTY
@given(st.integers(0, len(JSON) - 2))  # the last byte is a line end, which nobody misses
def test_a_json_cut_short_is_torn(length):
    with pytest.raises(store.TornResult):
        load_pair(NPZ, JSON[:length])


@PROPERTY
@given(st.integers(0, len(JSON) - 1), st.integers(1, 255))
def test_a_json_with_a_flipped_byte_is_torn_or_the_arrays_are_right(at, mask):
    flipped = bytearray(JSON)
    flipped[at] ^= mask
    try:
        arrays, _ = load_pair(NPZ, bytes(flipped))
    except store.TornResult:
        return
    assert_same(arrays, ARRAYS)


@PROPERTY
@given(st.binary(max_size=60) | st.text(max_size=60).map(str.encode))
def test_any_garbage_for_a_json_is_torn(garbage):
    with pytest.raises(store.TornResult):
        load_pair(NPZ, garbage)


@pytest.mark.parametrize(
    "note", [b"", b"{}", b"[]", b"null", b"1", b'"sha256"', b'{"sha256": 3}', b"\xff\xfe{"]
)
def test_a_json_that_is_no_provenance_is_torn(note):
    with pytest.raises(store.TornResult, match="x"):
        load_pair(NPZ, note)


def test_a_json_nested_without_end_is_torn():
    with pytest.raises(store.TornResult):
        load_pair(NPZ, b"[" * 100_000)


def test_an_npz_damaged_before_its_digest_was_taken_is_torn_or_loads():
    cut = [NPZ[:length] for length in range(0, len(NPZ), 50)]
    flipped = [NPZ[:at] + bytes([NPZ[at] ^ 8]) + NPZ[at + 1 :] for at in range(0, len(NPZ), 3)]
    for npz in cut + flipped:
        with contextlib.suppress(store.TornResult):
            load_pair(npz, note_for(npz))


@pytest.mark.parametrize("npz", [b"\x93NUMPY", b"PK\x03\x04", b"words"])
def test_an_npz_that_is_none_is_torn_whatever_its_digest(npz):
    with pytest.raises(store.TornResult):
        load_pair(npz, note_for(npz))


class Hostile:
    """Leaves a mark wherever it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self._mark = str(mark)

    def __reduce__(self) -> tuple:
        return os.mkdir, (self._mark,)


def pickled_archive(value: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, a=np.array([value], dtype=object))
    return buffer.getvalue()


def pickled_array(value: Any) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.array([value], dtype=object))
    return buffer.getvalue()


def bare_pickle(value: Any) -> bytes:
    data = pickled_array(value)
    return data[data.index(b"\x80\x04") :]


@pytest.mark.parametrize("make", [pickled_archive, pickled_array, bare_pickle])
def test_a_pickle_is_refused_and_never_executed(tmp_path, make: Callable[[Any], bytes]):
    mark = tmp_path / "executed"
    npz = make(Hostile(mark))
    with pytest.raises(store.TornResult):
        load_pair(npz, note_for(npz))
    assert not mark.exists()
    trust(npz)
    assert mark.exists(), "these bytes would not have executed anyhow"


def trust(npz: bytes) -> None:
    """Load as the library never does: proof that the bytes would have executed."""
    loaded = np.load(io.BytesIO(npz), allow_pickle=True)
    if isinstance(loaded, np.lib.npyio.NpzFile):
        with loaded:
            assert len(loaded["a"]) == 1


def test_objects_are_not_saved(tmp_path):
    with pytest.raises(ValueError, match="a"):
        store.save(tmp_path / "x", {"a": np.array([{}], dtype=object)}, {})
    assert not any(tmp_path.iterdir())


def test_removed_is_gone_and_removing_nothing_is_no_error(tmp_path):
    store.save(tmp_path / "x", ARRAYS, NOTE)
    store.save(tmp_path / "xx", ARRAYS, NOTE)
    store.remove(tmp_path / "x")
    store.remove(tmp_path / "x")
    assert set(files(tmp_path)) == {"xx.npz", "xx.json"}


def test_a_removal_cut_in_the_middle_leaves_no_result(tmp_path, monkeypatch):
    store.save(tmp_path / "x", ARRAYS, NOTE)
    unlink, removed = Path.unlink, []

    def once(path: Path, missing_ok: bool = False) -> None:
        if removed:
            raise KeyboardInterrupt
        removed.append(path)
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", once)
    with pytest.raises(KeyboardInterrupt):
        store.remove(tmp_path / "x")
    assert not store.exists(tmp_path / "x")


@pytest.mark.parametrize("step", ["fsync", "chmod", "replace"])
@pytest.mark.parametrize("call", [1, 2])
def test_an_error_while_saving_leaves_no_result_and_no_litter(tmp_path, monkeypatch, step, call):
    real, calls = getattr(os, step), []

    def fail(*args: Any, **named: Any) -> Any:
        calls.append(args)
        if len(calls) == call:
            raise OSError(28, "No space left on device")
        return real(*args, **named)

    with monkeypatch.context() as patched:
        patched.setattr(os, step, fail)
        with pytest.raises(OSError, match="No space"):
            store.save(tmp_path / "x", ARRAYS, NOTE)
    assert not store.exists(tmp_path / "x")
    assert not [name for name in files(tmp_path) if name.startswith(".")]
    store.save(tmp_path / "x", ARRAYS, NOTE)
    assert_same(store.load(tmp_path / "x")[0], ARRAYS)


# Children of one process kill themselves before each call that touches the disk; others are killed
# from outside while they save one result after the other.
KILLED = """
import os, random, signal, sys, time
from pathlib import Path
import numpy as np
from vtlib import store

root = Path(sys.argv[1])

def fork(work):
    child = os.fork()
    if child == 0:
        try:
            work()
        finally:
            os._exit(0)
    return child

def kill_at(count):
    left = [count]
    def counted(real):
        def call(*args, **named):
            if left[0] == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            left[0] -= 1
            return real(*args, **named)
        return call
    for name in ("fdopen", "fsync", "chmod", "replace"):
        setattr(os, name, counted(getattr(os, name)))
    store.save(root / f"at-{count}" / "x", {"a": np.arange(5000) % 97}, {})

for count in range(9):
    os.waitpid(fork(lambda: kill_at(count)), 0)

def forever(folder):
    for i in range(10_000):
        store.save(folder / f"x{i}", {"a": np.arange(5000) % 97 + i}, {"i": i})

rng = random.Random(0)
for i in range(12):
    folder = root / f"loop-{i}"
    folder.mkdir()
    child = fork(lambda: forever(folder))
    while not any(folder.iterdir()):
        time.sleep(0.001)
    time.sleep(rng.uniform(0, 0.03))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
"""


@pytest.fixture(scope="module")
def killed(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("killed")
    subprocess.run([sys.executable, "-c", KILLED, str(root)], check=True, timeout=120)
    return root


@pytest.mark.parametrize("count", range(9))
def test_killed_before_any_call_leaves_the_whole_or_nothing(killed, count):
    path, expected = killed / f"at-{count}" / "x", {"a": np.arange(5000) % 97}
    # two files, each opened, flushed, given its mode and moved to its place: 8 calls
    assert store.exists(path) == (count == 8)
    if not store.exists(path):
        with pytest.raises(FileNotFoundError):
            store.load(path)
    store.save(path, expected, {})
    assert_same(store.load(path)[0], expected)


def test_killed_in_a_loop_leaves_the_whole_or_nothing(killed):
    for folder in killed.glob("loop-*"):
        stored = sorted(folder.glob("*.json"))
        for i in range(len(stored)):
            arrays, note = store.load(folder / f"x{i}")
            assert note["i"] == i
            assert_same(arrays, {"a": np.arange(5000) % 97 + i})
        following = folder / f"x{len(stored)}"
        assert not store.exists(following)
        store.save(following, {"a": np.arange(3)}, {})
        assert_same(store.load(following)[0], {"a": np.arange(3)})


def test_leftovers_of_a_kill_do_not_confuse(tmp_path):
    for name in (".x.npz.k1ll3d", ".x.json.k1ll3d"):
        (tmp_path / name).write_bytes(b"half")
    assert not store.exists(tmp_path / "x")
    store.save(tmp_path / "x", ARRAYS, NOTE)
    assert_same(store.load(tmp_path / "x")[0], ARRAYS)
    store.remove(tmp_path / "x")
    assert not store.exists(tmp_path / "x")


def test_provenance_that_json_cannot_hold_leaves_no_result(tmp_path):
    with pytest.raises(TypeError):
        store.save(tmp_path / "x", ARRAYS, {"seconds": np.float32(1)})
    assert not store.exists(tmp_path / "x")


def test_the_machine_is_described_in_words():
    machine = store.machine()
    assert machine["numpy"] == np.__version__
    assert all(isinstance(value, str) and value for value in machine.values())
    json.dumps(machine)
