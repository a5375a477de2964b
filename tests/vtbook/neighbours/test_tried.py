"""Until its trial it is Trust, and from then on greedy episodes decide."""

import torch

from vtbook.neighbours.tried import TriedTrust
from vtlib.trust import Trust

STEPS, TRIAL = 12, 7


def test_it_is_trust_until_the_step_after_which_it_is_tried(on_a_line):
    sources = torch.randn(2, 3, 2, generator=torch.Generator().manual_seed(0))
    (tried, step), (trust, _) = (
        on_a_line(settings, sources) for settings in (TriedTrust(trial=TRIAL), Trust())
    )
    for done in range(STEPS):
        assert (tried.records[0].judged is None) == (done < TRIAL)
        fresh = torch.ones(2, dtype=torch.bool)
        actions = [agent.act(step.obs, fresh) for agent in (tried, trust)]
        assert done >= TRIAL or torch.equal(*actions)
        for agent in (tried, trust):
            agent.learn(step)
    assert tried.records[0].judged == TRIAL  # episodes, of one step each
