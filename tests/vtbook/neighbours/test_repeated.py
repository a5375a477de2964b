"""Several updates a step, of which one is the algorithm itself; sources that promise too much."""

import pytest
import torch

from vtbook.neighbours import RepeatedSettings, VariedTrust
from vtlib.baselines import FineTuning, MellowTDSettings
from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.rng import Rng

Q, TUNING = MLP((3, 5, 2)), FineTuning(MellowTDSettings(epsilon_steps=10, minibatch=4), "mean")


def tuned(settings, steps=10):
    """Weights (R, d) before and after some transitions of two runs."""
    g = torch.Generator().manual_seed(5)
    sources = torch.randn(2, 3, Q.d, generator=g)
    agent = settings.agent(Q, sources, 3, Rng("repeated", [0, 1]))
    for _ in range(steps):
        obs, after = torch.randn(2, 2, 3, generator=g)
        flags = torch.zeros(2, dtype=torch.bool)
        agent.learn(Transition(obs, flags.long(), torch.ones(2), after, flags))
    return sources.mean(1), agent.mu[:, 0]


def test_one_update_is_the_algorithm_itself():
    assert torch.equal(tuned(RepeatedSettings(TUNING, 1))[1], tuned(TUNING)[1])


def test_each_update_is_a_step_of_adam_and_there_is_one_at_least():
    # whose first steps are of the size alpha, as long as gradients keep their signs
    for updates in (2, 4):
        before, after = tuned(RepeatedSettings(TUNING, updates), steps=1)
        moved = (after - before).abs().amax()
        assert moved == pytest.approx(updates * TUNING.learner.alpha, rel=0.02)
    with pytest.raises(ValueError, match="updates must"):
        RepeatedSettings(TUNING, 0)


def test_optimism_raises_every_value_of_the_sources():
    sources, x = torch.randn(1, 4, Q.d), Q.prepare(torch.randn(1, 6, 3))
    agent = VariedTrust(optimism=2.0).agent(Q, sources, 3, Rng("varied", [0]))
    torch.testing.assert_close(Q.q(agent._sources, x), Q.q(sources, x) + 2)
