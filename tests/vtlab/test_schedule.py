"""Units of work: kept when done, never computed twice, by whatever executor there is."""

import re
from functools import partial

import numpy as np
import pytest
from attrs import evolve
from distributed import Client, LocalCluster

from vtlab import schedule, store
from vtlab.schedule import join_finished, keep
from vtlab.units import compute, units_of
from vtlib.files import TornResult
from vtlib.training import Diverged


def test_units_are_batches_of_runs_and_halves_of_small_pools(tiny):
    assert [u.members for u in units_of(tiny.pool)] == [range(2), range(2, 3)]
    assert units_of(evolve(tiny.pool, count=60))[0].members == range(25)
    units = [(u.label, u.members, u.pool) for u in units_of(tiny)]
    assert units[:2] == [("NT", x, tiny.pool) for x in (range(2), range(2, 3))]
    assert units[-1] == ("tasks", range(3), None)


def test_only_what_is_missing_is_computed_and_joined_and_the_rest_is_left_alone(
    tiny, stored, here, monkeypatch
):
    def rest():
        return {p: p.stat().st_mtime_ns for p in stored.rglob("*.*") if p.stem != "NT"}

    before = rest()
    first, other = (u for u in units_of(tiny) if u.label == "NT")
    expected, _ = store.read(stored / first.result)
    store.remove(stored / first.result)
    keep(first, *compute(first, store.weights(tiny.pool, stored)), stored)
    join_finished(units_of(tiny), stored)
    assert store.exists(stored / first.part)
    assert not store.exists(stored / first.result)
    units = []
    monkeypatch.setattr(schedule, "compute", lambda *x: (units.append(x[0]), compute(*x))[1])
    complete = partial(schedule.complete, [tiny], stored, here)
    complete()
    assert units == [other]
    assert rest() == before
    np.testing.assert_equal(store.read(stored / first.result)[0], expected)
    assert not (stored / "parts").exists()
    # a part beside its whole result is of no use
    store.save(stored / first.part, expected, store.read(stored / first.result)[1])
    complete()
    assert not (stored / "parts").exists()


def test_an_error_of_one_unit_keeps_what_the_others_have_done(tiny, stored, here, monkeypatch):
    for label in ("NT", "GVT"):
        store.remove(stored / "tiny" / label)

    def diverging(unit, *rest):
        if unit.label == "GVT" and unit.members == range(2, 3):
            raise Diverged("run 2 of tiny, GVT diverged")
        return compute(unit, *rest)

    monkeypatch.setattr(schedule, "compute", diverging)
    with pytest.raises(Diverged, match="run 2 of tiny"):
        schedule.complete([tiny], stored, here)
    assert store.exists(stored / "tiny" / "NT")
    assert list((stored / "parts" / "tiny").glob("GVT-*.json"))


def test_parts_of_another_configuration_are_refused(tiny, tmp_path):
    store.save(tmp_path / units_of(tiny.pool)[0].part, {"x": np.zeros(1)}, {"seconds": 1.0})
    with pytest.raises(TornResult, match="another configuration"):
        schedule.complete([tiny], tmp_path)


def test_experiments_share_a_pool_and_one_bar_but_no_name(tiny, here, tmp_path, capsys):
    pool = evolve(tiny.pool, iterations=199, limit=199)
    first = evolve(tiny, pool=pool, algorithms={"NT": tiny.algorithms["NT"]}, iterations=20)
    with pytest.raises(ValueError, match="names of their own"):
        schedule.complete([tiny, first], tmp_path)
    assert not list(tmp_path.rglob("*.npz"))
    schedule.complete([first, evolve(first, name="other")], tmp_path, here)
    assert {p.parent.name for p in tmp_path.rglob("*.npz")} == {"tiny-pool", "tiny", "other"}
    assert re.search(r"100%\|.* gone, 00:00 left", capsys.readouterr().err)


def test_dask_computes_what_processes_here_compute(tiny, stored, tmp_path):
    only = evolve(tiny, algorithms={"GVT": tiny.algorithms["GVT"]})
    workers = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with workers as cluster, Client(cluster) as client:
        schedule.complete([only], tmp_path, client.get_executor())
    for name in ("tiny-pool/sources", "tiny/GVT"):
        np.testing.assert_equal(store.read(tmp_path / name)[0], store.read(stored / name)[0])
