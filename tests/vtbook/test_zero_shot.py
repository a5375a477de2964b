"""What sources earn without learning."""

import numpy as np
import torch

from vtbook.zero_shot import at_start, greedy_returns, zero_shot
from vtlab.evaluation import Evaluation
from vtlab.run import chosen_sources, prepare, targets
from vtlib.rng import Rng


def test_what_sources_earn_at_once_is_by_the_surest_of_a_runs_own(tiny):
    # the mean of any two would push to the right
    pool = np.zeros((3, 226), dtype=np.float32)
    pool[:, -2:] = [[1.0, 0.9], [0.0, 0.95], [0.2, 0.97]]
    found, runs = zero_shot(tiny, pool, episodes=30), range(tiny.runs)
    surest = [max(row, key=lambda x: pool[x].max()) for row in chosen_sources(tiny, runs)]
    rng = Rng(f"{tiny.stream} zero-shot", runs)
    evaluate = Evaluation(tiny.family.q(), targets(tiny, runs), rng, 30)
    expected = evaluate(torch.from_numpy(pool[surest])[:, None])
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert (zero_shot(tiny, pool, of_mean=True) != zero_shot(tiny, pool)).any()


def test_a_posterior_s_samples_are_drawn_before_anything_is_learned(tiny, weights):
    given = tiny, "GVT", weights[:3], "some", 4
    found = at_start(*given)
    mu = prepare(tiny, "GVT", range(tiny.runs), weights[:3]).agent.mu.detach()
    np.testing.assert_array_equal(found["mean"], greedy_returns(tiny, mu, "some"))
    assert found["sample"].shape == (tiny.runs,)
    assert (found["sample"] != found["mean"]).any()
    np.testing.assert_array_equal(found["sample"], at_start(*given)["sample"])
