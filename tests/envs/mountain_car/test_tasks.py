"""The mountain car dynamics against Gymnasium's in float64, their bounds, and the family."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
import torch
from attrs import evolve
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from vtlib.envs import MountainCar, MountainCarFamily

STANDARD = 0.001
SPEEDS = torch.full((3,), STANDARD)
# What float32 may add to a state of at most 1.2.
ROUNDING = 1e-6

seeds = st.integers(0, 2**32 - 1)


def scene(seed: int, count: int) -> Tensor:
    """States (count, 2) of an episode: anywhere, near the wall, near the goal, near top speed."""
    rng = np.random.default_rng(seed)
    state = rng.uniform([-1.2, -0.07], [0.5, 0.07], (count, 2))
    near = rng.exponential(0.03, count)
    state[::4, 0] = np.maximum(-1.2, np.minimum(-1.2 + near - 0.01, 0.4))[::4]
    state[1::4, 0] = np.maximum(0.4999 - near, -1.2)[1::4]
    state[2::4, 1] = rng.choice([-1, 1], count)[2::4] * (0.07 - 0.02 * near[2::4].clip(0, 1))
    return torch.tensor(state, dtype=torch.float32)


def actions(seed: int, count: int) -> Tensor:
    return torch.tensor(np.random.default_rng(seed).integers(3, size=count))


def none(count: int) -> Tensor:
    return torch.zeros(count, 0)


@given(seeds, st.booleans(), st.sampled_from([0.0, -0.25, -1.0]))
@settings(max_examples=12, deadline=None)
def test_a_transition_is_gymnasiums(seed: int, standard: bool, last: float) -> None:
    count = 40
    family = MountainCarFamily(last_reward=last).sample(np.random.default_rng(seed), count)
    tasks = evolve(family, speed=torch.full((count,), STANDARD)) if standard else family
    state, action = scene(seed, count), actions(seed, count)
    reached, reward, terminated = tasks.step(state, action, none(count))
    env = gymnasium.make("MountainCar-v0").unwrapped
    for row in range(count):
        env.force, env.state = float(tasks.speed[row]), tuple(state[row].double().numpy())
        _, _, ends, _, _ = env.step(int(action[row]))
        expected = np.array(env.state)
        # At the wall the velocity jumps to zero, whichever way the last digit falls.
        if abs(expected[0] + 1.2) > ROUNDING or expected[0] == -1.2:
            np.testing.assert_allclose(reached[row], expected, rtol=0, atol=ROUNDING)
        if abs(expected[0] - 0.5) > ROUNDING:
            assert bool(terminated[row]) == ends
        assert reward[row] == (last if terminated[row] else -1)


def test_reaching_the_goal_is_the_one_step_without_a_cost() -> None:
    tasks = MountainCar.of(3, speed=STANDARD)
    state = torch.tensor([[0.49, 0.02], [0.45, 0.02], [0.49, -0.02]])
    reached, reward, terminated = tasks.step(state, torch.tensor([2, 2, 2]), none(3))
    assert terminated.tolist() == [True, False, False]
    assert reward.tolist() == [0.0, -1.0, -1.0]
    # Not minus zero: a stored reward would print as such.
    assert not torch.signbit(reward[0])
    assert reached[0, 1] > 0


@pytest.mark.parametrize("last", [0.5, -1.5, float("nan"), None, True])
def test_a_last_reward_that_would_not_be_a_cost_of_one_step_is_refused(last: object) -> None:
    for make in (MountainCarFamily, lambda last_reward: MountainCar(SPEEDS, last_reward)):
        with pytest.raises(ValueError, match=r"last_reward must lie in \[-1, 0\], got"):
            make(last_reward=last)  # type: ignore[operator]


def test_the_last_reward_is_told_to_the_kernel_and_only_alike_ones_join() -> None:
    family = MountainCarFamily(last_reward=-1.0)
    tasks = family.draw_tasks("t", [0, 1])
    expected = [[float(speed), -1.0] for speed in tasks.speed]
    assert [family.kernel_parameters(tasks, row) for row in (0, 1)] == expected
    assert torch.equal(tasks.speed, MountainCarFamily().draw_tasks("t", [0, 1]).speed)
    with pytest.raises(ValueError, match="must have the same last_reward"):
        family.join([tasks, MountainCarFamily().draw_tasks("t", [0])])


def test_starts_are_at_rest_left_of_zero() -> None:
    tasks = MountainCar.of(3, speed=STANDARD)
    start = tasks.start(torch.tensor([[0.0], [0.5], [1.0]]))
    torch.testing.assert_close(start, torch.tensor([[-0.9, 0.0], [-0.45, 0.0], [0.0, 0.0]]))
    assert torch.equal(tasks.observe(start), start)
