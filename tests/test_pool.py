"""A pool of sources: what joins it, what stays out, and what is read again."""

import datetime

import gymnasium as gym
import numpy as np
import pytest
import torch

from vtlib.files import TornResult
from vtlib.learned import Learned
from vtlib.pool import EPISODES, Pool
from vtlib.qfunctions import MLP
from vtlib.trust import Trust

Q = MLP((2, 2))


class Pays(gym.Env):
    """Three steps, of which one action pays."""

    action_space, observation_space = gym.spaces.Discrete(2), gym.spaces.Box(-1, 1, (2,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._left = 3
        return np.zeros(2, np.float32), {}

    def step(self, action):
        self._left -= 1
        return np.zeros(2, np.float32), float(action == 1), self._left == 0, False, {}


def learned(*biases):
    weights = torch.tensor([[0, 0, 0, 0, 0, float(x)] for x in biases]).unsqueeze(0)
    runs, none = torch.ones(1), torch.empty(0, dtype=torch.int64)
    parts = weights, none, torch.empty(1, 0), runs.long(), runs.bool()
    return Learned(*parts, q=Q, settings=Trust(gamma=0.5))


@pytest.fixture
def pool():
    pool = Pool(Q)
    assert pool.add("first", learned(-1, 2, -3), Pays())
    return pool


def test_of_an_ensemble_the_component_that_earns_most_joins(pool):
    assert pool.weights[:, -1].tolist() == [2]
    (source,) = pool.sources
    assert source.returns.tolist() == [1.75] * EPISODES
    assert source.date == datetime.date.today().isoformat()
    assert str(pool) == f"first: greedy return 1.750, {source.date}"


def test_a_task_and_weights_that_are_there_are_noticed(pool):
    with pytest.raises(ValueError, match="task must be new to the pool, got 'first'"):
        pool.add("first", learned(5), Pays())
    with pytest.warns(UserWarning, match="'again' are those of 'first' in the pool already"):
        assert not pool.add("again", learned(2), Pays())
    assert pool.add("second", learned(-1), Pays())
    assert [x.task for x in pool.sources] == ["first", "second"]


def test_each_source_is_evaluated(pool):
    pool.add("second", learned(-1), Pays())
    first, second = pool.evaluate([Pays(), Pays()], 4, gamma=1)
    assert first.returns.tolist() == [[3] * 4] * 2
    assert second.returns.tolist() == [[0] * 4] * 2


def test_it_is_saved_and_read(pool, tmp_path):
    pool.save(tmp_path / "new" / "pool.npz")
    again = Pool.load(tmp_path / "new" / "pool.npz")
    assert torch.equal(again.weights, pool.weights)
    assert str(again) == str(pool)
    again.add("second", learned(7), Pays())
    again.save(tmp_path / "new" / "pool.npz")
    assert len(Pool.load(tmp_path / "new" / "pool.npz", Q).sources) == 2
    Pool(Q).save(tmp_path / "empty.npz")
    assert Pool.load(tmp_path / "empty.npz").sources == []
    with pytest.raises(ValueError, match="q must be the saved"):
        Pool.load(tmp_path / "empty.npz", MLP((3, 2)))
    learned(1).save(tmp_path / "other.npz")
    with pytest.raises(TornResult, match=r"other\.npz is not what Pool\.save wrote"):
        Pool.load(tmp_path / "other.npz")
