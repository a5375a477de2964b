"""Episodes in lock-step: returns, truncation, fresh starts, and ordinary Gymnasium environments."""

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.wrappers import TransformAction

from vtlib.episodes import Episodes, GymEpisodes, Returns
from vtlib.rng import Stream


class Counters:
    """State: a run's label and its step count; run r reaches its terminal state at ``ends[r]``."""

    n_actions, obs_dim, noise_dim, start_dim, horizon, gamma = 3, 2, 1, 1, 5, 0.5

    def __init__(self, ends):
        self._ends = torch.as_tensor(ends)

    def __len__(self):
        return len(self._ends)

    def start(self, u):
        return torch.cat([u, torch.zeros_like(u)], 1)

    def step(self, state, action, noise):
        state = state + torch.tensor([0.0, 1.0])
        return state, 1.0 + action, state[:, 1] >= self._ends

    def observe(self, state):
        return 10 * state


def test_a_terminal_state_or_the_horizon_ends_an_episode_and_the_next_begins():
    noise, starts = (Stream("t", range(3), role) for role in ("n", "s"))
    lock = Episodes(Counters([2, 3, 99]), noise, starts, record=True)
    assert lock.fresh.tolist() == [True] * 3
    terminated, fresh = [], []
    for _ in range(6):
        before, transition = lock.obs, lock.step(torch.tensor([1, 2, 0]))
        # the transition shows where the episode ended, obs where the next begins
        assert torch.equal(transition.obs, before)
        assert transition.reward.tolist() == [2, 3, 1]
        assert torch.equal(transition.next_obs, lock.visited[:, -1])
        assert torch.equal(lock.fresh, lock.obs[:, 1] == 0)
        assert torch.equal(lock.obs[~lock.fresh], transition.next_obs[~lock.fresh])
        terminated.append(transition.terminated)
        fresh.append(lock.fresh)
    counts = torch.tensor([[1, 2, 1, 2, 1, 2], [1, 2, 3, 1, 2, 3], [1, 2, 3, 4, 5, 1]])
    assert torch.equal(lock.visited[..., 1] / 10, counts.float())
    ends = torch.tensor([[2], [3], [99]])
    assert torch.equal(torch.stack(terminated, 1), counts == ends)
    assert torch.equal(torch.stack(fresh, 1), counts == ends.clamp(max=Counters.horizon))


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
    with pytest.raises(ValueError, match="shorter"):
        GymEpisodes(odd, seeds=[0])
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
