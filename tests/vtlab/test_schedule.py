"""Units of work: kept when done, never computed twice, and computed again when a worker dies."""

import os
import re
import shutil
import signal
import threading
import time
from functools import partial

import numpy as np
import pytest
from attrs import evolve
from distributed import Client

from vtbook.experiments.rooms import ROOMS_EVALUATION
from vtlab import schedule, store
from vtlab.schedule import compute, done, join_finished, keep, units_of
from vtlib.files import TornResult
from vtlib.training import Diverged


def test_units_are_batches_of_runs_and_halves_of_small_pools(tiny):
    assert [u.members for u in units_of(tiny.pool)] == [range(2), range(2, 3)]
    assert units_of(evolve(tiny.pool, count=60))[0].members == range(25)
    units = units_of(tiny)
    assert [(u.label, u.members) for u in units[:2]] == [("NT", range(2)), ("NT", range(2, 3))]
    assert (units[-1].label, units[-1].members) == ("tasks", range(3))
    assert [u.pool for u in units] == [tiny.pool] * 8 + [None]
    assert len({u.part for u in units}) == len(units)


def test_complete_stores_every_result_with_its_provenance(tiny, stored):
    for owner, label in store.results_of(tiny):
        _, note = store.stored(owner, label, stored)
        assert note["seconds"] >= 0
        assert 10 < note["megabytes"] < 5000
        assert note["machine"] == store.machine()
        assert (note["owner"], note["label"]) == (owner.name, label)
    assert note["seeds"] == "SHA-256 of tiny/<run>/<role>"
    assert list(store.stored(tiny, "GVT", stored)[0]["run"]) == [0, 1, 2]
    assert sorted(p.name for p in stored.iterdir()) == ["tiny", "tiny-pool"]


def test_only_what_is_missing_is_computed_and_joined_and_the_rest_is_left_alone(
    tiny, stored, here, monkeypatch
):
    def rest():
        return {p: p.stat().st_mtime_ns for p in stored.rglob("*.*") if p.stem != "NT"}

    before = rest()
    first, other = (u for u in units_of(tiny) if u.label == "NT")
    expected, _ = store.read(stored / first.result)
    store.remove(stored / first.result)
    weights = store.weights(tiny.pool, stored)
    keep(first, *compute(first, weights), stored)
    assert done(first, stored)
    assert not done(other, stored)
    join_finished(units_of(tiny), stored)
    assert not store.exists(stored / first.result)
    ran = []
    monkeypatch.setattr(
        schedule, "compute", lambda *given: (ran.append(given[0]), compute(*given))[1]
    )
    complete = partial(schedule.complete, [tiny], stored, scheduler=here, quiet=True)
    complete()
    assert ran == [other]
    assert rest() == before
    assert store.same_arrays(store.read(stored / first.result)[0], expected)
    assert not (stored / "parts").exists()
    # one that was left beside its whole result is no use
    keep(first, expected, {"seconds": 1.0, "megabytes": 9}, stored)
    complete()
    assert not (stored / "parts").exists()


def test_an_error_of_one_unit_keeps_what_the_others_have_done(tiny, stored, here, monkeypatch):
    for label in ("NT", "GVT"):
        store.remove(stored / "tiny" / label)
    real = schedule.compute

    def diverging(unit, *rest):
        if unit.label == "GVT" and unit.members == range(2, 3):
            raise Diverged("run 2 of tiny, GVT diverged")
        return real(unit, *rest)

    monkeypatch.setattr(schedule, "compute", diverging)
    with pytest.raises(Diverged, match="run 2 of tiny"):
        schedule.complete([tiny], stored, scheduler=here, quiet=True)
    assert store.exists(stored / "tiny" / "NT")
    assert list((stored / "parts" / "tiny").glob("GVT-*.json"))


def test_two_experiments_share_their_pool_and_one_bar(tiny, here, tmp_path, capsys):
    pool = evolve(tiny.pool, iterations=199, limit=199)
    one = evolve(tiny, pool=pool, algorithms={"NT": tiny.algorithms["NT"]}, iterations=20)
    schedule.complete([one, evolve(one, name="other")], tmp_path, scheduler=here)
    assert {p.parent.name for p in tmp_path.rglob("*.npz")} == {"tiny-pool", "tiny", "other"}
    bar = capsys.readouterr().err
    assert "2 experiments 100%" in bar
    assert "left" in bar


def test_two_experiments_of_one_name_are_refused(tiny, tmp_path):
    one = evolve(tiny, algorithms={"NT": tiny.algorithms["NT"]})
    with pytest.raises(ValueError, match="names of their own"):
        schedule.complete([tiny, one], tmp_path)
    assert not list(tmp_path.rglob("*.npz"))


def test_the_bar_never_goes_back_and_ends_with_the_last_unit(tiny):
    progress = schedule.Progress(units_of(tiny), "tiny", quiet=True)
    parts = [str(unit.part) for unit in units_of(tiny)]
    progress.tell(parts[0], 1)
    progress.tell(parts[0], 0.5)  # a message that was late
    assert progress._gone[parts[0]] == progress._seconds[parts[0]]
    for part in parts:
        progress.tell(part, 1)
    assert sum(progress._gone.values()) == progress.bar.total


def test_the_time_of_a_unit_is_expected_as_it_was_for_the_stored_runs(tiny, monkeypatch):
    note = store.provenance(store.results_folder() / "rooms-evaluation" / "GVT")
    units = [u for u in units_of(ROOMS_EVALUATION.published) if u.label == "GVT"]
    assert sum(u.expected_seconds for u in units) == pytest.approx(note["seconds"])
    for junk in ({}, {"seconds": "1", "config": {"runs": 3}}, {"seconds": 1.0, "config": 2}):
        monkeypatch.setattr(store, "provenance", lambda *_, junk=junk: junk)
        assert units_of(tiny)[0].expected_seconds > 0


def test_a_part_of_another_configuration_stops_it_before_anything_is_computed(
    tiny, tmp_path, monkeypatch
):
    note = {"config": {"limit": 7}, "seconds": 1.0}
    store.save(tmp_path / units_of(tiny.pool)[0].part, {"x": np.zeros(1)}, note)
    monkeypatch.setattr(schedule, "_cluster", None)
    with pytest.raises(TornResult, match="another configuration"):
        schedule.complete([tiny], tmp_path, quiet=True)


def test_a_scheduler_that_is_not_there_is_named(tiny, tmp_path, monkeypatch):
    short = partial(Client, set_as_default=False, timeout=0.5)
    monkeypatch.setattr(schedule, "Client", lambda address, **_: short(address))
    with pytest.raises(OSError, match=re.escape("tcp://127.0.0.1:9")):
        schedule.complete([tiny], tmp_path, scheduler="tcp://127.0.0.1:9", quiet=True)


def test_memory_is_not_given_back_to_the_system_again_and_again(tiny, monkeypatch):
    monkeypatch.delenv("MALLOC_TRIM_THRESHOLD_", raising=False)
    bar = schedule.Progress(units_of(tiny), "tiny", quiet=True)
    with schedule._cluster(1, None, bar) as client:
        assert set(client.run(os.getenv, "MALLOC_TRIM_THRESHOLD_").values()) == {None}


def test_a_worker_that_dies_loses_nothing_and_others_versions_are_refused(
    tiny, computed, cluster, tmp_path, monkeypatch
):
    shutil.copytree(computed / "tiny-pool", tmp_path / "tiny-pool")
    small = evolve(tiny, algorithms={label: tiny.algorithms[label] for label in ("NT", "GVT")})
    with cluster(n_workers=2) as there:
        address = {"scheduler": there.scheduler_address}
        call = partial(schedule.complete, [small], tmp_path, quiet=True, **address)
        with monkeypatch.context() as patched:
            patched.setattr(schedule, "__version__", "0.0")  # here, not in the workers
            with pytest.raises(ValueError, match=r"worker tcp.* must have .*'0\.0'.*, has "):
                call()
        with Client(there, set_as_default=False) as client:
            victim = next(iter(client.run(os.getpid).values()))
        left = []

        def kill_in_the_middle():
            while not list((tmp_path / "parts").rglob("*.json")):
                time.sleep(0.005)
            os.kill(victim, signal.SIGKILL)
            left.extend(u for u in units_of(small) if not done(u, tmp_path))

        killer = threading.Thread(target=kill_in_the_middle)
        killer.start()
        call()
        killer.join()
    assert left
    for owner, label in store.results_of(small):
        a, b = (store.stored(owner, label, root)[0] for root in (computed, tmp_path))
        assert store.same_arrays(a, b), label
