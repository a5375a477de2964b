"""Stored results: written whole; read as what they were written as, or not at all."""

import hashlib
import io
import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from attrs import evolve
from hypothesis import given, settings
from hypothesis import strategies as st

from vtlab import store
from vtlib.files import TornResult
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


with tempfile.TemporaryDirectory() as folder:
    store.save(Path(folder, "x"), ARRAYS, NOTE)
    NPZ, JSON = (Path(folder, name).read_bytes() for name in ("x.npz", "x.json"))


def read_pair(npz, note):
    """What is read where these two files lie; None for a file that is missing."""
    with tempfile.TemporaryDirectory() as folder:
        if npz is not None:
            Path(folder, "x.npz").write_bytes(npz)
        Path(folder, "x.json").write_bytes(note)
        return store.read(Path(folder, "x"))[0]


def assert_same(arrays):
    assert arrays.keys() == ARRAYS.keys()
    for key, array in arrays.items():
        np.testing.assert_array_equal(array, ARRAYS[key], strict=True)


def assert_torn(npz, note):
    with pytest.raises(TornResult) as caught:
        read_pair(npz, note)
    assert len(str(caught.value).splitlines()) == 1


def test_what_is_saved_is_read(tmp_path):
    path = tmp_path / "deep" / "down" / "1-MGVT-lambda-1e-06-psi-0.5"
    assert not store.exists(path)
    store.save(path, ARRAYS, NOTE)
    assert store.exists(path)
    arrays, note = store.read(path)
    assert_same(arrays)
    assert note == store.provenance(path) == NOTE | {"sha256": note["sha256"]}
    assert {p.name for p in path.parent.iterdir()} == {f"{path.name}.npz", f"{path.name}.json"}
    with np.load(f"{path}.npz", allow_pickle=False) as plain:  # readable without vtlib
        assert set(plain) == set(ARRAYS)


@PROPERTY
@given(st.integers(0, len(NPZ) - 1), st.integers(1, 255), st.binary(max_size=40))
def test_an_npz_that_was_altered_is_torn(at, mask, more):
    flipped = bytearray(NPZ)
    flipped[at] ^= mask
    for npz in (None, bytes(flipped), NPZ[:at], NPZ + b"x" + more):
        assert_torn(npz, JSON)


@PROPERTY
@given(st.integers(0, len(JSON) - 2), st.integers(1, 255))  # nobody misses the last line end
def test_a_json_that_was_altered_is_torn_or_the_arrays_are_right(at, mask):
    assert_torn(NPZ, JSON[:at])
    flipped = bytearray(JSON)
    flipped[at] ^= mask
    try:
        arrays = read_pair(NPZ, bytes(flipped))
    except TornResult:
        return
    assert_same(arrays)


def test_a_json_that_is_no_provenance_is_torn_and_a_pickle_is_refused():
    for note in (b"{}", b"[]", b"1", b'{"sha256": 3}', b"\xff\xfe{", b"[" * 100_000, b""):
        assert_torn(NPZ, note)
    buffer = io.BytesIO()
    np.savez(buffer, np.array([{}], dtype=object))
    digest = hashlib.sha256(buffer.getvalue()).hexdigest()
    assert_torn(buffer.getvalue(), json.dumps({"sha256": digest}).encode())


def test_what_the_files_cannot_hold_leaves_no_result(tmp_path):
    with pytest.raises(ValueError, match="x cannot hold objects, only plain arrays: a"):
        store.save(tmp_path / "x", {"a": np.array([{}], dtype=object)}, {})
    with pytest.raises(TypeError):
        store.save(tmp_path / "x", ARRAYS, {"seconds": np.float32(1)})
    assert not any(tmp_path.iterdir())


def saved(owner, label, root, arrays):
    store.save(store.path_of(owner, label, root), arrays, store.origin(owner, label))


def check(owner, config, /, **changes):
    note = {**store.origin(owner, "GVT"), "config": config}
    store.check_note(Path("x"), note | changes, owner, "GVT")


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"iterations": 240}, "iterations"),
        ({"stream": "other"}, "stream, seeds"),
        ({"sources": 1}, "sources"),
        ({"counts": {"GVT": 1}}, "sources"),
        ({"runs_per_task": 3}, "runs_per_task"),
        ({"visits": True}, "visits"),
        ({"excluded": (2,)}, "excluded"),
        ({"algorithms": {"GVT": Settings("gaussian", minibatch=5)}}, "algorithm.n_samples"),
    ],
)
def test_a_result_of_another_configuration_is_refused(tiny, tmp_path, changes, named):
    other = evolve(tiny, **changes)
    saved(other, "GVT", tmp_path, {"run": np.arange(3)})
    store.stored(other, "GVT", tmp_path)
    with pytest.raises(TornResult, match=f"another configuration, which differs in {named}:"):
        store.stored(tiny, "GVT", tmp_path)
    # of the tasks only where they depend on it
    same = store.origin(other, "tasks")["config"] == store.origin(tiny, "tasks")["config"]
    assert same == changes.keys().isdisjoint(store.OF_TASKS)


def test_a_key_that_is_missing_has_its_default_and_is_refused_where_that_is_not_the_value(tiny):
    def without(key, at=None):
        config = store.origin(tiny, "GVT")["config"]
        del (config[at] if at else config)[key]
        return config

    check(tiny, without("patience", "algorithm"))
    for key in ("visits", "excluded", "stream"):
        check(tiny, without(key))
    with pytest.raises(TornResult, match=r"differs in algorithm\.minibatch:"):
        check(tiny, without("minibatch", "algorithm"))
    for key in ("every", "sources", "pool", "family", "algorithm"):
        with pytest.raises(TornResult, match=f"differs in {key}:"):
            check(tiny, without(key))


@pytest.mark.parametrize("name", ["owner", "label", "seeds"])
def test_a_provenance_that_is_of_another_result_is_refused(tiny, name):
    with pytest.raises(TornResult, match=f"differs in {name}"):
        check(tiny, store.origin(tiny, "GVT")["config"], **{name: None})


def test_a_key_that_nobody_knows_is_refused(tiny):
    config = store.origin(tiny, "GVT")["config"]
    for junk in (None, [], "a", {"algorithm": 3}):
        with pytest.raises(TornResult, match="differs in"):
            check(tiny, junk)
    with pytest.raises(TornResult, match=r"differs in .*'a\\+nb'"):
        check(tiny, {**config, "a\nb": 1})
    config["algorithm"]["alpha_2"] = 0.25
    with pytest.raises(TornResult, match=r"algorithm\.'alpha_2'"):
        check(tiny, config)


def test_what_is_loaded_has_the_names_of_its_axes(tiny, computed, tmp_path):
    runs, arrays = store.returns(tiny, "GVT", computed), store.read(computed / "tiny/GVT")[0]
    assert runs.learning.dims == ("run", "iteration")
    assert runs.learning.sel(run=2, iteration=40) == arrays["learning"][2, 1]
    assert runs.optimum.sel(run=1) == store.read(computed / "tiny/tasks")[0]["optimum"][1]
    assert runs.attrs["config"]["every"] == 20
    records = {"inside": np.zeros((3, 2, 5)), "fingerprints": np.zeros((3, 2, 4))}
    saved(tiny, "GVT", tmp_path, {"iterations": np.arange(2), **records})
    runs = store.load(tiny, "GVT", tmp_path)
    assert runs.inside.dims == ("run", "iteration", "inside_2")
    assert runs.fingerprints.dims == ("run", "fingerprints_1", "fingerprints_2")
    weights = store.load(tiny.pool, "sources", computed).weights
    assert weights.dims == ("source", "weights_1")
    np.testing.assert_array_equal(weights, store.weights(tiny.pool, computed))
    saved(tiny.pool, "sources", tmp_path, {"index": np.arange(3)})
    with pytest.raises(ValueError, match="weights of tiny-pool must"):
        store.weights(tiny.pool, tmp_path)


@pytest.mark.parametrize("wrong", [np.zeros(0), np.float64(0), np.zeros(4), np.ones(3) * np.nan])
def test_runs_of_another_number_or_of_none_are_torn(tiny, tmp_path, wrong):
    saved(tiny, "GVT", tmp_path, {"run": np.arange(3), "learning": wrong})
    with pytest.raises(TornResult, match=r"GVT (does not hold 3|has .* among its) learning"):
        store.load(tiny, "GVT", tmp_path)
