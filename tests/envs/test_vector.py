"""The registered environments in Gymnasium's vector mode, and for a learner from elsewhere."""

from __future__ import annotations

import re
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import vtlib.envs  # noqa: F401  # registers them

NAMES = ("Rooms", "Cartpole", "MountainCar", "Maze")


@pytest.mark.parametrize("name", NAMES)
def test_a_list_of_seeds_gives_each_its_own_episode(name):
    seeds = [3, 1, 3, 2**31]
    together = gym.make_vec(f"vtlib/{name}-v0", num_envs=4, vectorization_mode="sync")
    seen, _ = together.reset(seed=seeds)
    alone = [gym.make(f"vtlib/{name}-v0") for _ in seeds]
    first = [env.reset(seed=seed)[0] for env, seed in zip(alone, seeds, strict=True)]
    np.testing.assert_array_equal(seen, first)
    for _ in range(5):
        seen, paid, *_ = together.step(np.ones(4, np.int64))
        outcomes = [env.step(np.int64(1)) for env in alone]
        np.testing.assert_array_equal(seen, [outcome[0] for outcome in outcomes])
        np.testing.assert_array_equal(paid, [outcome[1] for outcome in outcomes])
    np.testing.assert_array_equal(seen[0], seen[2])
    assert not np.array_equal(seen[0], seen[1])
    together.close()


def test_the_guides_lines_train_a_learner_of_stable_baselines3():
    """Skipped but in an environment that tests/requirements-sb3.txt tells how to make."""
    pytest.importorskip("stable_baselines3")
    guide = Path(__file__).resolve().parents[2] / "book" / "guide.md"
    (code,) = re.findall(r"```python\n(.*?)```", guide.read_text(), re.S)
    assert len(code.splitlines()) == 5
    names: dict = {}
    exec(compile(code, str(guide), "exec"), names)
    assert names["model"].num_timesteps >= 5000
