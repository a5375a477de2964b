"""The benchmark measures something and compares it with the right bound; no timing is asserted."""

from __future__ import annotations

import math

import pytest
from attrs import evolve

from vtlib import bench
from vtlib.experiments.mountain_car import CAR
from vtlib.experiments.rooms import MGVT, ROOMS_EVALUATION

ALL = [(experiment, label) for experiment, old in bench.PUBLISHED for label in old]


@pytest.mark.parametrize("components", [1, 3])
@pytest.mark.parametrize("n_samples", [1, 10])
def test_the_bound_is_the_flops_of_one_update_at_that_rate(components, n_samples):
    settings = evolve(MGVT, components=components, n_samples=n_samples, minibatch=50)
    experiment = evolve(ROOMS_EVALUATION.published, algorithms={"one": settings})
    factor = 2 * 484**2 * (n_samples + 1 / 2)
    network = 2 * 2 * 484 * (50 + 50) * n_samples
    ms = components * (factor + network) / 1e9 * 1000
    assert bench.bound(experiment, "one", rate=1e9) == pytest.approx(ms)
    assert bench.bound(experiment, "one", rate=2e9) == pytest.approx(ms / 2)


def test_without_a_posterior_the_bound_is_four_passes_through_the_network():
    assert bench.bound(CAR.published, "DDQN", 1e9) == pytest.approx(4 * 2 * 387 * 32 / 1e6)


def test_the_rate_counts_two_operations_for_each_product(monkeypatch):
    monkeypatch.setattr(bench, "_best", lambda work, repeats: work().shape[0] * 1e-3)
    assert bench.sgemm_rate(size=100, repeats=1) == pytest.approx(2 * 100**3 / 0.1)


def test_the_table_has_every_published_algorithm(monkeypatch, capsys):
    def once(work, iterations, repeats=1):
        work(1)
        return 2.0

    monkeypatch.setattr(bench, "_milliseconds", once)
    monkeypatch.setattr(bench, "RUNS", 2)
    monkeypatch.setattr(bench, "sgemm_rate", lambda: 50e9)
    assert bench.main() == 0
    first, *rows = capsys.readouterr().out.splitlines()
    assert "50 GFLOP/s" in first
    cells = [row.split() for row in rows if "(d =" not in row]
    assert [row[0] for row in cells] == [label for _, label in ALL]
    # 2 d^2 10.5 operations for L and 4 d 100 10 for Q at 50 GFLOP/s take 0.137 ms, d = 484
    expected = [2, 0.137, 2 / 0.137, 2, 1, 1, 17.5]
    assert [float(x) for x in cells[2][1:]] == pytest.approx(expected, rel=5e-3)
    assert all(math.isnan(float(row[4])) for row in cells[-3:])  # the kernels do not know them
