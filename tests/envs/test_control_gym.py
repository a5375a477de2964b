"""Cartpole and mountain car as Gymnasium environments, single and vectorised."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from vtlib.envs.gym import (
    CartpoleEnv,
    CartpoleVectorEnv,
    MountainCarEnv,
    MountainCarVectorEnv,
    RoomsEnv,
)

# Each environment, its vectorised form, arguments that differ by row, and a picture's shape.
PARTS = {
    "Cartpole": (
        CartpoleEnv,
        CartpoleVectorEnv,
        {"cart_mass": [0.5, 1.0, 1.5], "pole_mass": [0.3, 0.1, 0.2], "half_length": [1, 0.2, 0.5]},
        (300, 600, 3),
    ),
    "MountainCar": (
        MountainCarEnv,
        MountainCarVectorEnv,
        {"speed": [0.001, 0.0015, 0.004]},
        (400, 600, 3),
    ),
}
both = pytest.mark.parametrize("name", PARTS)


def rollout(env: gymnasium.Env, seed: int, steps: int = 250) -> list[tuple[object, ...]]:
    """Everything the environment returns under one fixed sequence of actions."""
    actions = np.random.default_rng(7).integers(int(env.action_space.n), size=steps)
    log: list[tuple[object, ...]] = [(env.reset(seed=seed)[0].tolist(),)]
    for action in actions:
        observation, reward, terminated, truncated, _ = env.step(action)
        log.append((observation.tolist(), reward, terminated, truncated))
        if terminated or truncated:
            log.append((env.reset()[0].tolist(),))
    return log


@both
def test_the_environment_passes_gymnasiums_check(name: str) -> None:
    env = gymnasium.make(f"vtlib/{name}-v0", render_mode="rgb_array")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env.unwrapped)
    # Gymnasium's own CartPole-v1 has velocities without bounds too.
    assert [w for w in caught if name != "Cartpole" or "infinity" not in str(w.message)] == []


@both
def test_it_is_registered_with_both_entry_points(name: str) -> None:
    single, vectorised, arguments, _ = PARTS[name]
    assert isinstance(gymnasium.make(f"vtlib/{name}-v0").unwrapped, single)
    vector = gymnasium.make_vec(f"vtlib/{name}-v0", num_envs=3, **arguments)
    assert isinstance(vector, vectorised)
    assert vector.num_envs == 3
    assert vector.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    for parameter, values in arguments.items():
        assert torch.equal(getattr(vector.tasks, parameter), torch.tensor(values).float())


@both
def test_the_docstring_has_the_same_headings_as_that_of_the_rooms(name: str) -> None:
    def headings(env: type) -> list[str]:
        return [line for line in inspect.getdoc(env).splitlines() if line.startswith("## ")]

    assert headings(PARTS[name][0]) == headings(RoomsEnv)
    assert len(headings(RoomsEnv)) == 9


@both
def test_equal_seeds_give_equal_rollouts_and_others_do_not(name: str) -> None:
    single = PARTS[name][0]
    first = rollout(single(), seed=5)
    assert first == rollout(single(), seed=5)
    assert first != rollout(single(), seed=6)


def some_skill(name: str, observations: np.ndarray) -> np.ndarray:
    """Actions that let some rows reach their horizon and others a terminal state."""
    if name == "MountainCar":
        return np.where(observations[:, 1] < 0, 0, 2)
    balancing = observations[:, 2] + 0.5 * observations[:, 3] > 0
    return np.where(np.arange(len(observations)) == 0, balancing, 1).astype(np.int64)


@both
def test_the_vectorised_environment_is_the_single_one_many_times(name: str) -> None:
    single, vectorised, arguments, _ = PARTS[name]

    def row(index: int) -> Callable[[], gymnasium.Env]:
        own = {parameter: values[index] for parameter, values in arguments.items()}
        return lambda: single(**own, horizon=60)

    ours = vectorised(3, **arguments, horizon=60)
    theirs = SyncVectorEnv([row(index) for index in range(3)])
    observations = ours.reset(seed=11)[0]
    assert np.array_equal(observations, theirs.reset(seed=11)[0])
    terminated = truncated = 0
    for _ in range(200):
        actions = some_skill(name, observations)
        left, right = ours.step(actions), theirs.step(actions)
        for a, b in zip(left[:4], right[:4], strict=True):
            assert np.array_equal(a, b)
            assert a.dtype == b.dtype
        observations = left[0]
        terminated, truncated = terminated + left[2].sum(), truncated + left[3].sum()
    assert terminated > 0
    assert truncated > 0


def states(env: gymnasium.Env, actions: list[int]) -> np.ndarray:
    return np.stack([env.step(action)[0] for action in actions])


def test_the_defaults_are_gymnasiums_cartpole() -> None:
    ours, theirs = CartpoleEnv(), gymnasium.make("CartPole-v1").unwrapped
    first, _ = ours.reset(seed=3)
    theirs.reset(seed=0)
    theirs.state = first.astype(np.float64)
    actions = [0, 1, 1, 0, 1, 0, 0, 1, 0]
    np.testing.assert_allclose(states(ours, actions), states(theirs, actions), atol=1e-5)


def test_the_defaults_are_gymnasiums_mountain_car() -> None:
    ours, theirs = MountainCarEnv(), gymnasium.make("MountainCar-v0").unwrapped
    first, _ = ours.reset(seed=3)
    theirs.reset(seed=0)
    theirs.state = tuple(first.astype(np.float64))
    actions = [0] * 20 + [2] * 30 + [1] * 10
    np.testing.assert_allclose(states(ours, actions), states(theirs, actions), atol=1e-5)


@both
def test_the_horizon_truncates_and_does_not_terminate(name: str) -> None:
    env = gymnasium.make(f"vtlib/{name}-v0")
    assert env.unwrapped.horizon == {"Cartpole": 100, "MountainCar": 200}[name]
    short = PARTS[name][0](horizon=4)
    short.reset(seed=0)
    assert [short.step(0)[2:4] for _ in range(4)] == [(False, False)] * 3 + [(False, True)]
    with pytest.raises(ResetNeeded):
        short.step(0)


def test_rewards() -> None:
    pole, car = CartpoleEnv(), MountainCarEnv(speed=0.004)
    for env, usual, last in ((pole, 1.0, 1.0), (car, -1.0, 0.0)):
        env.reset(seed=1)
        rewards, terminated = [], False
        while not terminated:
            _, reward, terminated, truncated, _ = env.step(int(env.action_space.n) - 1)
            rewards.append(reward)
            assert not truncated
        assert rewards == [usual] * (len(rewards) - 1) + [last]


@both
def test_what_is_returned_is_the_callers_to_change(name: str) -> None:
    single, vectorised, _, _ = PARTS[name]
    for env, action in ((single(), 0), (vectorised(2), np.zeros(2, dtype=np.int64))):
        env.reset(seed=0)[0][...] = 99.0
        env.step(action)[0][...] = 99.0
        assert env.step(action)[0].max() < 10


@both
def test_pictures(name: str) -> None:
    single, vectorised, _, shape = PARTS[name]
    env = single(render_mode="rgb_array")
    assert single().render() is None
    assert vectorised().render() is None
    with pytest.raises(ResetNeeded):
        env.render()
    env.reset(seed=0)
    before = env.render()
    for _ in range(5):
        env.step(0)
    after = env.render()
    assert before.shape == shape
    assert before.dtype == np.uint8
    assert not np.array_equal(before, after)
    vector = vectorised(2, render_mode="rgb_array")
    vector.reset(seed=0)
    assert [picture.shape for picture in vector.render()] == [shape] * 2


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("Cartpole", {"cart_mass": 0.0}, "cart_mass must be positive and finite, got 0"),
        ("Cartpole", {"pole_mass": float("nan")}, "pole_mass must be positive and finite, got nan"),
        ("Cartpole", {"half_length": -1.0}, "half_length must be positive and finite, got -1"),
        ("Cartpole", {"cart_mass": [1.0, 1.0]}, "cart_mass must be a number or have shape"),
        ("Cartpole", {"horizon": 0}, "horizon must be a whole number from 1 .*, got 0"),
        ("MountainCar", {"speed": 0.0}, "speed must be positive and finite, got 0"),
        ("MountainCar", {"speed": [0.001, 0.001]}, "speed must be a number or have shape"),
        ("MountainCar", {"render_mode": "human"}, "render_mode must be None or one of"),
    ],
)
def test_bad_arguments(name: str, options: dict[str, Any], message: str) -> None:
    single, vectorised, _, _ = PARTS[name]
    with pytest.raises(ValueError, match=message):
        single(**options)
    with pytest.raises(ValueError, match=message):
        vectorised(3, **options)


@both
def test_bad_actions_and_counts(name: str) -> None:
    single, vectorised, _, _ = PARTS[name]
    env, vector = single(), vectorised(2)
    env.reset(seed=0)
    vector.reset(seed=0)
    count = int(env.action_space.n)
    for action in (count, -1, 0.5):
        with pytest.raises(ValueError, match=f"action must be an integer in 0..{count - 1}"):
            env.step(action)
    for actions in ([0], [0, count], [0.5, 0.5]):
        with pytest.raises(ValueError, match=f"actions must be 2 integers in 0..{count - 1}"):
            vector.step(np.array(actions))
    with pytest.raises(ValueError, match=r"num_envs must be a whole number from 1 .*, got 0"):
        vectorised(0)
