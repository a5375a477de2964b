"""The greedy return: against a rollout of one episode at a time, and apart from learning."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
import torch
from torch import Tensor

from vtlib.envs.episodes import Episodes
from vtlib.evaluation import GreedyReturn
from vtlib.qfunctions import MLP, RBFLinear
from vtlib.streams import Stream
from vtlib.training import train
from vtlib.transfer import Settings, VariationalTransfer

BASES = RBFLinear(torch.arange(-3.0, 3.5, 1.5), 0.5, 4)
MOVES = torch.tensor([[0.0, 0.5], [0.5, 0.0], [0.0, -0.5], [-0.5, 0.0]])
GOALS = torch.tensor([[1.0, 0.0], [0.0, 1.5], [-1.0, -1.0]])
EPISODES = 6


@dataclass
class Walks:
    """Random walks toward a goal, rewarded by distance at every step and more at the goal."""

    goals: Tensor

    n_actions = 4
    obs_dim = noise_dim = start_dim = 2
    horizon = 9
    gamma = 0.9

    def __len__(self) -> int:
        return len(self.goals)

    def start(self, u: Tensor) -> Tensor:
        return 4 * u - 2

    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        state = state + MOVES[action] + 0.2 * noise
        apart = (state - self.goals).square().sum(1)
        terminal = apart < 0.5
        return state, 5 * terminal.float() - 0.1 * apart, terminal

    def observe(self, state: Tensor) -> Tensor:
        return state

    def select(self, index: Tensor) -> Walks:
        return Walks(self.goals[index])


def streams(runs: list[int]) -> tuple[Stream, Stream]:
    return Stream("e", runs, "eval-noise"), Stream("e", runs, "eval-starts")


def evaluator(runs: list[int], q=BASES, episodes: int = EPISODES) -> GreedyReturn:
    return GreedyReturn(q, Walks(GOALS[runs]), *streams(runs), episodes=episodes)


def weights(components: int = 1, d: int = BASES.d) -> Tensor:
    return torch.randn(3, components, d, generator=torch.Generator().manual_seed(0))


def one_by_one(q, mu: Tensor, noise: Tensor, starts: Tensor) -> Tensor:
    """Returns (R,) by plain loops, from the same random numbers."""
    h, dim = Walks.horizon, Walks.noise_dim
    means = []
    for r in range(3):
        task = Walks(GOALS[r : r + 1])
        each = noise[r].view(EPISODES, h, dim)
        returns = []
        for e in range(EPISODES):
            state = task.start(starts[r].view(EPISODES, -1)[e : e + 1])
            total = 0.0
            for t in range(h):
                values = q.q(mu[r : r + 1], q.prepare(state.unsqueeze(0)))[0, :, :, 0]
                action = values.mean(0).argmax().view(1)
                state, reward, terminal = task.step(state, action, each[e, t : t + 1])
                total += Walks.gamma**t * reward.item()
                if terminal:
                    break
            returns.append(total)
        means.append(sum(returns) / EPISODES)
    return torch.tensor(means)


@pytest.mark.parametrize("q", [BASES, MLP((2, 8, 4))], ids=["rbf", "mlp"])
@pytest.mark.parametrize("components", [1, 3])
def test_it_equals_episodes_played_one_by_one(q, components):
    mu = weights(components, q.d)
    noise, starts = streams([0, 1, 2])
    evaluate = evaluator([0, 1, 2], q)
    for _ in range(3):
        drawn = noise.normal(EPISODES * Walks.horizon * 2), starts.uniform(EPISODES * 2)
        torch.testing.assert_close(evaluate(mu), one_by_one(q, mu, *drawn), rtol=0, atol=1e-4)


def test_components_are_averaged_as_q_functions():
    mu = weights(3)
    # a linear Q of the mean weights is the mean of the Qs
    joint, single = evaluator([0, 1, 2])(mu), evaluator([0, 1, 2])(mu.mean(1, keepdim=True))
    torch.testing.assert_close(joint, single)
    first = evaluator([0, 1, 2])(mu[:, :1])
    assert not torch.allclose(joint, first)


def test_equal_streams_give_equal_results_and_later_evaluations_others():
    evaluate, again = evaluator([0, 1, 2]), evaluator([0, 1, 2])
    first, second = evaluate(weights()), evaluate(weights())
    assert torch.equal(again(weights()), first)
    assert torch.equal(again(weights()), second)
    assert not torch.equal(first, second)


def test_later_evaluations_do_not_depend_on_how_earlier_ones_went():
    evaluate, again = evaluator([0, 1, 2]), evaluator([0, 1, 2])
    evaluate(weights())
    # other weights end their episodes at other times
    again(-weights())
    assert torch.equal(evaluate(weights()), again(weights()))


def test_a_run_does_not_feel_its_neighbours():
    together, alone = evaluator([0, 1, 2]), evaluator([1])
    for _ in range(2):
        torch.testing.assert_close(together(weights())[1:2], alone(weights()[1:2]))


def test_the_weights_are_left_alone():
    mu = weights(2)
    evaluator([0, 1, 2])(mu)
    assert torch.equal(mu, weights(2))


@pytest.mark.parametrize("every", [5, 40])
def test_evaluation_does_not_disturb_learning(every):
    def learned(interval: int) -> tuple[Tensor, Tensor]:
        runs = [0, 1, 2]
        roles = ("noise", "component", "replay", "steps", "starts")
        noise, component, replay, steps, starts = (Stream("e", runs, role) for role in roles)
        agent = VariationalTransfer(
            BASES, weights(4), 2, Settings(components=2), noise, component, replay
        )
        episodes = Episodes(Walks(GOALS), steps, starts)
        train(agent, episodes, evaluator(runs), 40, interval, ["a", "b", "c"])
        return agent.mu, episodes.obs

    for with_few, with_many in zip(learned(40), learned(every), strict=True):
        assert torch.equal(with_few, with_many)


def test_more_episodes_leave_less_noise():
    few, many = (evaluator([0, 1, 2], episodes=count) for count in (2, 200))
    spread = [torch.stack([each(weights()) for _ in range(12)]).std(0) for each in (few, many)]
    # a hundredth of the variance; a third of the deviation is many standard errors away
    assert (spread[1] < spread[0] / 3).all()
