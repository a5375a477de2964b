"""The benchmark measures something and compares it with the right bound; no timing is asserted."""

import math

import pytest

from vtbook import bench
from vtlab.registry import named


def test_the_table_has_every_algorithm(monkeypatch, capsys):
    def once(work, _):
        work(1)
        return 2.0

    monkeypatch.setattr(bench, "_milliseconds", once)
    monkeypatch.setattr(bench, "RUNS", 2)
    monkeypatch.setattr(bench, "sgemm_rate", lambda: 50e9)
    assert bench.main() == 0
    _, *rows = capsys.readouterr().out.splitlines()
    cells = [row.split() for row in rows if "(d =" not in row]
    assert [row[0] for row in cells] == [label for old in bench.PUBLISHED.values() for label in old]
    # 2 d^2 10.5 operations for L and 4 d 100 10 for Q at 50 GFLOP/s take 0.137 ms, d = 484
    expected = [2, 0.137, 2 / 0.137, 2, 1, 17.5]
    assert [float(x) for x in cells[2][1:]] == pytest.approx(expected, rel=5e-3)
    assert all(math.isnan(float(row[4])) for row in cells[-3:])  # the kernels do not know them
    # without a posterior it is four passes through the network
    (car,) = named("mountain-car")
    assert bench.bound(car, "DDQN", 1e9) == pytest.approx(4 * 2 * 387 * 32 / 1e6)
