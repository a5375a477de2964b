"""Every posterior against a slow one that inverts L at each step, and those in C++ in blocks."""

import math
from types import SimpleNamespace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from vtlib import posteriors
from vtlib.posteriors import CALM, COVARIANCES, LARGE, MANY, Descent, Posterior
from vtlib.posteriors.dense import Dense
from vtlib.posteriors.diagonal import Diagonal
from vtlib.posteriors.native import DRAWS, MOST_SAMPLES, Blocked, Fused
from vtlib.priors import GaussianPrior, Precision, Start
from vtlib.rng import Stream

KINDS = [Dense, Fused, Blocked, Diagonal]
STEPS, SAMPLES, ALPHA = 100, 3, 0.05
NEVER, SOMETIMES, ALWAYS, ANY = range(1), range(1, STEPS), range(STEPS, STEPS + 1), range(STEPS + 1)
PULL = 0.02


def draw(*shape: int, seed: int) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def streams(runs: int) -> Stream:
    return Stream("posteriors", range(runs), "posterior")


class Slow:
    """Eqs. 5.9 to 5.11 as they are written, in float64, with no shortcut."""

    def __init__(self, kind, start, precision, descent, noise):
        self.mu, self._descent, self._noise = start.mu.double(), descent, noise
        runs, components, d = self.mu.shape
        self._eye = eye = torch.eye(d, dtype=torch.float64)
        self._precision = precision.times(torch.eye(d).expand(runs, d, d)).double().unsqueeze(1)
        spread = torch.zeros(runs, d, 1) if start.spread is None else start.spread
        covariance = (spread.double() @ spread.double().mT + start.variance * eye).unsqueeze(1)
        if kind is Diagonal:
            covariance = self._precision.diagonal(dim1=2, dim2=3).reciprocal().diag_embed()
        self._free = eye if kind is Diagonal else torch.ones_like(eye).tril()
        self.L = torch.linalg.cholesky(covariance).repeat(1, components, 1, 1)
        self.L.diagonal(dim1=2, dim2=3).clamp_(min=descent.sigma_min)
        self.clipped = self.held = self.pulled = 0

    def sample(self, draws: int = SAMPLES + 1) -> Tensor:
        runs, components, d = self.mu.shape
        z = self._noise.normal(components * draws * d)
        self.z = z.view(runs, components, draws, d).double()
        return self.mu.unsqueeze(2) + self.z @ self.L.mT

    def gradient(self, gradients: Tensor, kl_weight: float) -> Tensor:
        inverse = torch.linalg.solve_triangular(self.L, self._eye, upper=False)
        pull = self._precision @ self.L - inverse.mT
        if self._descent.kl == "diagonal":
            own, of_prior = (x.diagonal(dim1=2, dim2=3) for x in (self.L, self._precision))
            pull = (of_prior * own - 1 / own).diag_embed()
        most = self._descent.kl_clip or math.inf
        self.pulled += int((self._free * pull.abs() > most).any())
        of_error = gradients.double().mT @ self.z[:, :, 1:]
        return self._free * (of_error + kl_weight * pull.clamp(-most, most))

    def step(self, gradients: Tensor, kl_weight: float) -> None:
        gradient, clip = self.gradient(gradients, kl_weight), self._descent.clip or math.inf
        self.clipped += int((gradient.abs() > clip).any())
        self.L = self.L - self._descent.alpha * gradient.clamp(-clip, clip)
        diagonal = self.L.diagonal(dim1=2, dim2=3)
        self.held += int((diagonal < self._descent.sigma_min).any())
        diagonal.clamp_(min=self._descent.sigma_min)


@pytest.mark.parametrize(
    ("kind", "low_rank"),
    [*((kind, False) for kind in KINDS), (Dense, True), (Fused, True), (Diagonal, True)],
)
@pytest.mark.parametrize(
    ("d", "variance", "scale", "descent", "clipped", "held"),
    [
        (1, 0.3, 0.02, Descent(ALPHA, 1e-4, 1000.0), NEVER, NEVER),
        (4, 0.3, 0.02, Descent(ALPHA, 1e-4), NEVER, NEVER),
        (10, 0.3, 0.3, Descent(ALPHA, 0.15, 1000.0), NEVER, SOMETIMES),
        (17, 0.3, 0.05, Descent(ALPHA, 0.05, 1.0), SOMETIMES, ANY),
        (40, 0.3, 0.01, Descent(ALPHA, 1e-4, 1000.0), NEVER, NEVER),
        # a start below sigma_min is lifted to it: what decides about clipping rests on that
        (10, 0.01, 0.1, Descent(ALPHA, 0.5, 0.02), ALWAYS, ANY),
        (9, 0.3, 0.1, Descent(ALPHA, 0.35, 0.5, "diagonal"), SOMETIMES, SOMETIMES),
        (9, 0.3, 0.02, Descent(ALPHA, 1e-4, 1000.0, "full", 0.2), NEVER, NEVER),
        (17, 0.3, 0.05, Descent(ALPHA, 0.05, 1.0, "full", 0.05), SOMETIMES, ANY),
        # as of the first weights of GVT, which hardly vary: the divergence asks for steps of 1e4
        (40, 1e-8, 0.01, Descent(ALPHA, 1e-4, None, "full", 0.1), NEVER, ANY),
        (10, 1e-8, 0.02, Descent(ALPHA, 1e-4, 1000.0, "diagonal", 0.2), NEVER, ANY),
    ],
)
def test_steps_equal_the_slow_update(kind, low_rank, d, variance, scale, descent, clipped, held):
    runs, components, precision = 2, 2, Precision(5.0)
    if low_rank:
        runs, components = 3, 1
        precision = GaussianPrior(draw(runs, 4, d, seed=7), 0.2).precision
    spread = 0.4 * draw(runs, d, 3, seed=2) if d % 2 == 0 else None
    start = Start(draw(runs, components, d, seed=1), variance, spread)
    slow = Slow(kind, start, precision, descent, streams(runs))
    fast = kind(start, precision, descent, streams(runs), SAMPLES + 1)
    for t in range(STEPS):
        expected = slow.sample()
        # float32 is as accurate as that in sums of so few numbers
        close = 2e-5 * expected.abs().max().item()
        torch.testing.assert_close(fast.sample().double(), expected, rtol=0, atol=close)
        z = slow.z[:, :, 1:].float()
        # they on the whole shrink the factor, and one in 50 is far larger, as with a reward found
        gradients = (30.0 if t % 50 == 49 else 1.0) * scale * (0.2 * z + draw(*z.shape, seed=t))
        for each in (fast, slow):
            each.step(gradients, 0.02 * (1 + 3 * (t % 2)))
    close = 2e-5 * slow.L.abs().max().item()
    torch.testing.assert_close(fast.scale_tril.double(), slow.L, rtol=0, atol=close)
    assert torch.equal(fast.scale_tril, fast.scale_tril.tril())
    assert slow.clipped in clipped
    assert slow.held in held
    assert (slow.pulled > STEPS / 20) == (descent.kl_clip is not None)


def of_one_entry(kind, start, scale, descent, column) -> tuple[Posterior, Slow]:
    """A posterior and the slow one, with one sample whose noise has one entry."""
    z = torch.zeros(1, 1, 2, start.mu.shape[2])
    z[..., 1, column] = 1.0
    arguments = start, Precision(scale), descent, SimpleNamespace(normal=lambda _: z.flatten(1))
    fast, slow = kind(*arguments, 2), Slow(kind, *arguments)
    fast.sample()
    slow.sample(2)
    return fast, slow


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("td", "column", "weight", "scale", "variance", "kl", "sigma_min"),
    [
        (2e7, 1, 0.0, 5.0, 0.3, "full", 1e-3),  # the TD error's part alone
        (20.0, 1, 1.6, 5.0, 0.3, "full", 0.5),  # a pull that would leave nothing of L
        (20.0, 1, 1.5, 5.0, 0.3, "full", 0.5),
        (-1.0, 55, 1.0, 0.01, 0.01, "full", 0.1),  # the diagonal, pushed away from zero
        (1.0, 55, 1.0, 1.0, 900.0, "full", 3.0),  # the diagonal, pulled to the prior
        (1.0, 55, 1.0, 1.0, 900.0, "diagonal", 3.0),
    ],
)
def test_the_bound_on_gradients_is_felt_where_they_barely_exceed_it(
    kind, td, column, weight, scale, variance, kl, sigma_min
):
    # The cheap tests of whether clipping may bind are at their tightest for one sample whose
    # gradient and noise have one entry each: an entry 2 % beyond the clip must be cut to it.
    # Row and column are so far apart that posteriors which put a step off do so with this one.
    column = 55 if kind is Diagonal else column
    spread, gradient = torch.zeros(1, 60, 1), torch.zeros(1, 1, 1, 60)
    spread[0, 1], spread[0, 55] = 30.0, 40.0  # L has its largest entry there
    start = Start(torch.zeros(1, 1, 60), variance, spread if column == 1 and weight else None)
    gradient[..., 55] = td
    largest = None
    for share in (None, 0.5, 0.98, 1.02):
        clip = share and share * largest
        fast, slow = of_one_entry(kind, start, scale, Descent(0.125, sigma_min, clip, kl), column)
        entries = slow.gradient(gradient, weight).abs()
        largest = entries.max().item()
        assert entries[0, 0, 55, column] == largest
        for each in (fast, slow):
            each.step(gradient, weight)
        assert slow.clipped == (share in (0.5, 0.98))
        torch.testing.assert_close(fast.scale_tril.double(), slow.L, rtol=0, atol=1e-5 * largest)


@pytest.mark.parametrize("kind", [Dense, Fused, Blocked])
@pytest.mark.parametrize("column", [0, 49])
@pytest.mark.parametrize(("td", "clip"), [(4.0, 20.0), (9e3, 1e4)])
def test_a_factor_that_has_grown_is_clipped(kind, column, td, clip):
    # the pull of the KL, harmless at the start, exceeds the clip once the entries are large
    start, gradient = Start(torch.zeros(1, 1, 50), 0.25), torch.zeros(1, 1, 1, 50)
    fast, slow = of_one_entry(kind, start, 5.0, Descent(ALPHA, 0.5, clip), column)
    gradient[..., 49] = -td
    for t in range(28):
        # twenty steps up, then a pull of 5 for each unit of the largest entry
        for each in (fast, slow):
            each.step(gradient * (t < 20), float(t >= 20))
        assert slow.clipped == 0 or t >= 20
        torch.testing.assert_close(fast.scale_tril.double(), slow.L, rtol=1e-5, atol=1e-5)
        fast.sample()
    assert slow.clipped


def both(kind, d, samples, descent, members=(1, 1)) -> tuple[Fused | Blocked, Dense]:
    runs, precision = members[0], Precision(5.0)
    if members[1] == 1 and (kind is Fused or descent.kl == "diagonal"):
        precision = GaussianPrior(draw(runs, 4, d, seed=7), 0.2).precision
    spread = 0.4 * draw(runs, d, 3, seed=2) if d % 3 else None
    start = Start(draw(*members, d, seed=1), 0.3, spread)
    return tuple(k(start, precision, descent, streams(runs), samples) for k in (kind, Dense))


def assert_close(ours: Tensor, plain: Tensor) -> Tensor:
    """Up to rounding; the plain ones are returned."""
    torch.testing.assert_close(ours, plain, rtol=0, atol=2e-5 * plain.abs().max().item())
    return plain


def step(pair, gradients: Tensor, pull: float = PULL) -> None:
    for each in pair:
        each.step(gradients, pull)


# the same examples each time: in a hundred steps rounding can grow beyond the tolerance
@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    st.sampled_from([Fused, Blocked]),
    st.integers(1, 101) | st.just(200),
    st.integers(2, MOST_SAMPLES),
    st.tuples(st.integers(1, 2), st.integers(1, 3)),
    st.sampled_from(["full", "diagonal"]),
    st.sampled_from([None, 0.3, 1.0, 1000.0]),
    st.sampled_from([None, 2.0, 100.0]),
    st.sampled_from([1e-4, 0.1, 0.5]),
    st.sampled_from([0.02, 1.0]),
    # what is left of a factor: 1 - 5 alpha of it, most, a quarter, or less than nothing
    st.sampled_from([0.1, 3.0, 5.0, 9.0]),
    st.integers(1, MOST_SAMPLES),
)
def test_whatever_happens_in_a_block_equals_the_plain_update(
    kind, d, samples, members, kl, clip, kl_clip, sigma_min, pull, strong, used
):
    pair = both(kind, d, samples, Descent(0.05, sigma_min, clip, kl, kl_clip), members)
    # two blocks and the beginning of the next
    for t in range(2 * (DRAWS // samples) + 2):
        plain = assert_close(*(each.sample() for each in pair))[:, :, -used:]
        gradients = 0.02 * (0.2 * plain + draw(*plain.shape, seed=t))
        if t % 13 in (3, 4):
            gradients[:, -1] *= 30  # the others are left alone
        step(pair, gradients, strong if t % 17 == 9 else pull)
        if t % 5 == 1:
            step(pair, draw(*plain.shape, seed=t))  # without samples between
        if t % 7 == 3:
            assert_close(*(each.sample() for each in pair))  # with which no step is made
    ours, plain = (each.scale_tril for each in pair)
    assert_close(ours, plain)
    assert torch.equal(ours, ours.tril())


@pytest.mark.parametrize("kind", [Fused, Blocked])
def test_looking_at_the_factors_changes_nothing(kind):
    looked, alone = (both(kind, 67, 11, Descent(0.02, 1e-3))[0] for _ in range(2))
    for t in range(DRAWS // 11 + 3):
        assert torch.equal(looked.sample(), alone.sample())
        step((looked, alone), draw(1, 1, 10, 67, seed=t), 0.1)
        assert torch.equal(looked.scale_tril, looked.scale_tril)
    assert torch.equal(looked.scale_tril, alone.scale_tril)


@pytest.mark.parametrize("kind", [Fused, Blocked])
def test_weights_that_are_not_finite_stay_so(kind):
    ours, _ = both(kind, 100, 3, Descent(0.05, 0.1, 1000.0))
    for t in range(DRAWS):
        ours.sample()
        gradients = torch.zeros(1, 1, 2, 100)
        gradients[..., 70] = torch.nan if t == 5 else 0.0
        ours.step(gradients, PULL)
    assert ours.sample()[..., 70].isnan().all()


@pytest.mark.parametrize(
    ("d", "n_samples", "kl", "low_rank", "kind"),
    [
        (MANY - 1, MOST_SAMPLES, "full", False, Fused),
        (MANY, MOST_SAMPLES, "full", False, Blocked),
        (MANY, 2, "full", True, Fused),
        (MANY, 2, "diagonal", True, Blocked),
        (MANY, MOST_SAMPLES + 1, "full", False, Dense),
    ],
)
def test_a_full_covariance_is_updated_by_the_kernel_that_suits_it(
    monkeypatch, d, n_samples, kl, low_rank, kind
):
    start, stream = Start(torch.zeros(1, 1, d), 1.0), Stream("t", [0], "posterior")
    precision = Precision(1.0, torch.zeros(1, d, 2) if low_rank else None)
    arguments = start, precision, Descent(0.1, 1e-4, kl=kl), stream, n_samples
    assert type(COVARIANCES["full"](*arguments)) is kind
    monkeypatch.setattr(posteriors, "kernels", lambda: None)
    assert type(COVARIANCES["full"](*arguments)) is Dense


def test_a_large_covariance_is_diagonal_moves_calmly_and_says_so(caplog):
    stream = Stream("t", [0, 1], "posterior")
    start = Start(torch.zeros(2, 1, LARGE), 1.0)
    large = COVARIANCES["full"](start, Precision(1.0), Descent(0.1, 1e-4), stream, 2)
    assert (type(large), large._alpha) == (Diagonal, CALM)
    said = "covariances of 2000 weights are diagonal; 'dense' keeps them full"
    assert [x.getMessage() for x in caplog.records] == [said]
