"""The same units of work on a Dask cluster of two workers, one of which dies in the middle."""

from __future__ import annotations

import os
import re
import signal
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest
from distributed import Client, LocalCluster

from vtlib import store
from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.envs.cartpole import CartpoleFamily
from vtlib.experiments import Experiment, schedule, work
from vtlib.experiments.schedule import cluster, complete
from vtlib.sources import NetworkPool
from vtlib.transfer import Settings

POOL = NetworkPool(
    "tiny-pool",
    CartpoleFamily(),  # whose optimum needs no planning
    count=2,
    iterations=210,
    limit=210,
    episodes=2,
    settings=MellowTDSettings(epsilon_steps=100, batch=5),
)
TINY = Experiment(
    "tiny",
    POOL,
    CartpoleFamily(),
    {"DDQN": DDQNSettings(epsilon_steps=100), "GVT": Settings("gaussian", weights=2)},
    runs=3,
    sources=2,
    iterations=400,
    every=200,
)


@contextmanager
def here(progress):
    with ThreadPoolExecutor(1) as executor:
        yield executor


@pytest.fixture(scope="module")
def dask():
    with LocalCluster(2, threads_per_worker=1, dashboard_address=None) as local:
        yield local


def test_a_worker_that_dies_loses_nothing(dask, tmp_path, monkeypatch):
    monkeypatch.setattr(work, "BATCH", 1)
    complete([TINY], tmp_path / "here", here, quiet=True)
    with Client(dask) as client:
        victim = next(iter(client.run(os.getpid).values()))
    left = []

    def kill_in_the_middle():
        while not list((tmp_path / "there" / "tiny").glob("*.json")):
            time.sleep(0.005)
        os.kill(victim, signal.SIGKILL)
        left.extend(u for u in work.run_units(TINY) if not work.done(u, tmp_path / "there"))

    killer = threading.Thread(target=kill_in_the_middle)
    killer.start()
    complete([TINY], tmp_path / "there", cluster(dask.scheduler_address), quiet=True)
    killer.join()
    assert left
    for owner, label in work.results_of(TINY):
        ours, _ = work.load(owner, label, tmp_path / "here")
        theirs, note = work.load(owner, label, tmp_path / "there")
        assert store.same_arrays(ours, theirs)
        assert note["machine"] == store.machine()
    assert not (tmp_path / "there" / work.PARTS).exists()


def test_workers_with_other_versions_are_refused(dask, tmp_path, monkeypatch):
    monkeypatch.setattr(schedule, "__version__", "0.0")  # here, not in the workers
    with pytest.raises(ValueError, match=r"worker tcp.* must have .*'0\.0'.*, has "):
        complete([TINY], tmp_path, cluster(dask.scheduler_address), quiet=True)
    assert not list(tmp_path.rglob("*.npz"))


def test_a_scheduler_that_is_not_there_is_named(tmp_path):
    with pytest.raises(OSError, match=re.escape("tcp://127.0.0.1:9")):
        complete([TINY], tmp_path, cluster("tcp://127.0.0.1:9"), quiet=True)


def test_without_dask_the_error_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ValueError, match="pip install distributed"):
        complete([TINY], tmp_path, cluster("tcp://127.0.0.1:9"), quiet=True)
