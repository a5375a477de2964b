"""What each environment brings to the experiments."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from vtlib.domains import (
    DOMAINS,
    balances,
    domain,
    first_weights,
    near_optimum,
    parameters,
)
from vtlib.envs.cartpole import CartpoleFamily
from vtlib.envs.maze import MazeFamily
from vtlib.envs.mountain_car import MountainCarFamily
from vtlib.envs.rooms import RoomsFamily

FAMILIES = (RoomsFamily(), CartpoleFamily(), MountainCarFamily(), MazeFamily())


@pytest.mark.parametrize(("family", "d"), list(zip(FAMILIES, (484, 226, 387, 1891), strict=True)))
def test_q_functions_have_the_thesis_numbers_of_weights(family, d):
    assert domain(family).q().d == d
    assert first_weights(family, "t", [0, 3]).shape == (2, d)


@pytest.mark.parametrize("family", FAMILIES)
def test_tasks_are_told_apart_by_their_parameters(family):
    tasks = family.sample(np.random.default_rng(0), 3)
    values = parameters(family, tasks)
    assert values.keys() == set(DOMAINS[type(family)].parameters)
    rows = np.concatenate([array.reshape(3, -1) for array in values.values()], 1)
    assert len(np.unique(rows, axis=0)) == 3


def test_first_weights_are_a_runs_own_and_zero_for_linear_values():
    one, two = first_weights(CartpoleFamily(), "t", [4, 5])
    assert not torch.equal(one, two)
    torch.testing.assert_close(first_weights(CartpoleFamily(), "t", [5])[0], two)
    many = first_weights(CartpoleFamily(), "t", list(range(40)))
    assert abs(float(many.std()) - 0.1) < 0.004
    assert not first_weights(RoomsFamily(), "t", [4]).any()


def test_the_best_cartpole_return_is_that_of_a_hundred_steps():
    tasks = CartpoleFamily().sample(np.random.default_rng(0), 2)
    expected = sum(0.99**t for t in range(100))
    np.testing.assert_allclose(domain(CartpoleFamily()).optimum(tasks), expected, rtol=1e-6)
    assert expected == pytest.approx(63.397, abs=1e-3)


def test_within_ten_percent_also_holds_for_negative_returns():
    returns = torch.tensor([[-54.0, -56.0], [-56.0, -56.0], [-20.0, -20.0]])
    passed = near_optimum(returns, torch.full((3,), -50.0), 0.9)
    assert passed.tolist() == [True, False, True]
    assert near_optimum(torch.tensor([[0.75, 0.71]]), torch.tensor([0.8]), 0.9).tolist() == [True]


def test_a_cart_balances_by_its_share_of_whole_episodes():
    best = torch.tensor([60.0, 60.0])
    returns = torch.full((2, 100), 60.0)
    returns[0, :5] = 10.0
    returns[1, :6] = 59.9
    assert balances(returns, best, 0.95).tolist() == [True, False]
