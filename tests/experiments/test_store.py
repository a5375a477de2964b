"""Stored results: written once and whole; what was not written, or otherwise, is never read."""

from __future__ import annotations

import hashlib
import io
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from attrs import evolve, field, frozen
from hypothesis import given, settings
from hypothesis import strategies as st

from vtlib.experiments import store
from vtlib.transfer import Settings

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


def written(arrays: store.Arrays = ARRAYS) -> tuple[bytes, bytes]:
    """The two files of a stored result."""
    with tempfile.TemporaryDirectory() as folder:
        store.save(Path(folder, "x"), arrays, NOTE)
        return Path(folder, "x.npz").read_bytes(), Path(folder, "x.json").read_bytes()


NPZ, JSON = written()


def read_pair(npz: bytes | None, note: bytes) -> tuple[store.Arrays, dict[str, Any]]:
    """What is read where these two files lie; None for a file that is missing."""
    with tempfile.TemporaryDirectory() as folder:
        if npz is not None:
            Path(folder, "x.npz").write_bytes(npz)
        Path(folder, "x.json").write_bytes(note)
        return store.read(Path(folder, "x"))


def assert_torn(npz: bytes | None, note: bytes) -> None:
    with pytest.raises(store.TornResult) as caught:
        read_pair(npz, note)
    assert len(str(caught.value).splitlines()) == 1


def note_for(npz: bytes) -> bytes:
    return json.dumps({"sha256": hashlib.sha256(npz).hexdigest()}).encode()


def files(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir()}


# --- files ---------------------------------------------------------------------------------------


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
        {"run": np.arange(3, dtype=np.int32)},
        {"gaps": np.array([np.nan, np.inf, 0.0])},
        {"more": np.zeros(1)},
    ],
    ids=["a value", "a shape", "a type", "a sign of zero", "a name"],
)
def test_another_result_is_refused_and_the_old_one_stays(tmp_path, change):
    store.save(tmp_path / "x", ARRAYS, NOTE)
    before = files(tmp_path)
    with pytest.raises(FileExistsError, match="x holds another result: move it away"):
        store.save(tmp_path / "x", {**ARRAYS, **change}, NOTE)
    assert files(tmp_path) == before


def test_half_a_result_is_none(tmp_path):
    with pytest.raises(FileNotFoundError, match="no stored result at"):
        store.read(tmp_path / "x")
    (tmp_path / "x.npz").write_bytes(NPZ[:100])
    (tmp_path / ".x.json.k1ll3d").write_bytes(b"half")
    assert not store.exists(tmp_path / "x")
    store.save(tmp_path / "x", ARRAYS, NOTE)
    assert store.same_arrays(store.read(tmp_path / "x")[0], ARRAYS)
    (tmp_path / "x.npz").unlink()
    before = files(tmp_path)
    with pytest.raises(store.TornResult):
        store.save(tmp_path / "x", ARRAYS, NOTE)
    assert files(tmp_path) == before


@PROPERTY
@given(st.integers(0, len(NPZ) - 1), st.integers(1, 255), st.binary(max_size=40))
def test_an_npz_that_was_altered_is_torn(at, mask, more):
    flipped = bytearray(NPZ)
    flipped[at] ^= mask
    for npz in (None, bytes(flipped), NPZ[:at], NPZ + b"x" + more):
        assert_torn(npz, JSON)
    assert_torn(written({**ARRAYS, "run": np.arange(1, 4)})[0], JSON)


@PROPERTY
@given(st.integers(0, len(JSON) - 2), st.integers(1, 255))  # nobody misses the last line end
def test_a_json_that_was_altered_is_torn_or_the_arrays_are_right(at, mask):
    assert_torn(NPZ, JSON[:at])
    flipped = bytearray(JSON)
    flipped[at] ^= mask
    try:
        arrays, _ = read_pair(NPZ, bytes(flipped))
    except store.TornResult:
        return
    assert store.same_arrays(arrays, ARRAYS)


@pytest.mark.parametrize(
    "note",
    [b"{}", b"[]", b"null", b"1", b'"sha256"', b'{"sha256": 3}', b"\xff\xfe{", b"[" * 100_000, b""],
)
def test_a_json_that_is_no_provenance_is_torn(note):
    assert_torn(NPZ, note)


class Hostile:
    """Leaves a mark wherever it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self._mark = str(mark)

    def __reduce__(self) -> tuple:
        return os.mkdir, (self._mark,)


@pytest.mark.parametrize("write", [np.save, np.savez], ids=["array", "archive"])
def test_a_pickle_is_refused_and_never_executed(tmp_path, write):
    mark = tmp_path / "executed"
    buffer = io.BytesIO()
    write(buffer, np.array([Hostile(mark)], dtype=object))
    npz = buffer.getvalue()
    assert_torn(npz, note_for(npz))
    assert not mark.exists()
    # proof that the bytes would have executed, had they been trusted
    loaded = np.load(io.BytesIO(npz), allow_pickle=True)
    assert len(loaded["arr_0"] if write is np.savez else loaded) == 1
    assert mark.exists()


def test_what_the_files_cannot_hold_leaves_no_result(tmp_path):
    with pytest.raises(ValueError, match="x cannot hold objects, only plain arrays: a"):
        store.save(tmp_path / "x", {"a": np.array([{}], dtype=object)}, {})
    with pytest.raises(TypeError):
        store.save(tmp_path / "x", ARRAYS, {"seconds": np.float32(1)})
    assert not any(tmp_path.iterdir())


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
    assert store.same_arrays(store.read(tmp_path / "x")[0], ARRAYS)


# Children of one process kill themselves before each call that touches the disk.
KILLED = """
import os, signal, sys
from pathlib import Path
import numpy as np
from vtlib.experiments import store

def killed_at(count):
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
    store.save(Path(sys.argv[1], f"at-{count}", "x"), {"a": np.arange(5000) % 97}, {})

for count in range(9):
    child = os.fork()
    if child == 0:
        killed_at(count)
        os._exit(0)
    os.waitpid(child, 0)
"""


def test_killed_before_any_call_leaves_the_whole_or_nothing(tmp_path):
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], check=True, timeout=120)
    for count in range(9):
        path, expected = tmp_path / f"at-{count}" / "x", {"a": np.arange(5000) % 97}
        # two files, each opened, flushed, given its mode and moved to its place: 8 calls
        assert store.exists(path) == (count == 8)
        store.save(path, expected, {})
        assert store.same_arrays(store.read(path)[0], expected)


# --- configurations ------------------------------------------------------------------------------


def saved(owner, label, root, arrays=None, **note):
    config = {"config": store.config_of(owner, label), "seconds": 1.0, **note}
    count = getattr(owner, "runs", owner.count if hasattr(owner, "count") else 0)
    store.save(store.path_of(owner, label, root), arrays or {"run": np.arange(count)}, config)


def test_a_configuration_is_written_out_and_holds_what_the_result_depends_on(tiny):
    runs = store.config_of(evolve(tiny, counts={"GVT": 1}, excluded=(2,)), "GVT")
    assert (runs["sources"], runs["excluded"], runs["pool"]) == (1, [2], "tiny-pool")
    assert runs["algorithm"]["minibatch"] == 5
    assert runs["algorithm"]["patience"] == 0
    tasks = store.config_of(tiny, "tasks")
    assert tasks.keys() == set(runs) - {"algorithm", "iterations", "every", "visits", "probes", "each"}
    pool = store.config_of(tiny.pool, "sources")
    assert (pool["stream"], pool["settings"]["epsilon_steps"]) == ("tiny-pool", 100)
    json.dumps([runs, tasks, pool])


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"iterations": 240}, "iterations"),
        ({"stream": "other"}, "stream"),
        ({"sources": 1}, "sources"),
        ({"counts": {"GVT": 1}}, "sources"),
        ({"runs_per_task": 3}, "runs_per_task"),
        ({"visits": True}, "visits"),
        ({"each": True}, "each"),
        ({"algorithms": {"GVT": Settings("gaussian", minibatch=5)}}, "algorithm.n_samples"),
    ],
)
def test_a_result_of_another_configuration_is_refused(tiny, tmp_path, changes, named):
    saved(tiny, "GVT", tmp_path)
    store.stored(tiny, "GVT", tmp_path)
    with pytest.raises(store.TornResult, match=f"another configuration, which differs in {named}:"):
        store.stored(evolve(tiny, **changes), "GVT", tmp_path)


def config_without(config: dict[str, Any], path: str) -> dict[str, Any]:
    """A configuration without one of its keys, which may lie deeper."""
    first, _, rest = path.partition(".")
    if rest:
        return {**config, first: config_without(config[first], rest)}
    return {key: value for key, value in config.items() if key != path}


def test_a_key_that_is_missing_has_its_default_and_is_refused_where_that_is_not_the_value(tiny):
    whole = store.config_of(tiny, "GVT")
    for key in ("visits", "excluded", "stream", "algorithm.patience"):
        note = {"config": config_without(whole, key), "seconds": 1.0}
        store.check_note(Path("x"), note, tiny, "GVT")
    for key in ("every", "sources", "pool", "family", "algorithm", "algorithm.minibatch"):
        note = {"config": config_without(whole, key), "seconds": 1.0}
        with pytest.raises(store.TornResult, match=f"differs in {key}:"):
            store.check_note(Path("x"), note, tiny, "GVT")


@pytest.mark.parametrize("at", ["", "algorithm"])
def test_a_key_that_nobody_knows_is_refused(tiny, tmp_path, at):
    config = store.config_of(tiny, "GVT")
    (config[at] if at else config)["a\nb"] = 1
    saved(tiny, "GVT", tmp_path, config=config)
    with pytest.raises(store.TornResult, match=r"differs in .*'a\\+nb'") as caught:
        store.stored(tiny, "GVT", tmp_path)
    assert len(str(caught.value).splitlines()) == 1


@PROPERTY
@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.text(max_size=5),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
        max_leaves=5,
    ).filter(lambda value: value != 3)
)
def test_whatever_stands_for_a_configuration_is_one_line(tiny, value):
    for config in (value, {"algorithm": value}, {**store.config_of(tiny, "GVT"), "runs": value}):
        with pytest.raises(store.TornResult) as caught:
            store.check_note(Path("x"), {"config": config, "seconds": 1.0}, tiny, "GVT")
        assert len(str(caught.value).splitlines()) == 1


def test_a_provenance_without_seconds_is_refused(tiny, tmp_path):
    saved(tiny, "GVT", tmp_path, seconds="1")
    with pytest.raises(store.TornResult, match="does not tell its seconds"):
        store.stored(tiny, "GVT", tmp_path)


def test_settings_of_ones_own_are_stored_like_any_other(tiny, tmp_path):
    @frozen
    class Mine(Settings):
        alpha_2: float = field(default=0.5)

    mine = evolve(tiny, algorithms={"GVT": Mine("gaussian", alpha_2=0.25)})
    saved(mine, "GVT", tmp_path)
    store.stored(mine, "GVT", tmp_path)
    with pytest.raises(store.TornResult, match=r"algorithm\.'alpha_2'"):
        store.stored(evolve(mine, algorithms={"GVT": Settings("gaussian")}), "GVT", tmp_path)


# --- data sets -----------------------------------------------------------------------------------


def test_runs_are_loaded_with_the_names_of_their_axes(tiny, tmp_path):
    runs = {
        "run": np.arange(3),
        "iterations": np.array([20, 40]),
        "learning": np.arange(6.0).reshape(3, 2),
        "fingerprints": np.zeros((3, 3, 4)),
        "inside": np.zeros((3, 2, 5)),
    }
    saved(tiny, "GVT", tmp_path, runs)
    saved(tiny, "tasks", tmp_path, {"optimum": np.array([0.5, 0.6, 0.7]), "doors": np.ones((3, 2))})
    found = store.returns(tiny, "GVT", tmp_path)
    assert found.learning.dims == ("run", "iteration")
    assert found.fingerprints.dims == ("run", "fingerprints_1", "fingerprints_2")
    assert found.inside.dims == ("run", "iteration", "inside_2")
    assert float(found.learning.sel(run=2, iteration=40)) == 5
    assert found.optimum.sel(run=1) == 0.6
    assert found.attrs["config"]["every"] == 20
    assert store.load(tiny, "tasks", tmp_path).doors.dims == ("run", "doors_1")


def test_sources_are_loaded_with_their_places_in_the_pool(tiny, weights, tmp_path):
    arrays = {"index": np.arange(3), "weights": weights[:3], "iterations": np.array([5, 6, 7])}
    saved(tiny.pool, "sources", tmp_path, arrays)
    found = store.load(tiny.pool, "sources", tmp_path)
    assert found.weights.dims == ("source", "weights_1")
    assert found.iterations.sel(source=2) == 7
    np.testing.assert_array_equal(store.weights(tiny.pool, tmp_path), weights[:3])


@pytest.mark.parametrize("wrong", [np.zeros(0), np.float64(0), np.zeros((4, 2))])
def test_runs_of_another_number_are_torn(tiny, tmp_path, wrong):
    saved(tiny, "GVT", tmp_path, {"run": np.arange(3), "learning": wrong})
    with pytest.raises(store.TornResult, match="GVT does not hold 3 learning"):
        store.load(tiny, "GVT", tmp_path)


@pytest.mark.parametrize(
    "wrong",
    [None, np.zeros((3, 226)), np.zeros((2, 226), "f4"), np.full((3, 226), np.nan, "f4")],
    ids=["missing", "float64", "count", "nan"],
)
def test_weights_of_another_shape_are_refused(tiny, tmp_path, wrong):
    arrays = {"index": np.arange(3)} | ({} if wrong is None else {"weights": wrong})
    saved(tiny.pool, "sources", tmp_path, arrays)
    with pytest.raises(ValueError, match="weights of tiny-pool must"):
        store.weights(tiny.pool, tmp_path)
