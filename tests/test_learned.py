"""What was learned acts, says how sure it is, and is saved with all that it takes to go on."""

import gymnasium as gym
import numpy as np
import pytest
import torch

from vtlib.learned import Learned
from vtlib.playing import evaluate
from vtlib.qfunctions import MLP, ModuleQ
from vtlib.transfer import Settings
from vtlib.trust import Trust

Q = MLP((4, 8, 2))


def learned(components=3, d=Q.d, **more):
    weights = torch.randn(2, components, d, generator=torch.Generator().manual_seed(0))
    empty, runs = torch.empty(0, dtype=torch.int64), torch.ones(2)
    parts = weights, empty, torch.empty(2, 0), runs.long(), runs.bool()
    return Learned(*parts, **{"q": Q, "settings": Settings(), **more})


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
    obs = np.stack(env.seen[: len(env.done)])
    assert things.predict(obs, run=1).tolist() == env.done
    assert [things.predict(x, run=1) for x in obs] == env.done
    assert isinstance(things.predict(obs[0]), int)
    assert learned(first_action=3).predict(obs, run=1).tolist() == [a + 3 for a in env.done]


@pytest.mark.parametrize("diagonal", [True, False])
def test_a_value_has_the_mean_and_the_deviation_of_the_posterior(diagonal):
    q = ModuleQ(torch.nn.Linear(4, 2, bias=False), 2)
    L = torch.full((2, 1, q.d), 0.5)
    L = L if diagonal else torch.diag_embed(L)
    things = learned(1, q.d, q=q)
    things = learned(1, q.d, q=q, mu=things.weights, scale_tril=L)
    obs = np.array([[1.0, 0, 0, 0], [0, 3.0, 4.0, 0]])
    mean, deviation = things.values(obs, run=1)
    expected = things.weights[1, 0].view(2, 4) @ torch.tensor(obs.T, dtype=torch.float32)
    np.testing.assert_allclose(mean, expected.T, atol=0.6)
    np.testing.assert_allclose(deviation, [[0.5, 0.5], [2.5, 2.5]], rtol=0.2)
    one, spread = things.values(obs[1], run=1)
    np.testing.assert_allclose((one, spread), (mean[1], deviation[1]), rtol=1e-5)
    assert (learned(1).values(obs)[1] == 0).all()


@pytest.mark.parametrize(
    ("obs", "run", "message"),
    [
        ([0, 0, 0], 0, "obs must be observations of q, got .0, 0, 0.: .*4 numbers"),
        (np.full(4, np.nan), 0, "obs must be .* not finite"),
        ("left", 0, "obs must be observations of q, got 'left'"),
        (np.zeros(4), 2, "run must be a whole number from 0 to 1, got 2"),
    ],
)
def test_what_cannot_be_seen_is_refused(obs, run, message):
    with pytest.raises(ValueError, match=message):
        learned().predict(obs, run)


def test_a_module_has_to_be_given_again(tmp_path):
    q, other = (ModuleQ(torch.nn.Linear(n, 2), 2) for n in (4, 5))
    learned(d=q.d, q=q, settings=Trust(gamma=0.9), interrupted=True).save(tmp_path / "x.npz")
    again = Learned.load(tmp_path / "x.npz", q)
    assert again.q is q
    assert (again.settings, again.gamma, again.interrupted) == (Trust(gamma=0.9), 0.9, True)
    for wrong in (None, other):
        with pytest.raises(ValueError, match=r"q must be the saved .*ModuleQ.*, got "):
            Learned.load(tmp_path / "x.npz", wrong)
