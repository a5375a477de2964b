"""What all tasks and their families have in common, and tasks given by a few positive numbers."""

import numpy as np
import pytest
import torch

from vtlab import envs
from vtlab.bases import RBFLinear

ROOMS = [envs.RoomsFamily(), envs.RoomsFamily(2, normal=(5.0, 1.8))]
OTHERS = [envs.CartpoleFamily(), envs.MountainCarFamily(), envs.MazeFamily()]
every_family = pytest.mark.parametrize("family", ROOMS + OTHERS, ids=lambda x: type(x).__name__)


@every_family
def test_a_row_does_not_feel_its_neighbours_and_no_argument_changes(family):
    count, rng = 99, np.random.default_rng(0)
    tasks = family.sample(rng, count)
    u = torch.tensor(rng.random((count, tasks.start_dim), np.float32))
    state = tasks.start(u)
    for _ in range(11):
        action = torch.tensor(rng.integers(tasks.n_actions, size=count))
        noise = torch.tensor(rng.standard_normal((count, tasks.noise_dim), np.float32))
        arguments = state, action, noise
        before = [x.clone() for x in arguments]
        state, _, _ = tasks.step(*arguments)

    def outcome(rows, some):
        given = [x[rows] for x in arguments]
        return *some.step(*given), some.observe(given[0]), some.start(u[rows])

    together = outcome(slice(None), tasks)
    assert all(map(torch.equal, before, arguments))
    shapes = [state.shape, (count,), (count,), (count, tasks.obs_dim), state.shape]
    assert [x.shape for x in together] == shapes
    assert [x.dtype == torch.float32 for x in together] == [True, True, False, True, True]
    assert together[2].dtype == torch.bool
    for row in range(count):
        rows = slice(row, row + 1)
        assert all(
            map(torch.equal, (x[rows] for x in together), outcome(rows, tasks.select([row])))
        )
    for wrong in range(3):
        shapes = [torch.cat([x, x]) if i == wrong else x for i, x in enumerate(arguments)]
        with pytest.raises(ValueError, match="state, action, noise must have shapes"):
            tasks.step(*shapes)


@every_family
def test_select_takes_and_repeats_tasks(family):
    tasks = family.sample(np.random.default_rng(1), 3)
    for index in ([2, 0, 0], np.array([-1, 0, 0]), torch.tensor([2, 0, -3])):
        chosen = tasks.select(index)
        assert type(chosen) is type(tasks)
        for name, rows in family.values(tasks).items():
            np.testing.assert_array_equal(getattr(chosen, name), rows[[2, 0, 0]])


@every_family
def test_a_run_has_its_task_whatever_the_other_runs_are(family):
    together, alone = family.draw_tasks("a", range(9)), family.draw_tasks("a", [5])
    others = family.values(family.draw_tasks("b", range(9)))
    for name, rows in family.values(together).items():
        np.testing.assert_array_equal(rows[5:6], getattr(alone, name))
        assert not np.array_equal(others[name], rows)
        assert len(np.unique(rows, axis=0)) > 1


@pytest.mark.parametrize(
    ("family", "ranges"),
    [
        (envs.RoomsFamily(), [(0.5, 9.5)] * 2),
        (envs.CartpoleFamily(), [(0.5, 1.5), (0.1, 0.3), (0.2, 1.0)]),
        (envs.MountainCarFamily(), [(0.001, 0.0015)]),
    ],
)
def test_a_family_draws_uniform_and_independent_parameters(family, ranges):
    values = family.values(family.sample(np.random.default_rng(3), 4000)).values()
    low, high = np.array(ranges, np.float32).T
    share = (np.column_stack(list(values)) - low) / (high - low)
    assert 0 <= share.min() < 0.01
    assert 0.99 < share.max() <= 1.0001
    # Four standard errors of the mean of a uniform number.
    assert np.abs(share.mean(0) - 0.5).max() < 0.02
    assert np.abs(np.atleast_2d(np.corrcoef(share.T)) - np.eye(len(ranges))).max() < 0.07


@every_family
def test_first_weights_are_a_runs_own_and_zero_for_linear_values(family):
    weights = family.first_weights("t", range(40))
    assert weights.shape == (40, family.q().d)
    assert torch.equal(family.first_weights("t", [5])[0], weights[5])
    assert weights.std().item() == pytest.approx(family.scale, rel=0.04)
    assert (family.scale == 0) == isinstance(family.q(), RBFLinear)


def test_within_ten_percent_also_holds_for_negative_returns():
    returns = torch.tensor([[-54.0, -56.0], [-56.0, -56.0], [-20.0, -20.0]])
    solved = envs.MountainCarFamily().solved
    assert solved(returns, torch.full((3,), -50.0), 0.9).tolist() == [True, False, True]
    assert solved(torch.tensor([[0.75, 0.71]]), torch.tensor([0.8]), 0.9).tolist() == [True]
