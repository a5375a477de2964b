"""The loop: what it records and when, when it ends, and that it leaves global randomness alone."""

from __future__ import annotations

import random
from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from vtlib.baselines import MellowTD, MellowTDSettings
from vtlib.domains import rooms_q
from vtlib.envs.episodes import Episodes
from vtlib.envs.rooms import Rooms
from vtlib.evaluation import GreedyReturn
from vtlib.replay import Transition
from vtlib.streams import Stream
from vtlib.training import FINGERPRINTS, Curves, Diverged, check_finite, fingerprint, train
from vtlib.transfer import Settings, VariationalTransfer


class Counting:
    """An agent whose weights count what it has learned, one more for each later run."""

    def __init__(self, runs: int) -> None:
        self.mu = torch.arange(runs, dtype=torch.float32).view(-1, 1, 1).repeat(1, 2, 3)

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        assert len(obs) == len(fresh) == len(self.mu)
        return torch.zeros(len(obs), dtype=torch.int64)

    def learn(self, transition: Transition) -> None:
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


def counted(iterations: int, every: int, **more) -> Curves:
    return train(
        Counting(3), Walk(3), lambda mu: mu[:, 0, 0], iterations, every, ["a", "b", "c"], **more
    )


def test_returns_are_recorded_every_so_many_iterations():
    curves = counted(250, 100)
    np.testing.assert_array_equal(curves.iterations, [100, 200])
    np.testing.assert_allclose(curves.learning, [[1, 2]] * 3)
    np.testing.assert_array_equal(curves.greedy, [[100, 200], [101, 201], [102, 202]])


def test_fingerprints_are_left_at_their_iterations_whatever_is_recorded():
    for every in (7, 100, 1000):
        prints = counted(250, every).fingerprints
        assert prints.shape == (3, 3, 4)
        # six equal weights, their squares, both coordinates, the learning return
        for i, run in np.ndindex(3, 3):
            t, w = FINGERPRINTS[run], i + FINGERPRINTS[run]
            np.testing.assert_allclose(prints[i, run], [6 * w, 6 * w**2, 2 * t, t / 100])


def reached(iterations: int) -> int:
    """How many fingerprints so many iterations leave."""
    return sum(at <= iterations for at in FINGERPRINTS)


@pytest.mark.parametrize("late", [-1, 0, 1])
@pytest.mark.parametrize("at", FINGERPRINTS)
def test_a_short_run_leaves_the_fingerprints_it_reached(at, late):
    assert counted(at + late, 1000).fingerprints.shape == (3, reached(at + late), 4)


@pytest.mark.parametrize("iterations", [0, 5])
def test_nothing_recorded_is_empty_and_of_the_right_shape(iterations):
    curves = counted(iterations, 10)
    assert curves.learning.shape == curves.greedy.shape == (3, 0)
    assert len(curves.iterations) == 0
    assert curves.fingerprints.shape == (3, reached(iterations), 4)


def test_a_fingerprint_is_summed_in_double():
    agent, episodes = Counting(1), Walk(1)
    agent.mu = torch.tensor([[[2.0**24, 1.0, 1.0]]])
    assert fingerprint(agent, episodes)[0, 0] == 2.0**24 + 2


def test_progress_hears_of_every_evaluation():
    heard = []
    counted(250, 60, progress=lambda t: heard.append(t) is None)
    assert heard == [60, 120, 180, 240]


def test_progress_stops_the_loop_and_keeps_what_was_learned():
    curves = counted(250, 20, progress=lambda t: t < 60)
    np.testing.assert_array_equal(curves.iterations, [20, 40, 60])
    assert curves.learning.shape == curves.greedy.shape == (3, 3)
    assert curves.fingerprints.shape == (3, reached(60), 4)


class Exploding(Counting):
    """Its run of that index diverges at iteration 30."""

    def __init__(self, runs: int, index: int, value: float) -> None:
        super().__init__(runs)
        self._index, self._value, self._steps = index, value, 0

    def learn(self, transition: Transition) -> None:
        super().learn(transition)
        self._steps += 1
        if self._steps == 30:
            self.mu[self._index, 1, 2] = self._value


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("index", [0, 2])
def test_divergence_names_the_run_and_the_iteration(index, value):
    names = [f"run {i} of tiny, GVT" for i in (4, 5, 6)]
    with pytest.raises(Diverged) as raised:
        train(Exploding(3, index, value), Walk(3), lambda mu: mu[:, 0, 0], 100, 20, names)
    text = str(raised.value)
    assert text == f"{names[index]} diverged: its weights are not finite at iteration 40"


def test_weights_are_checked_before_they_are_evaluated():
    def evaluate(mu: Tensor) -> Tensor:
        assert torch.isfinite(mu).all()
        return mu[:, 0, 0]

    with pytest.raises(Diverged):
        train(Exploding(1, 0, np.nan), Walk(1), evaluate, 100, 20, ["run 0"])


def test_finite_weights_pass():
    check_finite(torch.full((2, 1, 3), 1e38), ["a", "b"], 1)


def mellow_td(runs: list[int]) -> MellowTD:
    q = rooms_q()
    settings = MellowTDSettings(epsilon_steps=100, batch=5)
    streams = (Stream("loop", runs, role) for role in ("exploration", "replay"))
    return MellowTD(q, torch.zeros(len(runs), q.d), Rooms.obs_dim, settings, *streams)


def transfer(runs: list[int]) -> VariationalTransfer:
    q = rooms_q()
    sources = 0.1 * Stream("loop", runs, "sources").normal(3 * q.d).view(len(runs), 3, q.d)
    settings = Settings(components=2, batch=5, weights=2)
    streams = (Stream("loop", runs, role) for role in ("posterior", "component", "replay"))
    return VariationalTransfer(q, sources, Rooms.obs_dim, settings, *streams)


def rooms_run(make: Callable, runs: list[int]) -> Curves:
    def stream(role: str) -> Stream:
        return Stream("loop", runs, role)

    tasks = Rooms.from_doors([[2.0 + run, 8.0 - run] for run in runs])
    greedy = GreedyReturn(rooms_q(), tasks, stream("test noise"), stream("test start"), 2)
    names = [str(run) for run in runs]
    return train(
        make(runs), Episodes(tasks, stream("noise"), stream("start")), greedy, 210, 70, names
    )


@pytest.mark.parametrize("make", [mellow_td, transfer])
def test_training_neither_reads_nor_moves_any_global_generator(make):
    def states() -> list[bytes]:
        name, keys, *rest = np.random.get_state(legacy=True)  # noqa: NPY002
        return [
            torch.get_rng_state().numpy().tobytes(),
            repr((name, keys.tobytes(), *rest)).encode(),
            repr(random.getstate()).encode(),
        ]

    before = states()
    first = rooms_run(make, [0, 1])
    assert states() == before
    torch.rand(1)
    again = rooms_run(make, [0, 1])
    for field in ("learning", "greedy", "fingerprints"):
        np.testing.assert_array_equal(getattr(first, field), getattr(again, field))


@pytest.mark.parametrize("make", [mellow_td, transfer])
def test_a_run_leaves_the_same_fingerprints_alone_and_beside_others(make):
    together, alone = rooms_run(make, [0, 1, 2]), rooms_run(make, [1])
    np.testing.assert_allclose(together.fingerprints[1:2], alone.fingerprints, rtol=1e-3, atol=1e-3)
    assert together.learning.shape == together.greedy.shape == (3, 3)


@pytest.mark.parametrize("make", [transfer, mellow_td])
def test_different_runs_never_leave_the_same_fingerprint(make):
    first, second = rooms_run(make, [0, 1]).fingerprints
    assert not np.isclose(first, second).all(1).any()
