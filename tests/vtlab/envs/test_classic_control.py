"""The dynamics of cartpole and mountain car against Gymnasium's in float64, and their bounds."""

import gymnasium
import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from vtlab.envs import CartpoleFamily, MountainCar, MountainCarFamily

ANGLE_LIMIT = np.radians(12)
COUNT = 40
NONE = torch.zeros(COUNT, 0)  # noise
# What float32 may add to a state of a few units.
ROUNDING = 1e-6

seeds = given(st.integers(0, 2**32 - 1))
few = settings(max_examples=12, deadline=None)


def poles(rng):
    """States (40, 4) of an episode, half of them near a limit of position or angle."""
    high = np.array([2.4, 3.0, ANGLE_LIMIT, 3.0])
    state = rng.uniform(-high, high, (COUNT, 4))
    sides = rng.choice([-1, 1], (COUNT, 2))
    state[::4, 0] = (sides[:, 0] * (2.4 - rng.exponential(0.03, COUNT)))[::4]
    state[2::4, 2] = (sides[:, 1] * (ANGLE_LIMIT - rng.exponential(0.02, COUNT)))[2::4]
    return torch.tensor(state, dtype=torch.float32)


def cars(rng):
    """States (40, 2) of an episode: anywhere, near the wall, near the goal, near top speed."""
    state = rng.uniform([-1.2, -0.07], [0.5, 0.07], (COUNT, 2))
    near = rng.exponential(0.03, COUNT)
    state[::4, 0] = np.maximum(-1.2, np.minimum(-1.2 + near - 0.01, 0.4))[::4]
    state[1::4, 0] = np.maximum(0.4999 - near, -1.2)[1::4]
    state[2::4, 1] = rng.choice([-1, 1], COUNT)[2::4] * (0.07 - 0.02 * near[2::4].clip(0, 1))
    return torch.tensor(state, dtype=torch.float32)


@seeds
@few
def test_a_transition_of_a_cartpole_is_gymnasiums(seed):
    rng = np.random.default_rng(seed)
    tasks = CartpoleFamily().sample(rng, COUNT)
    state, action = poles(rng), torch.tensor(rng.integers(2, size=COUNT))
    reached, reward, terminated = tasks.step(state, action, NONE)
    env = gymnasium.make("CartPole-v1").unwrapped
    for row in range(COUNT):
        env.masscart, env.masspole, env.length = CartpoleFamily().kernel_parameters(tasks, row)
        env.total_mass = env.masscart + env.masspole
        env.polemass_length = env.masspole * env.length
        env.state, env.steps_beyond_terminated = state[row].double().numpy(), None
        _, expected_reward, ends, _, _ = env.step(int(action[row]))
        np.testing.assert_allclose(reached[row], env.state, rtol=ROUNDING, atol=ROUNDING)
        assert reward[row] == expected_reward == 1
        if np.abs(np.abs(env.state[[0, 2]]) - [2.4, ANGLE_LIMIT]).min() > ROUNDING:
            assert bool(terminated[row]) == ends


def test_poles_start_in_a_small_box_and_cars_at_rest_left_of_zero():
    start = MountainCar.of(2, speed=0.001).start(torch.tensor([[0.0], [1.0]]))
    torch.testing.assert_close(start, torch.tensor([[-0.9, 0.0], [0.0, 0.0]]))
    tasks = CartpoleFamily().sample(np.random.default_rng(0), COUNT)
    u = torch.rand(COUNT, 4, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(tasks.start(u), (u - 0.5) / 10)


def test_the_best_return_is_that_of_a_hundred_steps_and_whole_episodes_balance():
    tasks = CartpoleFamily().sample(np.random.default_rng(0), 2)
    expected = sum(0.99**t for t in range(100))
    np.testing.assert_allclose(CartpoleFamily().optimum(tasks), expected, rtol=1e-6)
    returns = torch.full((2, 100), 60.0)
    returns[0, :5] = 10.0
    returns[1, :6] = 59.9
    assert CartpoleFamily().solved(returns, torch.full((2,), 60.0), 0.95).tolist() == [True, False]


@seeds
@few
def test_a_transition_of_a_car_is_gymnasiums(seed):
    rng = np.random.default_rng(seed)
    last = float(rng.choice([0.0, -0.25]))
    tasks = MountainCarFamily(last_reward=last).sample(rng, COUNT)
    state, action = cars(rng), torch.tensor(rng.integers(3, size=COUNT))
    reached, reward, terminated = tasks.step(state, action, NONE)
    env = gymnasium.make("MountainCar-v0").unwrapped
    for row in range(COUNT):
        env.force, env.state = float(tasks.speed[row]), tuple(state[row].double().numpy())
        _, _, ends, _, _ = env.step(int(action[row]))
        expected = np.array(env.state)
        # At the wall the velocity jumps to zero, whichever way the last digit falls.
        if abs(expected[0] + 1.2) > ROUNDING or expected[0] == -1.2:
            np.testing.assert_allclose(reached[row], expected, rtol=0, atol=ROUNDING)
        if abs(expected[0] - 0.5) > ROUNDING:
            assert bool(terminated[row]) == ends
        assert reward[row] == (last if terminated[row] else -1)
    # Not minus zero: a stored reward would print as such.
    assert torch.equal(reward.signbit(), reward < 0)
