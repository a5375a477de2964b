import json
import multiprocessing
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from vtlib import store
from vtlib.baselines import MellowTDSettings
from vtlib.domains import DOMAINS
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments import EXPERIMENTS, POOLS, Experiment, named, schedule, verify, work
from vtlib.experiments.schedule import complete
from vtlib.experiments.work import load_result
from vtlib.sources import Pool
from vtlib.training import Diverged
from vtlib.transfer import Settings

POOL = Pool(
    "tiny-pool",
    RoomsFamily(rooms=2),
    count=3,
    iterations=220,
    limit=230,
    check_every=10,
    episodes=2,
    settings=MellowTDSettings(epsilon_steps=100),
)
TINY = Experiment(
    "tiny",
    POOL,
    RoomsFamily(rooms=2),
    {
        "NT": MellowTDSettings(epsilon_steps=100),
        "GVT": Settings("gaussian", lambda_=1e-4, batch=5, weights=2),
        "2-MGVT": Settings(components=2, batch=5, weights=2),
    },
    runs=3,
    sources=2,
    iterations=220,
    every=20,
)


@contextmanager
def here(progress):
    """Work that is done in this process, one unit after the other."""
    with ThreadPoolExecutor(1) as executor:
        yield executor


def install(monkeypatch):
    """A small experiment under its own names, with targets that need no planning."""
    monkeypatch.setitem(EXPERIMENTS, TINY.name, TINY)
    monkeypatch.setitem(POOLS, POOL.name, POOL)
    monkeypatch.setattr(work, "BATCH", 2)
    planned = replace(DOMAINS[RoomsFamily], optimum=lambda tasks: torch.ones(len(tasks)))
    monkeypatch.setitem(DOMAINS, RoomsFamily, planned)


@pytest.fixture
def tiny(monkeypatch):
    install(monkeypatch)
    return TINY


@pytest.fixture(scope="module")
def computed(tmp_path_factory):
    root = tmp_path_factory.mktemp("computed")
    with pytest.MonkeyPatch.context() as monkeypatch:
        install(monkeypatch)
        complete([TINY], root, here)
    return root


@pytest.fixture
def stored(tiny, computed, tmp_path):
    return shutil.copytree(computed, tmp_path / "stored")


def test_complete_stores_every_result_with_its_provenance(stored):
    for owner, label in verify.results_of("tiny"):
        _, note = work.load_result(owner, label, stored)
        assert note["seconds"] >= 0
        assert note["machine"]["torch"]
    arrays, note = work.load_result("tiny", "GVT", stored)
    assert arrays["learning"].shape == arrays["greedy"].shape == (3, 11)
    assert list(arrays["iterations"]) == list(range(20, 221, 20))
    assert note["config"]["algorithm"]["lambda_"] == 1e-4
    assert not (stored / work.PARTS).exists()


def test_a_stored_result_is_readable_without_vtlib(stored):
    with np.load(stored / "tiny" / "NT.npz", allow_pickle=False) as arrays:
        assert set(arrays) == {"run", "iterations", "learning", "greedy", "fingerprints"}
    assert json.loads((stored / "tiny" / "NT.json").read_text())["label"] == "NT"


def test_stored_runs_verify_whole_and_one_by_one(stored):
    for owner, label in verify.results_of("tiny"):
        assert verify.check_heads(owner, label, stored).wrong == []
    assert verify.check_heads("tiny", "2-MGVT", stored, members=[2]).wrong == []


@pytest.mark.parametrize("label", ["GVT", "2-MGVT", "NT"])
def test_a_shifted_seed_does_not_verify(stored, label, monkeypatch):
    shifted = replace(TINY, stream="other")
    monkeypatch.setitem(EXPERIMENTS, "tiny", shifted)
    monkeypatch.setattr(work, "_check_config", lambda *a: None)
    assert verify.check_heads("tiny", label, stored).wrong == [0, 1, 2]


def test_changed_arrays_do_not_verify(stored):
    path = stored / "tiny" / "NT"
    arrays, note = store.load(path)
    store.remove(path)
    arrays["fingerprints"][1, 2, 0] += 1.0
    store.save(path, arrays, note)
    assert verify.check_heads("tiny", "NT", stored).wrong == [1]


def test_a_result_of_another_configuration_is_refused(stored, monkeypatch):
    monkeypatch.setitem(EXPERIMENTS, "tiny", replace(TINY, iterations=240))
    with pytest.raises(store.TornResult, match="another configuration"):
        work.load_result("tiny", "NT", stored)


def test_sources_of_one_attempt_are_not_those_of_several(stored, monkeypatch):
    monkeypatch.setitem(POOLS, POOL.name, replace(POOL, attempts=2))
    with pytest.raises(store.TornResult, match="another configuration"):
        load_result(POOL.name, "sources", stored)


def test_finished_units_are_not_computed_again(stored, monkeypatch):
    kept = {u.result: (stored / f"{u.result}.npz").read_bytes() for u in work.run_units(TINY)}
    store.remove(stored / "tiny" / "GVT")
    ran, compute = [], work._compute
    monkeypatch.setattr(work, "_compute", lambda u, *rest: (ran.append(u), compute(u, *rest))[1])
    complete([TINY], stored, here)
    assert {u.label for u in ran} == {"GVT"}
    for result, data in kept.items():
        assert (stored / f"{result}.npz").read_bytes() == data


def test_unknown_experiment():
    with pytest.raises(
        ValueError, match=r"unknown experiment 'romos'; known are .*rooms-evaluation"
    ):
        named("romos")


def _complete_in_child(root):
    complete([TINY], root, here, quiet=True)


def _stored(root):
    return {str(path) for path in root.rglob("*.json")}


def test_killed_ten_times_at_random_moments_the_same_call_leaves_the_same_files(
    tiny, tmp_path, monkeypatch
):
    monkeypatch.setattr(work, "BATCH", 1)
    began = time.monotonic()
    complete([TINY], tmp_path / "undisturbed", here)
    took = time.monotonic() - began
    root, kills = tmp_path / "killed", 0
    # after each unit that is done, at a random moment of the next or the one after
    for wait in np.random.default_rng(0).uniform(0, took / 10, 10):
        before = _stored(root)
        child = multiprocessing.get_context("fork").Process(target=_complete_in_child, args=(root,))
        child.start()
        while child.is_alive() and _stored(root) == before:
            time.sleep(0.001)
        time.sleep(wait)
        kills += child.is_alive()
        child.kill()
        child.join()
    assert kills >= 3  # the others found nothing left to do
    complete([TINY], root, here)
    for owner, label in verify.results_of("tiny"):
        undisturbed, _ = store.load(tmp_path / "undisturbed" / owner / label)
        assert store.same_arrays(store.load(root / owner / label)[0], undisturbed)
    assert not (root / work.PARTS).exists()


def test_parts_left_from_a_run_that_was_stopped_are_joined_with_the_others(tiny, tmp_path, stored):
    root = tmp_path / "again"
    shutil.copytree(stored / POOL.name, root / POOL.name)
    left = next(unit for unit in work.run_units(tiny) if unit.label == "NT")
    work.keep(left, *work.compute(left, work.pool_weights(POOL, root)), root)
    complete([TINY], root, here, quiet=True)
    for label in tiny.algorithms:
        assert list(store.load(root / "tiny" / label)[0]["run"]) == [0, 1, 2]


def test_parts_of_a_result_that_is_joined_are_removed(stored):
    unit = work.run_units(TINY)[0]
    work.keep(unit, *work.compute(unit, work.pool_weights(POOL, stored)), stored)
    complete([TINY], stored, here)
    assert not (stored / work.PARTS).exists()


def test_an_error_of_one_unit_keeps_what_the_others_have_done(tiny, tmp_path, monkeypatch):
    compute = work._compute

    def diverging(unit, *rest):
        if unit.label == "NT" and unit.members == (2,):
            raise Diverged("run 2 of tiny, NT diverged")
        return compute(unit, *rest)

    monkeypatch.setattr(work, "_compute", diverging)
    with pytest.raises(Diverged, match="run 2 of tiny"):
        complete([TINY], tmp_path, here, quiet=True)
    assert store.exists(tmp_path / POOL.name / "sources")
    monkeypatch.setattr(work, "_compute", compute)
    complete([TINY], tmp_path, here, quiet=True)
    assert store.exists(tmp_path / "tiny" / "NT")


def test_two_experiments_share_their_pool_and_one_bar(tmp_path, capsys, monkeypatch):
    install(monkeypatch)
    other = replace(TINY, name="other", algorithms={"NT": TINY.algorithms["NT"]})
    complete([TINY, other], tmp_path, here)
    assert {p.parent.name for p in tmp_path.rglob("*.npz")} == {POOL.name, "tiny", "other"}
    bar = capsys.readouterr().err
    assert "2 experiments 100%" in bar
    assert "left" in bar


def test_the_time_of_a_unit_is_expected_as_it_was_for_the_stored_runs():
    experiment = named("rooms-evaluation")
    note = store.provenance(store.results_folder() / "rooms-evaluation" / "GVT")
    units = [u for u in work.run_units(experiment) if u.label == "GVT"]
    expected = sum(map(schedule.expected_seconds, units))
    assert expected == pytest.approx(note["seconds"])
    assert schedule.expected_seconds(work.source_units(POOL)[0]) > 0


def test_a_part_of_another_configuration_stops_it_before_anything_is_computed(
    tiny, tmp_path, monkeypatch
):
    root, ran = tmp_path / "parts", []
    unit = work.source_units(POOL)[0]
    store.save(root / unit.part, {"x": np.zeros(1)}, {"config": {"limit": 7}, "seconds": 1.0})
    monkeypatch.setattr(work, "_compute", lambda *_: ran.append(1))
    with pytest.raises(store.TornResult, match="another configuration"):
        complete([TINY], root, here)
    assert not ran


@pytest.mark.parametrize("jobs", [1, 2])
def test_real_processes_compute_what_is_missing(tiny, stored, jobs):
    before, _ = store.load(stored / "tiny" / "NT")
    store.remove(stored / "tiny" / "NT")
    store.remove(stored / "tiny" / "tasks")
    complete([TINY], stored, schedule.processes(jobs), quiet=True)
    after, note = store.load(stored / "tiny" / "NT")
    assert store.same_arrays(before, after)
    assert 10 < note["megabytes"] < 5000


def _children(pid):
    text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    return [int(child) for child in text.split()]


def _running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def _wait_until(condition, seconds=60):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)
    assert condition()


@pytest.mark.skipif(
    not Path("/proc/self/task").exists(), reason="/proc alone tells a dead parent's children"
)
def test_workers_end_with_a_parent_that_is_killed(tmp_path):
    pool = named("rooms-evaluation").pool.name
    shutil.copytree(store.results_folder() / pool, tmp_path / pool)
    command = [sys.executable, "-m", "vtlib", "run", "rooms-evaluation", "--jobs", "2"]
    parent = subprocess.Popen([*command, "--results", str(tmp_path)], stderr=subprocess.DEVNULL)
    _wait_until(lambda: len(_children(parent.pid)) >= 2)
    workers = _children(parent.pid)
    parent.kill()
    parent.wait()
    _wait_until(lambda: not any(map(_running, workers)))
