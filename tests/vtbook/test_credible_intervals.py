"""Coverage: closed forms, a calibrated posterior, one too sure of itself; and projections."""

from statistics import NormalDist

import numpy as np
import pytest
import torch

from vtbook.credible_intervals import (
    LEVELS,
    inside,
    nearest_weights,
    posterior_samples,
    projected_weights,
    values_at,
)
from vtlab.envs.planning import GridPlan
from vtlab.envs.rooms import Rooms, RoomsFamily
from vtlab.envs.rooms.plan import gaussian_quadrature
from vtlib.qfunctions import MLP
from vtlib.td import mellowmax

Q, PAIRS = MLP((1, 2)), 2000  # whose values at zero are its biases, the last two weights
LAWS = NormalDist(), NormalDist(0, 2), NormalDist(0, 0.5), NormalDist(1.5, 1)  # of each run's truth


def test_shares_are_those_of_the_normal_distribution():
    g, runs = torch.Generator().manual_seed(0), len(LAWS)
    # two components that differ, but not in the biases' means and deviations, which are one
    mu, factors = torch.tensor([[0.0, 0, 0, 9], [5, 0, 0, 9]]), torch.eye(4).repeat(2, 1, 1)
    factors[0, 2, [0, 2]] = factors[1, 3, [1, 3]] = torch.tensor([0.8, 0.6])
    noise = torch.randn(runs, 2, 500, 4, generator=g)
    samples = posterior_samples(mu.expand(runs, 2, 4), factors.expand(runs, 2, 4, 4), noise)
    drawn = mu.unsqueeze(1) + torch.einsum("cij,rckj->rcki", factors, noise)
    torch.testing.assert_close(samples, drawn.flatten(1, 2))
    action = torch.randint(2, (runs, PAIRS), generator=g)
    shift, spread = torch.tensor([(x.mean, x.stdev) for x in LAWS]).unsqueeze(2).unbind(1)
    truth = mu[0, 2 + action] + shift + spread * torch.randn(3, runs, PAIRS, generator=g)
    found = inside(values_at(Q, samples, torch.zeros(runs, PAIRS, 1), action), truth)
    ends = [NormalDist().inv_cdf((1 + x) / 2) for x in LEVELS]
    expected = [[law.cdf(z) - law.cdf(-z) for z in ends] for law in LAWS]
    # three standard errors of 2,000 pairs, and as much for the 1,000 samples' quantiles
    np.testing.assert_allclose(found, [expected] * 3, atol=0.065)


PLACES = (torch.arange(24) + 0.5) * 10 / 24
STATES, BASES = torch.cartesian_prod(PLACES, PLACES), RoomsFamily().q()


def test_what_no_weights_represent_is_orthogonal_to_the_bases():
    features = BASES.prepare(STATES[None])[0].T.double()
    values = (STATES.sum(1, keepdim=True) > torch.arange(6.0, 10)).double()  # steps, like walls
    off = values - features @ nearest_weights(BASES, STATES, values).view(4, -1).T
    assert off.abs().max() > 0.1
    torch.testing.assert_close(features.T @ off, torch.zeros(121, 4).double())


def test_a_projected_backup_leaves_the_projected_weights_alone():
    task, noise, kappa = Rooms.from_doors([[3.2, 6.7]]), gaussian_quadrature(3), 100.0
    plan = GridPlan(task.select([0] * 1024), None, noise, None)  # of which no values are asked
    w = projected_weights(BASES, plan, STATES, kappa, torch.zeros(BASES.d).double())
    copies, z = task.select([0] * len(STATES)), noise.repeat_interleave(len(STATES), 0)
    backups = []
    for action in range(4):
        backup = torch.zeros(len(STATES), dtype=torch.float64)
        for noises in z.split(len(STATES)):
            moved = copies.step(STATES, torch.full((len(STATES),), action), noises)
            values = BASES.q(w.float().view(1, 1, -1), BASES.prepare(moved[0][None]))[0, 0]
            backup += moved[1] + 0.99 * mellowmax(values, kappa, 0) * ~moved[2]
        backups.append(backup / len(noise))
    again = nearest_weights(BASES, STATES, torch.stack(backups, 1))
    torch.testing.assert_close(again, w, rtol=0, atol=1e-4)
    assert w.max() > 0.5


def test_a_search_without_a_fixed_point_says_so():
    plan = GridPlan(Rooms.from_doors([[5.0]]).select([0] * 1024), None, torch.zeros(1, 2), None)
    with pytest.raises(ArithmeticError, match="no fixed point"):
        projected_weights(BASES, plan, STATES, 100.0, torch.full((BASES.d,), torch.nan).double())
