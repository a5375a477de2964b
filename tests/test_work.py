import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vtlib import store
from vtlib.baselines import MellowTDSettings
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments import EXPERIMENTS, POOLS, Experiment, named, verify, work
from vtlib.experiments.reproduce import reproduce
from vtlib.sources import Pool
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


RUN_ALL = work._run_all


def install(monkeypatch):
    """A small experiment under its own names, computed in this process."""
    monkeypatch.setitem(EXPERIMENTS, TINY.name, TINY)
    monkeypatch.setitem(POOLS, POOL.name, POOL)
    monkeypatch.setattr(work, "BATCH", 2)
    monkeypatch.setattr(work, "_run_all", run_here)


def run_here(missing, units, root, jobs, quiet):
    for unit in missing:
        work.run_unit(unit, root, lambda unit, share: True)


@pytest.fixture
def tiny(monkeypatch):
    install(monkeypatch)
    return TINY


@pytest.fixture(scope="module")
def computed(tmp_path_factory):
    root = tmp_path_factory.mktemp("computed")
    with pytest.MonkeyPatch.context() as monkeypatch:
        install(monkeypatch)
        work.complete("tiny", root, jobs=1)
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
        assert verify.mismatches(owner, label, stored) == []
    assert verify.mismatches("tiny", "2-MGVT", stored, members=[2]) == []


@pytest.mark.parametrize("label", ["GVT", "2-MGVT", "NT"])
def test_a_shifted_seed_does_not_verify(stored, label, monkeypatch):
    shifted = replace(TINY, stream="other")
    monkeypatch.setitem(EXPERIMENTS, "tiny", shifted)
    monkeypatch.setattr(work, "_check_config", lambda *a: None)
    assert verify.mismatches("tiny", label, stored) == [0, 1, 2]


def test_changed_arrays_do_not_verify(stored):
    path = stored / "tiny" / "NT"
    arrays, note = store.load(path)
    store.remove(path)
    arrays["fingerprints"][1, 2, 0] += 1.0
    store.save(path, arrays, note)
    assert verify.mismatches("tiny", "NT", stored) == [1]


def test_a_result_of_another_configuration_is_refused(stored, monkeypatch):
    monkeypatch.setitem(EXPERIMENTS, "tiny", replace(TINY, iterations=240))
    with pytest.raises(store.TornResult, match="another configuration"):
        work.load_result("tiny", "NT", stored)


def test_finished_units_are_not_computed_again(stored, monkeypatch):
    kept = {u.result: (stored / f"{u.result}.npz").read_bytes() for u in work.run_units(TINY)}
    store.remove(stored / "tiny" / "GVT")
    ran = []
    monkeypatch.setattr(work, "_run_all", lambda us, *rest: (ran.extend(us), run_here(us, *rest)))
    work.complete("tiny", stored, jobs=1)
    assert {u.label for u in ran} == {"GVT"}
    for result, data in kept.items():
        assert (stored / f"{result}.npz").read_bytes() == data


def test_reproduce_says_what_is_identical(stored, tmp_path):
    lines = reproduce(["tiny"], stored, tmp_path / "fresh", jobs=1)
    assert len(lines) == len(verify.results_of("tiny"))
    assert all("identical" in line for line in lines)


def test_unknown_experiment():
    with pytest.raises(
        ValueError, match=r"unknown experiment 'romos'; known are .*rooms-evaluation"
    ):
        named("romos")


def _complete_in_child(root):
    EXPERIMENTS[TINY.name], POOLS[POOL.name] = TINY, POOL
    work.BATCH = 1
    work._run_all = run_here
    work.complete("tiny", root, jobs=1)


@pytest.mark.parametrize("wait", [0.0, 0.4, 1.2])
def test_killed_at_any_moment_the_same_call_finishes_with_the_same_files(
    stored, tmp_path, wait, tiny
):
    root = tmp_path / "killed"
    root.mkdir()
    child = multiprocessing.get_context("fork").Process(target=_complete_in_child, args=(root,))
    child.start()
    while child.is_alive() and not any(root.rglob("*.json")):
        time.sleep(0.01)
    time.sleep(wait)
    if child.is_alive():
        os.kill(child.pid, signal.SIGKILL)
    child.join()
    work.complete("tiny", root, jobs=1)
    for owner, label in verify.results_of("tiny"):
        again, _ = store.load(root / owner / label)
        first, _ = store.load(stored / owner / label)
        for key in first:
            np.testing.assert_allclose(again[key], first[key], rtol=1e-3, atol=1e-3)


class Inline:
    """An executor that does at once what it is given, in this process."""

    def __init__(self, *_):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def submit(self, function, *arguments):
        future = Future()
        future.set_result(function(*arguments))
        return future


def test_parts_left_from_a_run_that_was_stopped_are_joined_with_the_others(
    tiny, tmp_path, stored, monkeypatch
):
    monkeypatch.setattr(work, "_run_all", RUN_ALL)
    monkeypatch.setattr(work, "ProcessPoolExecutor", Inline)
    monkeypatch.setattr(work, "_in_process", lambda u, root: work.run_unit(u, root, lambda *_: 1))
    shutil.copytree(stored / POOL.name, tmp_path / "again" / POOL.name)
    root = tmp_path / "again"
    left = next(unit for unit in work.run_units(tiny) if unit.label == "NT")
    work.run_unit(left, root, lambda *_: True)
    work.complete("tiny", root, jobs=1, quiet=True)
    for label in tiny.algorithms:
        assert list(store.load(root / "tiny" / label)[0]["run"]) == [0, 1, 2]


def test_a_part_of_another_configuration_stops_it_before_anything_is_computed(
    tiny, tmp_path, monkeypatch
):
    root, ran = tmp_path / "parts", []
    unit = work.source_units(POOL)[0]
    store.save(root / unit.part, {"x": np.zeros(1)}, {"config": {"limit": 7}, "seconds": 1.0})
    monkeypatch.setattr(work, "_run_all", lambda *_: ran.append(1))
    with pytest.raises(store.TornResult, match="another configuration"):
        work.complete("tiny", root, jobs=1)
    assert not ran


def test_real_processes_compute_what_is_missing(tmp_path):
    name = "rooms-evaluation"
    for owner in (named(name).pool.name, name):
        shutil.copytree(store.results_folder() / owner, tmp_path / owner)
    store.remove(tmp_path / name / "tasks")
    work.complete(name, tmp_path, jobs=2, quiet=True)
    for key, values in store.load(store.results_folder() / name / "tasks")[0].items():
        np.testing.assert_allclose(store.load(tmp_path / name / "tasks")[0][key], values, 1e-4)


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
