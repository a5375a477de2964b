"""The rooms dynamics by their properties, against plain geometry in float64."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from vtlib.envs.rooms import ACTIONS, Rooms, RoomsFamily, even_walls

MOVES = {"UP": (0, 1), "RIGHT": (1, 0), "DOWN": (0, -1), "LEFT": (-1, 0)}
# What float32 may add to a position of at most 10.
ROUNDING = 1e-5

seeds = st.integers(0, 2**32 - 1)
rooms = st.sampled_from([2, 3])
noise_scales = st.sampled_from([0.0, 1.0, 20.0])


def scene(seed: int, rooms: int, count: int) -> tuple[Rooms, Tensor]:
    """Tasks and states, a third of the states close to a door post or exactly on a wall."""
    rng = np.random.default_rng(seed)
    tasks = RoomsFamily(rooms).sample(rng, count)
    state = torch.tensor(rng.uniform(0, 10, (count, 2)), dtype=torch.float32)
    near = torch.arange(0, count, 3)
    wall = rng.integers(rooms - 1, size=len(near))
    post = tasks.doors[near, wall] + torch.tensor(rng.choice([-0.5, 0.5], len(near))).float()
    state[near, 0] = (post + 0.1 * torch.tensor(rng.normal(size=len(near))).float()).clamp(0, 10)
    above = torch.tensor(rng.choice([-1e-6, 0.0, 1e-6, -0.3, 0.3], len(near))).float()
    state[near, 1] = tasks.walls[wall] + above
    return tasks, state


def draw(seed: int, count: int, scale: float) -> tuple[Tensor, Tensor]:
    rng = np.random.default_rng(seed)
    noise = scale * rng.standard_normal((count, 2), dtype=np.float32)
    return torch.tensor(rng.integers(4, size=count)), torch.tensor(noise)


def crossings(start: np.ndarray, end: np.ndarray, walls: np.ndarray) -> list[tuple[int, float]]:
    """Walls strictly between two points, and where the segment meets them."""
    found = []
    for wall, height in enumerate(walls):
        if (start[1] - height) * (end[1] - height) < 0:
            share = (height - start[1]) / (end[1] - start[1])
            found.append((wall, start[0] + share * (end[0] - start[0])))
    return found


def outside_door(tasks: Rooms, row: int, wall: int, x: float) -> float:
    """How far x lies outside the door, negative inside."""
    return abs(x - float(tasks.doors[row, wall])) - 0.5


@settings(max_examples=40)
@given(seeds, rooms, noise_scales)
def test_never_outside_and_never_through_a_wall(seed: int, rooms: int, scale: float) -> None:
    tasks, state = scene(seed, rooms, 60)
    walls = tasks.walls.double().numpy()
    for turn in range(5):
        action, noise = draw(seed + turn, 60, scale)
        reached, _, _ = tasks.step(state, action, noise)
        assert bool(((reached >= 0) & (reached <= 10)).all())
        for row in range(60):
            for wall, x in crossings(state[row].double().numpy(), reached[row].numpy(), walls):
                assert outside_door(tasks, row, wall, x) <= ROUNDING
        state = reached


@settings(max_examples=40)
@given(seeds, rooms, noise_scales)
def test_an_agent_stays_only_where_a_wall_is_in_its_way(
    seed: int, rooms: int, scale: float
) -> None:
    tasks, state = scene(seed, rooms, 60)
    action, noise = draw(seed, 60, scale)
    reached, _, _ = tasks.step(state, action, noise)
    start, walls = state.double().numpy(), tasks.walls.double().numpy()
    for row in range(60):
        move = np.array(MOVES[ACTIONS[action[row]]]) + 0.2 * noise[row].double().numpy()
        proposed = (start[row] + move).clip(0, 10)
        if np.abs(reached[row].numpy() - proposed).max() <= ROUNDING:
            continue
        assert torch.equal(reached[row], state[row])
        if np.abs(start[row, 1] - walls).min() > ROUNDING:
            met = crossings(start[row], proposed, walls)
            # Along a wall rounding moves the meeting point by more than it moves the agent.
            slack = ROUNDING * (1 + 20 / max(abs(proposed[1] - start[row, 1]), ROUNDING))
            assert any(outside_door(tasks, row, wall, x) > -slack for wall, x in met)


@pytest.mark.parametrize("toward", [0, 2])
def test_nobody_tunnels_by_stopping_on_the_wall_line(toward: int) -> None:
    tasks = Rooms.from_doors([[9.0, 9.0]])
    wall = tasks.walls[0].item()
    up = 1.0 if toward == 0 else -1.0
    for offset in np.linspace(-3e-6, 3e-6, 61):
        # Noise that lands the agent on the line to within rounding, then a full step onwards.
        state = torch.tensor([[2.0, wall - up * 1.0]])
        landing = torch.tensor([[0.0, float(offset) / 0.2]])
        beside, _, _ = tasks.step(state, torch.tensor([toward]), landing)
        beyond, _, _ = tasks.step(beside, torch.tensor([toward]), torch.zeros(1, 2))
        assert up * (beyond[0, 1].item() - wall) <= 0


@pytest.mark.parametrize(
    ("state", "action", "expected"),
    [
        ((2.0, 3.0), "UP", (2.0, 4.0)),
        ((2.0, 4.0), "DOWN", (2.0, 3.0)),
        ((2.6, 3.0), "UP", (2.6, 3.0)),
        ((2.6, 6.0), "UP", (2.6, 6.0)),
        ((7.0, 6.0), "UP", (7.0, 7.0)),
        ((0.4, 1.0), "LEFT", (0.0, 1.0)),
        ((9.5, 1.0), "RIGHT", (10.0, 1.0)),
        ((5.0, 9.5), "UP", (5.0, 10.0)),
        ((5.0, 0.0), "DOWN", (5.0, 0.0)),
    ],
)
def test_a_step_without_noise(
    state: tuple[float, float], action: str, expected: tuple[float, float]
) -> None:
    tasks = Rooms.from_doors([[2.0, 7.0]])
    reached, reward, terminal = tasks.step(
        torch.tensor([state]), torch.tensor([ACTIONS.index(action)]), torch.zeros(1, 2)
    )
    torch.testing.assert_close(reached, torch.tensor([expected]))
    assert (reward.item(), terminal.item()) == (0.0, False)


def test_the_noise_has_the_stated_deviation() -> None:
    tasks = Rooms.from_doors([[5.0, 5.0]]).select([0] * 40_000)
    noise = torch.tensor(np.random.default_rng(0).standard_normal((40_000, 2), np.float32))
    state = torch.full((40_000, 2), 1.5)
    reached, _, _ = tasks.step(state, torch.ones(40_000, dtype=torch.int64), noise)
    # Four standard errors.
    torch.testing.assert_close(reached.mean(0), torch.tensor([2.5, 1.5]), atol=0.004, rtol=0)
    torch.testing.assert_close(reached.std(0), torch.tensor([0.2, 0.2]), atol=0.003, rtol=0)


@given(seeds)
@settings(max_examples=30)
def test_the_goal_ends_the_episode_with_reward_one_and_nothing_else_does(seed: int) -> None:
    tasks, state = scene(seed, 3, 60)
    state[::2] = 8 + 0.2 * state[::2]
    reached, reward, terminal = tasks.step(state, *draw(seed, 60, 1.0))
    distance = (10 - reached.double()).norm(dim=1)
    clear = (distance - 1).abs() > ROUNDING
    assert torch.equal(terminal[clear], (distance <= 1)[clear])
    assert torch.equal(reward, terminal.float())


def test_the_rim_of_the_goal_belongs_to_it() -> None:
    tasks = Rooms.from_doors([[5.0, 5.0]])
    _, reward, terminal = tasks.step(
        torch.tensor([[8.0, 10.0]]), torch.tensor([1]), torch.zeros(1, 2)
    )
    assert (reward.item(), terminal.item()) == (1.0, True)


@given(seeds, rooms)
@settings(max_examples=30)
def test_a_row_does_not_feel_its_neighbours(seed: int, rooms: int) -> None:
    tasks, state = scene(seed, rooms, 37)
    action, noise = draw(seed, 37, 1.0)
    together = tasks.step(state, action, noise)
    for row in range(37):
        alone = tasks.select([row]).step(
            state[row : row + 1], action[row : row + 1], noise[row : row + 1]
        )
        for batched, single in zip(together, alone, strict=True):
            assert torch.equal(batched[row : row + 1], single)


def test_a_step_changes_none_of_its_arguments() -> None:
    tasks, state = scene(0, 3, 9)
    action, noise = draw(0, 9, 1.0)
    before = [x.clone() for x in (state, action, noise, tasks.doors)]
    tasks.step(state, action, noise)
    for old, new in zip(before, (state, action, noise, tasks.doors), strict=True):
        assert torch.equal(old, new)


def test_starts_and_observations() -> None:
    tasks = Rooms.from_doors([[2.0, 7.0], [3.0, 4.0]])
    u = torch.tensor([[0.0, 0.25], [0.5, 0.99]])
    assert torch.equal(tasks.start(u), torch.zeros(2, 2))
    assert torch.equal(replace(tasks, uniform_start=True).start(u), 10 * u)
    assert torch.equal(tasks.observe(u), u)


def test_rooms_are_counted_from_the_bottom() -> None:
    tasks = Rooms.from_doors([[2.0, 7.0]])
    wall = tasks.walls[0]
    heights = torch.stack([torch.tensor(0.0), wall.nextafter(torch.tensor(0.0)), wall])
    heights = torch.cat([heights, torch.tensor([7.0, 10.0])])
    states = torch.stack([torch.ones(5), heights], 1)
    assert tasks.room(states).tolist() == [0, 0, 1, 2, 2]


def test_select_takes_and_repeats_tasks() -> None:
    tasks = Rooms.from_doors([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], uniform_start=True)
    chosen = tasks.select([2, 0, 0])
    assert chosen.doors.tolist() == [[5.0, 6.0], [1.0, 2.0], [1.0, 2.0]]
    assert len(chosen) == 3
    assert chosen.uniform_start
    assert torch.equal(tasks.select(np.array([1])).doors, tasks.select(torch.tensor([1])).doors)


def test_walls_cut_the_square_evenly() -> None:
    torch.testing.assert_close(even_walls(2), torch.tensor([10 / 3, 20 / 3]))
    torch.testing.assert_close(even_walls(1), torch.tensor([5.0]))


def test_a_family_draws_uniform_doors_from_its_generator_alone() -> None:
    first = RoomsFamily().sample(np.random.default_rng(3), 4000)
    again = RoomsFamily().sample(np.random.default_rng(3), 4000)
    assert torch.equal(first.doors, again.doors)
    assert first.doors.shape == (4000, 2)
    torch.testing.assert_close(first.doors.mean(0), torch.full((2,), 5.0), atol=0.17, rtol=0)
    # The deviation of a uniform number on an interval of length 9.
    torch.testing.assert_close(first.doors.std(0), torch.full((2,), 2.6), atol=0.1, rtol=0)
    assert abs(np.corrcoef(first.doors.numpy().T)[0, 1]) < 0.07


def test_the_other_families() -> None:
    fixed = RoomsFamily(fixed_lower=5.0).sample(np.random.default_rng(0), 50).doors
    free = RoomsFamily().sample(np.random.default_rng(0), 50).doors
    assert fixed[:, 0].tolist() == [5.0] * 50
    assert torch.equal(fixed[:, 1], free[:, 1])
    bell = RoomsFamily(2, normal=(5.0, 1.8)).sample(np.random.default_rng(0), 4000).doors
    assert bell.shape == (4000, 1)
    assert abs(bell.mean().item() - 5) < 0.12
    assert abs(bell.std().item() - 1.8) < 0.1
    assert bell.min() >= 0.5
    assert bell.max() <= 9.5


@pytest.mark.parametrize(
    ("doors", "message"),
    [
        ([[0.4, 5.0]], r"doors must lie in \[0.5, 9.5\], got 0.4"),
        ([[5.0, 9.6]], r"doors must lie in \[0.5, 9.5\], got 9.6"),
        ([[5.0, float("nan")]], r"doors must lie in \[0.5, 9.5\], got nan"),
        (5.0, r"doors must have shape \(R, W\) or \(W,\), got \(\)"),
        (np.full((2, 0), 5.0), r"doors must have shape"),
    ],
)
def test_bad_doors(doors: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Rooms.from_doors(doors)  # type: ignore[arg-type]


@pytest.mark.parametrize("walls", [[5.0, 4.0], [0.0, 5.0], [5.0, 10.0], [5.0, float("nan")], []])
def test_bad_walls(walls: list[float]) -> None:
    with pytest.raises(ValueError, match="walls must be a vector of increasing heights"):
        Rooms(torch.full((1, len(walls)), 5.0), torch.tensor(walls))


def test_one_door_per_wall() -> None:
    with pytest.raises(ValueError, match=r"doors must have shape \(R, 1\), one per wall"):
        Rooms(torch.full((1, 2), 5.0), even_walls(1))


@pytest.mark.parametrize("index", [[2], [-3], [0.5], [[0]], [True]])
def test_bad_index(index: list[object]) -> None:
    with pytest.raises(ValueError, match="index must"):
        Rooms.from_doors([[2.0], [3.0]]).select(index)  # type: ignore[arg-type]


def test_bad_shapes_of_a_step() -> None:
    tasks = Rooms.from_doors([[2.0], [3.0]])
    state, action, noise = torch.zeros(2, 2), torch.zeros(2, dtype=torch.int64), torch.zeros(2, 2)
    for wrong in (
        (state[:1], action, noise),
        (state, action[:1], noise),
        (state, action, noise.T[:1]),
    ):
        with pytest.raises(ValueError, match="state, action, noise must have shapes"):
            tasks.step(*wrong)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rooms": 4}, "rooms must be a whole number from 2 to 3, got 4"),
        ({"fixed_lower": 0.0}, "fixed_lower must lie in"),
        ({"fixed_lower": float("nan")}, "fixed_lower must lie in"),
        ({"normal": (5.0, 0.0)}, "deviation in normal must be positive"),
        ({"normal": (float("nan"), 1.0)}, "mean in normal must lie in"),
    ],
)
def test_bad_families(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RoomsFamily(**arguments)  # type: ignore[arg-type]


def test_a_family_draws_at_least_one_task() -> None:
    with pytest.raises(ValueError, match=r"count must be a whole number from 1 .*, got 0"):
        RoomsFamily().sample(np.random.default_rng(0), 0)


def test_join_appends_batches_in_order() -> None:
    parts = [Rooms.from_doors(doors, True) for doors in ([[1.0, 2.0]], [[3.0, 4.0], [5.0, 6.0]])]
    joined = RoomsFamily().join(parts)
    assert joined.doors.tolist() == [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]
    assert torch.equal(joined.walls, parts[0].walls)
    assert joined.uniform_start


def test_join_refuses_tasks_of_different_kinds() -> None:
    three, two = Rooms.from_doors([[1.0, 2.0]]), Rooms.from_doors([[1.0]])
    with pytest.raises(ValueError, match="at least one batch"):
        RoomsFamily().join([])
    with pytest.raises(ValueError, match="must have the same walls, got"):
        RoomsFamily().join([three, two])
    with pytest.raises(ValueError, match="must start alike"):
        RoomsFamily().join([three, replace(three, uniform_start=True)])
