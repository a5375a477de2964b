"""The loop: what it records and when, when it ends, and that it leaves global randomness alone."""

from __future__ import annotations

import itertools
import random
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.envs.cartpole import CartpoleFamily
from vtlib.envs.episodes import Episodes
from vtlib.evaluation import Evaluation
from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.rng import Rng
from vtlib.training import FINGERPRINTS, Curves, Diverged, fingerprint, iterate, train
from vtlib.transfer import Settings


class Counting:
    """An agent whose weights count what it has learned, one more for each later run."""

    def __init__(self, runs: int) -> None:
        self.mu = torch.arange(runs, dtype=torch.float32).view(-1, 1, 1).repeat(1, 2, 3)

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        assert fresh.all()
        return obs[:, 0].long()

    def learn(self, transition: Transition) -> None:
        # the action is for what was observed, and learned from before the next
        assert torch.equal(transition.action, transition.obs[:, 0].long())
        assert torch.equal(transition.next_obs, transition.obs + 1)
        self.mu = self.mu + 1


class Walk:
    """Episodes that only count their steps; the learning return is a hundredth of the count."""

    def __init__(self, runs: int) -> None:
        self.obs, self.fresh = torch.zeros(runs, 2), torch.ones(runs, dtype=torch.bool)
        self.returns = self

    def mean(self) -> Tensor:
        return self.obs[:, 0] / 100

    def step(self, action: Tensor) -> Transition:
        before, self.obs = self.obs, self.obs + 1
        return Transition(before, action, self.obs[:, 0], self.obs, self.fresh)


def counted(iterations: int, every: int, **more: Any) -> Curves:
    names = ["a", "b", "c"]
    return train(Counting(3), Walk(3), lambda mu: mu[:, 0, 0], iterations, every, names, **more)


def reached(iterations: int) -> int:
    """How many fingerprints so many iterations leave."""
    return sum(at <= iterations for at in FINGERPRINTS)


@pytest.mark.parametrize("every", [7, 100, 1000])
@pytest.mark.parametrize("iterations", [0, 1, 5, 48, 49, 198, 199, 250])
def test_returns_and_fingerprints_are_recorded_in_time(iterations, every):
    curves = counted(iterations, every)
    times = np.arange(every, iterations + 1, every)
    np.testing.assert_array_equal(curves.iterations, times)
    np.testing.assert_allclose(curves.learning, np.tile(times / 100, (3, 1)), rtol=1e-6)
    np.testing.assert_array_equal(curves.greedy, times + np.arange(3)[:, None])
    assert curves.fingerprints.shape == (3, reached(iterations), 4)
    for i, k in np.ndindex(3, reached(iterations)):
        # six equal weights, their squares, both coordinates, the learning return
        t, w = FINGERPRINTS[k], i + FINGERPRINTS[k]
        np.testing.assert_allclose(curves.fingerprints[i, k], [6 * w, 6 * w**2, 2 * t, t / 100])


def test_a_fingerprint_is_summed_in_double():
    agent, episodes = Counting(1), Walk(1)
    agent.mu = torch.tensor([[[2.0**24, 1.0, 1.0]]])
    assert fingerprint(agent, episodes)[0, 0] == 2.0**24 + 2


def test_progress_hears_of_every_evaluation_and_stops_the_loop():
    assert list(itertools.islice(iterate(Counting(2), Walk(2)), 3)) == [1, 2, 3]
    heard: list[int] = []
    counted(250, 60, progress=lambda t: heard.append(t) is None)
    assert heard == [60, 120, 180, 240]
    curves = counted(250, 20, progress=lambda t: t < 60)
    np.testing.assert_array_equal(curves.iterations, [20, 40, 60])
    assert curves.learning.shape == curves.greedy.shape == (3, 3)
    assert curves.fingerprints.shape == (3, reached(60), 4)


class Exploding(Counting):
    """Its run of that index diverges at iteration 30."""

    def __init__(self, runs: int, index: int, value: float) -> None:
        super().__init__(runs)
        self._index, self._value = index, value

    def learn(self, transition: Transition) -> None:
        super().learn(transition)
        if transition.obs[0, 0] == 29:
            self.mu[self._index, 1, 2] = self._value


@pytest.mark.parametrize(("index", "value"), [(0, np.nan), (2, -np.inf)])
def test_divergence_names_the_run_and_the_iteration_before_it_is_evaluated(index, value):
    def evaluate(mu: Tensor) -> Tensor:
        assert torch.isfinite(mu).all()
        return mu[:, 0, 0]

    names = [f"run {i} of tiny, GVT" for i in (4, 5, 6)]
    with pytest.raises(Diverged) as raised:
        train(Exploding(3, index, value), Walk(3), evaluate, 100, 20, names)
    text = str(raised.value)
    assert text == f"{names[index]} diverged: its weights are not finite at iteration 40"


def course(settings: Any, runs: list[int]) -> Curves:
    family, q, rng = CartpoleFamily(), MLP((4, 8, 2)), Rng("loop", runs)
    tasks = family.draw_tasks("loop", runs)
    weights = rng.stream("weights").normal(3 * q.d).view(len(runs), 3, q.d)
    given = weights if settings.transfers else weights[:, 0]
    agent = settings.agent(q, given, tasks.obs_dim, rng)
    episodes = Episodes(tasks, rng.stream("noise"), rng.stream("start"))
    names = [str(run) for run in runs]
    return train(agent, episodes, Evaluation(q, tasks, rng, 2), 210, 70, names)


def global_states() -> list[bytes]:
    name, keys, *rest = np.random.get_state(legacy=True)  # noqa: NPY002
    return [
        torch.get_rng_state().numpy().tobytes(),
        repr((name, keys.tobytes(), *rest)).encode(),
        repr(random.getstate()).encode(),
    ]


@pytest.mark.parametrize(
    "settings",
    [
        Settings("gaussian", lambda_=1e-2, alpha_L=1e-3),
        Settings(components=3, alpha_L=1e-3),
        Settings(components=2, init="mean", act="episode", lambda_=1e-2, alpha_L=1e-3),
        MellowTDSettings(100),
        DDQNSettings(100, target_every=50),
    ],
)
def test_a_run_depends_on_its_own_random_numbers_alone(settings):
    before = global_states()
    together = course(settings, [0, 1, 2])
    assert global_states() == before
    torch.rand(1)
    again, alone = course(settings, [0, 1, 2]), course(settings, [1])
    for part in ("learning", "greedy", "fingerprints"):
        np.testing.assert_array_equal(getattr(together, part), getattr(again, part))
    prints = together.fingerprints
    np.testing.assert_allclose(prints[1:2], alone.fingerprints, rtol=1e-3, atol=1e-3)
    assert not np.isclose(prints[0], prints[1]).all(1).any()
