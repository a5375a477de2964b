"""Episodes of a batch of tasks in lock-step: ends, truncation and fresh starts."""

import torch

from vtlab.episodes import Episodes
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
