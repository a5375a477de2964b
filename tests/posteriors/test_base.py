"""Every posterior against a slow one that inverts L at each step, and its samples' moments."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from vtlib.posteriors import Descent, Posterior
from vtlib.posteriors.blocked import Blocked
from vtlib.posteriors.dense import Dense
from vtlib.posteriors.diagonal import Diagonal
from vtlib.posteriors.fused import Fused
from vtlib.posteriors.native import MOST_SAMPLES
from vtlib.priors import Precision, Start, low_rank_precision, sources_mean_and_spread
from vtlib.rng import Stream

KINDS = [Dense, Fused, Blocked, Diagonal]
PRIORS = {"isotropic": (2, 2), "low rank": (3, 1)}  # runs and components
STEPS, SAMPLES, ALPHA = 200, 3, 0.05


def draw(*shape: int, seed: int) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def noise(runs: int) -> Stream:
    return Stream("posteriors", range(runs), "posterior")


class Given:
    """A stream of one draw (R, n), again and again."""

    def __init__(self, z: Tensor) -> None:
        self._z = z.flatten(1)

    def normal(self, n: int) -> Tensor:
        return self._z


class Slow:
    """Eqs. 5.9 to 5.11 as they are written, in float64, with no shortcut."""

    def __init__(self, start: Start, precision: Precision, descent: Descent, kind: type) -> None:
        runs, components, d = start.mu.shape
        eye = torch.eye(d, dtype=torch.float64)
        self.mu, self._noise, self._descent = start.mu.double(), noise(runs), descent
        self._precision = precision.times(torch.eye(d).expand(runs, d, d)).double().unsqueeze(1)
        if kind is Diagonal:
            L = self._precision.diagonal(dim1=2, dim2=3).rsqrt().diag_embed()
        else:
            spread = torch.zeros(runs, d, 1) if start.spread is None else start.spread
            covariance = spread.double() @ spread.double().mT + start.variance * eye
            L = torch.linalg.cholesky(covariance).unsqueeze(1)
        self.L = L.repeat(1, components, 1, 1)
        self.L.diagonal(dim1=2, dim2=3).clamp_(min=descent.sigma_min)
        self._free = eye if kind is Diagonal else torch.ones_like(eye).tril()
        self.clipped = self.held = self.pulled = 0

    def sample(self) -> Tensor:
        runs, components, d = self.mu.shape
        z = self._noise.normal(components * (SAMPLES + 1) * d)
        self.z = z.view(runs, components, SAMPLES + 1, d).double()
        return self.mu.unsqueeze(2) + self.z @ self.L.mT

    def gradient(self, gradients: Tensor, kl_weight: float) -> Tensor:
        pull = self._precision @ self.L - torch.linalg.inv(self.L).mT
        if self._descent.kl == "diagonal":
            diagonals = self._precision.diagonal(dim1=2, dim2=3), self.L.diagonal(dim1=2, dim2=3)
            pull = (diagonals[0] * diagonals[1] - 1 / diagonals[1]).diag_embed()
        most = math.inf if self._descent.kl_clip is None else self._descent.kl_clip
        self.pulled += int((self._free * pull.abs() > most).any())
        pull = pull.clamp(-most, most)
        return self._free * (gradients.double().mT @ self.z[:, :, 1:] + kl_weight * pull)

    def step(self, gradients: Tensor, kl_weight: float) -> None:
        gradient = self.gradient(gradients, kl_weight)
        clip = math.inf if self._descent.clip is None else self._descent.clip
        self.clipped += int((gradient.abs() > clip).any())
        self.L = self.L - self._descent.alpha * gradient.clamp(-clip, clip)
        diagonal = self.L.diagonal(dim1=2, dim2=3)
        self.held += int((diagonal < self._descent.sigma_min).any())
        diagonal.clamp_(min=self._descent.sigma_min)


def problem(prior: str, d: int) -> tuple[Start, Precision]:
    runs, components = PRIORS[prior]
    precision = Precision(5.0)
    if prior == "low rank":
        precision = low_rank_precision(sources_mean_and_spread(draw(runs, 4, d, seed=7))[1], 0.2)
    mu, spread = draw(runs, components, d, seed=1), 0.4 * draw(runs, d, 3, seed=2)
    return Start(mu, 0.3, spread if d % 2 == 0 else None), precision


def pair(kind: type, prior: str, d: int, descent: Descent) -> tuple[Posterior, Slow]:
    start, precision = problem(prior, d)
    slow = Slow(start, precision, descent, kind)
    return kind(start, precision, descent, noise(len(start.mu)), SAMPLES + 1), slow


def gradients(slow: Slow, scale: float, t: int) -> Tensor:
    """Gradients of samples that on the whole shrink the factor."""
    z = slow.z[:, :, 1:].float()
    # one step in 50 is far larger, as when a reward is found
    return (30.0 if t % 50 == 49 else 1.0) * scale * (0.2 * z + draw(*z.shape, seed=1000 + t))


@pytest.mark.parametrize(
    ("kind", "prior"),
    [(kind, prior) for kind in KINDS for prior in PRIORS if (kind, prior) != (Blocked, "low rank")],
)
@pytest.mark.parametrize(
    ("d", "scale", "descent", "clipped", "held"),
    [
        (1, 0.02, Descent(ALPHA, 1e-4, 1000.0), "never", "never"),
        (4, 0.02, Descent(ALPHA, 1e-4), "never", "never"),
        (9, 0.02, Descent(ALPHA, 1e-4, 1000.0), "never", "never"),
        (10, 0.3, Descent(ALPHA, 0.15, 1000.0), "never", "sometimes"),
        (3, 0.1, Descent(ALPHA, 0.05, 0.5), "sometimes", "any"),
        (17, 0.05, Descent(ALPHA, 0.05, 1.0), "sometimes", "any"),
        (40, 0.01, Descent(ALPHA, 1e-4, 1000.0), "never", "never"),
        (10, 0.1, Descent(ALPHA, 0.05, 0.02), "always", "any"),
        (8, 0.02, Descent(ALPHA, 1e-4, None, "diagonal"), "never", "never"),
        (9, 0.1, Descent(ALPHA, 0.35, 0.5, "diagonal"), "sometimes", "sometimes"),
        (9, 0.02, Descent(ALPHA, 1e-4, 1000.0, "full", 0.2), "never", "never"),
        (17, 0.05, Descent(ALPHA, 0.05, 1.0, "full", 0.05), "sometimes", "any"),
        (40, 0.01, Descent(ALPHA, 1e-4, None, "full", 0.1), "never", "never"),
        (10, 0.02, Descent(ALPHA, 1e-4, 1000.0, "diagonal", 0.2), "never", "never"),
    ],
)
def test_steps_equal_the_slow_update(kind, prior, d, scale, descent, clipped, held):
    fast, slow = pair(kind, prior, d, descent)
    for t in range(STEPS):
        expected = slow.sample()
        # float32 is as accurate as that in sums of so few numbers
        close = 2e-5 * expected.abs().max().item()
        torch.testing.assert_close(fast.sample().double(), expected, rtol=0, atol=close)
        weight = 0.02 * (1 + 3 * (t % 2))
        for each in (fast, slow):
            each.step(gradients(slow, scale, t), weight)
    close = 2e-5 * slow.L.abs().max().item()
    torch.testing.assert_close(fast.scale_tril.double(), slow.L, rtol=0, atol=close)
    assert torch.equal(fast.scale_tril, fast.scale_tril.tril())
    shares = {"never": (0, 0), "sometimes": (1, STEPS - 1), "always": (STEPS, STEPS)}
    for count, wanted in ((slow.clipped, clipped), (slow.held, held)):
        least, most = shares.get(wanted, (0, STEPS))
        assert least <= count <= most
    assert (slow.pulled > STEPS / 20) == (descent.kl_clip is not None)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("kl", ["full", "diagonal"])
@pytest.mark.parametrize("weight", [1e-3, 0.1])
def test_the_divergences_gradient_is_bounded_entry_by_entry_before_it_is_weighted(kind, kl, weight):
    # a deviation of 1e-4, as of the first weights of GVT: the divergence asks for steps of 1e4
    spread, precision = torch.tensor([3.0, -2.0, 0.005]).view(1, 3, 1), Precision(700.0)
    start = Start(torch.zeros(1, 1, 3), 1e-8, None if kind is Diagonal else spread)
    fast = kind(start, precision, Descent(ALPHA, 1e-4, None, kl, 100.0), noise(1), 2)
    if kind is Diagonal:
        fast._sigma.fill_(1e-4)
    before, bound = fast.scale_tril.double()[0, 0], ALPHA * weight * 100
    fast.sample()
    fast.step(torch.zeros(1, 1, 1, 3), weight)
    moved = fast.scale_tril.double()[0, 0] - before
    expected = torch.full((3, 3), 0.0, dtype=torch.float64)
    if kind is not Diagonal:  # whose first column is as large as the spread
        if kl == "full":
            expected[1, 0], expected[2, 0] = bound, -ALPHA * weight * 3.5
        expected[0, 0] = -bound
        expected[1, 1] = expected[2, 2] = bound
    else:
        expected = bound * torch.eye(3, dtype=torch.float64)
    torch.testing.assert_close(moved, expected, rtol=0, atol=1e-3 * bound)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("td", "column", "weight", "scale", "variance", "kl", "sigma_min"),
    [
        (2e7, 1, 0.0, 5.0, 0.3, "full", 1e-3),  # the TD error's part alone
        (20.0, 1, 2.0, 5.0, 0.3, "full", 0.5),  # a pull that would leave nothing of L
        (20.0, 1, 1.9, 5.0, 0.3, "full", 0.5),
        (-1.0, 55, 1.0, 0.01, 0.01, "full", 0.1),  # the diagonal, pushed away from zero
        (1.0, 55, 1.0, 1.0, 900.0, "full", 3.0),  # the diagonal, pulled to the prior
        (1.0, 55, 1.0, 1.0, 900.0, "diagonal", 3.0),
    ],
)
@pytest.mark.parametrize("share", [0.5, 0.98, 1.02, None])
def test_the_bound_on_gradients_is_felt_where_they_barely_exceed_it(
    kind, td, column, weight, scale, variance, kl, sigma_min, share
):
    # The cheap tests of whether clipping may bind are at their tightest for one sample whose
    # gradient and noise have one entry each: an entry 2 % beyond the clip must be cut to it.
    # Row and column are so far apart that posteriors which put a step off do so with this one.
    column = 55 if kind is Diagonal else column
    spread = torch.zeros(1, 60, 1)
    spread[0, 1], spread[0, 55] = 30.0, 40.0  # L has its largest entry there
    start = Start(torch.zeros(1, 1, 60), variance, spread if column == 1 and weight else None)
    z, gradient = torch.zeros(1, 1, 2, 60), torch.zeros(1, 1, 1, 60)
    z[..., 1, column], gradient[..., 55] = 1.0, td

    def made(clip: float | None) -> tuple[Posterior, Slow]:
        descent = Descent(0.1, sigma_min, clip, kl)
        slow = Slow(start, Precision(scale), descent, kind)
        fast = kind(start, Precision(scale), descent, Given(z), 2)
        fast.sample()
        slow.z = z.double()
        return fast, slow

    entries = made(1.0)[1].gradient(gradient, weight).abs()
    largest = entries.max().item()
    assert entries[0, 0, 55, column] == largest
    fast, slow = made(None if share is None else share * largest)
    for each in (fast, slow):
        each.step(gradient, weight)
    assert slow.clipped == (share in (0.5, 0.98))
    torch.testing.assert_close(fast.scale_tril.double(), slow.L, rtol=0, atol=1e-5 * largest)


@pytest.mark.parametrize("kind", [Dense, Fused, Blocked])
@pytest.mark.parametrize("column", [0, 49])
@pytest.mark.parametrize(("td", "clip"), [(4.0, 20.0), (9e3, 1e4)])
def test_a_factor_that_has_grown_is_clipped(kind, column, td, clip):
    # the pull of the KL, harmless at the start, exceeds the clip once the entries are large
    start, descent = Start(torch.zeros(1, 1, 50), 0.25), Descent(ALPHA, 0.5, clip)
    z, gradient = torch.zeros(1, 1, 2, 50), torch.zeros(1, 1, 1, 50)
    z[..., 1, column], gradient[..., 49] = 1.0, -td
    fast = kind(start, Precision(5.0), descent, Given(z), 2)
    slow = Slow(start, Precision(5.0), descent, kind)
    slow.z = z.double()
    for t in range(28):
        fast.sample()
        # twenty steps up, then a pull of 5 for each unit of the largest entry
        for each in (fast, slow):
            each.step(gradient * (t < 20), float(t >= 20))
        assert slow.clipped == 0 or t >= 20
        torch.testing.assert_close(fast.scale_tril.double(), slow.L, rtol=1e-5, atol=1e-5)
    assert slow.clipped


@pytest.mark.parametrize("kind", KINDS)
def test_a_start_below_sigma_min_is_lifted_to_it(kind):
    # the bounds that decide about clipping rest on 1 / L_ii being at most 1 / sigma_min
    start = Start(torch.zeros(1, 1, 7), 1e-8)
    fast = kind(start, Precision(1e8), Descent(ALPHA, 0.1, 10.0), noise(1), 2)
    assert torch.equal(fast.scale_tril[0, 0], 0.1 * torch.eye(7))


@pytest.mark.parametrize("kind", KINDS)
def test_samples_have_the_posteriors_moments(kind):
    d, draws, runs = 4, 1_500, 2
    start, precision = Start(draw(runs, 2, d, seed=1), 0.3), Precision(5.0)
    start = start._replace(spread=0.4 * draw(runs, d, 3, seed=2))
    fast = kind(start, precision, Descent(0.1, 1e-3, 1000.0), noise(runs), MOST_SAMPLES)
    for t in range(3):
        assert fast.sample().shape == (runs, 2, MOST_SAMPLES, d)
        fast.step(0.5 * draw(runs, 2, 3, d, seed=t), 0.02)
        fast.mu.add_(0.1)
    x = torch.cat([fast.sample() for _ in range(draws)], 2) - fast.mu.unsqueeze(2)
    white = torch.linalg.solve_triangular(fast.scale_tril, x.mT, upper=False).double()
    # standard normal: errors of 1 / sqrt(n) and of sqrt(2 / n), five of each
    count = draws * MOST_SAMPLES
    assert white.mean(-1).abs().max() < 5 / count**0.5
    covariance = white @ white.mT / count
    assert (covariance - torch.eye(d)).abs().max() < 5 * (2 / count) ** 0.5
