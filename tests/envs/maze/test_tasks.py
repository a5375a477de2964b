"""The maze dynamics by their properties, and the sensors against exact geometry in plain Python."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from vtlib.envs import MazeFamily, Mazes
from vtlib.envs.maze.geometry import BACK_OFF, BORDER, CLEARANCE
from vtlib.envs.maze.library import library, parse_maze

# What float32 may add to a position of at most 10.
ROUNDING = 1e-6

seeds = st.integers(0, 2**32 - 1)
noise_scales = st.sampled_from([0.0, 1.0, 20.0])

OPEN = parse_maze("." * 9 + "G\n" + ("." * 10 + "\n") * 9)


def scene(seed: int, count: int) -> tuple[Mazes, Tensor]:
    """Random mazes of all densities, connected or not, and states; many close by a wall."""
    rng = np.random.default_rng(seed)
    walls = rng.random((count, 10, 10)) < rng.uniform(0, 0.7, (count, 1, 1))
    goal = rng.choice([0, 9], (count, 2))
    walls[(np.arange(count), *goal.T)] = False
    walls[(np.arange(count), *(9 - goal).T)] = False
    tasks = Mazes(torch.tensor(walls), torch.tensor(goal))
    u = rng.random((count, 4))
    u[::2, 1:3] = rng.choice([0.0, 1.0, 0.5, 0.01], (len(u[::2]), 2))
    u[::3, 3] = rng.integers(16, size=len(u[::3])) / 16
    return tasks, tasks.start(torch.tensor(u, dtype=torch.float32))


def draw(seed: int, count: int, scale: float) -> tuple[Tensor, Tensor]:
    rng = np.random.default_rng(seed)
    noise = scale * rng.standard_normal((count, 3), dtype=np.float32)
    return torch.tensor(rng.integers(3, size=count)), torch.tensor(noise)


def first_met(
    boxes: list[tuple[int, int]], start: tuple[float, float], along: tuple[float, float], grown=0.0
) -> float:
    """Multiple of `along` after which a line enters the first of some unit boxes: slab method."""
    nearest = math.inf
    for box in boxes:
        enter, leave = 0.0, math.inf
        for low, at, rate in zip(box, start, along, strict=True):
            rate = rate or 1e-300
            ends = sorted(((low - grown - at) / rate, (low + 1 + grown - at) / rate))
            enter, leave = max(enter, ends[0]), min(leave, ends[1])
        if enter <= leave:
            nearest = min(nearest, enter)
    return nearest


def solid(tasks: Mazes, row: int, near: Tensor) -> list[tuple[int, int]]:
    """Cells of walls, and beyond the border, that lie within two of a state's own."""
    walls, (x, y) = tasks.walls[row].tolist(), near[:2].int().tolist()
    around = [(i, j) for i in range(x - 2, x + 3) for j in range(y - 2, y + 3)]
    return [(i, j) for i, j in around if not (0 <= i < 10 and 0 <= j < 10) or walls[i][j]]


def in_walls(tasks: Mazes, points: np.ndarray) -> np.ndarray:
    """Whether points (R, N, 2) lie in walls of the maze of their row, or outside."""
    padded = np.pad(tasks.walls.numpy(), ((0, 0), (3, 3), (3, 3)), constant_values=True)
    cell = np.floor(points).astype(int) + 3
    return padded[np.arange(len(points))[:, None], cell[..., 0], cell[..., 1]]


# --- moving -----------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(seeds, noise_scales)
def test_a_robot_keeps_clear_of_walls_and_border_all_the_way(seed: int, scale: float) -> None:
    tasks, state = scene(seed, 60)
    rim = np.array([[i, j] for i in (-1, 1) for j in (-1, 1)]) * (CLEARANCE - ROUNDING)
    for turn in range(8):
        action, noise = draw(seed + turn, 60, scale)
        before, (state, _, _) = state, tasks.step(state, action, noise)
        ways = before[:, None].double() + torch.linspace(0, 1, 40)[:, None] * (
            state - before
        ).double().unsqueeze(1)
        assert not in_walls(tasks, ways[..., :2].numpy()).any()
        assert not in_walls(tasks, state[:, None, :2].double().numpy() + rim).any()
        assert bool(((state[:, 2] >= 0) & (state[:, 2] < 2 * math.pi + ROUNDING)).all())


def test_a_robot_slides_along_the_border_and_stops_at_a_wall() -> None:
    # one wall on the lower border; headings of 45 degrees down, toward it and away from it
    rows = ["." * 9 + "G"] + ["." * 10] * 8 + ["....#....."]
    tasks = Mazes.of([parse_maze("\n".join(rows))] * 3)
    state = torch.tensor([[2.0, 0.02, -math.pi / 4], [3.9, 0.02, -math.pi / 4], [6.0, 0.5, 0.0]])
    state[:, 2] %= 2 * math.pi
    after, _, _ = tasks.step(state, torch.zeros(3, dtype=torch.int64), torch.zeros(3, 3))
    along = 0.5 / math.sqrt(2)
    assert after[0, :2].tolist() == pytest.approx([2 + along, BORDER], abs=2e-4)
    assert after[1, 0] == pytest.approx(4 - CLEARANCE, abs=2e-4)  # the wall stops it
    assert after[2, :2].tolist() == pytest.approx([6.5, 0.5], abs=2e-4)


@settings(max_examples=25, deadline=None)
@given(seeds, noise_scales)
def test_a_robot_goes_straight_until_just_before_a_wall(seed: int, scale: float) -> None:
    tasks, state = scene(seed, 30)
    action, noise = draw(seed, 30, scale)
    reached, _, _ = tasks.step(state, action, noise)
    for row in range(30):
        x, y, heading = state[row].double().tolist()
        length = 0.5 if action[row] == 0 else 0.0
        move = length * np.array([math.cos(heading), math.sin(heading)])
        move = (move + 0.05 * noise[row, :2].double().numpy()).clip(-0.95, 0.95)
        at = np.array([x, y])
        move = (move + at).clip(BORDER, 10 - BORDER) - at
        made = reached[row, :2].double().numpy() - at
        # float32 decides by a hair whether a robot touches a wall, and where it stands then.
        walls, hair = solid(tasks, row, state[row]), 2 * ROUNDING
        soonest, latest = (
            first_met(walls, (x, y), tuple(move), CLEARANCE + by) for by in (hair, -hair)
        )
        low, high = (min(max(share - BACK_OFF, 0), 1) for share in (soonest, latest))
        share = made @ move / max(move @ move, 1e-12)
        slack = hair / max(np.hypot(*move), hair)
        assert low - slack <= share <= high + slack
        np.testing.assert_allclose(made, share * move, rtol=0, atol=hair)
        turned = heading + [0, math.pi / 8, -math.pi / 8][action[row]] + 0.05 * float(noise[row, 2])
        off = (float(reached[row, 2]) - turned + math.pi) % (2 * math.pi) - math.pi
        assert abs(off) < 1e-5


def test_nobody_slips_between_two_walls_that_touch_at_a_corner() -> None:
    walls = torch.zeros(1, 10, 10, dtype=torch.bool)
    walls[0, 4, 5] = walls[0, 5, 4] = True
    tasks = Mazes(walls, torch.tensor([[9, 9]])).select([0] * 2001)
    offset = torch.linspace(-2e-3, 2e-3, 2001)
    offset[1000] = 0.0
    state = torch.stack([4.8 + offset, 4.8 - offset, torch.full((2001,), math.pi / 4)], 1)
    for _ in range(3):
        forward = torch.zeros(2001, dtype=torch.int64)
        state, _, _ = tasks.step(state, forward, torch.zeros(2001, 3))
    assert (state[:, :2] < 5).all()


@pytest.mark.parametrize("corner", [(3, 3), (3, 5), (5, 3), (5, 5)])
def test_a_corner_that_is_aimed_at_exactly_stops_a_robot(corner: tuple[int, int]) -> None:
    walls = torch.zeros(1, 10, 10, dtype=torch.bool)
    walls[0, corner[0], corner[1]] = True
    toward = torch.tensor(corner) - 4
    # As long a noise as is cut to the same length along both axes; from the middle, and touching.
    noise = torch.cat([60.0 * toward, torch.zeros(1)]).expand(2, 3)
    middle = torch.tensor([4.5, 4.5]).expand(2, 2)
    state = middle + torch.tensor([[0.0], [0.5 - CLEARANCE]]) * toward
    state = torch.cat([state, torch.zeros(2, 1)], 1)
    tasks = Mazes(walls, torch.tensor([[9, 9]])).select([0, 0])
    reached, _, _ = tasks.step(state, torch.ones(2, dtype=torch.int64), noise)
    expected = (middle + (0.5 - CLEARANCE) * toward).numpy()
    np.testing.assert_allclose(reached[:, :2], expected, rtol=0, atol=3e-4)


def test_a_robot_that_ran_into_a_wall_can_drive_along_it() -> None:
    state = torch.tensor([[9.2, 1.5, 0.0]])
    for action in [0] * 5 + [1] * 4 + [0] * 6:
        state, _, _ = Mazes.of([OPEN]).step(state, torch.tensor([action]), torch.zeros(1, 3))
    torch.testing.assert_close(state[0, :2], torch.tensor([9.99, 4.5]), atol=1e-3, rtol=0)


@given(seeds)
@settings(max_examples=15, deadline=None)
def test_only_the_goals_cell_ends_an_episode_and_it_pays_one(seed: int) -> None:
    tasks, state = scene(seed, 60)
    rng = np.random.default_rng(seed)
    near = tasks.goal + torch.tensor(rng.uniform(-0.3, 1.3, (60, 2)))
    state[::2, :2] = near[::2].clamp(0.01, 9.99).float()
    reached, reward, terminated = tasks.step(state, *draw(seed, 60, 1.0))
    for row in range(60):
        cell = [math.floor(x) for x in reached[row, :2].tolist()]
        assert terminated[row].item() == (cell == tasks.goal[row].tolist())
    assert torch.equal(reward, terminated.float())


# --- sensing ----------------------------------------------------------------------------------


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_readings_are_those_of_exact_geometry(seed: int) -> None:
    tasks, state = scene(seed, 12)
    seen = tasks.observe(state)
    assert seen.dtype == torch.float32
    for row in range(12):
        x, y, heading = state[row].double().tolist()
        pose = [x, y, math.cos(heading), math.sin(heading)]
        np.testing.assert_allclose(seen[row, :4], pose, rtol=0, atol=ROUNDING)
        walls, goal = solid(tasks, row, state[row]), [tuple(tasks.goal[row].tolist())]
        for ray in range(9):
            expected = []
            # A ray that meets a corner to the last digit may see what either neighbour sees.
            for hair in (-1e-9, 0.0, 1e-9):
                angle = heading + math.radians(-90 + 22.5 * ray) + hair
                along = math.cos(angle), math.sin(angle)
                wall = min(first_met(walls, (x, y), along), 2.0)
                expected.append((wall, float(first_met(goal, (x, y), along) < wall)))
            got = seen[row, 4 + ray].item(), seen[row, 13 + ray].item()
            assert any(abs(got[0] - wall) <= ROUNDING and got[1] == flag for wall, flag in expected)


@pytest.mark.parametrize("side", [-1, 1])
def test_no_ray_passes_between_walls_that_touch_at_a_corner(side: int) -> None:
    walls = torch.zeros(1, 10, 10, dtype=torch.bool)
    walls[0, 5, 4] = walls[0, 4, 4 + side] = True
    # With heading 0 the ray at 45 degrees to that side runs exactly to the corner, on a diagonal.
    along = torch.arange(-63, 64) / 128
    state = torch.stack([4.5 + along, 4.5 + side * along, torch.zeros(127)], 1)
    seen = Mazes(walls, torch.tensor([[9, 9]])).select([0] * 127).observe(state)
    torch.testing.assert_close(seen[:, 8 + 2 * side], 2**0.5 * (0.5 - along))


# --- starts -----------------------------------------------------------------------------------


def test_starts_are_uniform_over_free_cells_positions_and_headings() -> None:
    maze, count = library()["north-west 8"], 60_000
    tasks = Mazes.of([maze]).select([0] * count)
    start = tasks.start(torch.tensor(np.random.default_rng(0).random((count, 4), np.float32)))
    cells = start[:, :2].floor().long()
    hits = np.zeros((10, 10), dtype=int)
    np.add.at(hits, tuple(cells.numpy().T), 1)
    free = ~maze.walls
    free[maze.goal] = False
    assert ((hits > 0) == free).all()
    expected = count / free.sum()
    assert np.abs(hits[free] - expected).max() < 5 * math.sqrt(expected)
    within = start[:, :2] - cells
    assert within.min() >= CLEARANCE - ROUNDING
    assert within.max() <= 1 - CLEARANCE + ROUNDING
    turn = start[:, 2:] / (2 * math.pi)
    for share in (*within.T, turn[:, 0]):
        # The deviation of a uniform number; the rim takes a little of it.
        assert abs(share.mean() - 0.5) < 0.006
        assert abs(share.std() - 1 / math.sqrt(12)) < 0.008


def test_the_largest_uniform_number_is_a_start_too() -> None:
    tasks = MazeFamily().sample(np.random.default_rng(0), 50)
    last = torch.full((50, 4), float(np.nextafter(np.float32(1), np.float32(0))))
    cells = tasks.start(last)[:, :2].floor().long()
    assert not tasks.walls[torch.arange(50), cells[:, 0], cells[:, 1]].any()


# --- families and wrong values ----------------------------------------------------------------


def test_a_family_draws_its_names_evenly() -> None:
    family = MazeFamily(("north-east 0", "south-west 14"))
    first = family.sample(np.random.default_rng(3), 1000)
    assert 400 < int((first.goal == 0).all(1).sum()) < 600
    assert MazeFamily().names == tuple(library())
    drawn = MazeFamily().sample(np.random.default_rng(0), 400)
    assert len(drawn.walls.unique(dim=0)) == 20


def test_sources_are_the_families_mazes_in_order() -> None:
    named = MazeFamily(("south-east 16", "north-west 5")).source_tasks("any", [1, 0])
    assert named.goal.tolist() == [[0, 9], [9, 0]]


@pytest.mark.parametrize(
    ("names", "message"),
    [(("north 1",), "names must be one of north-east 0, .*, got 'north 1'"), ((), "at least one")],
)
def test_bad_families(names: tuple[str, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        MazeFamily(names)


FREE, CORNER = torch.zeros(2, 10, 10, dtype=torch.bool), torch.tensor([[9, 9], [0, 9]])


@pytest.mark.parametrize(
    ("walls", "goal", "message"),
    [
        (FREE[0], CORNER, r"walls must be bool of shape .* of \(10, 10\)"),
        (FREE, CORNER[:1], r"goal must be int64 of shape \(2, 2\), got torch.int64 of \(1, 2\)"),
        (FREE, CORNER - 1, r"a goal must be a corner cell, got \[8, 8\]"),
        (~FREE, CORNER, "a goal must not be a wall"),
        (
            (~FREE).index_put((torch.arange(2), *CORNER.T), torch.tensor(False)),
            CORNER,
            "a maze must have a free cell beside the goal's",
        ),
    ],
)
def test_bad_mazes(walls: Tensor, goal: Tensor, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Mazes(walls, goal)
