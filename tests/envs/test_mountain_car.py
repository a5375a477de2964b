"""The mountain car dynamics against Gymnasium's in float64, their bounds, and the family."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from vtlib.envs import MountainCar, MountainCarFamily
from vtlib.envs.episodes import Episodes
from vtlib.streams import Stream

STANDARD = 0.001
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


def gymnasiums_step(speed: float, state: Tensor, action: int) -> tuple[np.ndarray, bool]:
    """What MountainCar-v0 does with that speed as its force, in float64."""
    env = gymnasium.make("MountainCar-v0").unwrapped
    env.force = speed
    env.state = tuple(state.double().numpy())
    _, _, terminal, _, _ = env.step(action)
    return np.array(env.state), terminal


@given(seeds, st.booleans())
@settings(max_examples=12, deadline=None)
def test_a_transition_is_gymnasiums(seed: int, standard: bool) -> None:
    count = 40
    family = MountainCarFamily().sample(np.random.default_rng(seed), count)
    tasks = MountainCar.of(count, speed=STANDARD) if standard else family
    state, action = scene(seed, count), actions(seed, count)
    reached, reward, terminal = tasks.step(state, action, none(count))
    for row in range(count):
        expected, ends = gymnasiums_step(float(tasks.speed[row]), state[row], int(action[row]))
        # At the wall the velocity jumps to zero, whichever way the last digit falls.
        if abs(expected[0] + 1.2) > ROUNDING or expected[0] == -1.2:
            np.testing.assert_allclose(reached[row], expected, rtol=0, atol=ROUNDING)
        if abs(expected[0] - 0.5) > ROUNDING:
            assert bool(terminal[row]) == ends
        assert reward[row] == (0 if terminal[row] else -1)


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_position_and_velocity_stay_within_bounds(seed: int) -> None:
    tasks = MountainCar.of(60, speed=np.random.default_rng(seed).uniform(0.0005, 0.1, 60))
    state = scene(seed, 60)
    for turn in range(20):
        state, _, _ = tasks.step(state, actions(seed + turn, 60), none(60))
        position, velocity = state.double().unbind(1)
        assert bool(((position >= np.float32(-1.2)) & (position <= np.float32(0.6))).all())
        assert bool((velocity.abs() <= np.float32(0.07)).all())
        assert bool((velocity[position == np.float32(-1.2)] >= 0).all())


def test_the_wall_stops_the_car_and_lets_it_go() -> None:
    tasks = MountainCar.of(2, speed=STANDARD)
    state = torch.tensor([[-1.19, -0.05], [-1.2, 0.0]])
    reached, reward, terminal = tasks.step(state, torch.tensor([0, 2]), none(2))
    wall, free = reached.tolist()
    assert wall == pytest.approx([-1.2, 0.0])
    assert free[0] > -1.2
    assert free[1] > 0
    assert reward.tolist() == [-1.0, -1.0]
    assert not terminal.any()


def test_reaching_the_goal_is_the_one_step_without_a_cost() -> None:
    tasks = MountainCar.of(3, speed=STANDARD)
    state = torch.tensor([[0.49, 0.02], [0.45, 0.02], [0.49, -0.02]])
    reached, reward, terminal = tasks.step(state, torch.tensor([2, 2, 2]), none(3))
    assert terminal.tolist() == [True, False, False]
    assert reward.tolist() == [0.0, -1.0, -1.0]
    # Not minus zero: a stored reward would print as such.
    assert not torch.signbit(reward[0])
    assert reached[0, 1] > 0


def test_an_engine_alone_does_not_climb_the_hill() -> None:
    tasks = MountainCar.of(2, speed=[0.001, 0.0015])
    state = torch.tensor([[-np.pi / 6, 0.0]] * 2, dtype=torch.float32)
    for _ in range(tasks.horizon):
        state, _, terminal = tasks.step(state, torch.tensor([2, 2]), none(2))
        assert not terminal.any()


def test_types_and_shapes() -> None:
    tasks = MountainCar.of(3, speed=STANDARD)
    state = tasks.start(torch.rand(3, 1, generator=torch.Generator().manual_seed(0)))
    parts = tasks.step(state, torch.tensor([0, 1, 2]), none(3))
    assert [part.dtype for part in parts] == [torch.float32, torch.float32, torch.bool]
    assert [tuple(part.shape) for part in parts] == [(3, 2), (3,), (3,)]
    assert (tasks.n_actions, tasks.obs_dim, tasks.noise_dim, tasks.start_dim) == (3, 2, 0, 1)
    assert (tasks.horizon, tasks.gamma) == (200, 0.99)


def test_starts_are_at_rest_left_of_zero() -> None:
    tasks = MountainCar.of(3, speed=STANDARD)
    start = tasks.start(torch.tensor([[0.0], [0.5], [1.0]]))
    torch.testing.assert_close(start, torch.tensor([[-0.9, 0.0], [-0.45, 0.0], [0.0, 0.0]]))
    assert torch.equal(tasks.observe(start), start)


@given(seeds)
@settings(max_examples=10, deadline=None)
def test_a_row_does_not_feel_its_neighbours(seed: int) -> None:
    tasks = MountainCarFamily().sample(np.random.default_rng(seed), 37)
    state, action = scene(seed, 37), actions(seed, 37)
    together = tasks.step(state, action, none(37))
    for row in range(37):
        rows = slice(row, row + 1)
        alone = tasks.select([row]).step(state[rows], action[rows], none(1))
        for batched, single in zip(together, alone, strict=True):
            assert torch.equal(batched[rows], single)


def test_a_step_changes_none_of_its_arguments() -> None:
    tasks, state, action = MountainCar.of(9, speed=STANDARD), scene(0, 9), actions(0, 9)
    before = state.clone(), action.clone()
    tasks.step(state, action, none(9))
    assert torch.equal(state, before[0])
    assert torch.equal(action, before[1])


def test_the_return_counts_every_step_but_the_one_to_the_goal() -> None:
    tasks = MountainCarFamily().sample(np.random.default_rng(0), 4)
    lock = Episodes(tasks, Stream("m", range(4), "n"), Stream("m", range(4), "s"), window=1)
    steps, solved, truncated = torch.zeros(4), 0, 0
    for _ in range(450):
        # Pushing along builds momentum; the last row's engine stays off.
        along = torch.where(lock.obs[:, 1] < 0, 0, 2)
        transition = lock.step(torch.where(torch.arange(4) < 3, along, 1))
        steps += 1
        for row in lock.fresh.nonzero().flatten().tolist():
            at_goal = bool(transition.terminal[row])
            costs = int(steps[row]) - at_goal
            expected = -(1 - 0.99**costs) / 0.01
            assert lock.returns.mean()[row].item() == pytest.approx(expected, rel=1e-4)
            solved, truncated = solved + at_goal, truncated + (not at_goal)
            assert at_goal or steps[row] == 200
            steps[row] = 0
    assert solved > 5
    assert truncated >= 2


# --- families ---------------------------------------------------------------------------------


def test_a_family_draws_uniform_speeds_from_its_generator_alone() -> None:
    first = MountainCarFamily().sample(np.random.default_rng(3), 4000).speed
    assert torch.equal(first, MountainCarFamily().sample(np.random.default_rng(3), 4000).speed)
    assert np.float32(0.001) <= first.min() < 0.001005
    assert 0.001495 < first.max() <= np.float32(0.0015)
    # Four standard errors of the mean of a uniform number.
    assert abs(first.mean().item() - 0.00125) < 1e-5


def test_a_family_draws_at_least_one_task() -> None:
    with pytest.raises(ValueError, match=r"count must be a whole number from 1 .*, got 0"):
        MountainCarFamily().sample(np.random.default_rng(0), 0)


def test_join_appends_batches_in_order() -> None:
    parts = [MountainCar.of(1, speed=0.001), MountainCar.of(2, speed=[0.003, 0.002])]
    joined = MountainCarFamily().join(parts)
    assert torch.equal(joined.speed, torch.tensor([0.001, 0.003, 0.002]))
    with pytest.raises(ValueError, match="at least one batch"):
        MountainCarFamily().join([])
