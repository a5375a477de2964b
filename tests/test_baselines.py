"""The baselines: how they explore and what they learn."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from vtlib.baselines import DDQN, DDQNSettings, MellowTD, MellowTDSettings
from vtlib.envs.cartpole import CartpoleFamily
from vtlib.envs.episodes import Episodes
from vtlib.evaluation import GreedyReturn
from vtlib.qfunctions import MLP, RBFLinear
from vtlib.replay import Transition
from vtlib.streams import Stream
from vtlib.transfer import td_gradients

ACTIONS = 4
BASES = RBFLinear(torch.arange(3.0), 0.5, ACTIONS)


def draw(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def agent(w: Tensor, runs: list[int] | None = None, **settings) -> MellowTD:
    names = list(range(len(w))) if runs is None else runs
    chosen = MellowTDSettings(**({"epsilon_steps": 100} | settings))
    return MellowTD(
        BASES, w, 2, chosen, Stream("t", names, "explore"), Stream("t", names, "replay")
    )


def transition(runs: int, seed: int = 0, terminal: bool = False) -> Transition:
    g = torch.Generator().manual_seed(seed)
    return Transition(
        2 * torch.rand(runs, 2, generator=g),
        torch.randint(ACTIONS, (runs,), generator=g),
        torch.rand(runs, generator=g),
        2 * torch.rand(runs, 2, generator=g),
        torch.full((runs,), terminal),
    )


def prefers(action: int, runs: int) -> Tensor:
    """Weights whose greedy action is the given one everywhere."""
    w = torch.zeros(runs, ACTIONS, BASES.d // ACTIONS)
    w[:, action] = 1.0
    return w.flatten(1)


def share_of_greedy(learner: MellowTD, runs: int, action: int) -> float:
    fresh = torch.zeros(runs, dtype=torch.bool)
    return (learner.act(torch.ones(runs, 2), fresh) == action).double().mean().item()


def test_epsilon_falls_linearly_from_one_to_its_end():
    runs, end, steps = 4000, 0.2, 8
    learner = agent(prefers(2, runs), epsilon_steps=steps, epsilon_end=end, alpha=1e-12, batch=1)
    for t in range(12):
        epsilon = max(end, 1 + t / steps * (end - 1))
        # a random action is the greedy one a quarter of the time
        share = 1 - epsilon * (1 - 1 / ACTIONS)
        error = (share * (1 - share) / runs) ** 0.5
        assert share_of_greedy(learner, runs, 2) == pytest.approx(share, abs=5 * error)
        learner.learn(transition(runs))


def test_random_actions_are_uniform():
    runs = 8000
    learner = agent(torch.zeros(runs, BASES.d))
    taken = learner.act(torch.ones(runs, 2), torch.zeros(runs, dtype=torch.bool))
    expected = runs / ACTIONS
    counts = torch.bincount(taken, minlength=ACTIONS).double()
    # chi-squared with 3 degrees of freedom: 16.3 has probability 0.001
    assert ((counts - expected).square() / expected).sum() < 16.3


def test_without_exploration_actions_are_greedy():
    learner = agent(prefers(1, 50), epsilon_steps=1, epsilon_end=0.0)
    learner.learn(transition(50))
    assert share_of_greedy(learner, 50, 1) == 1.0


def test_the_first_step_is_adams_against_the_gradient():
    w = draw(3, BASES.d)
    learner = agent(w, alpha=0.01, batch=4, psi=0.3)
    step = transition(3)
    learner.learn(step)
    # one stored transition fills the whole batch, and Adam's first step is that of the sign
    batch = Transition(*(part.unsqueeze(1) for part in step))
    gradient = td_gradients(BASES, w.unsqueeze(1), batch, 0.3, 0.99, 100.0)
    moved = gradient.abs() > 1e-4
    change = (learner.mu - w.unsqueeze(1)) / 0.01
    torch.testing.assert_close(change[moved], -gradient.sign()[moved], rtol=0, atol=1e-3)
    assert moved.any()


def test_values_approach_the_rewards_of_terminal_transitions():
    learner = agent(torch.zeros(2, BASES.d), alpha=0.02, batch=16)
    data = [transition(2, seed, terminal=True) for seed in range(4)]
    for t in range(1200):
        learner.learn(data[t % 4])
    for step in data:
        values = BASES.q(learner.mu, BASES.prepare(step.obs.unsqueeze(1)))[:, 0, :, 0]
        chosen = values.gather(1, step.action.unsqueeze(1)).squeeze(1)
        torch.testing.assert_close(chosen, step.reward, rtol=0, atol=0.02)


def test_initial_weights_are_copied():
    w = draw(2, BASES.d)
    before = w.clone()
    learner = agent(w)
    assert learner.mu.shape == (2, 1, BASES.d)
    learner.learn(transition(2))
    assert torch.equal(w, before)
    assert not torch.equal(learner.mu[:, 0], before)


def test_a_run_does_not_feel_its_neighbours():
    w = draw(5, BASES.d)
    together, alone = agent(w), agent(w[3:4], runs=[3])
    for t in range(100):
        step = transition(5, seed=t)
        fresh = torch.zeros(5, dtype=torch.bool)
        assert together.act(step.obs, fresh)[3] == alone.act(step.obs[3:4], fresh[3:4])[0]
        together.learn(step)
        alone.learn(Transition(*(part[3:4] for part in step)))
    torch.testing.assert_close(together.mu[3], alone.mu[0], rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("psi", -0.1), ("psi", 2.0), ("psi", math.nan),
        ("epsilon_end", -0.1), ("epsilon_end", 1.1), ("epsilon_end", math.nan),
        ("epsilon_steps", 0), ("batch", 0), ("batch", 2.5), ("buffer", 0),
        ("gamma", -0.1), ("gamma", 1.5), ("gamma", math.nan),
        ("kappa", 0.0), ("kappa", math.nan), ("alpha", 0.0), ("alpha", math.inf),
    ],
)  # fmt: skip
def test_settings_out_of_range_are_refused_by_name(name, value):
    with pytest.raises(ValueError) as error:
        MellowTDSettings(**({"epsilon_steps": 100} | {name: value}))
    message = str(error.value)
    assert name in message
    assert str(value) in message
    assert "\n" not in message


@pytest.mark.parametrize(
    "w",
    [torch.zeros(2, BASES.d + 1), torch.zeros(BASES.d), torch.full((2, BASES.d), math.nan)],
    ids=["width", "axes", "nan"],
)
def test_bad_initial_weights_are_refused(w):
    streams = [Stream("t", [0, 1], role) for role in ("explore", "replay")]
    with pytest.raises(ValueError, match="weights"):
        MellowTD(BASES, w, 2, MellowTDSettings(epsilon_steps=1), *streams)


NETWORK = MLP((2, 5, 3))


def network(w: Tensor) -> torch.nn.Sequential:
    """The same multilayer perceptron as a torch module."""
    module = torch.nn.Sequential(torch.nn.Linear(2, 5), torch.nn.ReLU(), torch.nn.Linear(5, 3))
    torch.nn.utils.vector_to_parameters(w, module.parameters())
    return module


def plainly(
    w: Tensor, run: int, transitions: list[Transition], settings: DDQNSettings
) -> torch.nn.Sequential:
    """Double deep Q-learning of one run as the textbooks write it, by autograd."""
    online, target = network(w.clone()), network(w.clone())
    adam = torch.optim.Adam(online.parameters(), settings.alpha)
    uniforms = Stream("t", [run], "replay")
    for t, _ in enumerate(transitions, 1):
        picks = (uniforms.uniform(settings.batch)[0] * t).long()
        losses = []
        for i in picks.tolist():
            obs, action, reward, following, terminal = (x[run] for x in transitions[i])
            with torch.no_grad():
                best = online(following).argmax()
                value = 0.0 if terminal else target(following)[best]
            goal = torch.as_tensor(reward + settings.gamma * value)
            losses.append(torch.nn.functional.huber_loss(online(obs)[action], goal))
        adam.zero_grad()
        torch.stack(losses).mean().backward()
        adam.step()
        if t % settings.target_every == 0:
            target.load_state_dict(online.state_dict())
    return online


def test_ddqn_is_the_textbooks_algorithm():
    settings = DDQNSettings(epsilon_steps=10, batch=4, target_every=5, alpha=0.01)
    w = 2 * draw(2, NETWORK.d)
    streams = (Stream("t", [0, 1], role) for role in ("explore", "replay"))
    learner = DDQN(NETWORK, w, 2, settings, *streams)
    transitions = [transition(2, seed, terminal=seed % 4 == 0) for seed in range(13)]
    transitions = [t._replace(action=t.action % 3, reward=5 * t.reward) for t in transitions]
    for one in transitions:
        learner.learn(one)
    for run in range(2):
        expected = plainly(w[run], run, transitions, settings)
        weights = torch.nn.utils.parameters_to_vector(expected.parameters())
        torch.testing.assert_close(learner.mu[run, 0], weights, rtol=1e-4, atol=1e-5)
    assert (learner.mu[:, 0] - w).abs().max() > 0.05


def test_ddqn_learns_to_balance_a_pole():
    family = CartpoleFamily()
    tasks = family.join([family.sample(np.random.default_rng(seed), 1) for seed in range(2)])
    q = MLP((4, 32, 2))
    runs = range(2)

    def stream(role: str) -> Stream:
        return Stream("balance", runs, role)

    # a short horizon of the values, so that few iterations are enough
    settings = DDQNSettings(1_500, gamma=0.9, batch=64, alpha=2e-3, target_every=100)
    start = 0.1 * draw(1, q.d).repeat(2, 1)
    learner = DDQN(q, start, 4, settings, stream("explore"), stream("replay"))
    episodes = Episodes(tasks, stream("noise"), stream("start"))
    for _ in range(3_500):
        learner.learn(episodes.step(learner.act(episodes.obs, episodes.fresh)))
    # 100 steps earn 63.4, a random policy's 18 on average
    assert (GreedyReturn(q, tasks, stream("test noise"), stream("test"))(learner.mu) > 55).all()


@pytest.mark.parametrize("bad", [0, -5, 2.5])
def test_ddqn_refuses_a_target_that_is_never_copied(bad):
    with pytest.raises(ValueError, match="target_every"):
        DDQNSettings(epsilon_steps=10, target_every=bad)
