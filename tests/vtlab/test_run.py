"""Runs that share a task, use fewer sources than others, or keep where they went."""

from unittest.mock import Mock

import numpy as np
import pytest
import torch
from attrs import evolve

from vtlab import run
from vtlab.run import chosen_sources, head, prepare, run_batch, targets


@pytest.fixture
def shared(tiny):
    """Two targets for six runs, and algorithms that use fewer sources than others."""
    mean = evolve(tiny.algorithms["2-MGVT"], components=1, init="mean")
    return evolve(
        tiny,
        pool=evolve(tiny.pool, count=50),
        algorithms={"NT": tiny.algorithms["NT"], "few": mean, "all": mean},
        runs=6,
        sources=8,
        runs_per_task=3,
        counts={"few": 2},
    )


def test_runs_of_one_task_share_it_but_not_their_sources_which_are_never_excluded(shared):
    masses = targets(shared, range(6)).cart_mass
    assert len(set(masses.tolist())) == 2
    alone = targets(evolve(shared, runs_per_task=1), [0, 1]).cart_mass
    assert torch.equal(masses, alone.repeat_interleave(3))
    # a batch that begins within a task
    assert torch.equal(targets(shared, [2, 3, 5]).cart_mass, masses[[2, 3, 5]])
    chosen = chosen_sources(shared, range(6))
    assert len({tuple(sorted(row)) for row in chosen}) == 6
    assert all(len(set(row)) == 8 for row in chosen)
    allowed = evolve(shared, excluded=tuple(range(40)))
    assert chosen_sources(allowed, range(6)).min() == 40


def test_an_algorithm_gets_the_first_of_each_runs_sources(shared, weights):
    chosen = chosen_sources(shared, [1, 4])
    for label, count in (("few", 2), ("all", 8)):
        agent = prepare(shared, label, [1, 4], weights).agent
        # it starts at the mean of its sources
        expected = [weights[row[:count]].mean(0) for row in chosen]
        np.testing.assert_allclose(agent.mu[:, 0].detach(), expected, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("label", ["NT", "DDQN", "GVT", "2-MGVT"])
def test_a_batch_records_its_runs_whatever_runs_beside_them(tiny, weights, label):
    reports = []
    arrays = run_batch(tiny, label, [0, 2], weights[:3], lambda t: reports.append(t) or True)
    times = list(range(20, 221, 20))
    assert list(arrays["iterations"]) == reports == times
    assert arrays["learning"].shape == arrays["greedy"].shape == (2, len(times))
    prints = arrays["fingerprints"]
    np.testing.assert_array_equal(head(tiny, label, [0, 2], weights[:3]), prints)
    # rounding, which differs in batches of another size, may lead runs elsewhere later on
    alone = head(tiny, label, [2], weights[:3])
    np.testing.assert_allclose(alone[0, :2], prints[1, :2], rtol=1e-4, atol=1e-5)


def test_the_greedy_return_of_a_mixture_is_of_its_mean_or_of_each_component(tiny):
    # one component falls to the left, the other to the right, and so does their mean
    pool, pair = np.zeros((2, 226), dtype=np.float32), evolve(tiny.pool, count=2)
    pool[:, -2:] = [[1.0, 0.0], [0.0, 2.0]]
    either = [evolve(tiny, each=each, pool=pair, iterations=20) for each in (False, True)]
    mean, each = (run_batch(one, "2-MGVT", [0, 2], pool) for one in either)
    for key in mean:
        assert np.array_equal(mean[key], each[key]) == (key != "greedy"), key
    np.testing.assert_array_equal(
        *(run_batch(one, "GVT", [0, 2], pool)["greedy"] for one in either)
    )


@pytest.mark.parametrize("label", ["DDQN", "2-MGVT"])
def test_greedy_returns_are_left_out_where_no_one_asks_and_nothing_else_changes(
    tiny, weights, label
):
    plain, lean = (
        run_batch(evolve(tiny, greedy=greedy), label, range(3), weights) for greedy in (True, False)
    )
    del plain["greedy"]
    assert list(plain) == list(lean)
    for key in plain:
        np.testing.assert_array_equal(plain[key], lean[key])


def test_visits_are_kept_where_they_are_asked_for_and_disturb_nothing(tiny, weights):
    plain = run_batch(tiny, "DDQN", range(3), weights)
    kept = run_batch(evolve(tiny, visits=True), "DDQN", range(3), weights)
    assert set(kept) - set(plain) == {"visited"}
    assert kept["visited"].shape == (3, tiny.iterations, 4)
    for key, values in plain.items():
        np.testing.assert_array_equal(kept[key], values)


def test_the_table_plans_each_task_once_and_repeats_its_optimum(shared, monkeypatch):
    plan = Mock(side_effect=lambda tasks: tasks.cart_mass + 1)
    monkeypatch.setattr(type(shared.family), "optimum", staticmethod(plan))
    table = run.task_table(shared)
    np.testing.assert_array_equal(table["cart_mass"], targets(shared, range(6)).cart_mass)
    np.testing.assert_array_equal(table["sources"], chosen_sources(shared, range(6)))
    np.testing.assert_array_equal(table["optimum"], table["cart_mass"] + 1)
    assert len(plan.call_args[0][0]) == 2
