"""The bound on the KL of two mixtures against the KL itself, as one component moves."""

from __future__ import annotations

import numpy as np
import torch
from matplotlib.figure import Figure
from torch import Tensor
from torch.distributions import Categorical, MixtureSameFamily, Normal

from vtlib.illustrations.picture import BLUE, GREY, ORANGE, picture
from vtlib.priors import Gaussian, kl_bound, pairwise_kl, responsibilities

PLACES = torch.arange(-10, 11, dtype=torch.float64) / 4  # of the moving component
SOURCES = torch.tensor([-1.5, 0.3, 1.2], dtype=torch.float64)
WIDTH = torch.tensor(0.4, dtype=torch.float64)  # sigma_p
RESTING = 1.0  # mean of the other component
DEVIATIONS = torch.tensor([0.5, 0.3], dtype=torch.float64)  # of the two


def mixture(mu: Tensor, deviation: Tensor) -> MixtureSameFamily:
    """Equally weighted Gaussians on a line, from means (..., C) and deviations () or (C,)."""
    return MixtureSameFamily(Categorical(torch.ones_like(mu)), Normal(mu, deviation))


PRIOR = mixture(SOURCES, WIDTH)


def means(places: Tensor) -> Tensor:
    """Means (..., 2) of the posterior's components, the first at each of the places (...)."""
    return torch.stack([places, torch.full_like(places, RESTING)], -1)


def tightened(places: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The bound of eq. 5.13 (P,) at places (P,), and its tables (P, C, S) of eqs. 5.14, 5.15."""
    q = Gaussian(means(places).unsqueeze(-1), DEVIATIONS.view(2, 1, 1))
    pairwise = pairwise_kl(q, SOURCES.unsqueeze(-1), float(WIDTH) ** 2)
    log_theta, log_phi = responsibilities(pairwise)
    return kl_bound(pairwise, log_theta, log_phi), log_theta.exp(), log_phi.exp()


def sampled_kl(
    q: MixtureSameFamily, p: MixtureSameFamily, samples: int, rng: np.random.Generator
) -> tuple[Tensor, Tensor]:
    """KL(q || p) (...) of mixtures, eq. 2.17, by that many samples of each component of q.

    Returns the estimate and its standard error, which counts the components as strata.
    """
    mu, deviation = q.component_distribution.mean, q.component_distribution.stddev
    noise = torch.from_numpy(rng.standard_normal((*mu.shape, samples)))
    x = (mu.unsqueeze(-1) + deviation.unsqueeze(-1) * noise).movedim((-2, -1), (0, 1))
    ratios = q.log_prob(x) - p.log_prob(x)
    return ratios.mean((0, 1)), (ratios.var(1).sum(0) / samples).sqrt() / len(ratios)


@picture(6.5, 5.0)
def bound_picture(figure: Figure, estimates: Tensor, errors: Tensor, place: float) -> str:
    """Densities, bound (eq. 5.13) and KL over PLACES (P,), and the tables at one of the places."""
    bounds, thetas, phis = tightened(PLACES)
    now = PLACES.tolist().index(place)
    theta, phi = thetas[now].numpy(), phis[now].numpy()
    (densities, curves), tables = figure.subplots(2, 2, height_ratios=(1.4, 1))
    x = torch.linspace(-4, 4, 401, dtype=torch.float64)
    q = mixture(means(PLACES[now]), DEVIATIONS).log_prob(x).exp()
    densities.fill_between(x, PRIOR.log_prob(x).exp(), color=GREY, alpha=0.3, lw=0, label="prior p")
    densities.plot(x, q, color=ORANGE, label="posterior q")
    for name, at in (("1", place), ("2", RESTING)):
        densities.text(at, -0.1, name, color=ORANGE, ha="center", va="center", weight="bold")
    densities.set(xlim=(-4, 4), ylim=(-0.18, 1.15), xlabel="weight", ylabel="density")
    densities.legend(loc="upper left", handlelength=1.2)
    curves.plot(PLACES, bounds, color=ORANGE, label="bound on the KL")
    curves.errorbar(
        PLACES, estimates, 2 * errors, fmt=".", color=BLUE, ms=4, lw=1, label="KL, sampled"
    )
    curves.plot(place, bounds[now], "o", color=ORANGE, ms=8)
    curves.plot(place, estimates[now], "o", color=BLUE, ms=8, mfc="none")
    curves.set(ylim=(-0.1, 4), xlabel="place of component 1", ylabel="nats")
    curves.legend(loc="upper center")
    shown = (theta, "ϑ: rows sum to 1/2"), (phi, "φ: columns sum to 1/3")
    for ax, (table, title) in zip(tables, shown, strict=True):
        ax.imshow(table, cmap="Oranges", vmin=0, vmax=0.6, aspect="auto")
        for (i, j), value in np.ndenumerate(table):
            ax.text(j, i, f"{value:.2f}", ha="center", va="center")
        ax.set_xticks(range(3), [f"{w:g}" for w in SOURCES])
        ax.set_yticks(range(2), ["1", "2"])
        ax.set(xlabel="source at", ylabel="component", title=title)
        ax.grid(False)
    return (
        f"first component at {place:g}: bound {bounds[now]:.2f}, KL {estimates[now]:.2f} with "
        f"standard error {errors[now]:.2f}; its theta is {theta[0].round(2)}, its phi "
        f"{phi[0].round(2)}."
    )
