"""Maze navigation as Gymnasium environments, single and vectorised, and its drawing."""

from __future__ import annotations

import inspect
import math
import warnings

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from vtlib.envs import Mazes, parse_maze
from vtlib.envs.draw_control import ARROW, FLAG
from vtlib.envs.draw_maze import draw_maze
from vtlib.envs.gym import MazeEnv, MazeVectorEnv, RoomsEnv

NAMES = ["north-east 1", "south-west 3", "north-west 2"]
OPEN = parse_maze("." * 9 + "G\n" + ("." * 10 + "\n") * 9, "open")


def forward_or_left(observations: np.ndarray) -> np.ndarray:
    """Ahead where there is room, to the left elsewhere."""
    return np.where(observations[..., 8] > 0.6, 0, 1)


def rollout(env: gymnasium.Env, seed: int) -> list[tuple[object, ...]]:
    """Everything the environment returns over 1000 steps."""
    observation, _ = env.reset(seed=seed)
    log: list[tuple[object, ...]] = [(observation.tolist(),)]
    for whim in np.random.default_rng(7).random(1000):
        action = 2 if whim < 0.1 else int(forward_or_left(observation))
        observation, reward, terminated, truncated, _ = env.step(action)
        log.append((observation.tolist(), reward, terminated, truncated))
        if terminated or truncated:
            observation = env.reset()[0]
            log.append((observation.tolist(),))
    return log


@pytest.mark.parametrize("options", [{}, {"maze": "south-west 5"}, {"maze": OPEN}])
def test_the_environment_passes_gymnasiums_check(options: dict[str, object]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make("vtlib/Maze-v0", render_mode="rgb_array", **options).unwrapped)


def test_it_is_registered_with_both_entry_points() -> None:
    assert isinstance(gymnasium.make("vtlib/Maze-v0").unwrapped, MazeEnv)
    vector = gymnasium.make_vec("vtlib/Maze-v0", num_envs=3, maze=NAMES)
    assert isinstance(vector, MazeVectorEnv)
    assert vector.num_envs == 3
    assert torch.equal(vector.tasks.walls, Mazes.of(NAMES).walls)
    assert vector.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert torch.equal(MazeVectorEnv(2, OPEN).tasks.walls, Mazes.of([OPEN, OPEN]).walls)


def test_the_docstring_has_the_same_headings_as_that_of_the_rooms() -> None:
    def headings(env: type) -> list[str]:
        return [line for line in inspect.getdoc(env).splitlines() if line.startswith("## ")]

    assert headings(MazeEnv) == headings(RoomsEnv)


def test_equal_seeds_give_equal_rollouts_and_others_do_not() -> None:
    first = rollout(MazeEnv(), seed=5)
    assert first == rollout(MazeEnv(), seed=5)
    assert first != rollout(MazeEnv(), seed=6)
    rewards = {entry[1:3] for entry in first if len(entry) == 4}
    assert rewards == {(0.0, False), (1.0, True)}


def test_observations_lie_in_the_stated_space() -> None:
    env = MazeEnv("north-west 4")
    for entry in rollout(env, seed=1):
        assert env.observation_space.contains(np.array(entry[0], np.float32))


def test_the_vectorised_environment_is_the_single_one_many_times() -> None:
    ours = MazeVectorEnv(3, NAMES, horizon=40)
    theirs = SyncVectorEnv([lambda name=name: MazeEnv(name, horizon=40) for name in NAMES])
    observations = ours.reset(seed=11)[0]
    assert np.array_equal(observations, theirs.reset(seed=11)[0])
    terminated = truncated = 0
    for step in range(300):
        actions = forward_or_left(observations) if step % 5 else np.full(3, 2)
        left, right = ours.step(actions), theirs.step(actions)
        for a, b in zip(left[:4], right[:4], strict=True):
            assert np.array_equal(a, b)
            assert a.dtype == b.dtype
        observations = left[0]
        terminated, truncated = terminated + left[2].sum(), truncated + left[3].sum()
    assert terminated > 0
    assert truncated > 0


def test_the_horizon_truncates_and_does_not_terminate() -> None:
    assert gymnasium.make("vtlib/Maze-v0").unwrapped.horizon == 100
    short = MazeEnv("north-west 5", horizon=4)
    short.reset(seed=0)
    assert [short.step(1)[2:4] for _ in range(4)] == [(False, False)] * 3 + [(False, True)]
    with pytest.raises(ResetNeeded):
        short.step(0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"maze": "north 1"}, "there is no maze 'north 1'"),
        ({"horizon": 0}, "horizon must be a whole number from 1 .*, got 0"),
        ({"render_mode": "human"}, "render_mode must be None or one of"),
    ],
)
def test_bad_arguments(options: dict[str, object], message: str) -> None:
    for env in (MazeEnv, lambda **options: MazeVectorEnv(3, **options)):
        with pytest.raises(ValueError, match=message):
            env(**options)


def test_bad_actions_and_counts() -> None:
    env, vector = MazeEnv(), MazeVectorEnv(2)
    env.reset(seed=0)
    vector.reset(seed=0)
    with pytest.raises(ValueError, match=r"action must be an integer in 0..2"):
        env.step(3)
    with pytest.raises(ValueError, match=r"actions must be 2 integers in 0..2"):
        vector.step(np.array([0, 3]))
    with pytest.raises(ValueError, match=r"num_envs must be a whole number from 1 .*, got 0"):
        MazeVectorEnv(0)
    with pytest.raises(ValueError, match="maze must be one, or a sequence of 3, got 2"):
        MazeVectorEnv(3, NAMES[:2])


def test_pictures() -> None:
    env = MazeEnv(render_mode="rgb_array")
    assert MazeEnv().render() is None
    with pytest.raises(ResetNeeded):
        env.render()
    env.reset(seed=0)
    before = env.render()
    env.step(1)
    assert before.shape == (400, 400, 3)
    assert before.dtype == np.uint8
    assert not np.array_equal(before, env.render())
    vector = MazeVectorEnv(2, NAMES[:2], render_mode="rgb_array")
    vector.reset(seed=0)
    assert [picture.shape for picture in vector.render()] == [(400, 400, 3)] * 2


# --- drawing ----------------------------------------------------------------------------------


def drawn(**options: object) -> Axes:
    figure = Figure(figsize=(4, 4), dpi=100)
    FigureCanvasAgg(figure)
    ax = figure.add_axes((0, 0, 1, 1))
    draw_maze(ax, Mazes.of(NAMES), 1, **options)
    figure.canvas.draw()
    return ax


def test_cells_are_drawn_where_they_are() -> None:
    picture = np.asarray(drawn().figure.canvas.buffer_rgba())[..., :3]
    # Middles of the cells, [x, y] from bottom left.
    middles = picture[20::40, 20::40][::-1].transpose(1, 0, 2).astype(int)
    maze = Mazes.of(NAMES).walls[1].numpy()
    assert (middles[maze].sum(1) < 300).all()
    free = ~maze
    free[0, 0] = False
    assert (middles[free] == 255).all()
    assert middles[0, 0].tolist() == [round(255 * part) for part in to_rgba(FLAG)[:3]]


def test_walls_have_no_seams() -> None:
    picture = np.asarray(drawn().figure.canvas.buffer_rgba())[..., :3]
    # Row 2 from above of "south-west 3" begins with three walls.
    assert (np.ptp(picture[60, 6:114].astype(int), axis=0) == 0).all()


def test_the_robot_stands_in_its_place_and_its_rays_end_where_they_read() -> None:
    state = [0.5, 2.5, -math.pi / 2]
    ax = drawn(state=state, rays=True)
    (robot,) = [patch for patch in ax.patches if isinstance(patch, Circle)]
    assert robot.center == pytest.approx((0.5, 2.5))
    seen = Mazes.of(NAMES).select([1]).observe(torch.tensor([state]))[0]
    rays = [line for line in ax.lines if line.get_color() in (ARROW, FLAG)]
    lengths = [
        np.hypot(*np.diff(ray.get_xydata(), axis=0)[0]) for ray in rays if len(ray.get_xdata()) == 2
    ]
    np.testing.assert_allclose(lengths, seen[4:13], atol=1e-5)
    colors = [ray.get_color() for ray in rays if len(ray.get_xdata()) == 2]
    assert colors == [FLAG if flag else ARROW for flag in seen[13:]]
    assert {ARROW, FLAG} == set(colors)
    dots = [ray for ray in rays if len(ray.get_xdata()) == 1]
    assert len(dots) == int((seen[4:13] < 2).sum())


def test_a_path_is_a_line_through_its_positions() -> None:
    path = np.array([[0.5, 0.5, 1.0], [0.5, 2.0, 1.5], [3.0, 2.5, 0.1]])
    (line,) = drawn(path=path).lines
    np.testing.assert_array_equal(line.get_xydata(), path[:, :2])
