"""The baselines: how they explore, and what they learn against a textbook's loop by autograd."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor
from torch.nn.functional import huber_loss

from vtlib.baselines import (
    DDQNSettings,
    EpsilonGreedyLearner,
    FineTuning,
    LearnerSettings,
    MellowTDSettings,
)
from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.rng import Rng, Stream
from vtlib.td import mellowmax

ACTIONS = 3
NETWORK = MLP((2, 5, ACTIONS))
KINDS = [
    MellowTDSettings(10, minibatch=4, alpha=0.01, buffer=8, psi=0.3, kappa=5.0),
    DDQNSettings(10, minibatch=4, alpha=0.1, buffer=8, target_every=8),
]


def draw(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def learner(w: Tensor, settings: Any = KINDS[0], runs: list[int] | None = None) -> Any:
    return settings.agent(NETWORK, w, 2, Rng("t", list(range(len(w))) if runs is None else runs))


def transition(runs: int, seed: int = 0) -> Transition:
    g = torch.Generator().manual_seed(seed)
    return Transition(
        2 * torch.rand(runs, 2, generator=g),
        torch.randint(ACTIONS, (runs,), generator=g),
        5 * torch.rand(runs, generator=g),
        2 * torch.rand(runs, 2, generator=g),
        torch.rand(runs, generator=g) < 0.3,
    )


def prefers(action: int, runs: int) -> Tensor:
    """Weights whose greedy action is the given one everywhere: the last layer's biases."""
    w = torch.zeros(runs, NETWORK.d)
    w[:, action - ACTIONS] = 1.0
    return w


# --- exploring -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("start", "end"), [(1.0, 0.2), (0.6, 0.1), (0.05, 0.05), (0.1, 0.5)])
def test_epsilon_goes_linearly_from_its_start_to_its_end(start, end):
    runs, steps = 6000, 4
    settings = MellowTDSettings(steps, end, alpha=1e-12, minibatch=1, epsilon_start=start)
    agent = learner(prefers(2, runs), settings)
    for t in range(7):
        epsilon = start + min(1, t / steps) * (end - start)
        taken = agent.act(torch.ones(runs, 2), torch.zeros(runs, dtype=torch.bool))
        shares = torch.bincount(taken, minlength=ACTIONS) / runs
        # random actions are uniform, and the greedy one among them
        expected = torch.full((ACTIONS,), epsilon / ACTIONS)
        expected[2] += 1 - epsilon
        assert ((shares - expected).abs() < 5 * (expected * (1 - expected) / runs) ** 0.5).all()
        agent.learn(transition(runs))


# --- learning ------------------------------------------------------------------------------------


def module(w: Tensor) -> torch.nn.Sequential:
    """The same multilayer perceptron as a torch module."""
    made = torch.nn.Sequential(torch.nn.Linear(2, 5), torch.nn.ReLU(), torch.nn.Linear(5, ACTIONS))
    torch.nn.utils.vector_to_parameters(w.clone(), made.parameters())
    return made


def plainly(w: Tensor, run: int, seen: list[Transition], settings: LearnerSettings) -> Tensor:
    """The weights that one run learns, as textbooks write it."""
    online, target = module(w), module(w)
    adam = torch.optim.Adam(online.parameters(), settings.alpha)
    uniforms = Stream("t", [run], "replay")
    for t in range(1, len(seen) + 1):
        # the place of the oldest is the newest's
        kept = [max(i for i in range(t) if i % settings.buffer == place)
                for place in range(min(t, settings.buffer))]  # fmt: skip
        losses = []
        for place in (uniforms.uniform(settings.minibatch)[0] * len(kept)).long().tolist():
            obs, action, reward, after, terminated = (x[run] for x in seen[kept[place]])
            alive = settings.gamma * (not terminated)
            if isinstance(settings, DDQNSettings):
                best = online(after).argmax()
                goal = (reward + alive * target(after)[best]).detach()
                losses.append(huber_loss(online(obs)[action], goal))
            else:
                value = online(after)
                value = settings.psi * value + (1 - settings.psi) * value.detach()
                goal = reward + alive * mellowmax(value, settings.kappa)
                losses.append((goal - online(obs)[action]).square())
        adam.zero_grad()
        torch.stack(losses).mean().backward()
        adam.step()
        if isinstance(settings, DDQNSettings) and t % settings.target_every == 0:
            target.load_state_dict(online.state_dict())
    return torch.nn.utils.parameters_to_vector(online.parameters()).detach()


@pytest.mark.parametrize("settings", KINDS)
def test_it_is_the_textbooks_algorithm(settings):
    w, seen = 2 * draw(2, NETWORK.d), [transition(2, seed) for seed in range(23)]
    agent = learner(w, settings)
    assert isinstance(agent, EpsilonGreedyLearner)
    for one in seen:
        agent.learn(one)
    assert agent.mu.shape == (2, 1, NETWORK.d)
    for run in range(2):
        expected = plainly(w[run], run, seen, settings)
        torch.testing.assert_close(agent.mu[run, 0], expected, rtol=1e-4, atol=1e-5)
    assert (agent.mu[:, 0] - w).abs().max() > 0.05
    assert torch.equal(w, 2 * draw(2, NETWORK.d)), "initial weights are copied"


@pytest.mark.parametrize("settings", KINDS)
@pytest.mark.parametrize(("start", "expected"), [("one", [0.0, 3.0]), ("mean", [1.5, 4.5])])
def test_fine_tuning_is_the_learner_that_begins_with_sources(settings, start, expected):
    tuning = FineTuning(settings, start)
    assert tuning.transfers
    sources = torch.tensor([0.0, 1.0, 3.5, 3.0, 4.0, 6.5]).view(2, 3, 1) * prefers(1, 2)[:, None]
    sources[..., 0] = sources[..., 1 - ACTIONS]
    tuned, plain = (
        tuning.agent(NETWORK, sources, 2, Rng("t", [0, 1])),
        learner(tuning.first_weights(sources), settings),
    )
    torch.testing.assert_close(tuned.mu[:, 0, 0], torch.tensor(expected))
    for t in range(12):
        step, fresh = transition(2, seed=t), torch.zeros(2, dtype=torch.bool)
        assert torch.equal(tuned.act(step.obs, fresh), plain.act(step.obs, fresh))
        tuned.learn(step)
        plain.learn(step)
    assert type(tuned) is type(plain)
    assert torch.equal(tuned.mu, plain.mu)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: FineTuning(KINDS[0], "best"), "start must be one of one, mean, got 'best'"),
        (lambda: FineTuning(FineTuning(KINDS[0])), "learner must be of type"),
        (lambda: MellowTDSettings(5, epsilon_start=1.1), r"epsilon_start must lie in \[0, 1\]"),
        (lambda: MellowTDSettings(5, epsilon_start=None), "epsilon_start must lie in"),
    ],
)
def test_values_outside_their_range_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        wrong()


@pytest.mark.parametrize("settings", KINDS)
def test_a_run_feels_neither_its_neighbours_nor_that_they_are_left_behind(settings):
    w, rows = draw(5, NETWORK.d), [3, 1]
    together, alone = learner(w, settings), learner(w[rows], settings, rows)
    for t in range(40):
        if t == 17:  # in the middle of a target's time
            together.keep(rows)
        kept = rows if t < 17 else [0, 1]
        step, fresh = transition(5, seed=t), torch.zeros(5, dtype=torch.bool)
        own = Transition(*(part[rows] for part in step))
        step = step if t < 17 else own
        count = len(step.obs)
        taken = together.act(step.obs, fresh[:count])[kept]
        assert torch.equal(taken, alone.act(own.obs, fresh[:2]))
        together.learn(step)
        alone.learn(own)
    torch.testing.assert_close(together.mu, alone.mu, rtol=1e-4, atol=1e-5)
