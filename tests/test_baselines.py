"""The baselines: how they explore, and what they learn against a textbook's loop by autograd."""

import pytest
import torch
from torch.nn.functional import huber_loss
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from vtlib.baselines import DDQNSettings, FineTuning, MellowTDSettings
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


def transition(runs, seed=0):
    g = torch.Generator().manual_seed(seed)
    return Transition(
        2 * torch.rand(runs, 2, generator=g),
        torch.randint(ACTIONS, (runs,), generator=g),
        5 * torch.rand(runs, generator=g),
        2 * torch.rand(runs, 2, generator=g),
        torch.rand(runs, generator=g) < 0.3,
    )


@pytest.mark.parametrize(("start", "end"), [(1.0, 0.2), (0.05, 0.05), (0.1, 0.5)])
def test_epsilon_goes_linearly_from_its_start_to_its_end(start, end):
    runs, steps = 6000, 4
    w = torch.zeros(runs, NETWORK.d)
    w[:, -1] = 1.0  # the greedy action is the last one everywhere
    settings = MellowTDSettings(steps, end, alpha=1e-12, minibatch=1, buffer=1, epsilon_start=start)
    agent = settings.agent(NETWORK, w, 2, Rng("t", range(runs)))
    for t in range(7):
        epsilon = start + min(1, t / steps) * (end - start)
        taken = agent.act(torch.ones(runs, 2), torch.zeros(runs, dtype=torch.bool))
        shares = torch.bincount(taken, minlength=ACTIONS) / runs
        # random actions are uniform, and the greedy one among them
        expected = torch.full((ACTIONS,), epsilon / ACTIONS)
        expected[2] += 1 - epsilon
        assert ((shares - expected).abs() < 5 * (expected * (1 - expected) / runs) ** 0.5).all()
        agent.learn(transition(runs))


def plainly(w, run, seen, settings):
    """The weights that one run learns, as textbooks write it."""
    online, target = (
        torch.nn.Sequential(torch.nn.Linear(2, 5), torch.nn.ReLU(), torch.nn.Linear(5, ACTIONS))
        for _ in range(2)
    )
    vector_to_parameters(w.clone(), online.parameters())
    target.load_state_dict(online.state_dict())
    adam = torch.optim.Adam(online.parameters(), settings.alpha)
    uniforms = Stream("t", [run], "replay")
    for t in range(1, len(seen) + 1):
        # the place of the oldest is the newest's
        kept = {i % settings.buffer: i for i in range(t)}
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
    return parameters_to_vector(online.parameters()).detach()


@pytest.mark.parametrize("settings", KINDS)
@pytest.mark.parametrize("start", [None, "one", "mean"])
def test_a_run_is_the_textbooks_whoever_is_beside_it_and_may_begin_with_sources(settings, start):
    sources = 2 * torch.randn(3, 3, NETWORK.d, generator=torch.Generator().manual_seed(0))
    before, seen, rows = sources.clone(), [transition(3, seed) for seed in range(23)], [0, 1, 2]
    w = sources.mean(1) if start == "mean" else sources[:, 0]
    config, weights = (FineTuning(settings, start), sources) if start else (settings, w)
    agent = config.agent(NETWORK, weights, 2, Rng("t", rows))
    for t, batch in enumerate(seen):
        if t == 13:  # in the middle of a target's time some are left behind
            rows = [2, 0]
            agent.keep(rows)
        agent.act(batch.obs[rows], batch.terminated[rows])
        agent.learn(Transition(*(part[rows] for part in batch)))
    expected = torch.stack([plainly(w[run], run, seen, settings) for run in rows])
    torch.testing.assert_close(agent.mu[:, 0], expected, rtol=1e-4, atol=1e-5)
    assert (agent.mu[:, 0] - w[rows]).abs().max() > 0.05
    assert torch.equal(sources, before)
