"""What a stored result says of itself: its configuration, and the data set that it becomes."""

from pathlib import Path

import numpy as np
import pytest
from attrs import evolve, field, frozen
from hypothesis import given, settings
from hypothesis import strategies as st

from vtlib.experiments import store
from vtlib.transfer import Settings


def saved(owner, label, root, arrays):
    note = {"config": store.config_of(owner, label), "seconds": 1.0}
    store.save(store.path_of(owner, label, root), arrays, note)


def check(owner, config, seconds=1.0):
    store.check_note(Path("x"), {"config": config, "seconds": seconds}, owner, "GVT")


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
        ({"excluded": (2,)}, "excluded"),
        ({"algorithms": {"GVT": Settings("gaussian", minibatch=5)}}, "algorithm.n_samples"),
    ],
)
def test_a_result_of_another_configuration_is_refused(tiny, tmp_path, changes, named):
    other = evolve(tiny, **changes)
    saved(other, "GVT", tmp_path, {"run": np.arange(3)})
    store.stored(other, "GVT", tmp_path)
    with pytest.raises(store.TornResult, match=f"another configuration, which differs in {named}:"):
        store.stored(tiny, "GVT", tmp_path)
    # of the tasks only where they depend on it
    same = store.config_of(other, "tasks") == store.config_of(tiny, "tasks")
    assert same == changes.keys().isdisjoint(store.OF_TASKS)


def test_a_key_that_is_missing_has_its_default_and_is_refused_where_that_is_not_the_value(tiny):
    def without(key, at=None):
        config = store.config_of(tiny, "GVT")
        del (config[at] if at else config)[key]
        return config

    check(tiny, without("patience", "algorithm"))
    for key in ("visits", "excluded", "stream"):
        check(tiny, without(key))
    with pytest.raises(store.TornResult, match=r"differs in algorithm\.minibatch:"):
        check(tiny, without("minibatch", "algorithm"))
    for key in ("every", "sources", "pool", "family", "algorithm"):
        with pytest.raises(store.TornResult, match=f"differs in {key}:"):
            check(tiny, without(key))


@settings(deadline=None, derandomize=True, max_examples=60)
@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.text(max_size=5),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
        max_leaves=5,
    ).filter(lambda value: value != 3)
)
def test_whatever_stands_for_a_configuration_is_one_line(tiny, value):
    known = store.config_of(tiny, "GVT")
    for config in (value, {"algorithm": value}, {**known, "runs": value}):
        with pytest.raises(store.TornResult) as caught:
            check(tiny, config)
        assert len(str(caught.value).splitlines()) == 1


def test_a_key_that_nobody_knows_and_seconds_that_are_none_are_refused(tiny):
    config = store.config_of(tiny, "GVT")
    with pytest.raises(store.TornResult, match="does not tell its seconds"):
        check(tiny, config, seconds="1")
    with pytest.raises(store.TornResult, match=r"differs in .*'a\\+nb'"):
        check(tiny, {**config, "a\nb": 1})


def test_settings_of_ones_own_are_stored_like_any_other(tiny):
    @frozen
    class Mine(Settings):
        alpha_2: float = field(default=0.5)

    mine = evolve(tiny, algorithms={"GVT": Mine("gaussian", alpha_2=0.25)})
    config = store.config_of(mine, "GVT")
    check(mine, config)
    with pytest.raises(store.TornResult, match=r"algorithm\.'alpha_2'"):
        check(evolve(mine, algorithms={"GVT": Settings("gaussian")}), config)


def test_what_is_loaded_has_the_names_of_its_axes(tiny, weights, tmp_path):
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
    solved = {"index": np.arange(3), "weights": weights[:3], "iterations": np.array([5, 6, 7])}
    saved(tiny.pool, "sources", tmp_path, solved)
    found = store.load(tiny.pool, "sources", tmp_path)
    assert found.weights.dims == ("source", "weights_1")
    assert found.iterations.sel(source=2) == 7
    np.testing.assert_array_equal(store.weights(tiny.pool, tmp_path), weights[:3])


@pytest.mark.parametrize("wrong", [np.zeros(0), np.float64(0), np.zeros((4, 2))])
def test_runs_of_another_number_are_torn(tiny, tmp_path, wrong):
    saved(tiny, "GVT", tmp_path, {"run": np.arange(3), "learning": wrong})
    with pytest.raises(store.TornResult, match="GVT does not hold 3 learning"):
        store.load(tiny, "GVT", tmp_path)


@pytest.mark.parametrize("wrong", [None, np.zeros((2, 226), "f4")])
def test_weights_of_another_shape_are_refused(tiny, tmp_path, wrong):
    arrays = {"index": np.arange(3)} | ({} if wrong is None else {"weights": wrong})
    saved(tiny.pool, "sources", tmp_path, arrays)
    with pytest.raises(ValueError, match="weights of tiny-pool must"):
        store.weights(tiny.pool, tmp_path)
