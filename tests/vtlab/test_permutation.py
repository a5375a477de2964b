"""A test of pairs against all their exchanges."""

from itertools import product

import numpy as np
import pytest

from vtlab.permutation import same_distribution_p


@pytest.mark.parametrize("draws", [10, 4000])
def test_equal_values_count_as_one_step(draws):
    # all 16 exchanges of four pairs of few different values, by the definition of the distance
    rng, points = np.random.default_rng(6), np.arange(3)
    for _ in range(20):
        pairs = rng.integers(0, 3, (4, 2)).astype(float)
        distances = []
        for turned in product((False, True), repeat=4):
            x, y = np.where(np.array(turned)[:, None], pairs[:, ::-1], pairs).T
            below = [(sample[:, None] <= points).sum(0) for sample in (x, y)]
            distances.append(np.abs(below[0] - below[1]).max())
        exact = np.mean(np.array(distances) >= distances[0])
        # fewer draws than exchanges are random ones; more are not needed
        error = 4 * 0.5 / np.sqrt(draws) + 1 / draws if draws < 16 else 1e-12
        assert same_distribution_p(*pairs.T, rng, draws) == pytest.approx(exact, abs=error)
