"""The rooms dynamics by their properties, against plain geometry in float64."""

import numpy as np
import pytest
import torch
from attrs import evolve
from hypothesis import given, settings
from hypothesis import strategies as st

from vtlab.envs import Rooms, RoomsFamily

MOVES = np.array([[0, 1], [1, 0], [0, -1], [-1, 0]])  # up, right, down, left
# What float32 may add to a position of at most 10.
ROUNDING = 1e-5
COUNT = 60
DOORS = Rooms.from_doors([[2.0, 7.0]])


def scene(rng, rooms, stops):
    """Tasks and states: close to a door post or exactly on a wall, by the frontier, the goal."""
    tasks = RoomsFamily(rooms, stops=stops).sample(rng, COUNT)
    state = torch.tensor(rng.uniform(0, 10, (COUNT, 2)), dtype=torch.float32)
    wall, third = rng.integers(rooms - 1, size=COUNT // 3), COUNT // 3
    post = rng.choice([-0.5, 0.5], third) + 0.1 * rng.normal(size=third)
    above = rng.choice([-1e-6, 0.0, 1e-6, -0.3, 0.3], third)
    near = tasks.doors[torch.arange(third), wall], tasks.walls[wall]
    state[:third] = torch.stack(near, 1).add(torch.tensor(np.stack([post, above], 1))).clamp(0, 10)
    state[-20:-10] = torch.where(state[-20:-10] < 5, 0.3, 9.7)  # a third of a step from both sides
    state[-10:] = 8 + 0.2 * state[-10:]
    return tasks, state


def outside_doors(start, end, tasks, row):
    """How far outside its door a segment meets each wall strictly between its ends."""
    found = []
    for height, door in zip(tasks.walls.tolist(), tasks.doors[row].tolist(), strict=True):
        if (start[1] - height) * (end[1] - height) < 0:
            share = (height - start[1]) / (end[1] - start[1])
            found.append(abs(start[0] + share * (end[0] - start[0]) - door) - 0.5)
    return found


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 3), st.sampled_from([0, 1, 20]), st.booleans())
def test_a_step_is_that_of_plain_geometry(seed, rooms, scale, stops):
    rng = np.random.default_rng(seed)
    tasks, state = scene(rng, rooms, stops)
    walls = tasks.walls.double().numpy()
    for _ in range(5):
        action = rng.integers(4, size=COUNT)
        noise = scale * rng.standard_normal((COUNT, 2), dtype=np.float32)
        before = state.double().numpy()
        state, reward, terminated = tasks.step(state, torch.tensor(action), torch.tensor(noise))
        reached = state.double().numpy()
        assert ((reached >= 0) & (reached <= 10)).all()
        distance = np.hypot(*(10 - reached).T)
        clear = np.abs(distance - 1) > ROUNDING
        assert np.array_equal(terminated[clear], (distance <= 1)[clear])
        assert torch.equal(reward, terminated.float())
        aimed = before + MOVES[action] + 0.2 * noise.astype(float)
        proposed = aimed.clip(0, 10)
        # Whether a step ends beyond the frontier is unclear where it ends on it but for rounding.
        unclear = (np.abs(np.abs(aimed - 5) - 5) <= ROUNDING).any(1)
        beyond = stops & (aimed != proposed).any(1)
        moved = np.abs(reached - proposed).max(1) <= ROUNDING
        stayed = (reached == before).all(1)
        assert (moved | stayed).all()
        assert (stayed | ~beyond | unclear).all()
        for row in range(COUNT):
            passed = outside_doors(before[row], reached[row], tasks, row)
            assert all(outside <= ROUNDING for outside in passed)
            heights = np.array([[before[row, 1]], [proposed[row, 1]]])
            on_wall = np.abs(heights - walls).min() <= ROUNDING
            if not (moved[row] or beyond[row] or (stops and unclear[row]) or on_wall):
                met = outside_doors(before[row], proposed[row], tasks, row)
                # Along a wall rounding moves the meeting point by more than it moves the agent.
                slack = ROUNDING * (1 + 20 / max(abs(proposed[row, 1] - before[row, 1]), ROUNDING))
                assert any(outside > -slack for outside in met)


def test_an_agent_may_go_to_the_frontier_itself_and_the_goals_rim_is_part_of_it():
    tasks = Rooms.from_doors([[2.0, 7.0]] * 2, stops=True)
    step = torch.tensor([[1.0, 1.0], [8.0, 10.0]]), torch.tensor([3, 1]), torch.zeros(2, 2)
    reached, _, terminated = tasks.step(*step)
    assert reached.tolist() == [[0.0, 1.0], [9.0, 10.0]]
    assert terminated.tolist() == [False, True]


@pytest.mark.parametrize(("action", "up"), [(0, 1), (2, -1)])
def test_nobody_tunnels_by_stopping_on_the_wall_line(action, up):
    tasks, toward = Rooms.from_doors([[9.0, 9.0]] * 61), torch.full((61,), action)
    # Noise that lands the agents on the line to within rounding, then a full step onwards.
    state = torch.stack([torch.tensor(2.0), tasks.walls[0] - up]).expand(61, 2)
    landing = torch.stack([torch.zeros(61), torch.linspace(-3e-6, 3e-6, 61) / 0.2], 1)
    for noise in (landing, torch.zeros(61, 2)):
        state, _, _ = tasks.step(state, toward, noise)
    assert (up * (state[:, 1] - tasks.walls[0]) <= 0).all()


def test_starts_observations_and_rooms_which_are_counted_from_the_bottom():
    u = torch.tensor([[0.25, 0.5]])
    assert torch.equal(DOORS.start(u), torch.zeros(1, 2))
    assert torch.equal(evolve(DOORS, uniform_start=True).start(u), 10 * u)
    assert torch.equal(DOORS.observe(u), u)
    wall = DOORS.walls[0]
    heights = torch.stack([0 * wall, wall.nextafter(0 * wall), wall, 2.1 * wall, 3 * wall])
    assert DOORS.room(heights.expand(2, 5).T).tolist() == [0, 0, 1, 2, 2]


def test_a_ladder_has_the_targets_doors_go_through_its_places_and_sources_drawn():
    family, runs = RoomsFamily(2, ladder=19, stops=True), [0, 1, 18, 19, 25]
    tasks, sources = family.draw_tasks("t", runs), family.source_tasks("t", runs)
    spread = family.for_sources(tasks)
    assert all((tasks.stops, sources.stops, spread.stops, spread.uniform_start))
    places = torch.tensor([[0.5], [1.0], [9.5], [0.5], [3.5]])
    torch.testing.assert_close(tasks.doors, places, rtol=1e-6, atol=0)
    assert torch.equal(spread.doors, tasks.doors)
    assert torch.equal(sources.doors, RoomsFamily(2).draw_tasks("t", runs).doors)
    assert family.kernel_parameters(tasks, 1) == [1.0, 1.0, 1, False, True]


def test_the_other_families():
    families = RoomsFamily(fixed_lower=5.0), RoomsFamily(), RoomsFamily(2, normal=(5.0, 1.8))
    fixed, free, bell = (x.sample(np.random.default_rng(0), 4000).doors for x in families)
    assert (fixed[:, 0] == 5).all()
    assert torch.equal(fixed[:, 1], free[:, 1])
    assert bell.shape == (4000, 1)
    assert abs(bell.mean().item() - 5) < 0.12
    assert abs(bell.std().item() - 1.8) < 0.1
    assert (bell.min(), bell.max()) == (0.5, 9.5)
