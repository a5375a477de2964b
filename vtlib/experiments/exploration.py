"""Where agents go in two rooms, and what they believe on the way (section 6.1.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from vtlib.domains import rooms_q
from vtlib.envs.draw import draw_rooms
from vtlib.envs.episodes import RecordedEpisodes
from vtlib.envs.rooms import SIDE, Rooms
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.runs import prepare, targets
from vtlib.experiments.work import load_result
from vtlib.plots import COLOURS, BookFigure, image_html, look, small_png
from vtlib.store import results_folder
from vtlib.streams import generator
from vtlib.transfer import VariationalTransfer

NODES = 41  # of the grid on which a posterior is drawn, across and up
SAMPLES = 60  # a multiple of every number of components


def visited(name: str, label: str) -> np.ndarray:
    """Positions (R, T, 2) that the runs of one algorithm arrived at."""
    return load_result(name, label, results_folder())[0]["visited"]


def _rooms(experiment: Experiment, run: int = 0) -> Rooms:
    """The target task of one run."""
    tasks = targets(experiment, [run])
    assert isinstance(tasks, Rooms)
    return tasks


def overlay_figure(experiment: Experiment, labels: Sequence[str], run: int = 0) -> Figure:
    """Positions visited in one run by epsilon-greedy, and by each algorithm over them."""
    tasks = _rooms(experiment, run)
    behind = visited(experiment.name, "NT")[run]
    with look():
        figure = BookFigure(figsize=(7.6, 3.9))
        axes = figure.subplots(1, len(labels), squeeze=False)[0]
        for ax, label in zip(axes, labels, strict=True):
            draw_rooms(ax, tasks, start_color="black")
            ax.plot(*behind.T, ".", ms=3, color="#b0b0b0", label="ε-greedy")
            mine = visited(experiment.name, label)[run]
            ax.plot(*mine.T, ".", ms=3, alpha=0.6, color=COLOURS[label], label=label)
            ax.set_title(f"ε-greedy and {label}")
            ax.grid(False)
            ax.legend(loc="upper left", frameon=True, framealpha=0.9, markerscale=3, fontsize=9)
    return figure


def density_figure(experiment: Experiment, labels: Sequence[str]) -> Figure:
    """Visits per unit cell over all runs of each algorithm, on one logarithmic scale."""
    edges = np.arange(SIDE + 1)
    with look():
        figure = BookFigure(figsize=(7.6, 2.9))
        axes = figure.subplots(1, len(labels), squeeze=False)[0]
        for ax, label in zip(axes, labels, strict=True):
            at = visited(experiment.name, label)
            x, y = at.reshape(-1, 2).T
            counts, _, _ = np.histogram2d(x, y, bins=(edges, edges))
            share = counts.T / len(at) / at.shape[1]
            image = ax.imshow(
                np.where(share > 0, share, np.nan),
                norm="log",
                vmin=1e-4,
                vmax=0.2,
                origin="lower",
                extent=(0, SIDE, 0, SIDE),
                cmap="viridis",
            )
            draw_rooms(ax, _rooms(experiment), start_color="white")
            ax.grid(False)
            ax.set_title("ε-greedy" if label == "NT" else label)
        figure.colorbar(image, ax=axes, label="share of the visits", shrink=0.85)
    return figure


@dataclass(frozen=True)
class Snapshot:
    """A run at one iteration: positions (t, 2) so far, and max_a Q under its posterior.

    mean and deviation (41, 41) over posterior samples, on a grid of positions, bottom row first.
    """

    iteration: int
    path: np.ndarray
    mean: np.ndarray
    deviation: np.ndarray


def snapshots(
    experiment: Experiment, label: str, run: int, pool: np.ndarray, at: Sequence[int]
) -> list[Snapshot]:
    """Compute one run anew and look at its posterior at some iterations, 0 the start.

    Raises ValueError unless the experiment keeps its visits.
    """
    batch = prepare(experiment, label, experiment.algorithms[label], [run], pool)
    if not isinstance(batch.episodes, RecordedEpisodes):
        raise ValueError(f"{experiment.name} does not keep its visits")
    noise = generator(experiment.stream, run, "snapshots").standard_normal(
        (SAMPLES, rooms_q().d), np.float32
    )
    assert isinstance(batch.agent, VariationalTransfer)
    kept = []
    for t in batch.moments(at):
        path = batch.episodes.visited[0].numpy() if t else np.zeros((0, 2), np.float32)
        values = _values(batch.agent.mu, batch.agent.L, torch.from_numpy(noise))
        kept.append(Snapshot(t, path, values.mean(0), values.std(0, ddof=1)))
    return kept


def _values(mu: torch.Tensor, L: torch.Tensor, noise: torch.Tensor) -> np.ndarray:
    """max_a Q (S, 41, 41) of posterior samples of one run, equally many from each component."""
    components = mu.shape[1]
    share = noise.view(components, -1, noise.shape[-1])
    weights = (mu[0].unsqueeze(1) + share @ L[0].transpose(1, 2)).flatten(0, 1)
    line = torch.linspace(0, SIDE, NODES)
    grid = torch.cartesian_prod(line, line).flip(1)
    q = rooms_q()
    best = q.q(weights.unsqueeze(0), q.prepare(grid.unsqueeze(0)))[0].amax(1)
    return best.detach().view(-1, NODES, NODES).numpy()


def snapshot_picture(
    experiment: Experiment, runs: Mapping[str, Sequence[Snapshot]], index: int
) -> str:
    """One iteration of several runs as an HTML picture: value, its deviation, the path so far."""
    tasks = _rooms(experiment)
    shown = {label: taken[index] for label, taken in runs.items()}
    iteration = next(iter(shown.values())).iteration
    with look():
        figure = BookFigure(figsize=(7.6, 2.55 * len(shown)))
        axes = figure.subplots(len(shown), 3, squeeze=False)
        for row, (label, snapshot) in zip(axes, shown.items(), strict=True):
            value = _map(row[0], tasks, snapshot.mean, "viridis", Normalize(0.5, 1.0))
            spread = _map(row[1], tasks, snapshot.deviation, "magma", LogNorm(1e-3, 0.3))
            draw_rooms(row[2], tasks, start_color="black")
            row[2].plot(*snapshot.path.T, ".", ms=3, alpha=0.5, color=COLOURS[label])
            row[2].plot(*snapshot.path[-50:].T, ".", ms=4, color="black")
            row[0].set_ylabel(label, fontsize=11)
            for ax in row:
                ax.grid(False)
        titles = "mean value", "standard deviation", "visits, the last 50 black"
        for ax, title in zip(axes[0], titles, strict=True):
            ax.set_title(title)
        figure.colorbar(value, ax=axes[:, 0], location="bottom", shrink=0.8, aspect=25)
        figure.colorbar(spread, ax=axes[:, 1], location="bottom", shrink=0.8, aspect=25)
        figure.suptitle(f"iteration {iteration:,}", x=0.01, ha="left", fontsize=10)
        words = "; ".join(
            f"{label}: value at the start {s.mean[0, 0]:.2f}, largest deviation "
            f"{s.deviation.max():.3f}"
            for label, s in shown.items()
        )
        alt = f"Posterior after {iteration} iterations. {words}."
        return image_html(small_png(figure, 192), alt)


def _map(ax: Axes, tasks: Rooms, values: np.ndarray, colours: str, norm: Normalize) -> AxesImage:
    half = SIDE / (NODES - 1) / 2  # nodes lie in the middle of their pixels
    extent = (-half, SIDE + half, -half, SIDE + half)
    image = ax.imshow(values, origin="lower", extent=extent, cmap=colours, norm=norm)
    draw_rooms(ax, tasks, wall_color="white", start_color="white")
    return image
