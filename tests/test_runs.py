"""Runs that share a task, use fewer sources than others, or keep where they went."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from vtlib import store
from vtlib.baselines import MellowTDSettings
from vtlib.domains import DOMAINS, rooms_q
from vtlib.envs.episodes import RecordedEpisodes
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments import EXPERIMENTS, POOLS, Experiment, work
from vtlib.experiments.experiment import sliders_of
from vtlib.experiments.runs import chosen_sources, prepare, run_batch, targets, task_table
from vtlib.planning import optimal_return
from vtlib.sources import Pool
from vtlib.transfer import Settings

POOL = Pool("tiny-pool", RoomsFamily(rooms=2), count=50)
WEIGHTS = 0.1 * np.random.default_rng(0).random((POOL.count, rooms_q().d), dtype=np.float32)
MEAN = Settings(init="mean", batch=5, weights=2)
TINY = Experiment(
    "tiny",
    POOL,
    RoomsFamily(rooms=2),
    {
        "NT": MellowTDSettings(epsilon_steps=100),
        "from-2": MEAN,
        "from-5": MEAN,
        "from-all": MEAN,
    },
    runs=6,
    sources=8,
    iterations=20,
    every=10,
    runs_per_task=3,
    counts={"from-2": 2, "from-5": 5},
)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"runs_per_task": 0}, "runs_per_task must be a whole number from 1 .*, got 0"),
        ({"runs_per_task": -3}, "runs_per_task must be a whole number from 1 .*, got -3"),
        ({"runs_per_task": 4}, "runs_per_task must divide the 6 runs, got 4"),
        ({"runs_per_task": 12}, "runs_per_task must divide the 6 runs, got 12"),
        ({"counts": {"from-2": 0}}, r"counts\['from-2'\] must be .* from 1 to 8, got 0"),
        ({"counts": {"from-2": 9}}, r"counts\['from-2'\] must be .* from 1 to 8, got 9"),
        ({"counts": {"from-2": -1}}, r"counts\['from-2'\] must be .* from 1 to 8, got -1"),
        ({"counts": {"from-3": 3}}, "a label in counts must be one of NT, .* got 'from-3'"),
        # a count that was right before the sources became fewer
        ({"sources": 4}, r"counts\['from-5'\] must be .* from 1 to 4, got 5"),
    ],
)
def test_an_experiment_that_cannot_be_run_is_refused(bad, message):
    with pytest.raises(ValueError, match=message):
        replace(TINY, **bad)


def test_the_ends_of_what_is_allowed():
    replace(TINY, runs_per_task=6)
    replace(TINY, runs_per_task=1)
    replace(TINY, counts={"from-2": 1, "from-5": 8})


def test_consecutive_runs_have_one_task():
    assert [TINY.task_of(run) for run in range(6)] == [0, 0, 0, 1, 1, 1]
    alone = replace(TINY, runs_per_task=1)
    assert [alone.task_of(run) for run in range(6)] == list(range(6))


def test_an_algorithm_uses_all_sources_unless_told_otherwise():
    assert [TINY.sources_of(label) for label in TINY.algorithms] == [8, 2, 5, 8]


def test_runs_of_one_task_share_doors_but_not_sources():
    doors = targets(TINY, range(6)).doors
    assert torch.equal(doors[:3], doors[:1].expand(3, -1))
    assert torch.equal(doors[3:], doors[3:4].expand(3, -1))
    assert not torch.equal(doors[0], doors[3])
    chosen = chosen_sources(TINY, range(6))
    assert len({tuple(sorted(row)) for row in chosen}) == 6


def test_tasks_are_those_of_an_experiment_of_the_same_stream_with_one_run_each():
    alone = replace(TINY, runs_per_task=1)
    expected = targets(alone, [0, 1]).doors.repeat_interleave(3, 0)
    assert torch.equal(targets(TINY, range(6)).doors, expected)
    # a batch that begins within a task
    assert torch.equal(targets(TINY, [2, 3, 5]).doors, expected[[2, 3, 5]])


def test_sliders_run_once_on_each_of_the_first_tasks():
    around = replace(TINY, algorithms={"1-MGVT": MEAN}, counts={})
    sliders = sliders_of(around, "tiny-sliders", runs=2, iterations=10)
    assert sliders.runs_per_task == 1
    assert sliders.stream == TINY.stream
    assert torch.equal(targets(sliders, range(2)).doors, targets(TINY, [0, 3]).doors)


def test_runs_of_one_task_go_their_own_ways():
    arrays = run_batch(replace(TINY, visits=True), "NT", range(3), WEIGHTS)
    one, two, three = arrays["visited"]
    assert not np.array_equal(one, two)
    assert not np.array_equal(two, three)


def test_the_table_repeats_the_optimum_of_each_task(monkeypatch):
    planned = []

    def plan(tasks):
        planned.append(tasks.doors)
        return 0.5 + tasks.doors[:, 0] / 100

    monkeypatch.setitem(DOMAINS, RoomsFamily, replace(DOMAINS[RoomsFamily], optimum=plan))
    table = task_table(TINY)
    np.testing.assert_array_equal(table["doors"], targets(TINY, range(6)).doors)
    np.testing.assert_array_equal(table["sources"], chosen_sources(TINY, range(6)))
    np.testing.assert_array_equal(table["optimum"], 0.5 + table["doors"][:, 0] / np.float32(100))
    # planned once for a task, not once for a run
    assert [len(doors) for doors in planned] == [2]


def test_the_tables_optimum_is_the_planned_one():
    one = replace(TINY, runs=2, runs_per_task=2)
    expected = optimal_return(targets(one, [0])).item()
    assert task_table(one)["optimum"].tolist() == pytest.approx([expected, expected])


@pytest.mark.parametrize(("label", "count"), [("from-2", 2), ("from-5", 5), ("from-all", 8)])
def test_an_algorithm_gets_the_first_of_each_runs_sources(label, count):
    members = [1, 4]
    agent = prepare(TINY, label, TINY.algorithms[label], members, WEIGHTS).agent
    # it starts at the mean of its sources
    expected = [WEIGHTS[row[:count]].mean(0) for row in chosen_sources(TINY, members)]
    np.testing.assert_allclose(agent.mu[:, 0].detach(), expected, rtol=1e-5)


def test_fewer_sources_lead_elsewhere_and_the_rest_is_the_same():
    few, many = (run_batch(TINY, label, range(2), WEIGHTS) for label in ("from-2", "from-all"))
    assert not np.array_equal(few["fingerprints"], many["fingerprints"])
    # told to use all of them, the same label leaves the same course
    told = replace(TINY, counts={"from-2": 8})
    all_told = run_batch(told, "from-2", range(2), WEIGHTS)
    for key, values in all_told.items():
        np.testing.assert_array_equal(values, many[key])


def test_visits_are_stored_only_where_they_are_kept():
    plain = run_batch(TINY, "from-2", range(2), WEIGHTS)
    kept = run_batch(replace(TINY, visits=True), "from-2", range(2), WEIGHTS)
    assert set(kept) - set(plain) == {"visited"}
    assert kept["visited"].shape == (2, TINY.iterations, 2)
    for key, values in plain.items():
        np.testing.assert_array_equal(kept[key], values)


def test_kept_visits_are_those_of_the_runs():
    kept = replace(TINY, visits=True)
    assert isinstance(
        prepare(kept, "NT", TINY.algorithms["NT"], [0], WEIGHTS).episodes, RecordedEpisodes
    )
    visited = run_batch(kept, "NT", range(4), WEIGHTS)["visited"]
    np.testing.assert_array_equal(run_batch(kept, "NT", [2], WEIGHTS)["visited"][0], visited[2])
    # from the corner, at most a step and its noise from one position to the next
    steps = np.diff(visited, axis=1, prepend=np.zeros((4, 1, 2), np.float32))
    assert 0 < np.abs(steps).max() < 1 + 0.2 * 6


def test_batches_of_visits_join_along_the_runs(monkeypatch, tmp_path):
    kept = replace(TINY, visits=True, algorithms={"from-2": MEAN}, counts={"from-2": 2})
    monkeypatch.setitem(EXPERIMENTS, kept.name, kept)
    monkeypatch.setitem(POOLS, POOL.name, POOL)
    monkeypatch.setattr(work, "BATCH", 4)
    units = [unit for unit in work.run_units(kept) if unit.label != "tasks"]
    assert [unit.members for unit in units] == [(0, 1, 2, 3), (4, 5)]
    for unit in units:
        work.keep(unit, *work.compute(unit, WEIGHTS), tmp_path)
    work.join_finished(units, tmp_path)
    arrays, note = work.load_result(kept.name, "from-2", tmp_path)
    whole = run_batch(kept, "from-2", range(6), WEIGHTS)
    assert arrays["visited"].shape == (6, TINY.iterations, 2)
    np.testing.assert_allclose(arrays["visited"], whole["visited"], atol=1e-5)
    assert (note["config"]["sources"], note["config"]["runs_per_task"]) == (2, 3)


@pytest.mark.parametrize(
    "changed", [{"runs_per_task": 2}, {"runs_per_task": 1}, {"counts": {"from-2": 3}}]
)
def test_a_result_of_other_tasks_or_sources_is_refused(monkeypatch, tmp_path, changed):
    monkeypatch.setitem(EXPERIMENTS, TINY.name, TINY)
    note = {"config": work.config_of(TINY, "from-2"), "seconds": 1.0}
    store.save(tmp_path / TINY.name / "from-2", {"run": np.arange(6)}, note)
    work.load_result(TINY.name, "from-2", tmp_path)
    monkeypatch.setitem(EXPERIMENTS, TINY.name, replace(TINY, **changed))
    with pytest.raises(store.TornResult, match="another configuration"):
        work.load_result(TINY.name, "from-2", tmp_path)
