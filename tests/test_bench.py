"""The benchmark measures something and compares it with the right bound; no timing is asserted."""

from __future__ import annotations

import math

import pytest

from vtlib import bench
from vtlib.experiments import ROOMS_EVALUATION
from vtlib.transfer import Settings


@pytest.mark.parametrize("components", [1, 3])
@pytest.mark.parametrize("weights", [1, 10])
def test_the_bound_is_the_flops_of_one_update_at_that_rate(components, weights):
    settings = Settings(components=components, weights=weights)
    flops = 2 * 484**2 * (weights + 1 / 2) * components
    assert bench.bound(settings, rate=1e9) == pytest.approx(flops / 1e9 * 1000)
    assert bench.bound(settings, rate=2e9) == pytest.approx(flops / 2e9 * 1000)


def test_without_a_posterior_there_is_no_bound():
    assert bench.bound(ROOMS_EVALUATION.algorithms["NT"], 1e9) is None


@pytest.mark.parametrize("label", bench.PUBLISHED)
def test_every_published_algorithm_is_measured(label):
    assert label in ROOMS_EVALUATION.algorithms
    measured = bench.milliseconds(label, iterations=1, repeats=1)
    assert math.isfinite(measured)
    assert measured > 0


def test_an_unknown_algorithm():
    with pytest.raises(KeyError, match="DDQN"):
        bench.milliseconds("DDQN", iterations=1, repeats=1)


def test_the_rate_counts_two_operations_for_each_product(monkeypatch):
    monkeypatch.setattr(bench, "_best", lambda work, repeats: work().shape[0] * 1e-3)
    assert bench.sgemm_rate(size=100, repeats=1) == pytest.approx(2 * 100**3 / 0.1)


def test_the_rate_is_positive():
    assert bench.sgemm_rate(size=8, repeats=2) > 0


def test_the_least_of_the_repeats_counts_once_each():
    calls = []
    seconds = bench._best(lambda: calls.append(0), 4)
    assert len(calls) == 4
    assert seconds >= 0


def test_the_table_shows_the_time_its_bound_and_their_ratio(monkeypatch, capsys):
    monkeypatch.setattr(bench, "milliseconds", lambda label: 2.0)
    monkeypatch.setattr(bench, "sgemm_rate", lambda: 50e9)
    assert bench.main() == 0
    first, _, *rows = capsys.readouterr().out.splitlines()
    assert "50 GFLOP/s" in first
    assert "20 runs" in first
    cells = {row.split()[0]: row.split()[1:] for row in rows}
    assert cells["NT"] == ["2.000", "-", "-", "0.71"]
    # 2 d^2 10.5 operations at 50 GFLOP/s take 0.098 ms
    assert cells["1-MGVT"] == ["2.000", "0.098", "20.3", "17.50"]
    assert cells["3-MGVT"] == ["2.000", "0.295", "6.8", "80.00"]
    assert list(cells) == list(bench.PUBLISHED)
