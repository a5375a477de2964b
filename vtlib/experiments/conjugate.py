"""The learned posterior beside the exact one, where that is known: linear regression."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from matplotlib.typing import LineStyleType
from torch import Tensor

from vtlib.gaussian import Gaussian, kl, sources_mean_and_spread
from vtlib.plots import BookFigure, Curve, draw_curves, look
from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.streams import Stream
from vtlib.transfer import PRIOR_JITTER, Settings, VariationalTransfer

NAME, RUNS, INPUTS, NOISE = "conjugate", 10, 3, 0.5
BAYES = 2 * NOISE**2  # the lambda at which the minimiser of eq. 5.2 is Bayes' posterior
SOURCES = 6
LOOKS: tuple[tuple[str, LineStyleType], ...] = (
    ("#08306b", "-"),
    ("#4292c6", "--"),
    ("#6baed6", ":"),
)


@dataclass(frozen=True)
class Regression:
    """Rewards that are linear in the observation, with noise: sources, observations and rewards.

    Every transition is terminal, so that the reward is the target and the posterior is Gaussian.
    """

    sources: Tensor
    obs: Tensor
    reward: Tensor

    def exact(self, count: int, lambda_: float) -> Gaussian:
        """The minimiser of eq. 5.2 after ``count`` transitions: p(w) exp(-sum of errors / lambda).

        Shapes (R, d) and (R, d, d), in float64.
        """
        center, spread = sources_mean_and_spread(self.sources.double())
        eye = torch.eye(INPUTS + 1, dtype=torch.float64)
        prior = torch.linalg.inv(spread @ spread.mT + PRIOR_JITTER * eye)
        obs = self.obs[:, :count].double()
        x = torch.cat([obs, torch.ones_like(obs[..., :1])], -1)
        precision = prior + 2 / lambda_ * x.mT @ x
        pull = prior @ center.unsqueeze(-1)
        pull += 2 / lambda_ * x.mT @ self.reward[:, :count].double().unsqueeze(-1)
        mean = torch.linalg.solve(precision, pull).squeeze(-1)
        return Gaussian(mean, torch.linalg.cholesky(torch.linalg.inv(precision)))


def regression(count: int) -> Regression:
    """Ten regressions of three inputs and a constant, each with data and sources of its own."""
    runs = range(RUNS)
    true = Stream(NAME, runs, "task").normal(INPUTS + 1)
    around = Stream(NAME, runs, "sources").normal(SOURCES * (INPUTS + 1))
    sources = true.unsqueeze(1) + around.view(RUNS, SOURCES, INPUTS + 1)
    obs = Stream(NAME, runs, "observations").normal(count * INPUTS).view(RUNS, count, INPUTS)
    noise = Stream(NAME, runs, "noise").normal(count)
    reward = torch.einsum("rnd,rd->rn", obs, true[:, :INPUTS]) + true[:, INPUTS:] + NOISE * noise
    return Regression(sources, obs, reward)


def distances(settings: Settings, at: Sequence[int]) -> np.ndarray:
    """KL (R, T, 2) of the learned posterior to the exact one after some numbers of transitions.

    Its two parts: what is left when the covariances are equal, which the means cause, and the rest.
    """
    task, runs = regression(max(at)), range(RUNS)
    streams = [Stream(NAME, runs, role) for role in ("posterior", "component", "replay")]
    agent = VariationalTransfer(MLP((INPUTS, 1)), task.sources, INPUTS, settings, *streams)
    action, terminal = torch.zeros(RUNS, dtype=torch.int64), torch.ones(RUNS, dtype=torch.bool)
    found = []
    for t in range(max(at)):
        obs = task.obs[:, t]
        agent.learn(Transition(obs, action, task.reward[:, t], obs, terminal))
        if t + 1 in at:
            learned = Gaussian(agent.mu[:, 0].detach().double(), agent.L[:, 0].double())
            exact = task.exact(t + 1, settings.lambda_)
            centred = Gaussian(exact.mu, learned.L)
            of_means = kl(Gaussian(learned.mu, exact.L), exact)
            found.append(torch.stack([of_means, kl(centred, exact)], -1))
    return torch.stack(found, 1).numpy()


def conjugate_figure(at: Sequence[int], each: Sequence[tuple[Settings, np.ndarray]]) -> Figure:
    """Both parts of the distance over transitions, for (settings, distances) of step sizes."""
    with look():
        figure = BookFigure(figsize=(7.6, 3.4))
        axes = figure.subplots(1, 2, sharey=True)
        for part, (ax, title) in enumerate(zip(axes, ("means", "covariances"), strict=True)):
            curves = [
                Curve(
                    rf"$\alpha_\mu$ = {s.alpha_mu:g}, $\alpha_L$ = {s.alpha_L:g}",
                    np.array(at),
                    np.log10(found[..., part]),
                    shade,
                    style,
                )
                for (s, found), (shade, style) in zip(each, LOOKS, strict=True)
            ]
            draw_curves(ax, curves)
            ax.set(title=f"part of the {title}", xlabel="thousand transitions")
            # the mean of logarithms: its interval stays positive
            ax.yaxis.set_major_formatter(lambda x, _: f"$10^{{{x:g}}}$")
            ax.yaxis.set_major_locator(MultipleLocator(1))
        axes[0].set_ylabel("KL to the exact posterior")
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure
