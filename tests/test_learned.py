"""What was learned acts, and is saved with all that it takes to go on."""

import gymnasium as gym
import pytest
import torch

from vtlib.learned import Learned
from vtlib.playing import evaluate
from vtlib.qfunctions import MLP, ModuleQ
from vtlib.trust import Trust

Q = MLP((4, 8, 2))


def learned(d=Q.d, **more):
    weights = torch.randn(2, 3, d, generator=torch.Generator().manual_seed(0))
    empty, runs = torch.empty(0, dtype=torch.int64), torch.ones(2)
    parts = weights, empty, torch.empty(2, 0), runs.long(), runs.bool()
    return Learned(*parts, **{"q": Q, **more})


class Looks(gym.Wrapper):
    """Notes what is seen and done."""

    def __init__(self):
        super().__init__(gym.make("CartPole-v1"))
        self.seen, self.done = [], []

    def reset(self, **options):
        obs, info = super().reset(**options)
        self.seen.append(obs)
        return obs, info

    def step(self, action):
        self.done.append(action)
        obs, *rest = super().step(action)
        self.seen.append(obs)
        return obs, *rest


def test_predict_does_what_evaluate_does_with_all_components():
    things, env = learned(), Looks()
    evaluate([env], Q, things.weights[1:], 1)
    obs = env.seen[: len(env.done)]
    assert [things.predict(x, run=1) for x in obs] == env.done
    assert learned(first_action=3).predict(obs[0], run=1) == env.done[0] + 3
    with pytest.raises(ValueError, match="run must be a whole number from 0 to 1, got 2"):
        things.predict(obs[0], run=2)


def test_a_module_has_to_be_given_again(tmp_path):
    q, other = (ModuleQ(torch.nn.Linear(n, 2), 2) for n in (4, 5))
    learned(d=q.d, q=q, settings=Trust(gamma=0.9), interrupted=True).save(tmp_path / "x.npz")
    again = Learned.load(tmp_path / "x.npz", q)
    assert (again.q, again.settings, again.interrupted) == (q, Trust(gamma=0.9), True)
    assert Learned.load(tmp_path / "x.npz").q is None
    with pytest.raises(ValueError, match=r"q must be a Q-function of 10 weights, got <.*ModuleQ"):
        Learned.load(tmp_path / "x.npz", other)
