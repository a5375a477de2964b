"""The greedy return: against a rollout of one episode at a time, and apart from learning."""

import numpy as np
import pytest
import torch

from vtlab.envs import CartpoleFamily, Rooms, RoomsFamily
from vtlab.evaluation import Evaluation
from vtlib.qfunctions import MLP
from vtlib.rng import Rng

RUNS, EPISODES = [0, 1, 2], 4
ROOMS = Rooms.from_doors([[8.5], [9.0], [9.5]], uniform_start=True), RoomsFamily().q()
CARTPOLE = CartpoleFamily().draw_tasks("e", RUNS), MLP((4, 8, 2))


def weights(q, components):
    w = torch.randn(3, components, q.d, generator=torch.Generator().manual_seed(0))
    if q is ROOMS[1]:
        w[..., : q.d // 2] += 2.0  # up and right, where the goal is
    return w


def played(q, w, over, task, u, noise):
    """The return of one episode with weights w (C, d), step by step."""
    state, total = task.start(u), 0.0
    for t in range(task.horizon):
        values = q.q(w[None], q.prepare(task.observe(state)[None]))[0, :, :, 0]
        values = values.max(0).values if over == "max" else values.mean(0)
        state, reward, terminated = task.step(state, values.argmax().view(1), noise[t : t + 1])
        total += task.gamma**t * reward.item()
        if terminated:
            break
    return total


@pytest.mark.parametrize("case", [ROOMS, CARTPOLE], ids=["rooms", "cartpole"])
@pytest.mark.parametrize(
    ("over", "components"), [("mean", 1), ("mean", 3), ("max", 3), ("each", 3)]
)
def test_runs_earn_what_single_episodes_do_and_may_be_left_behind(case, over, components):
    tasks, q = case
    mu, rng = weights(q, components), Rng("e", RUNS)
    evaluate = Evaluation(q, tasks, rng, EPISODES, over)
    noises, starts = rng.stream("test noise"), rng.stream("test start")
    for kept in (RUNS, [2, 1]):
        noise = noises.normal(EPISODES * tasks.horizon * tasks.noise_dim)
        noise = noise.view(3, EPISODES, tasks.horizon, tasks.noise_dim)
        start = starts.uniform(EPISODES * tasks.start_dim).view(3, EPISODES, 1, tasks.start_dim)
        expected = torch.zeros(3, EPISODES)
        for r, e in np.ndindex(3, EPISODES):
            given = over, tasks.select([r]), start[r, e], noise[r, e]
            parts = mu[r].split(1 if over == "each" else components)
            expected[r, e] = sum(played(q, w, *given) for w in parts) / len(parts)
        assert expected.any()
        evaluate.keep(kept)
        torch.testing.assert_close(evaluate.episodes(mu[kept]), expected[kept], rtol=0, atol=1e-4)
    assert torch.equal(mu, weights(q, components))
