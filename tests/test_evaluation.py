"""The greedy return: against a rollout of one episode at a time, and apart from learning."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from vtlib.envs.cartpole import CartpoleFamily
from vtlib.envs.rooms import RoomsFamily
from vtlib.evaluation import Evaluation
from vtlib.qfunctions import MLP, QFunction
from vtlib.rng import Rng

RUNS, EPISODES = [0, 1, 2], 4
ROOMS = RoomsFamily(), RoomsFamily().q()
CARTPOLE = CartpoleFamily(), MLP((4, 8, 2))


def evaluation(case, runs: list[int] = RUNS, over: str = "mean") -> Evaluation:
    family, q = case
    return Evaluation(q, family.draw_tasks("e", runs), Rng("e", runs), EPISODES, over)


def weights(q: QFunction, components: int = 1) -> Tensor:
    return torch.randn(3, components, q.d, generator=torch.Generator().manual_seed(0))


@pytest.mark.parametrize("components", [1, 3])
@pytest.mark.parametrize("over", ["mean", "max"])
@pytest.mark.parametrize("case", [ROOMS, CARTPOLE], ids=["rooms", "cartpole"])
def test_it_equals_episodes_played_one_by_one(case, over, components):
    family, q = case
    mu, tasks, rng = weights(q, components), family.draw_tasks("e", RUNS), Rng("e", RUNS)
    before = mu.clone()
    noises, starts = rng.stream("test noise"), rng.stream("test start")
    evaluate, each = evaluation(case, over=over), evaluation(case, over=over)
    for _ in range(2):
        noise = noises.normal(EPISODES * tasks.horizon * tasks.noise_dim)
        noise = noise.view(3, EPISODES, tasks.horizon, tasks.noise_dim)
        start = starts.uniform(EPISODES * tasks.start_dim).view(3, EPISODES, tasks.start_dim)
        expected = torch.zeros(3, EPISODES)
        for r, e in torch.cartesian_prod(torch.arange(3), torch.arange(EPISODES)).tolist():
            task = tasks.select([r])
            state = task.start(start[r, e : e + 1])
            for t in range(task.horizon):
                obs = task.observe(state).unsqueeze(0)
                values = q.q(mu[r : r + 1], q.prepare(obs))[0, :, :, 0]
                values = values.mean(0) if over == "mean" else values.max(0).values
                action = values.argmax().view(1)
                state, reward, terminated = task.step(state, action, noise[r, e, t : t + 1])
                expected[r, e] += task.gamma**t * reward.item()
                if terminated:
                    break
        torch.testing.assert_close(each.episodes(mu), expected, rtol=0, atol=1e-4)
        torch.testing.assert_close(evaluate(mu), expected.mean(1), rtol=0, atol=1e-4)
    assert torch.equal(mu, before)


@pytest.mark.parametrize("case", [ROOMS, CARTPOLE], ids=["rooms", "cartpole"])
def test_each_component_plays_the_same_episodes_and_returns_are_averaged(case):
    mu, together = weights(case[1], 3), evaluation(case, over="each")
    alone = [evaluation(case) for _ in range(3)]
    for _ in range(2):  # the second evaluation draws from where all of them have come to
        found = [one.episodes(mu[:, i : i + 1]) for i, one in enumerate(alone)]
        torch.testing.assert_close(together.episodes(mu), torch.stack(found).mean(0))
    # in the rooms nobody arrives
    assert torch.equal(found[0], found[1]) == (case is ROOMS)


def test_later_evaluations_are_others_and_do_not_depend_on_how_earlier_ones_went():
    evaluate, again = evaluation(CARTPOLE), evaluation(CARTPOLE)
    mu = weights(CARTPOLE[1])
    first = evaluate(mu)
    # other weights end their episodes at other times
    again(-mu)
    second = evaluate(mu)
    assert torch.equal(second, again(mu))
    assert not torch.equal(first, second)


@pytest.mark.parametrize("case", [ROOMS, CARTPOLE], ids=["rooms", "cartpole"])
def test_a_run_feels_neither_its_neighbours_nor_that_they_are_left_behind(case):
    mu, rows = weights(case[1]), [2, 1]
    together, alone = evaluation(case), evaluation(case, rows)
    torch.testing.assert_close(together.episodes(mu)[rows], alone.episodes(mu[rows]))
    together.keep(rows)
    torch.testing.assert_close(together.episodes(mu[rows]), alone.episodes(mu[rows]))
