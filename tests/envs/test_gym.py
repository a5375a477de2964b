"""One contract for all Gymnasium environments, and Gymnasium's own where there is one."""

import inspect
import re
import warnings
from pathlib import Path
from typing import Any

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

HEADINGS = """Description, Observation Space, Action Space, Transition Dynamics, Reward,
    Starting State, Episode End, Arguments"""
OPEN = parse_maze("." * 9 + "G" + ("\n" + "." * 10) * 9)
# An environment, its horizon, a picture's shape, and arguments that make episodes end.
CASES: dict[str, tuple[type, int, tuple, dict[str, Any]]] = {
    "Rooms": (RoomsEnv, 50, (400, 400, 3), {"doors": (5.0,), "uniform_start": True}),
    "Cartpole": (CartpoleEnv, 100, (300, 600, 3), {"cart_mass": 0.5, "half_length": 1.0}),
    "MountainCar": (MountainCarEnv, 200, (400, 600, 3), {"speed": 0.0015}),
    "Maze": (MazeEnv, 100, (400, 400, 3), {"maze": OPEN}),
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


@every_env
def test_it_is_registered_documented_and_passes_gymnasiums_check(name):
    kind, horizon, *_ = CASES[name]
    made = gymnasium.make(f"vtlib/{name}-v0", render_mode="rgb_array")
    assert type(made.unwrapped) is kind
    assert made.unwrapped.horizon == made.spec.max_episode_steps == horizon
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(made.unwrapped)
    # Gymnasium's own CartPole-v1 has velocities without bounds too.
    assert [w for w in caught if name != "Cartpole" or "infinity" not in str(w.message)] == []
    headings = re.findall(r"^## (.*)$", inspect.getdoc(kind), re.MULTILINE)
    assert headings == re.split(r",\s+", HEADINGS)


@every_env
def test_a_row_of_make_vec_is_a_single_environment_of_that_seed(name):
    kind, most, _, arguments = CASES[name]
    arguments = {**arguments, "horizon": min(most, 60)}
    vector = gymnasium.make_vec(f"vtlib/{name}-v0", num_envs=3, **arguments)
    singles = [kind(**arguments) for _ in range(3)]
    seen = vector.reset(seed=11)[0]
    expected = [env.reset(seed=11 + row)[0] for row, env in enumerate(singles)]
    assert not np.array_equal(seen[0], seen[1])
    over, ends = np.zeros(3, dtype=bool), np.zeros(2, dtype=int)
    for whim in np.random.default_rng(1).random(250):
        np.testing.assert_array_equal(seen, expected)
        assert vector.observation_space.contains(seen)
        actions = some_skill(name, seen, whim)
        seen, rewards, terminated, truncated, _ = vector.step(actions)
        for row, env in enumerate(singles):
            if over[row]:  # a row starts anew on the step after an episode's last
                expected[row], outcome = env.reset()[0], (0.0, False, False)
            else:
                expected[row][...] = 99.0  # what was returned is the caller's to change
                expected[row], *outcome, _ = env.step(int(actions[row]))
            assert (rewards[row], terminated[row], truncated[row]) == tuple(outcome)
        over = terminated | truncated
        ends += terminated.sum(), truncated.sum()
    assert ends[0] > 0
    assert ends[1] > 0 or name == "MountainCar"


@every_env
def test_a_rollout_is_the_dynamics_under_the_environments_own_noise(name):
    env = CASES[name][0](**CASES[name][3])
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


def test_the_defaults_are_gymnasiums_own():
    pole, car = (gymnasium.make(x).unwrapped for x in ("CartPole-v1", "MountainCar-v0"))
    own, ours = (pole.masscart, pole.masspole, pole.length), CartpoleEnv().tasks
    assert [ours.cart_mass, ours.pole_mass, ours.half_length] == pytest.approx(own)
    assert MountainCarEnv().tasks.speed == pytest.approx(car.force)


@every_env
def test_an_episode_is_truncated_drawn_and_then_needs_a_reset(name):
    kind, _, shape, _ = CASES[name]
    env, count = kind(horizon=4, render_mode="rgb_array"), int(kind().action_space.n)
    assert kind().render() is None
    for call in (env.render, lambda: env.step(0)):
        with pytest.raises(ResetNeeded):
            call()
    env.reset(seed=0)
    before = env.render()
    for action in (count, -1, 0.5):
        with pytest.raises(ValueError, match=f"action must be an integer in 0..{count - 1}"):
            env.step(action)
    assert [env.step(1)[2:4] for _ in range(4)] == [(False, False)] * 3 + [(False, True)]
    assert (before.shape, before.dtype) == (shape, np.uint8)
    assert not np.array_equal(before, env.render())
    with pytest.raises(ResetNeeded):
        env.step(0)
    env.reset()
    assert not env.step(1)[3]


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
def test_bad_arguments(name, options, message):
    with pytest.raises(ValueError, match=message):
        CASES[name][0](**options)


def test_the_guides_lines_train_a_learner_of_stable_baselines3():
    """Skipped but in an environment that tests/requirements-sb3.txt tells how to make."""
    pytest.importorskip("stable_baselines3")
    guide = Path(__file__).resolve().parents[2] / "book" / "guide.md"
    (code,) = re.findall(r"```python\n(.*?)```", guide.read_text(), re.S)
    assert len(code.splitlines()) == 5
    names: dict = {}
    exec(compile(code, str(guide), "exec"), names)
    assert names["model"].num_timesteps >= 5000
