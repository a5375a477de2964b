"""Solving, transfer and evaluation on ordinary Gymnasium environments."""

from __future__ import annotations

import attrs
import gymnasium as gym
import numpy as np
import pytest
import torch
from torch import nn

from vtlib import gym_runs
from vtlib.baselines import DDQNSettings, FineTuning, MellowTDSettings
from vtlib.experiments.store import TornResult
from vtlib.gym_runs import Learned, evaluate, settings_for, solve, transfer
from vtlib.qfunctions import MLP, ModuleQ
from vtlib.replay import Transition
from vtlib.stability import largest_step, steepest
from vtlib.transfer import Settings


class TwoHeads(nn.Module):
    """A dueling network: one head for the state's value, one for the actions' advantages."""

    def __init__(self) -> None:
        super().__init__()
        self.trunk = nn.Linear(4, 16)
        self.value, self.advantage = nn.Linear(16, 1), nn.Linear(16, 2)

    def forward(self, obs: torch.Tensor) -> torch.Tensor:
        hidden = torch.relu(self.trunk(obs))
        advantage = self.advantage(hidden)
        return self.value(hidden) + advantage - advantage.mean(-1, keepdim=True)


def cartpole(length: float) -> gym.Env:
    env = gym.make("CartPole-v1", max_episode_steps=100)
    env.unwrapped.length = length
    return env


Q = MLP((4, 8, 2))
LEARNER = MellowTDSettings(epsilon_steps=100, minibatch=20)
TRANSFER = Settings(minibatch=20, n_samples=2, alpha_L=1e-4)


def weights(count: int, seed: int = 0) -> torch.Tensor:
    rng = torch.Generator().manual_seed(seed)
    return 0.5 * torch.randn(count, Q.d, generator=rng)


def test_a_two_headed_network_transfers_between_cartpoles():
    q = ModuleQ(TwoHeads(), n_actions=2)
    assert q.d == 4 * 16 + 16 + 17 + 34
    sources = solve([cartpole(x) for x in (0.35, 0.5, 0.65)], q, iterations=3000)
    settings = Settings(lambda_=1e-3, alpha_L=1e-4, minibatch=100, n_samples=5)
    learned = transfer([cartpole(0.45)], q, sources.weights[:, 0], 300, settings)
    # 63.4 is the most that 100 steps can pay; a random policy earns about 20
    assert evaluate([cartpole(0.45)], q, learned.weights).mean() > 40
    module = TwoHeads()
    nn.utils.vector_to_parameters(learned.weights[0, 0], module.parameters())
    obs = torch.randn(5, 4, generator=torch.Generator().manual_seed(0))
    values = q.q(learned.weights[:1], q.prepare(obs.unsqueeze(0)))[0, 0]
    torch.testing.assert_close(values.T, module(obs).detach())


class Corridor(gym.Env):
    """Action 1 pays 1 and action 0 nothing, for five steps."""

    def __init__(self) -> None:
        self.observation_space = gym.spaces.Box(-1, 1, (4,), np.float32)
        self.action_space = gym.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._left = 5
        return np.ones(4, np.float32), {}

    def step(self, action):
        self._left -= 1
        return np.ones(4, np.float32), float(action), False, self._left == 0, {}


def always(action: int) -> torch.Tensor:
    """Weights (d,) of a policy that always takes an action."""
    w = torch.zeros(Q.d)
    w[-2 + action] = 1.0
    return w


def test_greedy_returns_are_discounted_sums():
    paid = sum(0.99**t for t in range(5))
    both = torch.stack([always(1), always(0)]).unsqueeze(1)
    found = evaluate([Corridor(), Corridor()], Q, both, episodes=3)
    torch.testing.assert_close(found, torch.tensor([[paid] * 3, [0.0] * 3]))


def test_the_best_source_comes_first_and_is_kept_where_learning_harms(monkeypatch):
    sources = torch.stack([always(0), always(1)])
    destroyed = attrs.evolve(TRANSFER, alpha_mu=10.0, lambda_=0.0, minibatch=1)
    learned = transfer([Corridor(), Corridor()], Q, sources, 3, destroyed, trials=2)
    paid = evaluate([Corridor(), Corridor()], Q, learned.weights).mean(1)
    torch.testing.assert_close(paid, torch.full((2,), sum(0.99**t for t in range(5))))
    kept = ~learned.improved
    torch.testing.assert_close(learned.weights[kept, 0], always(1).expand(int(kept.sum()), -1))
    # two trials of each of two sources, learning, and as many of what was learned
    assert learned.steps.tolist() == [2 * 2 * 5 + 3 + 2 * 5] * 2


@pytest.mark.parametrize(
    ("ours", "improved"),
    [
        ((2.0, 2.0), True),
        ((0.9, 0.9), False),
        ((1.0, 1.0), True),
        ((0.0, 3.0), False),  # more by 0.5, with a standard error of 1.5
        ((1.3, 1.7), True),  # by 0.5, 0.2
    ],
)
def test_what_was_learned_must_beat_the_source_by_its_standard_error(monkeypatch, ours, improved):
    played = gym_runs._play
    returns = iter([(1.0, 1.0), (0.0, 0.0), ours])  # of both sources and what was learned

    def play(*arguments):
        return attrs.evolve(played(*arguments), returns=torch.tensor([next(returns)]))

    monkeypatch.setattr(gym_runs, "_play", play)
    learned = transfer([Corridor()], Q, weights(2), 2, TRANSFER, trials=2)
    assert learned.improved.tolist() == [improved]
    assert torch.equal(learned.weights[0, 0], weights(2)[0]) is not improved


def test_without_trials_it_is_the_method_alone():
    sources = torch.stack([always(0), always(1)])
    learned = transfer([Corridor()], Q, sources, 1, TRANSFER, trials=0)
    assert learned.steps.tolist() == [1]
    assert learned.improved.all()
    assert (learned.weights[0, 0] - always(0)).abs().max() < 0.01
    assert learned.scale_tril.shape == (1, 1, Q.d, Q.d)
    with pytest.raises(ValueError, match="settings must be given where there are no trials"):
        transfer([Corridor()], Q, sources, 1, trials=0)


def test_settings_follow_the_sources_scale_and_the_safe_step():
    rng = torch.Generator().manual_seed(1)
    obs = torch.randn(2, 50, 4, generator=rng)
    seen = [
        Transition(
            obs[:, t],
            torch.zeros(2, dtype=torch.int64),
            torch.ones(2),
            obs[:, t] / 2,
            torch.zeros(2, dtype=torch.bool),
        )
        for t in range(50)
    ]
    sources = weights(6).view(2, 3, -1)
    found, wider = (settings_for(Q, c * sources, seen) for c in (1, 2))
    assert wider.sigma_p2 == pytest.approx(4 * found.sigma_p2)
    assert found.sigma_p2**0.5 == pytest.approx(0.003 * float(sources.square().mean().sqrt()))
    batch = Transition(*(torch.stack(x, 1) for x in zip(*seen, strict=True)))
    eta, _ = steepest(Q, sources[:, 0], batch, 0.5, 0.99, 100.0)
    safe = largest_step(torch.tensor(float(Q.d)), found.n_samples) / eta
    assert 0 < found.alpha_L <= 0.25 * float(safe.min()) * (1 + 1e-5)


@pytest.mark.parametrize("learner", [LEARNER, DDQNSettings(epsilon_steps=100, minibatch=20)])
def test_seeds_repeat_and_differ(learner):
    first, again, other = (solve([cartpole(0.5)], Q, 120, learner, seed=s) for s in (1, 1, 2))
    assert torch.equal(first.weights, again.weights)
    assert not torch.equal(first.weights, other.weights)


def test_returns_are_unknown_before_an_episode_has_ended():
    long = gym.make("CartPole-v1", max_episode_steps=100)
    learned = solve([long, Endless()], Q, 250, LEARNER)
    assert learned.iterations.tolist() == [100, 200]
    assert torch.isnan(learned.returns[1]).all()
    assert (learned.returns[0] > 0).all()


class Endless(Corridor):
    def step(self, action):
        return np.ones(4, np.float32), 1.0, False, False, {}


def test_a_callback_is_told_and_ends_the_learning():
    told = []

    def callback(iteration, returns):
        told.append((iteration, returns.shape))
        return iteration < 200

    learned = solve([cartpole(0.5)], Q, 1000, LEARNER, callback=callback)
    assert told == [(100, (1,)), (200, (1,))]
    assert (learned.steps.tolist(), learned.iterations.tolist()) == ([200], [100, 200])


def test_what_was_learned_is_saved_whole(tmp_path):
    tuning = FineTuning(LEARNER)
    for settings in (TRANSFER, tuning):
        learned = transfer([cartpole(0.5)], Q, weights(2), 120, settings, trials=1)
        learned.save(tmp_path / "learned.npz")
        again = Learned.load(tmp_path / "learned.npz")
        for name, part in attrs.asdict(learned, recurse=False).items():
            other = getattr(again, name)
            assert (part is None) == (other is None)
            assert part is None or torch.equal(part, other), name
        assert (learned.scale_tril is None) == (settings is tuning)


def test_a_file_that_is_not_whole_is_named(tmp_path):
    path = tmp_path / "learned.npz"
    path.write_bytes(b"PK\x03\x04 cut")
    with pytest.raises(TornResult, match=r"learned\.npz is not what Learned\.save wrote"):
        Learned.load(path)
    np.savez(path, weights=np.zeros(3))
    with pytest.raises(TornResult, match="is not what"):
        Learned.load(path)


def test_the_settings_discount_is_the_returns(monkeypatch):
    short = attrs.evolve(LEARNER, gamma=0.5)
    learned = solve([Corridor()], Q, 200, attrs.evolve(short, epsilon_start=0.02, epsilon_steps=1))
    assert learned.returns.max() <= sum(0.5**t for t in range(5))
    both = always(1).view(1, 1, -1)
    found = evaluate([Corridor()], Q, both, 2, gamma=0.5)
    torch.testing.assert_close(found, torch.full((1, 2), sum(0.5**t for t in range(5))))


def test_an_episode_that_never_ends_is_told(monkeypatch):
    monkeypatch.setattr(gym_runs, "LONGEST", 50)
    with pytest.raises(
        ValueError, match=r"has not ended after 50 steps: gymnasium\.wrappers\.Time"
    ):
        evaluate([Endless()], Q, always(1).view(1, 1, -1))


@pytest.mark.parametrize("call", [solve, transfer])
def test_settings_of_another_kind_are_refused(call):
    given = (Q, 10) if call is solve else (Q, weights(2), 10)
    with pytest.raises(ValueError, match="settings must be"):
        call([Corridor()], *given, "mellow")


def test_an_environment_given_twice_is_refused():
    env = cartpole(0.5)
    with pytest.raises(ValueError, match="one is given twice"):
        solve([env, env], Q, 10)


def test_pictures_are_refused_with_what_would_help():
    class Picture(Corridor):
        def __init__(self):
            super().__init__()
            self.observation_space = gym.spaces.Box(0, 1, (2, 2), np.float32)

    with pytest.raises(ValueError, match="FlattenObservation makes one of it"):
        solve([Picture()], Q, 10)


@pytest.mark.parametrize(
    ("layer", "why"),
    [(nn.BatchNorm1d(2), "it has buffers: 1.running_mean"), (nn.Dropout(), "it has dropout")],
)
def test_modules_that_are_no_functions_of_their_weights_are_refused(layer, why):
    with pytest.raises(ValueError, match=why):
        ModuleQ(nn.Sequential(nn.Linear(4, 2), layer), 2)
