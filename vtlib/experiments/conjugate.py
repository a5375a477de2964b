"""The learned posterior beside the exact one, where that is known: linear regression."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from matplotlib.figure import Figure
from torch import Tensor

from vtlib.gaussian import Gaussian, kl
from vtlib.plots import BookFigure, Curve, draw_curves, look
from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.streams import Stream
from vtlib.transfer import PRIOR_JITTER, Settings, VariationalTransfer

NAME, RUNS, INPUTS, NOISE = "conjugate", 10, 3, 0.5
SOURCES = 6
SHADES = ("#9ecae1", "#4292c6", "#08306b")


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
        sources = self.sources.double()
        spread = sources - sources.mean(1, keepdim=True)
        eye = torch.eye(INPUTS + 1, dtype=torch.float64)
        prior = torch.linalg.inv(spread.mT @ spread / SOURCES + PRIOR_JITTER * eye)
        obs = self.obs[:, :count].double()
        x = torch.cat([obs, torch.ones_like(obs[..., :1])], -1)
        precision = prior + 2 / lambda_ * x.mT @ x
        pull = prior @ sources.mean(1).unsqueeze(-1)
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
    """KL (R, T) of the learned posterior to the exact one after some numbers of transitions."""
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
            found.append(kl(learned, task.exact(t + 1, settings.lambda_)))
    return torch.stack(found, 1).numpy()


def conjugate_figure(at: Sequence[int], each: Sequence[tuple[float, np.ndarray]]) -> Figure:
    """The distance over transitions for each step size of L: (alpha_L, distances) pairs."""
    with look():
        figure = BookFigure(figsize=(6.4, 3.4))
        ax = figure.subplots()
        for (alpha, found), shade in zip(each, SHADES, strict=True):
            label = rf"$\alpha_L$ = {alpha:g}"
            draw_curves(ax, [Curve(label, np.array(at), found, shade)])
        ax.set(yscale="log", ylabel="KL to the exact posterior", xlabel="thousand transitions")
        ax.legend()
    return figure
