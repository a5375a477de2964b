"""The benchmark measures something and compares it with the right bound; no timing is asserted."""

from __future__ import annotations

import math
import time
from pathlib import Path

import pytest

from vtlib import bench
from vtlib.experiments import CAR, ROOMS_EVALUATION
from vtlib.transfer import Settings

ALL = [(experiment, label) for experiment, old in bench.PUBLISHED for label in old]


@pytest.mark.parametrize("components", [1, 3])
@pytest.mark.parametrize("weights", [1, 10])
def test_the_bound_is_the_flops_of_one_update_at_that_rate(components, weights):
    settings = Settings(components=components, weights=weights, batch=50)
    factor = 2 * 484**2 * (weights + 1 / 2)
    network = 2 * 2 * 484 * (50 + 50) * weights
    ms = components * (factor + network) / 1e9 * 1000
    assert bench.bound(ROOMS_EVALUATION, settings, rate=1e9) == pytest.approx(ms)
    assert bench.bound(ROOMS_EVALUATION, settings, rate=2e9) == pytest.approx(ms / 2)


def test_without_a_posterior_the_bound_is_four_passes_through_the_network():
    assert bench.bound(CAR, CAR.algorithms["DDQN"], 1e9) == pytest.approx(4 * 2 * 387 * 32 / 1e6)


@pytest.mark.parametrize(("experiment", "label"), ALL)
def test_every_published_algorithm_is_measured(experiment, label):
    measured = bench.milliseconds(bench.ready(experiment, label), iterations=1, repeats=1)
    assert math.isfinite(measured)
    assert measured > 0


def test_an_unknown_algorithm():
    with pytest.raises(KeyError, match="DDQN"):
        bench.ready(ROOMS_EVALUATION, "DDQN")


def test_shares_are_those_of_the_functions_named(monkeypatch):
    class Slow:
        def advance(self) -> None:
            self.step()

        def step(self) -> None:
            time.sleep(2e-3)

    here = Path(__file__).stem
    parts = {"factor": (here, ("step",)), "noise": (here, ("normal",))}
    monkeypatch.setattr(bench, "PARTS", parts)
    found = bench.shares(Slow(), iterations=3)
    assert found["noise"] == 0
    assert 0.9 < found["factor"] <= 1


def test_the_parts_are_most_of_an_iteration():
    found = bench.shares(bench.ready(ROOMS_EVALUATION, "1-MGVT"), iterations=2)
    assert found.keys() == bench.PARTS.keys()
    assert all(share > 0 for share in found.values())
    assert 0.5 < sum(found.values()) < 1


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
    monkeypatch.setattr(bench, "milliseconds", lambda batch: 2.0)
    monkeypatch.setattr(bench, "shares", lambda batch: {"factor": 0.5, "network": 0.25})
    monkeypatch.setattr(bench, "sgemm_rate", lambda: 50e9)
    assert bench.main() == 0
    first, *rows = capsys.readouterr().out.splitlines()
    assert "50 GFLOP/s" in first
    assert "20 runs" in first
    assert [row.split()[0] for row in rows if "(d =" not in row] == [label for _, label in ALL]
    # 2 d^2 10.5 operations for L and 4 d 100 10 for Q at 50 GFLOP/s take 0.137 ms, d = 484
    assert rows[3].split() == ["1-MGVT", "2.000", "0.137", "14.6", "17.50", "50%", "25%"]
    assert rows[4].split() == ["3-MGVT", "2.000", "0.411", "4.9", "80.00", "50%", "25%"]
