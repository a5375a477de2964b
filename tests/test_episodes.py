"""Episodes of ordinary Gymnasium environments in lock-step, and their returns."""

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.wrappers import TransformAction

from vtlib.episodes import GymEpisodes, Returns


def test_learning_return_against_a_plain_list():
    g = torch.Generator().manual_seed(0)
    runs, window, gamma = 3, 5, 0.9
    returns = Returns(runs, gamma, window)
    finished, rewards = ([[] for _ in range(runs)] for _ in range(2))
    for _ in range(200):
        reward, done = torch.randn(runs, generator=g), torch.rand(runs, generator=g) < 0.2
        returns.add(reward, done)
        for r in range(runs):
            rewards[r].append(reward[r].item())
            if done[r]:
                finished[r].append(sum(gamma**t * x for t, x in enumerate(rewards[r])))
                rewards[r] = []
        expected = [np.mean(x[-window:] or [0.0]) for x in finished]
        assert returns.mean().tolist() == pytest.approx(expected, abs=1e-5)


class Reuses(gymnasium.ObservationWrapper):
    """Hands out one and the same array, changed in place."""

    array = None

    def observation(self, observation):
        self.array = observation.copy() if self.array is None else self.array
        self.array[:] = observation
        return self.array


def test_gym_episodes_equal_a_loop_over_each_environment():
    envs = [gymnasium.make("CartPole-v1", max_episode_steps=25) for _ in range(3)]
    space = gymnasium.spaces.Discrete(2, start=3)
    odd = [TransformAction(Reuses(env), lambda action: action - 3, space) for env in envs[:2]]
    with pytest.raises(ValueError, match="must have the same spaces"):
        GymEpisodes([gymnasium.make(x) for x in ("CartPole-v1", "Acrobot-v1")], seeds=[0, 0])
    lock, env = GymEpisodes(odd, seeds=[5, 6], gamma=0.9), envs[2]
    assert (lock.obs_dim, lock.n_actions) == (4, 2)
    actions = torch.randint(2, (120, 2), generator=torch.Generator().manual_seed(0))
    seen = [(lock.obs, lock.step(a), lock.fresh) for a in actions]
    for r, seed in enumerate((5, 6)):
        returns, ends = Returns(1, 0.9, 50), set()
        obs, _ = env.reset(seed=seed)
        for action, (before, transition, fresh) in zip(actions[:, r], seen, strict=True):
            assert np.array_equal(before[r], obs)
            after, reward, terminated, truncated, _ = env.step(action.item())
            assert np.array_equal(transition.next_obs[r], after)
            assert transition.reward[r] == reward
            assert transition.terminated[r] == terminated
            assert fresh[r] == (terminated or truncated)
            returns.add(torch.tensor([reward]), fresh[[r]])
            ends.add((terminated, truncated))
            obs = env.reset()[0] if fresh[r] else after
        assert ends >= {(True, False), (False, True)}
        assert lock.returns.mean()[r] == returns.mean()
