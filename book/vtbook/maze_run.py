"""The first run in a maze, computed anew: what it believes, and where its greedy policy goes."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from matplotlib.axes import Axes
from torch import Tensor

from vtbook.checkpoints import pauses
from vtbook.credible_intervals import posterior_samples
from vtbook.paths import walks
from vtlab.envs.maze import Mazes
from vtlab.envs.maze.draw import draw_maze
from vtlab.experiment import Experiment
from vtlab.run import prepare, targets
from vtlib.qfunctions import QFunction
from vtlib.rng import Rng, Stream, generator
from vtlib.transfer import VariationalTransfer

STARTS, SEEN, SAMPLES = 6, 200, 50
Policy = Callable[[Tensor], Tensor]  # actions (B,) at states (B, 3)


class Belief(NamedTuple):
    """At remembered states: the greedy value of the mean, and how far samples' values deviate."""

    value: float
    deviation: float


def maze_of(experiment: Experiment) -> Mazes:
    """The maze of the first run."""
    tasks = targets(experiment, [0])
    assert isinstance(tasks, Mazes)
    return tasks


def six_walks(experiment: Experiment, policy: Policy) -> list[np.ndarray]:
    """States (T, 3) of six walks; starts and noise are the same for every policy."""
    rng = generator(experiment.stream, 0, "walks")
    copies = maze_of(experiment).select([0] * STARTS)
    start = copies.start(torch.from_numpy(rng.random((STARTS, Mazes.start_dim))))
    noise = rng.standard_normal((Mazes.horizon, STARTS, Mazes.noise_dim))
    return walks(copies, policy, start, torch.from_numpy(noise))


def follow(
    experiment: Experiment, label: str, weights: np.ndarray, at: Sequence[int]
) -> dict[int, Belief]:
    """What the first run of a posterior believes at some iterations."""
    batch, rng = prepare(experiment, label, [0], weights), Rng(experiment.stream, [0])
    probes, q = (rng.stream("probes"), rng.stream("probe samples")), experiment.family.q()
    assert isinstance(batch.agent, VariationalTransfer)
    return {t: _belief(q, batch.agent, *probes) for t in pauses(batch, at)}


def _belief(q: QFunction, agent: VariationalTransfer, chosen: Stream, noise: Stream) -> Belief:
    x, mu = q.prepare(agent.remembered(chosen.uniform(SEEN)).obs), agent.mu.detach()
    z = noise.normal(SAMPLES * q.d).view(1, 1, SAMPLES, q.d)
    spread = q.q(posterior_samples(mu, agent.scale_tril, z), x).std(1).mean()
    return Belief(float(q.q(mu, x).mean(1).amax(1).mean()), float(spread))


def draw_walks(
    ax: Axes, maze: Mazes, paths: Sequence[np.ndarray], colour: str, along: float
) -> None:
    """Walks with their starts as dots, and the first one's robot that far along its way."""
    first = paths[0]
    draw_maze(ax, maze, 0, first[round(along * (len(first) - 1))])
    for path in paths:
        ax.plot(*path[:, :2].T, color=colour, lw=1.1, alpha=0.8)
        ax.plot(*path[0, :2], "o", color=colour, ms=3.5)
