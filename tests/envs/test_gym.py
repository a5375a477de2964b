"""One contract for all Gymnasium environments, and Gymnasium's own where there is one."""

from __future__ import annotations

import inspect
import warnings
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

from vtlib.envs import parse_maze
from vtlib.envs.cartpole.gym import CartpoleEnv
from vtlib.envs.maze.gym import MazeEnv
from vtlib.envs.mountain_car.gym import MountainCarEnv
from vtlib.envs.rooms.gym import RoomsEnv

OPEN = parse_maze("." * 9 + "G\n" + ("." * 10 + "\n") * 9, "open")
HEADINGS = "Description, Observation Space, Action Space, Transition Dynamics, Reward, "
HEADINGS += "Starting State, Episode End, Arguments"


class Case(NamedTuple):
    """An environment, its horizon, a picture's shape, and arguments that make episodes end."""

    kind: type
    horizon: int
    picture: tuple[int, int, int]
    arguments: dict[str, Any]


CASES = {
    "Rooms": Case(RoomsEnv, 50, (400, 400, 3), {"doors": (5.0,), "uniform_start": True}),
    "Cartpole": Case(CartpoleEnv, 100, (300, 600, 3), {"cart_mass": 0.5, "half_length": 1.0}),
    "MountainCar": Case(MountainCarEnv, 200, (400, 600, 3), {"speed": 0.0015}),
    "Maze": Case(MazeEnv, 100, (400, 400, 3), {"maze": OPEN}),
}
every_env = pytest.mark.parametrize("name", CASES)


def some_skill(name: str, seen: np.ndarray, whim: float) -> np.ndarray:
    """Actions that reach a terminal state now and then, from observations (..., obs_dim)."""
    if name == "Rooms":
        return np.where(seen[..., 0] < 10 * whim, 1, 0)
    if name == "Cartpole":
        return (seen[..., 2] + seen[..., 3] > 0.4 * (whim > 0.5)).astype(np.int64)
    if name == "MountainCar":
        return np.where(seen[..., 1] < 0, 0, 2)
    return np.where(seen[..., 8] < 0.6, 1, np.where(whim < 0.1, 2, 0))


def rollout(name: str, seed: int, env: gymnasium.Env, steps: int = 400) -> list[tuple]:
    """Everything the environment returns when actions depend on what is seen and on chance."""
    seen, rng = env.reset(seed=seed)[0], np.random.default_rng(7)
    log: list[tuple] = [(seen.tolist(),)]
    for whim in rng.random(steps):
        action = int(some_skill(name, seen, whim))
        seen[...] = 99.0  # what was returned is the caller's to change
        seen, reward, terminated, truncated, _ = env.step(action)
        assert env.observation_space.contains(seen)
        log.append((seen.tolist(), reward, terminated, truncated))
        if terminated or truncated:
            seen = env.reset()[0]
            log.append((seen.tolist(),))
    return log


@every_env
def test_the_environment_passes_gymnasiums_check(name: str) -> None:
    env = gymnasium.make(f"vtlib/{name}-v0", render_mode="rgb_array").unwrapped
    assert type(env) is CASES[name].kind
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env)
    # Gymnasium's own CartPole-v1 has velocities without bounds too.
    assert [w for w in caught if name != "Cartpole" or "infinity" not in str(w.message)] == []


@every_env
def test_the_docstring_has_gymnasiums_headings(name: str) -> None:
    lines = inspect.getdoc(CASES[name].kind).splitlines()
    assert ", ".join(line[3:] for line in lines if line.startswith("## ")) == HEADINGS


@every_env
def test_equal_seeds_give_equal_rollouts_and_others_do_not(name: str) -> None:
    kind, _, _, arguments = CASES[name]
    first = rollout(name, 5, kind(**arguments, horizon=60))
    assert first == rollout(name, 5, kind(**arguments, horizon=60))
    assert first != rollout(name, 6, kind(**arguments, horizon=60))
    assert any(entry[2] for entry in first if len(entry) == 4)


@every_env
def test_a_row_of_make_vec_is_a_single_environment_of_that_seed(name: str) -> None:
    kind, most, _, arguments = CASES[name]
    horizon = min(most, 60)
    vector = gymnasium.make_vec(f"vtlib/{name}-v0", num_envs=3, horizon=horizon, **arguments)
    singles = [kind(**arguments, horizon=horizon) for _ in range(3)]
    seen = vector.reset(seed=11)[0]
    expected = [env.reset(seed=11 + row)[0] for row, env in enumerate(singles)]
    over = np.zeros(3, dtype=bool)
    terminations = truncations = 0
    for whim in np.random.default_rng(1).random(250):
        np.testing.assert_array_equal(seen, expected)
        actions = some_skill(name, seen, whim)
        seen, rewards, terminated, truncated, _ = vector.step(actions)
        for row, env in enumerate(singles):
            if over[row]:  # a row starts anew on the step after an episode's last
                expected[row], outcome = env.reset()[0], (0.0, False, False)
            else:
                expected[row], *outcome, _ = env.step(int(actions[row]))
            assert (rewards[row], terminated[row], truncated[row]) == tuple(outcome)
        over = terminated | truncated
        terminations, truncations = terminations + terminated.sum(), truncations + truncated.sum()
    assert terminations > 0
    assert truncations > 0 or name == "MountainCar"


@every_env
def test_a_rollout_is_the_dynamics_under_the_environments_own_noise(name: str) -> None:
    env = CASES[name].kind(**CASES[name].arguments)
    first = env.reset(seed=2)[0]
    rng, tasks = np.random.default_rng(env.np_random.bit_generator.seed_seq), env.tasks
    state = tasks.start(torch.from_numpy(rng.random((1, tasks.start_dim), np.float32)))
    assert np.array_equal(first, tasks.observe(state)[0])
    for action in (0, 1, 0, 1, 0, 0, 1):
        noise = torch.from_numpy(rng.standard_normal((1, tasks.noise_dim), np.float32))
        state, *outcome = tasks.step(state, torch.tensor([action]), noise)
        seen, *ours, _, _ = env.step(action)
        assert np.array_equal(seen, tasks.observe(state)[0])
        assert ours == [x.item() for x in outcome]


@pytest.mark.parametrize(
    ("name", "id", "actions"),
    [
        ("Cartpole", "CartPole-v1", [0, 1, 1, 0, 1, 0, 0, 1, 0]),
        ("MountainCar", "MountainCar-v0", [0] * 20 + [2] * 30 + [1] * 10),
    ],
)
def test_the_defaults_are_gymnasiums_own(name: str, id: str, actions: list[int]) -> None:
    ours, theirs = CASES[name].kind(), gymnasium.make(id).unwrapped
    first, _ = ours.reset(seed=3)
    theirs.reset(seed=0)
    theirs.state = tuple(first.astype(np.float64))
    for action in actions:
        np.testing.assert_allclose(ours.step(action)[0], theirs.step(action)[0], atol=1e-5)


@every_env
def test_the_horizon_truncates_and_an_ended_episode_needs_a_reset(name: str) -> None:
    kind, horizon, *_ = CASES[name]
    made = gymnasium.make(f"vtlib/{name}-v0")
    assert made.unwrapped.horizon == made.spec.max_episode_steps == horizon
    env, count = kind(horizon=4), int(kind().action_space.n)
    with pytest.raises(ResetNeeded):
        env.step(0)
    env.reset(seed=0)
    for action in (count, -1, 0.5):
        with pytest.raises(ValueError, match=f"action must be an integer in 0..{count - 1}"):
            env.step(action)
    assert [env.step(1)[2:4] for _ in range(4)] == [(False, False)] * 3 + [(False, True)]
    with pytest.raises(ResetNeeded):
        env.step(0)


@every_env
def test_pictures(name: str) -> None:
    kind, _, shape, _ = CASES[name]
    env = kind(render_mode="rgb_array")
    assert kind().render() is None
    with pytest.raises(ResetNeeded):
        env.render()
    env.reset(seed=0)
    before = env.render()
    for _ in range(5):
        env.step(0)
    assert before.shape == shape
    assert before.dtype == np.uint8
    assert not np.array_equal(before, env.render())


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("Rooms", {"doors": ((5.0, 5.0), (5.0, 5.0))}, "doors must have shape"),
        ("Cartpole", {"half_length": [1.0, 1.0]}, "half_length must be a number or have shape"),
        ("Maze", {"maze": "north 1"}, "maze must be one of .*, got 'north 1'"),
        *((name, {"horizon": 0}, "horizon must be a whole number from 1") for name in CASES),
        *((name, {"render_mode": "human"}, "render_mode must be None or") for name in CASES),
    ],
)
def test_bad_arguments(name: str, options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        CASES[name].kind(**options)
