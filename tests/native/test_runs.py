"""Whole runs in C++ against the engine, number by number, and what the kernels leave to it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from attrs import frozen
from hypothesis import given, settings
from hypothesis import strategies as st

from vtbook.experiments.protocols import as_published
from vtlib import native
from vtlib.baselines import DDQNSettings, FineTuning, MellowTDSettings
from vtlib.envs.base import TaskFamily
from vtlib.envs.cartpole import CartpoleFamily
from vtlib.envs.episodes import Episodes
from vtlib.envs.maze import MazeFamily
from vtlib.envs.mountain_car import MountainCarFamily
from vtlib.envs.rooms import RoomsFamily
from vtlib.native.runs import NativeRun, supports, train_natively
from vtlib.rng import Rng
from vtlib.training import Agent, Diverged, fingerprint, iterate
from vtlib.transfer import Settings

ROOMS, CARTPOLE, CAR = RoomsFamily(), CartpoleFamily(), MountainCarFamily()
NETWORK = {"minibatch": 60, "n_samples": 5, "alpha_L": 1e-4, "lambda_": 1e-3}
GVT, LEARNER = {"family": "gaussian"}, MellowTDSettings(epsilon_steps=100)
STOPPING, LAST = RoomsFamily(stops=True), MountainCarFamily(last_reward=-1.0)
GREEDY = MellowTDSettings(epsilon_steps=100, epsilon_start=0.3, epsilon_end=0.1)


def both(
    family: TaskFamily, algorithm: Any, run: int = 3, sources: int = 5
) -> tuple[NativeRun, Agent, Episodes]:
    """One run, in C++ and by the engine."""
    rng, d = Rng("native", [run]), family.q().d
    scale = 0.3 if isinstance(family, RoomsFamily) else 1.0
    given = scale * rng.stream("sources").normal(sources * d).view(1, sources, d)
    given = given if algorithm.transfers else given[:, 0]
    tasks = family.draw_tasks("native", [run])
    agent = algorithm.agent(family.q(), given, tasks.obs_dim, rng)
    episodes = Episodes(tasks, rng.stream("noise"), rng.stream("start"))
    return NativeRun(family, tasks, 0, algorithm, given[0], "native", run), agent, episodes


@pytest.mark.parametrize(
    ("family", "algorithm"),
    [
        pytest.param(ROOMS, Settings(**GVT, lambda_=1e-4), id="rooms GVT"),
        pytest.param(ROOMS, Settings(components=3), id="rooms 3-MGVT"),
        pytest.param(ROOMS, Settings(psi=0.0, clip=1e-3), id="rooms, psi 0, clipped"),
        pytest.param(ROOMS, Settings(psi=1.0, clip=None, buffer=50), id="rooms, psi 1, forgetful"),
        pytest.param(ROOMS, Settings(**GVT, kl="diagonal", init="span"), id="rooms, diagonal KL"),
        # not both: at the mean nothing but rounding would pull, and Adam divides by its size
        pytest.param(ROOMS, Settings(components=2, init="mean"), id="rooms, mean"),
        pytest.param(ROOMS, Settings(components=2, responsibilities="equal"), id="rooms, equal"),
        pytest.param(ROOMS, LEARNER, id="rooms, mellow TD"),
        pytest.param(CARTPOLE, Settings(**GVT, **NETWORK), id="cartpole GVT"),
        pytest.param(CARTPOLE, Settings(components=3, **NETWORK), id="cartpole 3-MGVT"),
        pytest.param(CARTPOLE, LEARNER, id="cartpole, mellow TD"),
        pytest.param(CAR, Settings(**NETWORK), id="mountain car 1-MGVT"),
        pytest.param(CAR, Settings(psi=0.0, **GVT, **NETWORK), id="mountain car GVT, psi 0"),
        pytest.param(ROOMS, as_published(Settings(**GVT, lambda_=1e-3)), id="rooms GVT published"),
        pytest.param(ROOMS, Settings(**GVT, lambda_=0.1, kl_clip=0.5), id="rooms, tight KL clip"),
        pytest.param(ROOMS, Settings(lambda_=0.1, kl_clip=0.5), id="rooms 1-MGVT, tight KL clip"),
        pytest.param(ROOMS, as_published(Settings()), id="rooms 1-MGVT published"),
        pytest.param(ROOMS, as_published(Settings(components=3)), id="rooms 3-MGVT published"),
        pytest.param(STOPPING, Settings(components=3), id="rooms that stop, 3-MGVT"),
        pytest.param(STOPPING, LEARNER, id="rooms that stop, mellow TD"),
        pytest.param(ROOMS, FineTuning(LEARNER), id="rooms, fine-tuned"),
        pytest.param(ROOMS, FineTuning(GREEDY, "mean"), id="rooms, fine-tuned mean, greedy"),
        pytest.param(CARTPOLE, FineTuning(GREEDY), id="cartpole, fine-tuned"),
        pytest.param(
            CARTPOLE, as_published(Settings(**GVT, **NETWORK)), id="cartpole GVT published"
        ),
        pytest.param(
            CARTPOLE,
            as_published(Settings(components=3, **NETWORK)),
            id="cartpole 3-MGVT published",
        ),
        pytest.param(LAST, as_published(Settings(**NETWORK)), id="car 1-MGVT published"),
        pytest.param(LAST, as_published(Settings(**GVT, **NETWORK)), id="car GVT published"),
    ],
)
def test_a_run_in_cpp_is_the_engines(family, algorithm):
    alone, agent, episodes = both(family, algorithm)
    loop = iterate(agent, episodes)
    for t in range(1, 201):
        next(loop)
        alone.advance(1)
        if t in (1, 2, 20, 200):
            # float32's rounding; where it decides about the sign of a gradient, an Adam step
            apart = np.abs(agent.mu[0].numpy() - alone.mu)
            assert apart.max() < 5e-3
            assert np.median(apart) < 1e-4
            expected = fingerprint(agent, episodes)[0]
            np.testing.assert_allclose(alone.fingerprint, expected, 1e-3, 1e-3)


@settings(max_examples=25, deadline=None)
@given(
    st.sampled_from([ROOMS, RoomsFamily(2, fixed_lower=5.0), STOPPING, CARTPOLE, CAR, LAST]),
    st.fixed_dictionaries(
        {
            "components": st.integers(1, 3),
            "minibatch": st.sampled_from([1, 15, 16, 17, 512]),
            "n_samples": st.integers(1, 15),
            "buffer": st.integers(1, 40),
            "psi": st.floats(0, 1),
        }
    ),
    st.integers(1, 10),
)
def test_any_configuration_that_is_taken_is_the_engines(family, changes, sources):
    algorithm = Settings(alpha_L=1e-4, **changes)
    assert supports(family, algorithm, sources)
    alone, agent, episodes = both(family, algorithm, 1, sources)
    loop = iterate(agent, episodes)
    for _ in range(5):
        next(loop)
    alone.advance(5)
    assert np.abs(agent.mu[0].numpy() - alone.mu).max() < 5e-3


def test_records_progress_and_divergence_are_those_of_the_engines_loop():
    told = []
    runs = [both(ROOMS, LEARNER, run)[0] for run in (3, 4)]
    stop = train_natively(
        runs,
        lambda mu: mu.sum((1, 2)),
        100,
        20,
        ["a", "b"],
        lambda t: not told.append(t) and t < 60,
    )
    assert told == stop.iterations.tolist() == [20, 40, 60]
    assert stop.learning.shape == stop.greedy.shape == (2, 3)
    assert stop.fingerprints.shape == (2, 2, 4)
    expected = [float(run.mu.sum()) for run in runs]
    np.testing.assert_allclose(stop.greedy[:, -1], expected, rtol=1e-4)
    runs[1].mu[:] = np.nan
    with pytest.raises(Diverged, match="b diverged"):
        train_natively(runs, lambda mu: mu.sum((1, 2)), 20, 20, ["a", "b"])


def test_runs_do_not_depend_on_how_far_they_go_at_a_time():
    one, other = (both(ROOMS, Settings())[0] for _ in range(2))
    one.advance(50)
    for part in (1, 16, 17, 16):
        other.advance(part)
    assert np.array_equal(one.mu, other.mu)


@frozen
class Own(Settings):
    """Settings whose agent may be another one."""


@pytest.mark.parametrize(
    ("family", "algorithm", "sources"),
    [
        (MazeFamily(), Settings(), 5),
        (ROOMS, DDQNSettings(epsilon_steps=10), 5),
        (ROOMS, Own(), 5),
        (ROOMS, FineTuning(DDQNSettings(epsilon_steps=10)), 5),
        (ROOMS, Settings(), 11),
        (ROOMS, Settings(components=4), 5),
        (ROOMS, Settings(n_samples=16), 5),
        (ROOMS, Settings(minibatch=513), 5),
        (ROOMS, Settings(act="episode"), 5),
        (ROOMS, Settings(covariance="diagonal"), 5),
        (ROOMS, Settings(patience=1), 5),
    ],
)
def test_what_the_kernels_do_not_know_is_left_to_the_engine(family, algorithm, sources):
    assert not supports(family, algorithm, sources)


def test_without_kernels_torch_computes(monkeypatch):
    monkeypatch.setattr("vtlib.native.runs.kernels", lambda: None)
    assert native.kernels() is not None
    assert not supports(ROOMS, Settings(), 5)
