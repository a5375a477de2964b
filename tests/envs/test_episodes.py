"""Episodes in lock-step: returns, truncation, fresh starts, and ordinary Gymnasium environments."""

import gymnasium
import numpy as np
import pytest
import torch

from vtlib.envs.episodes import Episodes, GymEpisodes, Returns
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

    def select(self, index):
        return Counters(self._ends[index])


def episodes() -> Episodes:
    noise, starts = (Stream("t", range(3), role) for role in ("n", "s"))
    return Episodes(Counters([2, 3, 99]), noise, starts, record=True)


def test_a_terminal_state_or_the_horizon_ends_an_episode_and_the_next_begins():
    lock = episodes()
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


def test_runs_that_are_kept_go_on_as_before():
    whole, part = episodes(), episodes()
    for t in range(12):
        for some in (whole, part):
            some.step(torch.zeros(len(some.obs), dtype=torch.int64))
        if t == 4:
            part.keep([2, 0])
    for name in ("obs", "fresh", "visited"):
        assert torch.equal(getattr(part, name), getattr(whole, name)[[2, 0]])
    assert torch.equal(part.returns.mean(), whole.returns.mean()[[2, 0]])


def test_gym_episodes_equal_a_loop_over_each_environment():
    envs = [gymnasium.make("CartPole-v1", max_episode_steps=25) for _ in range(3)]
    lock, env = GymEpisodes(envs[:2], seeds=[5, 6], gamma=0.9), envs[2]
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


class Reuses(gymnasium.Env):
    """An environment that hands out one and the same array, changed in place."""

    def __init__(self, observations, actions):
        self.observation_space, self.action_space = observations, actions
        self._obs, self.actions = np.zeros(1, np.float32), []

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._obs[:] = 0
        return self._obs, {}

    def step(self, action):
        self.actions.append(action)
        self._obs += 1
        return self._obs, 0.0, bool(self._obs[0] >= 3), False, {}


def test_gym_observations_survive_the_next_reset_and_actions_count_from_the_spaces_start():
    env = Reuses(
        gymnasium.spaces.Box(-9, 9, (1,), np.float32), gymnasium.spaces.Discrete(2, start=3)
    )
    lock = GymEpisodes([env], seeds=[0])
    seen = [lock.step(torch.tensor([action])) for action in (0, 1, 0, 1)]
    assert [t.obs.item() for t in seen] == [0, 1, 2, 0]
    assert [t.next_obs.item() for t in seen] == [1, 2, 3, 1]
    assert env.actions == [3, 4, 3, 4]


BOX, TWO = gymnasium.spaces.Box(-1, 1, (1,), np.float32), gymnasium.spaces.Discrete(2)


@pytest.mark.parametrize(
    ("spaces", "message"),
    [
        ([(TWO, TWO)], "one-dimensional Box observation space, got"),
        ([(gymnasium.spaces.Box(-1, 1, (2, 2)), TWO)], "one-dimensional Box observation"),
        ([(BOX, BOX)], "Discrete action space, got"),
        ([(BOX, TWO), (BOX, gymnasium.spaces.Discrete(3))], "must have the same spaces"),
        ([(BOX, TWO), (BOX, TWO)], "shorter"),  # one seed for two
    ],
)
def test_gym_spaces_are_of_the_one_kind_and_each_environment_has_a_seed(spaces, message):
    envs = [Reuses(*pair) for pair in spaces]
    with pytest.raises(ValueError, match=message):
        GymEpisodes(envs, seeds=[0])
