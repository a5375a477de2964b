"""Episodes in lock-step: returns, truncation, fresh starts, and ordinary Gymnasium environments."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
import torch
from torch import Tensor

from vtlib.envs.episodes import Episodes, GymEpisodes, RecordedEpisodes, Returns
from vtlib.envs.rooms import Rooms
from vtlib.streams import Stream


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


NEVER = 99


def episodes(ends: list[int], runs: list[int] | None = None, window: int = 50) -> Episodes:
    names = list(range(len(ends))) if runs is None else runs
    return Episodes(Counters(ends), Stream("t", names, "n"), Stream("t", names, "s"), window)


def still(runs: int) -> Tensor:
    return torch.zeros(runs, dtype=torch.int64)


def test_a_terminal_state_ends_an_episode_and_the_next_begins():
    lock = episodes([2, 3])
    assert lock.fresh.tolist() == [True, True]
    counts, flags = [], []
    for _ in range(6):
        transition = lock.step(still(2))
        # the transition shows where the episode ended, obs where the next begins
        counts.append((transition.next_obs[:, 1] / 10).tolist())
        flags.append((transition.terminal.tolist(), lock.fresh.tolist()))
        assert torch.equal(lock.fresh, lock.obs[:, 1] == 0)
    assert counts == [[1, 1], [2, 2], [1, 3], [2, 1], [1, 2], [2, 3]]
    assert [terminal for terminal, _ in flags] == [fresh for _, fresh in flags]
    assert flags[1] == ([True, False], [True, False])
    assert flags[2] == ([False, True], [False, True])


def test_the_horizon_truncates_without_a_terminal_state():
    lock = episodes([NEVER])
    for t in range(1, 11):
        transition = lock.step(still(1))
        assert not transition.terminal.any()
        assert transition.next_obs[0, 1] == 10 * (1 + (t - 1) % 5)
        assert lock.fresh.item() == (t % 5 == 0)


def test_a_terminal_state_at_the_horizon_is_terminal():
    lock = episodes([5])
    last = [lock.step(still(1)) for _ in range(5)][-1]
    assert last.terminal.item()


def test_transitions_chain_within_an_episode():
    lock = episodes([2, NEVER])
    for _ in range(12):
        before, fresh = lock.obs.clone(), lock.fresh
        transition = lock.step(torch.tensor([1, 2]))
        assert torch.equal(transition.obs, before)
        assert torch.equal(transition.action, torch.tensor([1, 2]))
        assert torch.equal(transition.reward, torch.tensor([2.0, 3.0]))
        if fresh.any():
            assert not transition.obs[fresh][:, 1].any()
        assert torch.equal(lock.obs[~lock.fresh], transition.next_obs[~lock.fresh])


def test_every_episode_has_its_own_start():
    lock = episodes([1])
    starts = []
    for _ in range(20):
        starts.append(lock.obs[0, 0].item())
        lock.step(still(1))
    assert len(set(starts)) == 20


def test_starts_do_not_depend_on_the_neighbours_episodes():
    together, alone = episodes([2, 3, NEVER]), episodes([3], runs=[1])
    for _ in range(20):
        assert torch.equal(together.obs[1], alone.obs[0])
        together.step(still(3))
        alone.step(still(1))


def test_learning_return_is_the_mean_of_the_last_finished_episodes():
    lock = episodes([2, NEVER], window=3)
    assert lock.returns.mean().tolist() == [0.0, 0.0]
    finished = []
    for k in range(6):
        assert lock.returns.mean()[0].item() == pytest.approx(
            sum(finished[-3:]) / max(1, len(finished[-3:]))
        )
        for _ in range(2):
            lock.step(torch.tensor([k, 0]) % 3)
        finished.append((1 + k % 3) * (1 + 0.5))
    assert lock.returns.mean()[0].item() == pytest.approx(sum(finished[-3:]) / 3)
    # two truncated episodes of five rewards of one
    assert lock.returns.mean()[1].item() == pytest.approx((1 - 0.5**5) / 0.5)


def test_learning_return_is_zero_before_the_first_end_of_an_episode():
    returns = Returns(2, 0.9, window=4)
    for _ in range(3):
        returns.add(torch.ones(2), torch.tensor([False, False]))
        assert returns.mean().tolist() == [0.0, 0.0]
    returns.add(torch.ones(2), torch.tensor([False, True]))
    assert returns.mean().tolist() == pytest.approx([0.0, 1 + 0.9 + 0.81 + 0.729])


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


# --- episodes that keep where they went --------------------------------------------------------


def rooms_episodes(kind: type[Episodes]) -> Episodes:
    tasks = Rooms.from_doors([[5.0], [2.0], [8.0]], uniform_start=True)
    return kind(tasks, Stream("t", range(3), "n"), Stream("t", range(3), "s"), window=4)


def test_keeping_visits_changes_no_transition():
    plain, kept = rooms_episodes(Episodes), rooms_episodes(RecordedEpisodes)
    # up and right twice as often as back: the goal is reached, so that returns differ
    moves = torch.tensor([0, 0, 1, 1, 2, 3])
    picks = torch.randint(6, (600, 3), generator=torch.Generator().manual_seed(0))
    for action in moves[picks]:
        ours, theirs = kept.step(action), plain.step(action)
        assert all(map(torch.equal, ours, theirs))
        assert torch.equal(kept.obs, plain.obs)
        assert torch.equal(kept.fresh, plain.fresh)
    assert torch.equal(kept.returns.mean(), plain.returns.mean())
    assert plain.returns.mean().any()


def test_visits_are_the_states_arrived_at_in_order():
    kept = rooms_episodes(RecordedEpisodes)
    actions = torch.randint(4, (120, 3), generator=torch.Generator().manual_seed(1))
    # copied at once: what is kept must not change as episodes go on
    arrived = [kept.step(action).next_obs.clone() for action in actions]
    assert kept.visited.shape == (3, 120, 2)
    for t, positions in enumerate(arrived):
        assert torch.equal(kept.visited[:, t], positions)
    before = kept.visited
    kept.step(still(3))
    assert kept.visited.shape == (3, 121, 2)
    assert torch.equal(kept.visited[:, :120], before)


def test_visits_hold_the_end_of_an_episode_and_not_the_next_start():
    kept = RecordedEpisodes(
        Counters([2, NEVER]), Stream("t", [0, 1], "n"), Stream("t", [0, 1], "s")
    )
    for _ in range(6):
        kept.step(still(2))
    # run 0 ends at its second step, run 1 at the horizon of five; a start would be a zero
    assert (kept.visited[..., 1] / 10).tolist() == [[1, 2, 1, 2, 1, 2], [1, 2, 3, 4, 5, 1]]


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
            assert transition.terminal[r] == terminated
            obs = env.reset()[0] if terminated or truncated else after
    ends = torch.stack([fresh for *_, fresh in seen]).sum(0)
    assert (ends > 2).all()


def test_gym_episodes_types_and_shapes():
    lock = GymEpisodes(cartpoles(3), seeds=[0, 1, 2])
    assert lock.fresh.tolist() == [True] * 3
    transition = lock.step(torch.tensor([0, 1, 0]))
    kinds = [torch.float32, torch.int64, torch.float32, torch.float32, torch.bool]
    assert [part.dtype for part in transition] == kinds
    assert [tuple(part.shape) for part in transition] == [(3, 4), (3,), (3,), (3, 4), (3,)]
    assert lock.fresh.tolist() == [False] * 3


def test_gym_truncation_is_not_terminal():
    lock = GymEpisodes(cartpoles(1, limit=4), seeds=[0], gamma=0.9)
    for t in range(1, 13):
        transition = lock.step(torch.tensor([t % 2]))
        assert not transition.terminal.item()
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


def test_gym_observations_survive_the_next_reset():
    lock = GymEpisodes([Reuses()], seeds=[0])
    seen = [lock.step(torch.tensor([0])) for _ in range(4)]
    assert [t.obs.item() for t in seen] == [0, 1, 2, 0]
    assert [t.next_obs.item() for t in seen] == [1, 2, 3, 1]


def test_gym_actions_count_from_the_start_of_the_space():
    env = Reuses()
    lock = GymEpisodes([env], seeds=[0])
    for action in (0, 1):
        lock.step(torch.tensor([action]))
    assert env.actions == [3, 4]


class Spaces(Reuses):
    """An environment with other spaces."""

    def __init__(self, observations: gymnasium.Space, actions: gymnasium.Space) -> None:
        super().__init__()
        self.observation_space, self.action_space = observations, actions


BOX, TWO = gymnasium.spaces.Box(-1, 1, (1,), np.float32), gymnasium.spaces.Discrete(2)


@pytest.mark.parametrize(
    "observations",
    [TWO, gymnasium.spaces.Box(-1, 1, (2, 2)), gymnasium.spaces.Dict({"a": BOX})],
    ids=["discrete", "two axes", "dict"],
)
def test_gym_observations_must_be_a_vector(observations):
    with pytest.raises(ValueError, match="one-dimensional Box observation space, got"):
        GymEpisodes([Spaces(observations, TWO)], seeds=[0])


@pytest.mark.parametrize("actions", [BOX, gymnasium.spaces.MultiDiscrete([2, 2])])
def test_gym_actions_must_be_discrete(actions):
    with pytest.raises(ValueError, match="Discrete action space, got"):
        GymEpisodes([Spaces(BOX, actions)], seeds=[0])


def test_gym_environments_must_have_equal_spaces():
    other = Spaces(BOX, gymnasium.spaces.Discrete(3))
    with pytest.raises(ValueError, match="same"):
        GymEpisodes([Spaces(BOX, TWO), other], seeds=[0, 1])


def test_gym_needs_one_seed_for_each_environment():
    with pytest.raises(ValueError):
        GymEpisodes(cartpoles(2), seeds=[0])
