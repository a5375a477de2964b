"""The Gymnasium environments: the API's own check, and one behaviour for single and vectorised."""

from __future__ import annotations

import inspect
from collections.abc import Callable

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from matplotlib.figure import Figure

import vtlib.envs
from vtlib.envs.draw import draw_rooms
from vtlib.envs.gym import RoomsEnv, RoomsVectorEnv
from vtlib.envs.rooms import Rooms

HEADINGS = (
    "Description",
    "Observation Space",
    "Action Space",
    "Transition Dynamics",
    "Reward",
    "Starting State",
    "Episode End",
    "Arguments",
    "Version History",
)


def rollout(env: gymnasium.Env, seed: int, steps: int = 120) -> list[tuple[object, ...]]:
    """Everything the environment returns under one fixed sequence of actions."""
    actions = np.random.default_rng(7).integers(4, size=steps)
    log: list[tuple[object, ...]] = [(env.reset(seed=seed)[0].tolist(),)]
    for action in actions:
        observation, reward, terminated, truncated, _ = env.step(action)
        log.append((observation.tolist(), reward, terminated, truncated))
        if terminated or truncated:
            log.append((env.reset()[0].tolist(),))
    return log


@pytest.mark.parametrize("options", [{}, {"doors": (3.0,)}, {"uniform_start": True}])
def test_the_environment_passes_gymnasiums_check(options: dict[str, object]) -> None:
    check_env(gymnasium.make("vtlib/Rooms-v0", render_mode="rgb_array", **options).unwrapped)


def test_it_is_registered_with_both_entry_points() -> None:
    assert vtlib.envs.Rooms is Rooms
    assert isinstance(gymnasium.make("vtlib/Rooms-v0").unwrapped, RoomsEnv)
    vector = gymnasium.make_vec("vtlib/Rooms-v0", num_envs=3, doors=(2.0,))
    assert isinstance(vector, RoomsVectorEnv)
    assert vector.num_envs == 3
    assert vector.tasks.doors.tolist() == [[2.0]] * 3
    assert vector.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP


def test_the_docstring_has_gymnasiums_headings() -> None:
    lines = inspect.getdoc(RoomsEnv).splitlines()
    assert [line[3:] for line in lines if line.startswith("## ")] == list(HEADINGS)


def test_equal_seeds_give_equal_rollouts_and_others_do_not() -> None:
    first = rollout(RoomsEnv(uniform_start=True), seed=5)
    assert first == rollout(RoomsEnv(uniform_start=True), seed=5)
    assert first != rollout(RoomsEnv(uniform_start=True), seed=6)


@pytest.mark.parametrize("uniform_start", [False, True])
def test_the_vectorised_environment_is_the_single_one_many_times(uniform_start: bool) -> None:
    doors = [[2.0, 7.0], [5.0, 5.0], [9.5, 0.5], [6.0, 9.0]]

    def single(row: int) -> Callable[[], RoomsEnv]:
        return lambda: RoomsEnv(doors[row], uniform_start, horizon=20)

    ours = RoomsVectorEnv(4, doors, uniform_start, horizon=20)
    theirs = SyncVectorEnv([single(row) for row in range(4)])
    assert np.array_equal(ours.reset(seed=11)[0], theirs.reset(seed=11)[0])
    rng = np.random.default_rng(0)
    ended = 0
    for _ in range(300):
        # UP and RIGHT mostly, so that goals are met as well as horizons.
        actions = rng.choice(4, size=4, p=[0.4, 0.4, 0.1, 0.1])
        left, right = ours.step(actions), theirs.step(actions)
        for a, b in zip(left[:4], right[:4], strict=True):
            assert np.array_equal(a, b)
            assert a.dtype == b.dtype
        ended += int(left[2].sum())
    assert ended > 0 or not uniform_start


def test_a_rollout_is_the_dynamics_under_the_environments_own_noise() -> None:
    env, tasks = RoomsEnv((4.0, 6.0)), Rooms.from_doors([[4.0, 6.0]])
    env.reset(seed=2)
    rng = np.random.default_rng(env.np_random.bit_generator.seed_seq)
    state = tasks.start(torch.from_numpy(rng.random((1, 2), np.float32)))
    for action in (0, 1, 0, 1, 0, 0, 3, 2, 1):
        noise = torch.from_numpy(rng.standard_normal((1, 2), np.float32))
        state, _, _ = tasks.step(state, torch.tensor([action]), noise)
        assert np.array_equal(env.step(action)[0], state[0].numpy())


def test_the_horizon_truncates_and_does_not_terminate() -> None:
    env = gymnasium.make("vtlib/Rooms-v0")
    env.reset(seed=0)
    ends = [env.step(3)[2:4] for _ in range(50)]
    assert ends == [(False, False)] * 49 + [(False, True)]


def test_the_goal_terminates_with_reward_one() -> None:
    env = RoomsEnv((9.5, 9.5), uniform_start=True)
    rng = np.random.default_rng(0)
    rewards = []
    for seed in range(40):
        env.reset(seed=seed)
        terminated = truncated = False
        while not (terminated or truncated):
            _, reward, terminated, truncated, _ = env.step(rng.choice(2))
            assert reward == float(terminated)
        rewards.append(reward)
    assert sum(rewards) > 0


def test_an_ended_episode_needs_a_reset() -> None:
    env = RoomsEnv(horizon=1)
    with pytest.raises(ResetNeeded):
        env.step(0)
    with pytest.raises(ResetNeeded):
        RoomsVectorEnv(1).step(np.array([0]))
    env.reset(seed=0)
    env.step(0)
    with pytest.raises(ResetNeeded):
        env.step(0)


def test_what_is_returned_is_the_callers_to_change() -> None:
    for env, action in ((RoomsEnv(), 0), (RoomsVectorEnv(2), np.zeros(2, dtype=np.int64))):
        env.reset(seed=0)
        env.step(action)[0][...] = 99.0
        assert env.step(action)[0].max() < 10


def test_pictures() -> None:
    env = RoomsEnv(render_mode="rgb_array")
    assert RoomsEnv().render() is None
    assert RoomsVectorEnv().render() is None
    with pytest.raises(ResetNeeded):
        env.render()
    env.reset(seed=0)
    before = env.render()
    env.step(1)
    after = env.render()
    assert before.shape == (400, 400, 3)
    assert before.dtype == np.uint8
    assert not np.array_equal(before, after)
    vector = RoomsVectorEnv(2, render_mode="rgb_array")
    with pytest.raises(ResetNeeded):
        vector.render()
    vector.reset(seed=0)
    assert [picture.shape for picture in vector.render()] == [(400, 400, 3)] * 2


def test_the_drawing_leaves_the_doors_open() -> None:
    ax = Figure().add_subplot()
    draw_rooms(ax, Rooms.from_doors([[5.0, 5.0], [2.0, 7.0]]), 1)
    walls = [line.get_xydata().tolist() for line in ax.lines if len(line.get_xdata()) == 2]
    gaps = [(left[1][0], right[0][0]) for left, right in zip(walls[::2], walls[1::2], strict=True)]
    assert gaps == [(1.5, 2.5), (6.5, 7.5)]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"doors": (0.0, 5.0)}, "doors must lie in"),
        ({"doors": ((5.0, 5.0), (5.0, 5.0))}, "doors must have shape"),
        ({"horizon": 0}, "horizon must be a whole number from 1 .*, got 0"),
        ({"render_mode": "human"}, "render_mode must be None or one of"),
    ],
)
def test_bad_arguments(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RoomsEnv(**options)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=message):
        RoomsVectorEnv(3, **options)  # type: ignore[arg-type]


def test_bad_actions_and_counts() -> None:
    env, vector = RoomsEnv(), RoomsVectorEnv(2)
    env.reset(seed=0)
    vector.reset(seed=0)
    for action in (4, -1, 0.5):
        with pytest.raises(ValueError, match=r"action must be an integer in 0..3"):
            env.step(action)
    for actions in ([0], [0, 4], [0.5, 0.5]):
        with pytest.raises(ValueError, match=r"actions must be 2 integers in 0..3"):
            vector.step(np.array(actions))
    with pytest.raises(ValueError, match=r"num_envs must be a whole number from 1 .*, got 0"):
        RoomsVectorEnv(0)
