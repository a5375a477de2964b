"""The loop: what it records and when, and when it ends."""

import gymnasium
import numpy as np
import pytest
import torch
from attrs import evolve

from vtbook.experiments.cartpole import CARTPOLE
from vtbook.experiments.rooms import ROOMS_EVALUATION
from vtlab.run import run_batch
from vtlab.store import weights
from vtlab.training import FINGERPRINTS, train
from vtlib import evaluate, solve, transfer
from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.training import Diverged

NAMES = ["a", "b", "c"]


class Counting:
    """An agent whose weights count what it has learned, one more for each later run."""

    def __init__(self):
        self.mu = torch.arange(3.0).view(-1, 1, 1).repeat(1, 2, 3)

    def act(self, obs, fresh):
        assert fresh.all()
        return obs[:, 0].long()

    def learn(self, transition):
        # the action is for what was observed, and learned from before the next
        assert torch.equal(transition.action, transition.obs[:, 0].long())
        assert torch.equal(transition.next_obs, transition.obs + 1)
        self.mu = self.mu + 1


class Walk:
    """Episodes that only count their steps; the learning return is a hundredth of the count."""

    def __init__(self):
        self.obs, self.fresh = torch.zeros(3, 2), torch.ones(3, dtype=torch.bool)
        self.returns = self

    def mean(self):
        return self.obs[:, 0] / 100

    def step(self, action):
        before, self.obs = self.obs, self.obs + 1
        return Transition(before, action, self.obs[:, 0], self.obs, self.fresh)


def first(mu):
    """The first weight (R,) of each run, which has to be finite, as the greedy return."""
    assert torch.isfinite(mu).all()
    return mu[:, 0, 0]


def assert_counted(curves, iterations, times):
    """The curves of so many iterations of counting, recorded at these times."""
    np.testing.assert_array_equal(curves["iterations"], times)
    np.testing.assert_allclose(curves["learning"], np.tile(times / 100, (3, 1)), rtol=1e-6)
    np.testing.assert_array_equal(curves["greedy"], times + np.arange(3)[:, None])
    t = np.array([t for t in FINGERPRINTS if t <= iterations])
    w = t + np.arange(3)[:, None]
    # six equal weights, their squares, both coordinates, the learning return
    expected = np.stack(np.broadcast_arrays(6 * w, 6 * w**2, 2 * t, t / 100), -1)
    np.testing.assert_allclose(curves["fingerprints"], expected)


@pytest.mark.parametrize("every", [7, 100])
@pytest.mark.parametrize("iterations", [0, 1, 48, 49, 198, 199, 250])
def test_returns_and_fingerprints_are_recorded_in_time(iterations, every):
    curves = train(Counting(), Walk(), first, iterations, every, NAMES)
    assert_counted(curves, iterations, np.arange(every, iterations + 1, every))


def test_progress_hears_of_every_evaluation_and_stops_the_loop():
    heard = []
    train(Counting(), Walk(), first, 250, 60, NAMES, lambda t: heard.append(t) is None)
    assert heard == [60, 120, 180, 240]
    curves = train(Counting(), Walk(), first, 250, 20, NAMES, lambda t: t < 60)
    assert_counted(curves, 60, np.array([20, 40, 60]))


@pytest.mark.parametrize(("run", "value"), [(0, np.nan), (2, -np.inf)])
def test_divergence_names_the_run_and_the_iteration_before_it_is_evaluated(run, value):
    class Exploding(Counting):
        def learn(self, transition):
            super().learn(transition)
            if transition.obs[0, 0] == 29:
                self.mu[run, 1, 2] = value

    with pytest.raises(Diverged, match=f"^{NAMES[run]} diverged: .* not finite at iteration 40$"):
        train(Exploding(), Walk(), first, 100, 20, NAMES)


@pytest.fixture
def two_threads_in_double():
    threads = torch.get_num_threads()
    torch.set_num_threads(2)
    torch.set_default_dtype(torch.float64)
    yield
    assert (torch.get_num_threads(), torch.get_default_dtype()) == (2, torch.float64)
    torch.set_num_threads(threads)
    torch.set_default_dtype(torch.float32)


class Watched(gymnasium.Wrapper):
    """An environment that keeps with how many threads its steps are taken."""

    def step(self, action):
        self.threads = {*getattr(self, "threads", ()), torch.get_num_threads()}
        return super().step(action)


def test_the_library_computes_with_one_thread_and_leaves_what_was_set(two_threads_in_double):
    envs, q = [Watched(gymnasium.make("CartPole-v1")) for _ in range(3)], MLP((4, 8, 2))
    learned = solve(envs[:1], q, 20)
    transfer(envs[1:2], q, learned.weights[:, 0].expand(2, -1), 20)
    evaluate(envs[2:], q, learned.weights, 2)
    assert [env.threads for env in envs] == [{1}] * 3


@pytest.mark.parametrize(
    ("experiment", "label"), [(CARTPOLE, "DDQN"), (CARTPOLE, "1-MGVT"), (ROOMS_EVALUATION, "GVT")]
)
def test_runs_are_computed_in_float32_with_one_thread(experiment, label, two_threads_in_double):
    short, threads = evolve(experiment, iterations=100), set()
    batch = short, label, [0], weights(short.pool)
    arrays = run_batch(*batch, lambda _: threads.add(torch.get_num_threads()) is None)
    assert threads == {1}
    torch.set_default_dtype(torch.float32)
    np.testing.assert_equal(arrays, run_batch(*batch))
    torch.set_default_dtype(torch.float64)
