"""The cartpole dynamics against Gymnasium's in float64, and the family of tasks."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from vtlib.envs import Cartpole, CartpoleFamily
from vtlib.envs.episodes import Episodes
from vtlib.evaluation import GreedyReturn
from vtlib.streams import Stream

STANDARD = {"cart_mass": 1.0, "pole_mass": 0.1, "half_length": 0.5}
ANGLE_LIMIT = np.radians(12)
# What float32 may add to a state of a few units.
ROUNDING = 1e-6

seeds = st.integers(0, 2**32 - 1)


def scene(seed: int, count: int) -> Tensor:
    """States (count, 4) of an episode, half of them near a limit of position or angle."""
    rng = np.random.default_rng(seed)
    high = np.array([2.4, 3.0, ANGLE_LIMIT, 3.0])
    state = rng.uniform(-high, high, (count, 4))
    sides = rng.choice([-1, 1], (count, 2))
    state[::4, 0] = (sides[:, 0] * (2.4 - rng.exponential(0.03, count)))[::4]
    state[2::4, 2] = (sides[:, 1] * (ANGLE_LIMIT - rng.exponential(0.02, count)))[2::4]
    return torch.tensor(state, dtype=torch.float32)


def actions(seed: int, count: int) -> Tensor:
    return torch.tensor(np.random.default_rng(seed).integers(2, size=count))


def none(count: int) -> Tensor:
    return torch.zeros(count, 0)


def gymnasiums_step(
    tasks: Cartpole, row: int, state: Tensor, action: Tensor
) -> tuple[np.ndarray, float, bool]:
    """What CartPole-v1 does with the masses and the length of a row, in float64."""
    env = gymnasium.make("CartPole-v1").unwrapped
    env.masscart, env.masspole = float(tasks.cart_mass[row]), float(tasks.pole_mass[row])
    env.length = float(tasks.half_length[row])
    env.total_mass = env.masscart + env.masspole
    env.polemass_length = env.masspole * env.length
    env.state = state[row].double().numpy()
    _, reward, terminal, _, _ = env.step(int(action[row]))
    return env.state, reward, terminal


@given(seeds, st.booleans())
@settings(max_examples=12, deadline=None)
def test_a_transition_is_gymnasiums(seed: int, standard: bool) -> None:
    count = 40
    family = CartpoleFamily().sample(np.random.default_rng(seed), count)
    tasks = Cartpole.of(count, **STANDARD) if standard else family
    state, action = scene(seed, count), actions(seed, count)
    reached, reward, terminal = tasks.step(state, action, none(count))
    for row in range(count):
        expected, expected_reward, ends = gymnasiums_step(tasks, row, state, action)
        np.testing.assert_allclose(reached[row], expected, rtol=ROUNDING, atol=ROUNDING)
        assert reward[row] == expected_reward == 1
        if np.abs(np.abs(expected[[0, 2]]) - [2.4, ANGLE_LIMIT]).min() > ROUNDING:
            assert bool(terminal[row]) == ends


def test_both_limits_end_an_episode_on_both_sides() -> None:
    tasks = Cartpole.of(6, **STANDARD)
    state = torch.zeros(6, 4)
    state[:, 0] = torch.tensor([2.39, -2.39, 2.39, 0.0, 0.0, 0.0])
    state[:, 1] = torch.tensor([1.0, -1.0, -1.0, 0.0, 0.0, 0.0])
    state[:, 2] = torch.tensor([0.0, 0.0, 0.0, 0.2, -0.2, 0.2])
    state[:, 3] = torch.tensor([0.0, 0.0, 0.0, 1.0, -1.0, -1.0])
    _, reward, terminal = tasks.step(state, actions(0, 6), none(6))
    assert terminal.tolist() == [True, True, False, True, True, False]
    assert reward.tolist() == [1.0] * 6


def test_types_and_shapes() -> None:
    tasks = Cartpole.of(3, **STANDARD)
    state = tasks.start(torch.rand(3, 4, generator=torch.Generator().manual_seed(0)))
    parts = tasks.step(state, torch.tensor([0, 1, 0]), none(3))
    assert [part.dtype for part in parts] == [torch.float32, torch.float32, torch.bool]
    assert [tuple(part.shape) for part in parts] == [(3, 4), (3,), (3,)]
    assert (tasks.n_actions, tasks.obs_dim, tasks.noise_dim, tasks.start_dim) == (2, 4, 0, 4)
    assert (tasks.horizon, tasks.gamma) == (100, 0.99)


def test_starts_lie_in_a_small_box() -> None:
    tasks = Cartpole.of(3, **STANDARD)
    u = torch.tensor([[0.0] * 4, [0.5] * 4, [1.0, 0.0, 0.25, 0.75]])
    expected = torch.tensor([[-0.05] * 4, [0.0] * 4, [0.05, -0.05, -0.025, 0.025]])
    torch.testing.assert_close(tasks.start(u), expected)
    assert torch.equal(tasks.observe(expected), expected)


@given(seeds)
@settings(max_examples=10, deadline=None)
def test_a_row_does_not_feel_its_neighbours(seed: int) -> None:
    tasks = CartpoleFamily().sample(np.random.default_rng(seed), 37)
    state, action = scene(seed, 37), actions(seed, 37)
    together = tasks.step(state, action, none(37))
    for row in range(37):
        rows = slice(row, row + 1)
        alone = tasks.select([row]).step(state[rows], action[rows], none(1))
        for batched, single in zip(together, alone, strict=True):
            assert torch.equal(batched[rows], single)


def test_a_step_changes_none_of_its_arguments() -> None:
    tasks, state, action = Cartpole.of(9, **STANDARD), scene(0, 9), actions(0, 9)
    before = state.clone(), action.clone()
    tasks.step(state, action, none(9))
    assert torch.equal(state, before[0])
    assert torch.equal(action, before[1])


def test_a_fallen_pole_stays_finite_when_stepped_on() -> None:
    """Batched evaluation steps all rows until the last one has ended."""
    tasks = CartpoleFamily().sample(np.random.default_rng(0), 500)
    state = tasks.start(torch.rand(500, 4, generator=torch.Generator().manual_seed(0)))
    for _ in range(tasks.horizon):
        state, _, _ = tasks.step(state, torch.ones(500, dtype=torch.int64), none(500))
    assert bool(state.isfinite().all())


# --- episodes and evaluation ------------------------------------------------------------------


def discounted(steps: int) -> float:
    return (1 - 0.99**steps) / 0.01


def balancing(obs: Tensor) -> Tensor:
    return (obs[..., 2] + 0.5 * obs[..., 3] > 0).long()


def test_an_episode_of_n_steps_returns_the_geometric_sum() -> None:
    runs = range(5)
    tasks = CartpoleFamily().sample(np.random.default_rng(1), 5)
    lock = Episodes(tasks, Stream("c", runs, "n"), Stream("c", runs, "s"), window=1)
    steps, ends = torch.zeros(5), 0
    for t in range(130):
        # The first two rows balance until the horizon, the others are pushed over.
        action = torch.where(torch.arange(5) < 2, balancing(lock.obs), (t // 3) % 2)
        transition = lock.step(action)
        steps += 1
        for row in lock.fresh.nonzero().flatten().tolist():
            ends += 1
            n = int(steps[row])
            assert lock.returns.mean()[row].item() == pytest.approx(discounted(n), rel=1e-5)
            assert (n == 100) == (not transition.terminal[row])
            steps[row] = 0
        assert torch.equal(transition.reward, torch.ones(5))
    assert ends > 8


class Balancing:
    """A Q-function whose greedy policy keeps the pole upright."""

    def prepare(self, obs: Tensor) -> Tensor:
        return obs

    def q(self, mu: Tensor, obs: Tensor) -> Tensor:
        right = balancing(obs).float()
        return torch.stack([1 - right, right], 1).unsqueeze(1)


def test_the_greedy_return_of_a_balancing_policy_is_the_best_one() -> None:
    tasks = CartpoleFamily().sample(np.random.default_rng(2), 3)
    streams = Stream("c", range(3), "n"), Stream("c", range(3), "s")
    greedy = GreedyReturn(Balancing(), tasks, *streams, episodes=4)  # type: ignore[arg-type]
    for _ in range(2):
        returns = greedy(torch.zeros(3, 1, 1))
        assert returns.tolist() == pytest.approx([discounted(100)] * 3, rel=1e-5)


# --- families ---------------------------------------------------------------------------------

RANGES = {"cart_mass": (0.5, 1.5), "pole_mass": (0.1, 0.3), "half_length": (0.2, 1.0)}


def test_a_family_draws_uniform_parameters_from_its_generator_alone() -> None:
    first = CartpoleFamily().sample(np.random.default_rng(3), 4000)
    again = CartpoleFamily().sample(np.random.default_rng(3), 4000)
    values = []
    for name, (low, high) in RANGES.items():
        value = getattr(first, name)
        assert torch.equal(value, getattr(again, name))
        assert np.float32(low) <= value.min() <= low + 0.01 * (high - low)
        assert high - 0.01 * (high - low) <= value.max() <= np.float32(high)
        # Four standard errors of the mean of a uniform number.
        assert abs(value.mean() - (low + high) / 2) < 0.02 * (high - low)
        values.append(value.numpy())
    assert np.abs(np.corrcoef(values) - np.eye(3)).max() < 0.07


def test_a_family_draws_at_least_one_task() -> None:
    with pytest.raises(ValueError, match=r"count must be a whole number from 1 .*, got 0"):
        CartpoleFamily().sample(np.random.default_rng(0), 0)


def test_join_appends_batches_in_order() -> None:
    rng = np.random.default_rng(0)
    parts = [CartpoleFamily().sample(rng, count) for count in (2, 1, 3)]
    joined = CartpoleFamily().join(parts)
    assert len(joined) == 6
    for name in RANGES:
        assert torch.equal(getattr(joined, name), torch.cat([getattr(p, name) for p in parts]))
    with pytest.raises(ValueError, match="at least one batch"):
        CartpoleFamily().join([])
