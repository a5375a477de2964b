"""The greedy return: against a rollout of one episode at a time, and apart from learning."""

import numpy as np
import pytest
import torch
from torch import Tensor

from vtlib.envs import CartpoleFamily, Rooms, RoomsFamily
from vtlib.evaluation import Evaluation
from vtlib.qfunctions import MLP, QFunction
from vtlib.rng import Rng

RUNS, EPISODES = [0, 1, 2], 4
ROOMS = Rooms.from_doors([[8.5], [9.0], [9.5]], uniform_start=True), RoomsFamily().q()
CARTPOLE = CartpoleFamily().draw_tasks("e", RUNS), MLP((4, 8, 2))
CASES = pytest.mark.parametrize("case", [ROOMS, CARTPOLE], ids=["rooms", "cartpole"])


def evaluation(case, runs=RUNS, over="mean") -> Evaluation:
    return Evaluation(case[1], case[0].select(runs), Rng("e", runs), EPISODES, over)


def weights(q: QFunction, components: int = 1) -> Tensor:
    w = torch.randn(3, components, q.d, generator=torch.Generator().manual_seed(0))
    if q is ROOMS[1]:
        w[..., : q.d // 2] += 2.0  # up and right, where the goal is
    return w


def played(q, w, over, task, u, noise) -> float:
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


@CASES
@pytest.mark.parametrize(
    ("over", "components"), [("mean", 1), ("mean", 3), ("max", 3), ("each", 3)]
)
def test_it_equals_episodes_played_one_by_one(case, over, components):
    tasks, q = case
    mu, rng, evaluate = weights(q, components), Rng("e", RUNS), evaluation(case, over=over)
    noises, starts = rng.stream("test noise"), rng.stream("test start")
    for _ in range(2):
        noise = noises.normal(EPISODES * tasks.horizon * tasks.noise_dim)
        noise = noise.view(3, EPISODES, tasks.horizon, tasks.noise_dim)
        start = starts.uniform(EPISODES * tasks.start_dim).view(3, EPISODES, 1, tasks.start_dim)
        expected = torch.zeros(3, EPISODES)
        for r, e in np.ndindex(3, EPISODES):
            given = over, tasks.select([r]), start[r, e], noise[r, e]
            parts = mu[r].split(1 if over == "each" else components)
            expected[r, e] = sum(played(q, w, *given) for w in parts) / len(parts)
        assert expected.any()
        torch.testing.assert_close(evaluate.episodes(mu), expected, rtol=0, atol=1e-4)
    assert torch.equal(mu, weights(q, components))


@CASES
def test_a_run_feels_neither_its_neighbours_nor_that_they_are_left_behind(case):
    mu, rows = weights(case[1]), [2, 1]
    together, alone = evaluation(case), evaluation(case, rows)
    torch.testing.assert_close(together.episodes(mu)[rows], alone.episodes(mu[rows]))
    together.keep(rows)
    torch.testing.assert_close(together.episodes(mu[rows]), alone.episodes(mu[rows]))
