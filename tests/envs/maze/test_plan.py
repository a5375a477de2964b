"""Planned values of mazes against what can be known without a plan, and against other policies."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from vtlib.envs import MazeFamily, Mazes, maze
from vtlib.envs.maze import plan as planner
from vtlib.envs.maze.library import parse_maze
from vtlib.envs.maze.plan import plan_maze
from vtlib.envs.planning import GridPlan

OPEN = parse_maze("." * 9 + "G\n" + ("." * 10 + "\n") * 9)
MAZES = Mazes.of([OPEN, "south-west 12", "north-east 4"])
EPISODES = 300


@pytest.fixture(scope="module")
def plans() -> list[GridPlan]:
    return [plan_maze(MAZES, index) for index in range(3)]


def steps_at_least(start: Tensor, goal: Tensor) -> Tensor:
    """Steps (B,) of 0.5 m that a goal's cell is away from states in the open, as the crow flies."""
    nearest = torch.maximum(torch.minimum(start[:, :2], goal + 1.0), goal.float())
    return ((start[:, :2] - nearest).norm(dim=1) / 0.5).ceil()


def follow(index: int, plan: GridPlan) -> tuple[Tensor, Tensor]:
    """Starts (300, 3) and discounted returns (300,) of a plan's policy without noise."""
    tasks = MAZES.select([index] * EPISODES)
    start = state = tasks.start(torch.rand(EPISODES, 4, generator=torch.Generator().manual_seed(0)))
    alive, total = torch.ones(EPISODES), torch.zeros(EPISODES)
    for t in range(100):
        state, reward, terminated = tasks.step(state, plan.greedy(state), torch.zeros(EPISODES, 3))
        total += 0.99**t * reward * alive
        alive = alive * ~terminated
    return start, total


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plans that take a sixth of the time and earn some hundredths less."""
    for name, value in {"PER_CELL": 3, "HEADINGS": 16, "EPISODES": 400}.items():
        monkeypatch.setattr(planner, name, value)


def test_a_goal_straight_ahead_is_worth_its_steps(plans: list[GridPlan]) -> None:
    x = 8.75 - 0.5 * torch.arange(8)
    states = torch.stack([x, torch.full((8,), 9.5), torch.zeros(8)], 1)
    q = plans[0].q(states)
    assert (q.argmax(1) == 0).all()
    torch.testing.assert_close(q[:, 0], 0.99 ** torch.arange(8.0), atol=0.01, rtol=0)
    assert q[0].tolist() == pytest.approx([1.0, 0.99, 0.99], abs=0.003)


@pytest.mark.parametrize("index", [0, 1, 2])
def test_planned_values_are_what_the_policy_earns_without_noise(plans, index: int) -> None:
    start, earned = follow(index, plans[index])
    expected = plans[index].q(start).amax(1)
    # A step too many is worth 0.01; far away 100 steps may just not do, or just do.
    assert (earned - expected).abs().median() < 0.015
    assert abs(float((earned - expected).mean())) < 0.03


def test_no_value_comes_through_a_wall(plans: list[GridPlan]) -> None:
    # Either side of the first wall below the goal of "north-east 4".
    above, below = plans[2].q(torch.tensor([[8.5, 9.1, 0.0], [8.5, 5.9, 0.0]])).amax(1)
    assert above > 0.98
    assert below < 0.7


def test_the_optimum_is_near_its_bound_in_the_open() -> None:
    optimum = MazeFamily().optimum(MAZES.select([0])).item()
    count = 20_000
    tasks = MAZES.select([0] * 1000)
    start = torch.cat(
        [
            tasks.start(torch.rand(1000, 4, generator=torch.Generator().manual_seed(seed)))
            for seed in range(count // 1000)
        ]
    )
    straight = start[:, :2] - (MAZES.goal[0] + 0.5)
    angle = torch.atan2(-straight[:, 1], -straight[:, 0])
    off = ((start[:, 2] - angle + math.pi) % (2 * math.pi) - math.pi).abs()
    # Ahead as the crow flies, after the turns that the heading is off by, less one: on its way a
    # robot need not head for the goal's middle.
    turns = (off / (math.pi / 8) - 1).clamp(min=0)
    bound = 0.99 ** (steps_at_least(start, MAZES.goal[0]) + turns - 1)
    assert 0.97 * bound.mean() < optimum < bound.mean()


@pytest.mark.usefixtures("coarse")
def test_the_optimum_of_a_maze_is_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    planned = []

    def counted(mazes: Mazes, index: int) -> GridPlan:
        planned.append(index)
        return plan_maze(mazes, index)

    monkeypatch.setattr(maze, "plan_maze", counted)
    optimum = MazeFamily().optimum(MAZES.select([2, 0, 2, 2]))
    assert sorted(planned) == [0, 1]
    assert optimum[0] == optimum[2] == optimum[3]
    assert optimum[1] > optimum[0]
    assert torch.equal(MazeFamily().optimum(MAZES.select([2])), optimum[:1])
