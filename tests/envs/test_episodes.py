"""Episodes in lock-step: returns, truncation, fresh starts, and ordinary Gymnasium environments."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
import torch
from torch import Tensor

from vtlib.envs.episodes import Episodes, GymEpisodes, Returns
from vtlib.rng import Stream


class Counters:
    """State: a run's label and its step count; run r reaches its terminal state at ``ends[r]``."""

    n_actions, obs_dim, noise_dim, start_dim, horizon, gamma = 3, 2, 1, 1, 5, 0.5

    def __init__(self, ends: list[int]) -> None:
        self._ends = torch.tensor(ends)

    def __len__(self) -> int:
        return len(self._ends)

    def start(self, u: Tensor) -> Tensor:
        return torch.cat([u, torch.zeros_like(u)], 1)

    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        state = state + torch.tensor([0.0, 1.0])
        return state, 1.0 + action, state[:, 1] >= self._ends

    def observe(self, state: Tensor) -> Tensor:
        return 10 * state

    def select(self, index: list[int]) -> Counters:
        return Counters(self._ends[index].tolist())


NEVER = 99


def episodes(ends: list[int], runs: list[int] | None = None, **options) -> Episodes:
    names = list(range(len(ends))) if runs is None else runs
    return Episodes(Counters(ends), Stream("t", names, "n"), Stream("t", names, "s"), **options)


def still(runs: int) -> Tensor:
    return torch.zeros(runs, dtype=torch.int64)


def test_a_terminal_state_ends_an_episode_and_the_next_begins():
    lock = episodes([2, 3])
    assert lock.fresh.tolist() == [True, True]
    counts, flags = [], []
    for _ in range(6):
        before, transition = lock.obs.clone(), lock.step(torch.tensor([1, 2]))
        # the transition shows where the episode ended, obs where the next begins
        assert torch.equal(transition.obs, before)
        assert transition.reward.tolist() == [2.0, 3.0]
        counts.append((transition.next_obs[:, 1] / 10).tolist())
        flags.append((transition.terminated.tolist(), lock.fresh.tolist()))
        assert torch.equal(lock.fresh, lock.obs[:, 1] == 0)
        assert torch.equal(lock.obs[~lock.fresh], transition.next_obs[~lock.fresh])
    assert counts == [[1, 1], [2, 2], [1, 3], [2, 1], [1, 2], [2, 3]]
    assert [ended for ended, _ in flags] == [fresh for _, fresh in flags]
    assert flags[1] == ([True, False], [True, False])
    assert flags[2] == ([False, True], [False, True])


def test_the_horizon_truncates_without_a_terminal_state():
    lock = episodes([NEVER])
    for t in range(1, 11):
        transition = lock.step(still(1))
        assert not transition.terminated.any()
        assert transition.next_obs[0, 1] == 10 * (1 + (t - 1) % 5)
        assert lock.fresh.item() == (t % 5 == 0)


def test_starts_do_not_depend_on_the_neighbours_episodes():
    together, alone = episodes([2, 3, NEVER]), episodes([3], runs=[1])
    for _ in range(20):
        assert torch.equal(together.obs[1], alone.obs[0])
        together.step(still(3))
        alone.step(still(1))


def test_learning_return_against_a_plain_list():
    g = torch.Generator().manual_seed(0)
    runs, window, gamma = 3, 5, 0.9
    returns = Returns(runs, gamma, window)
    lists: list[list[float]] = [[] for _ in range(runs)]
    rewards: list[list[float]] = [[] for _ in range(runs)]
    for _ in range(200):
        reward, done = torch.randn(runs, generator=g), torch.rand(runs, generator=g) < 0.2
        returns.add(reward, done)
        for r in range(runs):
            rewards[r].append(reward[r].item())
            if done[r]:
                lists[r].append(sum(gamma**t * x for t, x in enumerate(rewards[r])))
                rewards[r] = []
        expected = [sum(x[-window:]) / max(1, len(x[-window:])) for x in lists]
        assert returns.mean().tolist() == pytest.approx(expected, abs=1e-5)


def test_recording_changes_nothing_and_holds_what_was_arrived_at():
    plain, kept = episodes([2, NEVER]), episodes([2, NEVER], record=True)
    for action in torch.randint(3, (6, 2), generator=torch.Generator().manual_seed(0)):
        assert all(map(torch.equal, kept.step(action), plain.step(action)))
        assert torch.equal(kept.obs, plain.obs)
    # run 0 ends at its second step, run 1 at the horizon of five; a start would be a zero
    assert (kept.visited[..., 1] / 10).tolist() == [[1, 2, 1, 2, 1, 2], [1, 2, 3, 4, 5, 1]]


def test_runs_that_are_kept_go_on_as_before():
    whole, part = episodes([2, 3, NEVER], record=True), episodes([2, 3, NEVER], record=True)
    for t in range(12):
        whole.step(still(3))
        part.step(still(len(part.obs)))
        if t == 4:
            part.keep([2, 0])
    assert torch.equal(part.obs, whole.obs[[2, 0]])
    assert torch.equal(part.fresh, whole.fresh[[2, 0]])
    assert torch.equal(part.visited, whole.visited[[2, 0]])
    assert torch.equal(part.returns.mean(), whole.returns.mean()[[2, 0]])


# --- ordinary Gymnasium environments -----------------------------------------------------------


def cartpoles(count: int, limit: int = 500) -> list[gymnasium.Env]:
    return [gymnasium.make("CartPole-v1", max_episode_steps=limit) for _ in range(count)]


def test_gym_episodes_equal_a_loop_over_each_environment():
    lock = GymEpisodes(cartpoles(2), seeds=[5, 6], gamma=0.9)
    assert (lock.obs_dim, lock.n_actions) == (4, 2)
    g = torch.Generator().manual_seed(0)
    actions = torch.randint(2, (120, 2), generator=g)
    seen = [(lock.obs, lock.step(a), lock.obs, lock.fresh) for a in actions]
    for r, seed in enumerate((5, 6)):
        (env,) = cartpoles(1)
        obs, _ = env.reset(seed=seed)
        for t, (before, transition, _, _) in enumerate(seen):
            assert np.array_equal(before[r], obs)
            after, reward, terminated, truncated, _ = env.step(actions[t, r].item())
            assert np.array_equal(transition.next_obs[r], after)
            assert transition.reward[r] == reward
            assert transition.terminated[r] == terminated
            obs = env.reset()[0] if terminated or truncated else after
    ends = torch.stack([fresh for *_, fresh in seen]).sum(0)
    assert (ends > 2).all()


def test_gym_truncation_is_not_terminal():
    lock = GymEpisodes(cartpoles(1, limit=4), seeds=[0], gamma=0.9)
    for t in range(1, 13):
        transition = lock.step(torch.tensor([t % 2]))
        assert not transition.terminated.item()
        assert lock.fresh.item() == (t % 4 == 0)
    assert lock.returns.mean().item() == pytest.approx(1 + 0.9 + 0.81 + 0.729)


class Reuses(gymnasium.Env):
    """An environment that hands out one and the same array, changed in place."""

    observation_space = gymnasium.spaces.Box(-100, 100, (1,), np.float32)
    action_space = gymnasium.spaces.Discrete(2, start=3)

    def __init__(self) -> None:
        self._obs = np.zeros(1, np.float32)
        self.actions: list[int] = []

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._obs[:] = 0
        return self._obs, {}

    def step(self, action):
        self.actions.append(action)
        self._obs += 1
        return self._obs, 0.0, bool(self._obs[0] >= 3), False, {}


def test_gym_observations_survive_the_next_reset_and_actions_count_from_the_spaces_start():
    env = Reuses()
    lock = GymEpisodes([env], seeds=[0])
    seen = [lock.step(torch.tensor([action])) for action in (0, 1, 0, 1)]
    assert [t.obs.item() for t in seen] == [0, 1, 2, 0]
    assert [t.next_obs.item() for t in seen] == [1, 2, 3, 1]
    assert env.actions == [3, 4, 3, 4]


class Spaces(Reuses):
    """An environment with other spaces."""

    def __init__(self, observations: gymnasium.Space, actions: gymnasium.Space) -> None:
        super().__init__()
        self.observation_space, self.action_space = observations, actions


BOX, TWO = gymnasium.spaces.Box(-1, 1, (1,), np.float32), gymnasium.spaces.Discrete(2)


@pytest.mark.parametrize(
    ("observations", "actions", "message"),
    [
        (TWO, TWO, "one-dimensional Box observation space, got"),
        (gymnasium.spaces.Box(-1, 1, (2, 2)), TWO, "one-dimensional Box observation space, got"),
        (BOX, BOX, "Discrete action space, got"),
    ],
)
def test_gym_observations_are_a_vector_and_actions_discrete(observations, actions, message):
    with pytest.raises(ValueError, match=message):
        GymEpisodes([Spaces(observations, actions)], seeds=[0])


def test_gym_needs_equal_spaces_and_one_seed_for_each_environment():
    other = Spaces(BOX, gymnasium.spaces.Discrete(3))
    with pytest.raises(ValueError, match="same"):
        GymEpisodes([Spaces(BOX, TWO), other], seeds=[0, 1])
    with pytest.raises(ValueError):
        GymEpisodes(cartpoles(2), seeds=[0])
