"""One contract for all Gymnasium environments, and Gymnasium's own where there is one."""

import re
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env

from vtlab.envs.gym import CartpoleEnv, MazeEnv, MountainCarEnv, RoomsEnv

# An environment, its horizon, and arguments of its own.
CASES = {
    "Rooms": (RoomsEnv, 50, {"doors": (5.0,), "uniform_start": True}),
    "Cartpole": (CartpoleEnv, 100, {"cart_mass": 0.5, "half_length": 1.0}),
    "MountainCar": (MountainCarEnv, 200, {"speed": 0.0015}),
    "Maze": (MazeEnv, 100, {"maze": "south-west 12"}),
}
every_env = pytest.mark.parametrize("name", CASES)


@every_env
def test_it_is_registered_and_passes_gymnasiums_check(name):
    kind, horizon, _ = CASES[name]
    made = gymnasium.make(f"vtlab/{name}-v0")
    assert type(made.unwrapped) is kind
    assert made.unwrapped.tasks.horizon == made.spec.max_episode_steps == horizon
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(made.unwrapped)
    # Gymnasium's own CartPole-v1 has velocities without bounds too.
    assert [w for w in caught if name != "Cartpole" or "infinity" not in str(w.message)] == []


@every_env
def test_a_rollout_is_the_dynamics_under_the_environments_own_noise(name):
    env = CASES[name][0](**CASES[name][2])
    seen = env.reset(seed=2)[0]
    rng, tasks = np.random.default_rng(env.np_random.bit_generator.seed_seq), env.tasks
    state = tasks.start(torch.from_numpy(rng.random((1, tasks.start_dim), np.float32)))
    assert np.array_equal(seen, tasks.observe(state)[0])
    for action in (0, 1, 0, 0, *[1] * 20):
        seen[...] = 99.0  # what was returned is the caller's to change
        noise = torch.from_numpy(rng.standard_normal((1, tasks.noise_dim), np.float32))
        state, *outcome = tasks.step(state, torch.tensor([action]), noise)
        seen, *ours, _, _ = env.step(action)
        assert np.array_equal(seen, tasks.observe(state)[0])
        assert ours == [x.item() for x in outcome]
        if ours[1]:
            break
    assert ours[1] or name != "Cartpole"


def test_the_defaults_are_gymnasiums_own():
    pole, car = (gymnasium.make(x).unwrapped for x in ("CartPole-v1", "MountainCar-v0"))
    expected, tasks = (pole.masscart, pole.masspole, pole.length), CartpoleEnv().tasks
    assert [tasks.cart_mass, tasks.pole_mass, tasks.half_length] == pytest.approx(expected)
    assert MountainCarEnv().tasks.speed == pytest.approx(car.force)


@every_env
def test_other_actions_are_refused(name):
    env = CASES[name][0]()
    env.reset(seed=0)
    for action in (env.action_space.n, -1, 0.5):
        with pytest.raises(ValueError, match=f"integer in 0..{env.action_space.n - 1}, got"):
            env.step(action)


def test_the_guides_lines_train_a_learner_of_stable_baselines3():
    """Skipped but in an environment that tests/requirements-sb3.txt tells how to make."""
    pytest.importorskip("stable_baselines3")
    guide = Path(__file__).resolve().parents[3] / "book" / "guide.md"
    (code,) = re.findall(r"```python\n(.*?)```", guide.read_text(), re.S)
    assert len(code.splitlines()) == 5
    names = {}
    exec(compile(code, str(guide), "exec"), names)
    assert names["model"].num_timesteps >= 5000
