"""The cartpole dynamics against Gymnasium's in float64, and the family of tasks."""

from __future__ import annotations

import attrs
import gymnasium
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from vtlib.envs import Cartpole, CartpoleFamily

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


@given(seeds, st.booleans())
@settings(max_examples=12, deadline=None)
def test_a_transition_is_gymnasiums(seed: int, standard: bool) -> None:
    count = 40
    family = CartpoleFamily().sample(np.random.default_rng(seed), count)
    tasks = Cartpole.of(count, **STANDARD) if standard else family
    state, action = scene(seed, count), actions(seed, count)
    reached, reward, terminated = tasks.step(state, action, none(count))
    env = gymnasium.make("CartPole-v1").unwrapped
    for row in range(count):
        env.masscart, env.masspole, env.length = (float(x[row]) for x in attrs.astuple(tasks))
        env.total_mass = env.masscart + env.masspole
        env.polemass_length = env.masspole * env.length
        env.state, env.steps_beyond_terminated = state[row].double().numpy(), None
        _, expected_reward, ends, _, _ = env.step(int(action[row]))
        expected = env.state
        np.testing.assert_allclose(reached[row], expected, rtol=ROUNDING, atol=ROUNDING)
        assert reward[row] == expected_reward == 1
        if np.abs(np.abs(expected[[0, 2]]) - [2.4, ANGLE_LIMIT]).min() > ROUNDING:
            assert bool(terminated[row]) == ends


def test_both_limits_end_an_episode_on_both_sides() -> None:
    tasks = Cartpole.of(6, **STANDARD)
    state = torch.zeros(6, 4)
    state[:, 0] = torch.tensor([2.39, -2.39, 2.39, 0.0, 0.0, 0.0])
    state[:, 1] = torch.tensor([1.0, -1.0, -1.0, 0.0, 0.0, 0.0])
    state[:, 2] = torch.tensor([0.0, 0.0, 0.0, 0.2, -0.2, 0.2])
    state[:, 3] = torch.tensor([0.0, 0.0, 0.0, 1.0, -1.0, -1.0])
    _, reward, terminated = tasks.step(state, actions(0, 6), none(6))
    assert terminated.tolist() == [True, True, False, True, True, False]
    assert reward.tolist() == [1.0] * 6


def test_starts_lie_in_a_small_box_and_a_fallen_pole_stays_finite_when_stepped_on() -> None:
    tasks = CartpoleFamily().sample(np.random.default_rng(0), 500)
    u = torch.rand(500, 4, generator=torch.Generator().manual_seed(0))
    state = tasks.start(u)
    torch.testing.assert_close(state, (u - 0.5) / 10)
    for _ in range(tasks.horizon):
        state, _, _ = tasks.step(state, torch.ones(500, dtype=torch.int64), none(500))
    assert bool(state.isfinite().all())


def test_the_best_return_is_that_of_a_hundred_steps() -> None:
    tasks = CartpoleFamily().sample(np.random.default_rng(0), 2)
    expected = sum(0.99**t for t in range(100))
    np.testing.assert_allclose(CartpoleFamily().optimum(tasks), expected, rtol=1e-6)
    assert expected == pytest.approx(63.397, abs=1e-3)


def test_a_cart_balances_by_its_share_of_whole_episodes() -> None:
    returns = torch.full((2, 100), 60.0)
    returns[0, :5] = 10.0
    returns[1, :6] = 59.9
    assert CartpoleFamily().solved(returns, torch.full((2,), 60.0), 0.95).tolist() == [True, False]
