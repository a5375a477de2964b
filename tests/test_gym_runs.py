"""Transfer between ordinary Gymnasium environments with a network of the user's own."""

from __future__ import annotations

import gymnasium as gym
import torch
from torch import nn

from vtlib.gym_runs import solve, transfer
from vtlib.qfunctions import ModuleQ
from vtlib.transfer import Settings


class TwoHeads(nn.Module):
    """A dueling network: one head for the state's value, one for the actions' advantages."""

    def __init__(self) -> None:
        super().__init__()
        self.trunk = nn.Linear(4, 16)
        self.value, self.advantage = nn.Linear(16, 1), nn.Linear(16, 2)

    def forward(self, obs: torch.Tensor) -> torch.Tensor:
        hidden = torch.relu(self.trunk(obs))
        advantage = self.advantage(hidden)
        return self.value(hidden) + advantage - advantage.mean(-1, keepdim=True)


def cartpole(length: float) -> gym.Env:
    env = gym.make("CartPole-v1", max_episode_steps=100)
    env.unwrapped.length = length
    return env


def test_a_two_headed_network_transfers_between_cartpoles():
    q = ModuleQ(TwoHeads(), n_actions=2)
    assert q.d == 4 * 16 + 16 + 17 + 34
    sources = solve([cartpole(x) for x in (0.35, 0.5, 0.65)], q, iterations=3000)
    settings = Settings(lambda_=1e-3, alpha_L=1e-4, minibatch=100, n_samples=5)
    learned = transfer([cartpole(0.45)], q, sources.weights[:, 0], 300, settings)
    # 63.4 is the most that 100 steps can pay; a random policy earns about 20
    assert learned.returns[0, -1] > 40
    module = TwoHeads()
    nn.utils.vector_to_parameters(learned.weights[0, 0], module.parameters())
    obs = torch.randn(5, 4, generator=torch.Generator().manual_seed(0))
    values = q.q(learned.weights[:1], q.prepare(obs.unsqueeze(0)))[0, 0]
    torch.testing.assert_close(values.T, module(obs).detach())
