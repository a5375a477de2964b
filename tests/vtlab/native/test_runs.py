"""Whole runs in C++ against the engine, number by number, and what the kernels leave to it."""

import ctypes
import threading

import numpy as np
import pytest
import torch
from attrs import evolve
from hypothesis import given, settings
from hypothesis import strategies as st

from vtbook.experiments.protocols import as_published
from vtbook.neighbours import RepeatedSettings
from vtlab.envs import CartpoleFamily, MazeFamily, MountainCarFamily, RoomsFamily
from vtlab.episodes import Episodes
from vtlab.native.runs import NativeRun, supports, train_natively
from vtlab.training import fingerprint
from vtlib.baselines import DDQNSettings, FineTuning, MellowTDSettings
from vtlib.native import kernels
from vtlib.posteriors.native import at
from vtlib.rng import Rng
from vtlib.training import Agent, Diverged, iterate
from vtlib.transfer import Settings

ROOMS = RoomsFamily()
FAMILIES = [ROOMS, RoomsFamily(stops=True), CartpoleFamily(), MountainCarFamily(last_reward=-1.0)]
LEARNER, DEEP = MellowTDSettings(epsilon_steps=100), DDQNSettings(epsilon_steps=10)
GREEDY = MellowTDSettings(epsilon_steps=100, epsilon_start=0.3, epsilon_end=0.1)
ALGORITHMS = [
    Settings("gaussian", lambda_=1e-4),
    Settings("gaussian", psi=0.0, kl="diagonal", init="span"),
    Settings("gaussian", lambda_=0.1, kl_clip=0.5),
    as_published(Settings("gaussian", lambda_=1e-3)),
    Settings(psi=0.0, clip=1e-3),
    Settings(psi=1.0, clip=None, buffer=50),
    Settings(lambda_=0.1, kl_clip=0.5),
    Settings(components=3),
    # not both: at the mean nothing but rounding would pull, and Adam divides by its size
    Settings(components=2, init="mean"),
    Settings(components=2, responsibilities="equal"),
    as_published(Settings(components=3)),
    LEARNER,
    FineTuning(LEARNER),
    FineTuning(GREEDY, "mean"),
    Settings(sigma_min=0.01),  # more than the prior has
    *(Settings(components=c, covariance="fixed", sigma_min=x) for c, x in ((1, 0.01), (2, 1e-4))),
    RepeatedSettings(Settings(components=2, minibatch=20, n_samples=3, alpha_L=1e-4), 3),
    RepeatedSettings(as_published(Settings(minibatch=20, n_samples=3, alpha_L=1e-4)), 2),
    RepeatedSettings(FineTuning(LEARNER, "mean"), 4),
]
# each with a linear Q and with a network
PAIRS = [(x, family) for i, x in enumerate(ALGORITHMS) for family in FAMILIES[i % 2 :: 2]]


def both(family, algorithm, run=3, sources=5) -> tuple[NativeRun, Agent, Episodes]:
    rng, d = Rng("native", [run]), family.q().d
    scale = 0.3 if isinstance(family, RoomsFamily) else 1.0
    given = scale * rng.stream("sources").normal(sources * d).view(1, sources, d)
    given = given if algorithm.transfers else given[:, 0]
    tasks = family.draw_tasks("native", [run])
    agent = algorithm.agent(family.q(), given, tasks.obs_dim, rng)
    episodes = Episodes(tasks, rng.stream("noise"), rng.stream("start"))
    return NativeRun(family, tasks, 0, algorithm, given[0], "native", run), agent, episodes


def factors(alone: NativeRun) -> torch.Tensor:
    """L (C, d, d) of all components, which lie one after the other where that of the first is."""
    components, d = alone.mu.shape
    found = torch.zeros(components, d, d)
    for c, L in enumerate(found):
        packed = ctypes.c_void_p(alone.L.ctypes.data + c * alone.L.nbytes)
        kernels().posterior_unpack(d, at(L), packed)
    return found


@pytest.mark.parametrize(("algorithm", "family"), PAIRS)
def test_a_run_in_cpp_is_the_engines(algorithm, family):
    if isinstance(algorithm, Settings) and not isinstance(family, RoomsFamily):
        algorithm = evolve(algorithm, minibatch=60, n_samples=5, alpha_L=1e-4)
    alone, agent, episodes = both(family, algorithm)
    loop = iterate(agent, episodes)
    for steps in (0, 1, 1, 15, 183):
        alone.advance(steps)
        for _ in range(steps):
            next(loop)
        # float32's rounding; where it decides about the sign of a gradient, an Adam step
        apart = np.abs(agent.mu[0].numpy() - alone.mu)
        assert apart.max() < 5e-3
        assert np.median(apart) < 1e-4
        expected = fingerprint(agent, episodes)[0]
        np.testing.assert_allclose(alone.fingerprint, expected, 1e-3, 1e-3)
        if isinstance(algorithm, Settings):
            L = agent.scale_tril[0]
            apart = torch.linalg.norm(factors(alone) - L, dim=(1, 2))
            # a tight clip makes all steps on L alike, and rounding decides about the sign of some
            most = 2e-2 if algorithm.kl_clip == 0.5 else 1e-3
            assert (apart < most * torch.linalg.norm(L, dim=(1, 2))).all()


@settings(max_examples=25, deadline=None)
@given(
    st.sampled_from([*FAMILIES, RoomsFamily(2, fixed_lower=5.0), MountainCarFamily()]),
    st.builds(
        Settings,
        alpha_L=st.just(1e-4),
        components=st.integers(1, 3),
        minibatch=st.sampled_from([1, 15, 16, 17, 512]),
        n_samples=st.integers(1, 15),
        buffer=st.integers(1, 40),
        psi=st.floats(0, 1),
    ),
    st.integers(1, 10),
)
def test_any_configuration_that_is_taken_is_the_engines(family, algorithm, sources):
    assert supports(family, algorithm, sources)
    alone, agent, episodes = both(family, algorithm, 1, sources)
    loop = iterate(agent, episodes)
    for _ in range(5):
        next(loop)
    alone.advance(5)
    assert np.abs(agent.mu[0].numpy() - alone.mu).max() < 5e-3


def test_progress_may_stop_runs_on_two_threads_and_one_that_diverged_is_named(monkeypatch):
    together, advance = threading.Barrier(2, timeout=60), NativeRun.advance
    runs, alone = ([both(ROOMS, LEARNER, run)[0] for run in (3, 4)] for _ in range(2))
    arguments = runs, lambda mu: mu.sum((1, 2)), 100, 20, ["a", "b"]
    with monkeypatch.context() as patched:
        patched.setattr(NativeRun, "advance", lambda *x: (together.wait(), advance(*x)))
        stop = train_natively(*arguments, lambda t: t < 60, threads=2)
    assert stop["iterations"].tolist() == [20, 40, 60]
    assert stop["fingerprints"].shape == (2, 2, 4)
    for run, mean in zip(alone, stop["greedy"][:, -1], strict=True):
        run.advance(60)
        assert run.mu.sum() == pytest.approx(mean, rel=1e-4)
    runs[1].mu[:] = np.nan
    with pytest.raises(Diverged, match="b diverged"):
        train_natively(*arguments)


def test_what_the_kernels_do_not_know_is_left_to_the_engine(monkeypatch):
    own, tuning, family = (type("Own", (x,), {}) for x in (Settings, FineTuning, RoomsFamily))
    assert supports(ROOMS, Settings(), 5)
    assert not supports(ROOMS, Settings(), 11)
    for other in (MazeFamily(), family()):
        assert not supports(other, Settings(), 5)
    beyond = {"components": 4, "n_samples": 16, "minibatch": 513, "patience": 1}
    changes = {**beyond, "act": "episode", "covariance": "diagonal", "gamma": 0.5}
    algorithms = [evolve(Settings(), **{name: value}) for name, value in changes.items()]
    algorithms += [own(), DEEP, FineTuning(DEEP), tuning(LEARNER), evolve(LEARNER, gamma=0.5)]
    for algorithm in algorithms:
        assert not supports(ROOMS, algorithm, 5)
    monkeypatch.setattr("vtlab.native.runs.kernels", lambda _: None)
    assert not supports(ROOMS, Settings(), 5)
