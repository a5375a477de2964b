"""A small experiment, which may be changed, and a cluster in this process that computes it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from distributed import LocalCluster

from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.envs.cartpole import CartpoleFamily
from vtlib.experiments import schedule
from vtlib.experiments.experiment import Experiment, Pool
from vtlib.transfer import Settings


@pytest.fixture(scope="session")
def tiny() -> Experiment:
    """Three runs of each kind of algorithm, on cartpoles, whose optimum needs no planning."""
    learner = MellowTDSettings(epsilon_steps=100, minibatch=5)
    pool = Pool(
        "tiny-pool",
        CartpoleFamily(),
        count=3,
        iterations=220,
        limit=230,
        check_every=10,
        episodes=2,
        settings=learner,
    )
    algorithms = {
        "NT": learner,
        "DDQN": DDQNSettings(epsilon_steps=100, minibatch=5),
        "GVT": Settings("gaussian", minibatch=5, n_samples=2),
        "2-MGVT": Settings(components=2, minibatch=5, n_samples=2),
    }
    return Experiment(
        "tiny", pool, CartpoleFamily(), algorithms, runs=3, sources=2, iterations=220, every=20
    )


@pytest.fixture(scope="session")
def weights(tiny: Experiment) -> np.ndarray:
    """Weights of a pool of cartpoles that nobody has solved."""
    rng = np.random.default_rng(0)
    return 0.1 * rng.standard_normal((50, tiny.family.q().d), dtype=np.float32)


def cluster(workers: int, **options: bool) -> LocalCluster:
    """A Dask cluster of this machine, such as somebody else has started."""
    return LocalCluster(
        workers,
        threads_per_worker=1,
        dashboard_address="127.0.0.1:0",
        scheduler_kwargs={"dashboard": False},
        **options,
    )


@pytest.fixture(scope="session")
def here() -> Iterator[str]:
    """The address of a cluster whose one worker is a thread of this process."""
    with cluster(1, processes=False) as local:
        yield local.scheduler_address


@pytest.fixture
def there() -> Iterator[LocalCluster]:
    """A cluster of two processes."""
    with cluster(2) as local:
        yield local


@pytest.fixture(scope="session", autouse=True)
def two_at_a_time() -> Iterator[None]:
    """Batches of two runs, so that three of them are cut."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(schedule, "BATCH", 2)
        yield


@pytest.fixture(scope="session")
def computed(tiny: Experiment, here: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All results of the tiny experiment."""
    root = tmp_path_factory.mktemp("computed")
    schedule.complete([tiny], root, scheduler=here, quiet=True)
    return root


@pytest.fixture
def stored(computed: Path, tmp_path: Path) -> Path:
    """A copy of them, which may be changed."""
    return shutil.copytree(computed, tmp_path / "stored")
