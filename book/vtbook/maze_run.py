"""The first run in a maze, computed anew: what it believes, and where its greedy policy goes."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import torch
from matplotlib.axes import Axes
from torch import Tensor

from vtbook.checkpoints import pauses
from vtbook.credible_intervals import posterior_samples
from vtbook.paths import walks
from vtbook.plots import COLOURS, BookFigure, figure_html, look
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


class Followed(NamedTuple):
    """What a run has believed, and the walks of its greedy policy, by iteration."""

    beliefs: dict[int, Belief]
    walks: dict[int, list[np.ndarray]]


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
    experiment: Experiment,
    label: str,
    weights: np.ndarray,
    believed: Sequence[int] = (),
    walked: Sequence[int] = (),
) -> Followed:
    """Beliefs and walks of a run at some iterations each; a belief takes a posterior."""
    batch, rng = prepare(experiment, label, [0], weights), Rng(experiment.stream, [0])
    probes, q = (rng.stream("probes"), rng.stream("probe samples")), experiment.family.q()
    maze, agent, followed = maze_of(experiment), batch.agent, Followed({}, {})

    def greedy(states: Tensor) -> Tensor:
        obs = maze.select([0] * len(states)).observe(states)
        return q.q(agent.mu.detach(), q.prepare(obs.unsqueeze(0)))[0].mean(0).argmax(0)

    for t in pauses(batch, sorted({*believed, *walked})):
        if t in believed:
            assert isinstance(agent, VariationalTransfer)
            followed.beliefs[t] = _belief(q, agent, *probes)
        if t in walked:
            followed.walks[t] = six_walks(experiment, greedy)
    return followed


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


def walks_picture(maze: Mazes, walked: Mapping[str, Sequence[np.ndarray]], iteration: int) -> str:
    """Where the robots of some algorithms go after an iteration, as an HTML picture."""
    goal = maze.goal[0].numpy()
    with look():
        figure, words = BookFigure(figsize=(7.6, 4.1)), []
        for ax, (label, paths) in zip(figure.subplots(1, len(walked)), walked.items(), strict=True):
            draw_walks(ax, maze, paths, COLOURS[label], along=1.0)
            ax.set_title(label)
            arrived = sum((path[-1, :2].astype(int) == goal).all() for path in paths)
            words.append(f"{label}: {arrived} of {len(paths)} robots reach the goal")
        figure.suptitle(f"iteration {iteration:,}", x=0.01, ha="left", fontsize=10)
        alt = f"Walks of the greedy policies after {iteration} iterations. {'; '.join(words)}."
        return figure_html(figure, alt)
