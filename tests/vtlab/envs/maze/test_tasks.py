"""The maze dynamics by their properties, and the sensors against exact geometry in plain Python."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from vtlab.envs import MazeFamily, Mazes
from vtlab.envs.maze.library import library

# What float32 may add to a position of at most 10.
ROUNDING = 1e-6
CLEARANCE, BORDER = 0.01, 0.01001  # m, from a wall and from the border
BACK_OFF = 2e-4  # the share of a move by which a wall ends it earlier

seeds = st.integers(0, 2**32 - 1)


def walled(count, *cells):
    """The same task many times: only some cells are walls, the goal is far away."""
    walls = torch.zeros(count, 10, 10, dtype=torch.bool)
    walls[:, *zip(*cells, strict=True)] = True
    return Mazes(walls, torch.full((count, 2), 9))


def scene(rng, count):
    """Random mazes of all densities, and states: many close by a wall, some in the goal's cell."""
    walls = rng.random((count, 10, 10)) < rng.uniform(0, 0.7, (count, 1, 1))
    goal = rng.choice([0, 9], (count, 2))
    walls[(np.arange(count), *goal.T)] = False
    walls[(np.arange(count), *(9 - goal).T)] = False
    tasks = Mazes(torch.tensor(walls), torch.tensor(goal))
    u = rng.random((count, 4))
    u[::2, 1:3] = rng.choice([0.0, 1.0, 0.5, 0.01], (len(u[::2]), 2))
    u[::3, 3] = rng.integers(16, size=len(u[::3])) / 16
    state = tasks.start(torch.tensor(u, dtype=torch.float32))
    state[::5, :2] = tasks.goal[::5] + state[::5, :2] % 1
    return tasks, state


def first_met(boxes, start, along, grown=0.0):
    """Multiple of `along` after which a line enters the first of some unit boxes: slab method."""
    rate = np.where(np.array(along) == 0, 1e-300, along)
    low, high = (np.array(boxes).reshape(-1, 2) + side for side in (-grown, 1 + grown))
    enter, leave = np.sort([(low - start) / rate, (high - start) / rate], 0)
    first = enter.max(1).clip(0)
    return float(first[first <= leave.min(1)].min(initial=math.inf))


def solid(tasks, row, near):
    """Cells of walls, and beyond the border, that lie within two of a state's own."""
    walls, (x, y) = tasks.walls[row].tolist(), np.asarray(near)[:2].astype(int)
    around = [(i, j) for i in range(x - 2, x + 3) for j in range(y - 2, y + 3)]
    return [(i, j) for i, j in around if not (0 <= i < 10 and 0 <= j < 10) or walls[i][j]]


def check_move(walls, at, move, made):
    """A robot goes straight until just before a wall, and along the border."""
    move = (move.clip(-0.95, 0.95) + at).clip(BORDER, 10 - BORDER) - at
    # float32 decides by a hair whether a robot touches a wall, and where it stands then.
    hair = 2 * ROUNDING
    soonest, latest = (first_met(walls, at, move, CLEARANCE + by) for by in (hair, -hair))
    low, high = (min(max(share - BACK_OFF, 0), 1) for share in (soonest, latest))
    share = made @ move / max(move @ move, 1e-12)
    slack = hair / max(np.hypot(*move), hair)
    assert low - slack <= share <= high + slack
    np.testing.assert_allclose(made, share * move, rtol=0, atol=hair)


@settings(max_examples=40, deadline=None)
@given(seeds, st.sampled_from([0, 1, 20]))
def test_a_step_is_that_of_exact_geometry_and_ends_in_the_goals_cell(seed, scale):
    rng = np.random.default_rng(seed)
    tasks, state = scene(rng, 30)
    goals = tasks.goal.tolist()
    for _ in range(3):
        before, action = state.double().numpy(), rng.integers(3, size=30)
        noise = scale * rng.standard_normal((30, 3), dtype=np.float32)
        state, reward, terminated = tasks.step(state, torch.tensor(action), torch.tensor(noise))
        after, heading = state.double().numpy(), before[:, 2]
        ahead = 0.5 * (action == 0) * np.stack([np.cos(heading), np.sin(heading)])
        move = ahead.T + 0.05 * noise[:, :2].astype(float)
        for row, made in enumerate(after[:, :2] - before[:, :2]):
            check_move(solid(tasks, row, before[row]), before[row, :2], move[row], made)
        turned = heading + np.array([0, math.pi / 8, -math.pi / 8])[action] + 0.05 * noise[:, 2]
        assert np.abs((after[:, 2] - turned + math.pi) % (2 * math.pi) - math.pi).max() < 1e-5
        assert np.abs(after[:, :2] - 5).max() <= 5 - CLEARANCE + ROUNDING
        assert ((after[:, 2] >= 0) & (after[:, 2] < 2 * math.pi + ROUNDING)).all()
        cells = [[math.floor(x), math.floor(y)] for x, y, _ in after.tolist()]
        assert terminated.tolist() == [c == goal for c, goal in zip(cells, goals, strict=True)]
        assert torch.equal(reward, terminated.float())


@pytest.mark.parametrize("corner", [(3, 3), (3, 5), (5, 3), (5, 5)])
def test_a_corner_that_is_aimed_at_exactly_stops_a_robot(corner):
    toward = torch.tensor([*corner, 4]) - 4
    # As long a noise as is cut to the same length along both axes; from the middle, and touching.
    middle, touching = torch.tensor([[0.0], [0.5 - CLEARANCE]]) * toward
    state = torch.tensor([4.5, 4.5, 0.0]) + torch.stack([middle, touching])
    action, noise = torch.ones(2, dtype=torch.int64), (60.0 * toward).expand(2, 3)
    reached, _, _ = walled(2, corner).step(state, action, noise)
    torch.testing.assert_close(reached[:, :2], state[[1, 1], :2], rtol=0, atol=3e-4)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_readings_are_those_of_exact_geometry(seed):
    tasks, state = scene(np.random.default_rng(seed), 12)
    seen = tasks.observe(state)
    assert seen.dtype == torch.float32
    for row in range(12):
        x, y, heading = state[row].double().tolist()
        pose = [x, y, math.cos(heading), math.sin(heading)]
        np.testing.assert_allclose(seen[row, :4], pose, rtol=0, atol=ROUNDING)
        walls, goal = solid(tasks, row, state[row]), [tuple(tasks.goal[row].tolist())]
        for ray in range(9):
            # A ray that meets a corner to the last digit may see what either neighbour sees.
            alike, got = [], seen[row, [4 + ray, 13 + ray]].tolist()
            for hair in (-1e-9, 0.0, 1e-9):
                angle = heading + math.radians(-90 + 22.5 * ray) + hair
                along = math.cos(angle), math.sin(angle)
                wall = min(first_met(walls, (x, y), along), 2.0)
                flag = first_met(goal, (x, y), along) < wall
                alike.append(abs(got[0] - wall) <= ROUNDING and got[1] == flag)
            assert any(alike)


@pytest.mark.parametrize("side", [-1, 1])
def test_no_ray_passes_between_walls_that_touch_at_a_corner(side):
    # With heading 0 the ray at 45 degrees to that side runs exactly to the corner, on a diagonal.
    along = torch.arange(-63, 64) / 128
    state = torch.stack([4.5 + along, 4.5 + side * along, torch.zeros(127)], 1)
    seen = walled(127, (5, 4), (4, 4 + side)).observe(state)
    torch.testing.assert_close(seen[:, 8 + 2 * side], 2**0.5 * (0.5 - along))


def test_starts_are_uniform_over_free_cells_positions_and_headings():
    name, count = "north-west 8", 60_000
    u = torch.rand(count, 4, generator=torch.Generator().manual_seed(0))
    u[0] = torch.tensor(1.0).nextafter(torch.tensor(0.0))  # the largest there is
    start = Mazes.of([name]).select([0] * count).start(u)
    cells = start[:, :2].floor()
    hits = np.histogram2d(*cells.numpy().T, bins=range(11))[0]
    free = ~library()[name].walls
    free[library()[name].goal] = False
    assert ((hits > 0) == free).all()
    expected = count / free.sum()
    assert np.abs(hits[free] - expected).max() < 5 * math.sqrt(expected)
    within = start[:, :2] - cells
    assert within.min() >= CLEARANCE - ROUNDING
    assert within.max() <= 1 - CLEARANCE + ROUNDING
    share = torch.cat([within, start[:, 2:] / (2 * math.pi)], 1)
    assert (share.mean(0) - 0.5).abs().max() < 0.006
    assert (share.std(0) - 1 / math.sqrt(12)).abs().max() < 0.008


def test_a_family_draws_its_mazes_evenly_and_has_them_as_sources():
    family, names = MazeFamily(), tuple(library())
    walls = family.sample(np.random.default_rng(3), 2000).walls
    mazes, counts = walls.unique(dim=0, return_counts=True)
    assert (counts - 100).abs().max() < 50
    assert torch.equal(mazes, Mazes.of(names).walls.unique(dim=0))
    assert torch.equal(family.source_tasks("any", [1, 0]).walls, Mazes.of(names[1::-1]).walls)
