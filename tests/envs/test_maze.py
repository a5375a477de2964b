"""The maze dynamics by their properties, and the sensors against exact geometry in plain Python."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from vtlib.envs import MazeFamily, Mazes
from vtlib.envs.episodes import Episodes
from vtlib.envs.maze import ACTIONS, TURN
from vtlib.envs.maze_geometry import BACK_OFF, CLEARANCE
from vtlib.envs.mazes import library, parse_maze
from vtlib.streams import Stream

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


@settings(max_examples=25, deadline=None)
@given(seeds, noise_scales)
def test_a_robot_goes_straight_until_just_before_a_wall(seed: int, scale: float) -> None:
    tasks, state = scene(seed, 30)
    action, noise = draw(seed, 30, scale)
    reached, _, _ = tasks.step(state, action, noise)
    for row in range(30):
        x, y, heading = state[row].double().tolist()
        length = 0.5 if ACTIONS[action[row]] == "FORWARD" else 0.0
        move = length * np.array([math.cos(heading), math.sin(heading)])
        move = (move + 0.05 * noise[row, :2].double().numpy()).clip(-0.95, 0.95)
        made = reached[row, :2].double().numpy() - [x, y]
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


@pytest.mark.parametrize(
    ("action", "expected"),
    [("FORWARD", (3.5, 3.0, 0.0)), ("LEFT", (3.0, 3.0, TURN)), ("RIGHT", (3.0, 3.0, 15 * TURN))],
)
def test_a_step_without_noise(action: str, expected: tuple[float, ...]) -> None:
    state, number = torch.tensor([[3.0, 3.0, 0.0]]), torch.tensor([ACTIONS.index(action)])
    reached, reward, terminal = Mazes.of([OPEN]).step(state, number, torch.zeros(1, 3))
    torch.testing.assert_close(reached, torch.tensor([expected]))
    assert (reward.item(), terminal.item()) == (0.0, False)


def test_a_robot_that_ran_into_a_wall_can_drive_along_it() -> None:
    state = torch.tensor([[9.2, 1.5, 0.0]])
    for action in [0] * 5 + [1] * 4 + [0] * 6:
        state, _, _ = Mazes.of([OPEN]).step(state, torch.tensor([action]), torch.zeros(1, 3))
    torch.testing.assert_close(state[0, :2], torch.tensor([9.99, 4.5]), atol=1e-3, rtol=0)


def test_the_noise_has_the_stated_deviation() -> None:
    count = 40_000
    tasks = Mazes.of([OPEN]).select([0] * count)
    noise = torch.tensor(np.random.default_rng(0).standard_normal((count, 3), np.float32))
    state = torch.tensor([[5.0, 5.0, 1.0]]).expand(count, 3)
    reached, _, _ = tasks.step(state, torch.ones(count, dtype=torch.int64), noise)
    # Four standard errors.
    expected = torch.tensor([5.0, 5.0, 1 + TURN])
    torch.testing.assert_close(reached.mean(0), expected, atol=0.001, rtol=0)
    torch.testing.assert_close(reached.std(0), torch.full((3,), 0.05), atol=0.00075, rtol=0)


@given(seeds)
@settings(max_examples=15, deadline=None)
def test_only_the_goals_cell_ends_an_episode_and_it_pays_one(seed: int) -> None:
    tasks, state = scene(seed, 60)
    rng = np.random.default_rng(seed)
    near = tasks.goal + torch.tensor(rng.uniform(-0.3, 1.3, (60, 2)))
    state[::2, :2] = near[::2].clamp(0.01, 9.99).float()
    reached, reward, terminal = tasks.step(state, *draw(seed, 60, 1.0))
    for row in range(60):
        cell = [math.floor(x) for x in reached[row, :2].tolist()]
        assert terminal[row].item() == (cell == tasks.goal[row].tolist())
    assert torch.equal(reward, terminal.float())


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


def test_the_rays_in_a_known_place() -> None:
    tasks = Mazes.of([parse_maze(".........G\n" + "..#.......\n" * 9)])
    # In the middle of the leftmost column, facing up; the first ray goes to the right.
    seen = tasks.observe(torch.tensor([[0.5, 5.3, math.pi / 2]]))[0]
    slant = math.cos(math.pi / 8), math.sin(math.pi / 8)
    expected = [1.5, 1.5 / slant[0], 2, 2, 2, 0.5 / slant[1], 0.5**0.5, 0.5 / slant[0], 0.5]
    torch.testing.assert_close(seen[4:13], torch.tensor(expected))
    assert not seen[13:].any()


@pytest.mark.parametrize("side", [-1, 1])
def test_no_ray_passes_between_walls_that_touch_at_a_corner(side: int) -> None:
    walls = torch.zeros(1, 10, 10, dtype=torch.bool)
    walls[0, 5, 4] = walls[0, 4, 4 + side] = True
    # With heading 0 the ray at 45 degrees to that side runs exactly to the corner, on a diagonal.
    along = torch.arange(-63, 64) / 128
    state = torch.stack([4.5 + along, 4.5 + side * along, torch.zeros(127)], 1)
    seen = Mazes(walls, torch.tensor([[9, 9]])).select([0] * 127).observe(state)
    torch.testing.assert_close(seen[:, 8 + 2 * side], 2**0.5 * (0.5 - along))


def test_a_wall_hides_the_goal() -> None:
    below = ("." * 10 + "\n") * 9
    mazes = [parse_maze("." * 8 + cell + "G\n" + below) for cell in ".#"]
    seen = Mazes.of(mazes).observe(torch.tensor([[7.9, 9.5, 0.0]] * 2))
    assert seen[:, 13 + 4].tolist() == [1.0, 0.0]
    assert seen[0, 4 + 4].item() == 2.0
    assert seen[1, 4 + 4].item() == pytest.approx(0.1, abs=ROUNDING)


def test_the_goal_is_seen_up_to_two_metres_and_from_within() -> None:
    tasks = Mazes.of([OPEN] * 3)
    seen = tasks.observe(torch.tensor([[6.99, 9.5, 0.0], [7.01, 9.5, 0.0], [9.5, 9.5, 4.0]]))
    assert seen[:, 17].tolist() == [0.0, 1.0, 1.0]
    assert seen[2, 13:].tolist() == [1.0] * 9


@given(seeds, st.integers(1, 3))
@settings(max_examples=20, deadline=None)
def test_turning_maze_and_robot_together_changes_nothing_it_senses(seed: int, turns: int) -> None:
    tasks, state = scene(seed, 40)
    # Anywhere in the cell, but where float32 holds the distance from 10 exactly too.
    within = torch.tensor(np.random.default_rng(seed).integers(20, 1004, (40, 2)) / 1024)
    state[:, :2] = state[:, :2].floor() + within
    state[:, 2] += 0.1
    before = tasks.observe(state)
    for _ in range(turns):
        # A quarter to the left takes (x, y) to (10 - y, x).
        walls = tasks.walls.flip(2).transpose(1, 2)
        tasks = Mazes(walls, torch.stack([9 - tasks.goal[:, 1], tasks.goal[:, 0]], 1))
        x, y, heading = state.unbind(1)
        state = torch.stack([10 - y, x, heading + math.pi / 2], 1)
    after = tasks.observe(state)
    # Headings are rounded anew, which moves the end of a ray that runs almost along a wall.
    close = (before[:, 4:13] - after[:, 4:13]).abs() < 1e-4
    assert close.float().mean() > 0.99
    assert (before[:, 13:] == after[:, 13:]).float().mean() > 0.99


# --- batches ----------------------------------------------------------------------------------


@given(seeds)
@settings(max_examples=10, deadline=None)
def test_a_row_does_not_feel_its_neighbours(seed: int) -> None:
    tasks, state = scene(seed, 37)
    action, noise = draw(seed, 37, 1.0)
    u = torch.tensor(np.random.default_rng(seed).random((37, 4), np.float32))
    together = (*tasks.step(state, action, noise), tasks.observe(state), tasks.start(u))
    for row in range(37):
        rows, one = slice(row, row + 1), tasks.select([row])
        alone = one.step(state[rows], action[rows], noise[rows])
        for batched, single in zip(
            together, (*alone, one.observe(state[rows]), one.start(u[rows])), strict=True
        ):
            assert torch.equal(batched[rows], single)


def test_a_step_changes_none_of_its_arguments() -> None:
    tasks, state = scene(0, 9)
    arguments = (state, *draw(0, 9, 1.0))
    before = [x.clone() for x in arguments]
    tasks.step(*arguments)
    tasks.observe(state).fill_(9.0)
    for old, new in zip(before, arguments, strict=True):
        assert torch.equal(old, new)


def test_types_shapes_and_constants() -> None:
    tasks, state = scene(0, 5)
    parts = (*tasks.step(state, *draw(0, 5, 1.0)), tasks.observe(state))
    kinds = [torch.float32, torch.float32, torch.bool, torch.float32]
    assert [part.dtype for part in parts] == kinds
    assert [tuple(part.shape) for part in parts] == [(5, 3), (5,), (5,), (5, 22)]
    assert all(part.is_contiguous() for part in parts)
    assert (tasks.n_actions, tasks.obs_dim, tasks.noise_dim, tasks.start_dim) == (3, 22, 3, 4)
    assert (tasks.horizon, tasks.gamma) == (100, 0.99)


def test_starts_are_uniform_over_free_cells_positions_and_headings() -> None:
    maze, count = library()["north-west 3"], 60_000
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


def test_select_takes_and_repeats_tasks() -> None:
    tasks = MazeFamily().sample(np.random.default_rng(1), 4)
    chosen = tasks.select([2, 0, 0])
    assert torch.equal(chosen.walls, tasks.walls[[2, 0, 0]])
    assert torch.equal(chosen.goal, tasks.goal[[2, 0, 0]])
    assert len(tasks.select(np.array([-1]))) == len(tasks.select(torch.tensor([1]))) == 1


def test_equal_streams_give_equal_episodes_over_different_mazes() -> None:
    def run() -> list[Tensor]:
        tasks = MazeFamily().sample(np.random.default_rng(5), 6)
        lock = Episodes(tasks, Stream("m", range(6), "n"), Stream("m", range(6), "s"))
        rng, steps = np.random.default_rng(0), []
        for _ in range(400):
            # Ahead while there is room, and sometimes a turn.
            blocked = (lock.obs[:, 8].numpy() < 0.6) | (rng.random(6) < 0.2)
            steps.append(lock.step(torch.tensor(np.where(blocked, 1, 0))))
        assert lock.returns.mean().max() > 0
        return [part for step in steps for part in (step.next_obs, step.reward, step.terminal)]

    for first, again in zip(run(), run(), strict=True):
        assert torch.equal(first, again)


def test_two_hundred_thousand_steps_a_second_are_not_far() -> None:
    count = 80
    tasks = MazeFamily().sample(np.random.default_rng(0), count)
    state = tasks.start(torch.rand(count, 4, generator=torch.Generator().manual_seed(0)))
    action, noise = draw(0, count, 1.0)
    best = math.inf
    for _ in range(20):
        began = time.perf_counter()
        for _ in range(10):
            state, _, _ = tasks.step(state, action, noise)
            tasks.observe(state)
        best = min(best, time.perf_counter() - began)
    # A tenth of what one core does, for machines that are busy with other things.
    assert 10 * count / best > 40_000


# --- families and wrong values ----------------------------------------------------------------


def test_a_family_draws_its_names_evenly_from_its_generator_alone() -> None:
    family = MazeFamily(("north-east 1", "south-west 5"))
    first = family.sample(np.random.default_rng(3), 1000)
    assert torch.equal(first.walls, family.sample(np.random.default_rng(3), 1000).walls)
    assert 400 < int((first.goal == 0).all(1).sum()) < 600
    assert MazeFamily().names == tuple(library())
    drawn = MazeFamily().sample(np.random.default_rng(0), 400)
    assert len(drawn.walls.unique(dim=0)) == 20


def test_a_family_of_one_maze_and_join() -> None:
    one = MazeFamily(("south-east 2",)).sample(np.random.default_rng(0), 3)
    assert torch.equal(one.walls, Mazes.of(["south-east 2"] * 3).walls)
    joined = MazeFamily().join([one, Mazes.of([OPEN])])
    assert len(joined) == 4
    assert not joined.walls[3].any()
    assert joined.goal[2:].tolist() == [[9, 0], [9, 9]]
    with pytest.raises(ValueError, match="at least one batch"):
        MazeFamily().join([])


@pytest.mark.parametrize(
    ("names", "message"),
    [(("north 1",), "names must be one of north-east 1, .*, got 'north 1'"), ((), "at least one")],
)
def test_bad_families(names: tuple[str, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        MazeFamily(names)


def test_a_family_draws_at_least_one_task() -> None:
    with pytest.raises(ValueError, match=r"count must be a whole number from 1 .*, got 0"):
        MazeFamily().sample(np.random.default_rng(0), 0)


FREE, CORNER = torch.zeros(2, 10, 10, dtype=torch.bool), torch.tensor([[9, 9], [0, 9]])


@pytest.mark.parametrize(
    ("walls", "goal", "message"),
    [
        (FREE.float(), CORNER, r"walls must be bool of shape \(R, 10, 10\), got torch.float32"),
        (FREE[0], CORNER, r"walls must be bool of shape .* of \(10, 10\)"),
        (FREE, CORNER[:1], r"goal must be int64 of shape \(2, 2\), got torch.int64 of \(1, 2\)"),
        (FREE, CORNER.int(), "goal must be int64 of shape"),
        (FREE, CORNER - 1, r"a goal must be a corner cell, got \(8, 8\)"),
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


@pytest.mark.parametrize("index", [[2], [-3], [0.5], [[0]], [True]])
def test_bad_index(index: list[object]) -> None:
    with pytest.raises(ValueError, match="index must"):
        Mazes(FREE, CORNER).select(index)  # type: ignore[arg-type]


def test_bad_shapes_of_a_step() -> None:
    tasks = Mazes(FREE, CORNER)
    state, action, noise = torch.ones(2, 3), torch.zeros(2, dtype=torch.int64), torch.zeros(2, 3)
    for wrong in (
        (state[:1], action, noise),
        (state, action[:1], noise),
        (state, action, noise[:, :2]),
    ):
        with pytest.raises(ValueError, match="state, action, noise must have shapes"):
            tasks.step(*wrong)
