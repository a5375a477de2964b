"""The mellowmax between its limits, and the shares of its gradient."""

from __future__ import annotations

import pytest
import torch

from vtlib.illustrations.mellow_limits import (
    KAPPAS,
    Q_VALUES,
    gradient_shares,
    mellow_picture,
    shortfall,
)
from vtlib.mellow import mellowmax

VALUES = torch.tensor(Q_VALUES, dtype=torch.float64)


@pytest.mark.parametrize("kappa", KAPPAS)
def test_shares_are_the_softmax_of_kappa_times_the_values(kappa):
    shares = gradient_shares(VALUES, kappa)
    torch.testing.assert_close(shares, torch.softmax(kappa * VALUES, 0))


@pytest.mark.parametrize("kappa", [0.5, 7.0])
def test_shares_are_finite_differences(kappa):
    h = 1e-6
    ends = VALUES + h * torch.stack([torch.eye(4), -torch.eye(4)]).double()
    up, down = mellowmax(ends, kappa)
    torch.testing.assert_close(gradient_shares(VALUES, kappa), (up - down) / (2 * h))


def test_shares_of_a_batch_are_those_of_its_rows():
    rows = torch.stack([VALUES, VALUES.flip(0)])
    torch.testing.assert_close(gradient_shares(rows, 3.0)[1], gradient_shares(VALUES, 3.0).flip(0))


def test_small_and_large_kappa_are_mean_and_maximum():
    torch.testing.assert_close(gradient_shares(VALUES, 1e-6), torch.full((4,), 0.25).double())
    assert gradient_shares(VALUES, 1e4).tolist() == pytest.approx([1, 0, 0, 0])


@pytest.mark.parametrize("kappa", KAPPAS)
def test_shortfall_bounds_the_distance_from_the_maximum_and_is_reached(kappa):
    random = torch.randn(500, 4, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    gap = random.amax(-1) - mellowmax(random, kappa)
    assert (gap >= -1e-12).all()
    assert (gap <= shortfall(4, kappa) + 1e-12).all()
    # one value far above the others leaves only the division by their number
    far = torch.tensor([1e3, 0.0, 0.0, 0.0], dtype=torch.float64)
    assert float(1e3 - mellowmax(far, kappa)) == pytest.approx(shortfall(4, kappa))


def test_picture_tells_value_and_kappa():
    html = mellow_picture(10.0)
    assert f"{float(mellowmax(VALUES, 10.0)):.3f}" in html
    assert "kappa = 10:" in html
