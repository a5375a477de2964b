"""The rooms dynamics by their properties, against plain geometry in float64."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from attrs import evolve
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from vtlib.envs import Rooms, RoomsFamily
from vtlib.envs.rooms.tasks import even_walls

MOVES = np.array([[0, 1], [1, 0], [0, -1], [-1, 0]])  # up, right, down, left
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


@settings(max_examples=40, deadline=None)
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


@settings(max_examples=40, deadline=None)
@given(seeds, rooms, noise_scales)
def test_an_agent_stays_only_where_a_wall_is_in_its_way(
    seed: int, rooms: int, scale: float
) -> None:
    tasks, state = scene(seed, rooms, 60)
    action, noise = draw(seed, 60, scale)
    reached, _, _ = tasks.step(state, action, noise)
    start, walls = state.double().numpy(), tasks.walls.double().numpy()
    for row in range(60):
        move = MOVES[action[row]] + 0.2 * noise[row].double().numpy()
        proposed = (start[row] + move).clip(0, 10)
        if np.abs(reached[row].numpy() - proposed).max() <= ROUNDING:
            continue
        assert torch.equal(reached[row], state[row])
        if np.abs(start[row, 1] - walls).min() > ROUNDING:
            met = crossings(start[row], proposed, walls)
            # Along a wall rounding moves the meeting point by more than it moves the agent.
            slack = ROUNDING * (1 + 20 / max(abs(proposed[1] - start[row, 1]), ROUNDING))
            assert any(outside_door(tasks, row, wall, x) > -slack for wall, x in met)


@settings(max_examples=40, deadline=None)
@given(seeds, rooms, noise_scales)
def test_a_frontier_that_stops_leaves_the_position_unchanged(
    seed: int, rooms: int, scale: float
) -> None:
    tasks, state = scene(seed, rooms, 90)
    state[::3] = torch.where(state[::3] < 5, 0.3, 9.7)  # a third of a step from both sides
    action, noise = draw(seed, 90, scale)
    reached, reward, _ = evolve(tasks, stops=True).step(state, action, noise)
    slid, _, _ = tasks.step(state, action, noise)
    aimed = state.double().numpy() + MOVES[action] + 0.2 * noise.double().numpy()
    for row in range(90):
        beyond = any(x < 0 or x > 10 for x in aimed[row])
        if np.abs(np.abs(aimed[row] - 5) - 5).min() > ROUNDING:
            assert torch.equal(reached[row], state[row] if beyond else slid[row])
    at_goal = (10 - reached.double()).norm(dim=1)
    clear = (at_goal - 1).abs() > ROUNDING
    assert torch.equal(reward[clear], (at_goal <= 1).float()[clear])


@pytest.mark.parametrize(
    ("state", "action", "noise", "slides"),
    [
        ((0.4, 1.0), 3, (0.0, 0.0), (0.0, 1.0)),
        ((0.4, 1.0), 3, (0.0, 1.0), (0.0, 1.2)),
        ((9.5, 1.0), 1, (0.0, 0.0), (10.0, 1.0)),
        ((3.0, 0.1), 1, (0.0, -1.0), (4.0, 0.0)),
        ((7.0, 9.5), 0, (0.0, 0.0), (7.0, 10.0)),
    ],
)
def test_at_the_frontier_an_agent_slides_or_stops(state, action, noise, slides) -> None:
    for stops, expected in ((False, slides), (True, state)):
        tasks = Rooms.from_doors([[2.0, 7.0]], stops=stops)
        step = torch.tensor([state]), torch.tensor([action]), torch.tensor([noise])
        reached, _, terminated = tasks.step(*step)
        torch.testing.assert_close(reached, torch.tensor([expected]))
        assert not terminated


def test_to_the_frontier_itself_an_agent_may_go() -> None:
    tasks = Rooms.from_doors([[2.0, 7.0]], stops=True)
    state, action = torch.tensor([[1.0, 1.0]]), torch.tensor([3])
    reached, _, _ = tasks.step(state, action, torch.zeros(1, 2))
    assert reached.tolist() == [[0.0, 1.0]]


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
        ((2.0, 3.0), 0, (2.0, 4.0)),
        ((2.0, 4.0), 2, (2.0, 3.0)),
        ((2.6, 3.0), 0, (2.6, 3.0)),
        ((7.0, 6.0), 0, (7.0, 7.0)),
        ((0.4, 1.0), 3, (0.0, 1.0)),
        ((9.5, 1.0), 1, (10.0, 1.0)),
        ((8.0, 10.0), 1, (9.0, 10.0)),
    ],
)
def test_a_step_without_noise(state: tuple, action: int, expected: tuple) -> None:
    step = torch.tensor([state]), torch.tensor([action]), torch.zeros(1, 2)
    reached, reward, terminated = Rooms.from_doors([[2.0, 7.0]]).step(*step)
    torch.testing.assert_close(reached, torch.tensor([expected]))
    # The rim of the goal belongs to it.
    assert reward.item() == terminated.item() == (expected == (9.0, 10.0))


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_the_goal_ends_the_episode_with_reward_one_and_nothing_else_does(seed: int) -> None:
    tasks, state = scene(seed, 3, 60)
    state[::2] = 8 + 0.2 * state[::2]
    reached, reward, terminated = tasks.step(state, *draw(seed, 60, 1.0))
    distance = (10 - reached.double()).norm(dim=1)
    clear = (distance - 1).abs() > ROUNDING
    assert torch.equal(terminated[clear], (distance <= 1)[clear])
    assert torch.equal(reward, terminated.float())


def test_starts_and_observations() -> None:
    tasks = Rooms.from_doors([[2.0, 7.0], [3.0, 4.0]])
    u = torch.tensor([[0.0, 0.25], [0.5, 0.99]])
    assert torch.equal(tasks.start(u), torch.zeros(2, 2))
    assert torch.equal(evolve(tasks, uniform_start=True).start(u), 10 * u)
    assert torch.equal(tasks.observe(u), u)


def test_rooms_are_counted_from_the_bottom() -> None:
    tasks = Rooms.from_doors([[2.0, 7.0]])
    wall = tasks.walls[0]
    heights = torch.stack([torch.tensor(0.0), wall.nextafter(torch.tensor(0.0)), wall])
    heights = torch.cat([heights, torch.tensor([7.0, 10.0])])
    states = torch.stack([torch.ones(5), heights], 1)
    assert tasks.room(states).tolist() == [0, 0, 1, 2, 2]


def test_a_ladder_has_the_targets_doors_go_through_its_places_and_sources_drawn() -> None:
    family = RoomsFamily(2, ladder=19)
    tasks = family.draw_tasks("t", [0, 1, 18, 19, 25])
    np.testing.assert_allclose(tasks.doors[:, 0], [0.5, 1.0, 9.5, 0.5, 3.5], rtol=1e-6)
    both = RoomsFamily(3, ladder=3).draw_tasks("t", [1, 2])
    assert both.doors.tolist() == [[5.0, 5.0], [9.5, 9.5]]
    drawn = family.source_tasks("t", range(3)).doors
    assert torch.equal(drawn, RoomsFamily(2).draw_tasks("t", range(3)).doors)


def test_all_tasks_of_a_family_stop_at_the_frontier_and_others_do_not_join_them() -> None:
    stopping, sliding = (RoomsFamily(2, ladder=ladder, stops=True) for ladder in (0, 3))
    for family in (stopping, sliding):
        tasks = family.draw_tasks("t", range(3))
        assert tasks.stops
        assert family.source_tasks("t", range(3)).stops
        assert family.for_sources(tasks).stops
        assert family.kernel_parameters(tasks, 1)[2:] == [1, False, True]
    free = RoomsFamily(2).draw_tasks("t", range(3))
    assert torch.equal(free.doors, stopping.draw_tasks("t", range(3)).doors)
    with pytest.raises(ValueError, match="must have the same stops"):
        stopping.join([tasks, free])


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
    for doors in (torch.full((1, 2), 5.0), torch.full((1, 1), 5.0).double()):
        with pytest.raises(ValueError, match=r"doors must be float32 of shape \(R, 1\), one per"):
            Rooms(doors, even_walls(1))
    with pytest.raises(ValueError, match="walls must be a vector of increasing heights"):
        Rooms(torch.full((1, len(walls)), 5.0), torch.tensor(walls))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rooms": 4}, "rooms must be a whole number from 2 to 3, got 4"),
        ({"fixed_lower": 0.0}, "fixed_lower must lie in"),
        ({"fixed_lower": float("nan")}, "fixed_lower must lie in"),
        ({"normal": (5.0, 0.0)}, "deviation in normal must be positive"),
        ({"normal": (float("nan"), 1.0)}, "mean in normal must lie in"),
        ({"ladder": -1}, "ladder must be a whole number from 0"),
        ({"stops": 1}, "stops must be of type bool"),
    ],
)
def test_bad_families(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RoomsFamily(**arguments)  # type: ignore[arg-type]


def test_sources_start_anywhere_in_the_same_rooms_and_do_not_join_others() -> None:
    tasks = Rooms.from_doors([[1.0, 2.0], [3.0, 4.0]])
    spread = RoomsFamily().for_sources(tasks)
    assert spread.uniform_start
    assert torch.equal(spread.doors, tasks.doors)
    with pytest.raises(ValueError, match="must have the same uniform_start"):
        RoomsFamily().join([tasks, spread])
    with pytest.raises(ValueError, match="must have the same walls"):
        RoomsFamily().join([tasks, Rooms.from_doors([[1.0]])])
