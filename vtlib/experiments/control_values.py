"""What a network believes while it learns: its value over two coordinates of the state."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.image import AxesImage
from torch import Tensor

from vtlib.domains import domain
from vtlib.envs.cartpole import ANGLE_LIMIT, CartpoleFamily
from vtlib.envs.mountain_car import GOAL, MAX_SPEED, POSITIONS, MountainCarFamily
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.runs import prepare, targets
from vtlib.plots import BookFigure, image_html, look, small_png

NODES = 61  # of the grid, across and up
SPIN = 2.0  # rad/s, the largest angular velocity shown


@dataclass(frozen=True)
class Plane:
    """Two coordinates of a state, the others being zero, and how to show them.

    axes: their indices. ends: ranges. labels: with units. units: of an axis' tick, in the state's
    own. values: range of the colours. start: state from which the path is drawn.
    """

    axes: tuple[int, int]
    ends: tuple[tuple[float, float], tuple[float, float]]
    labels: tuple[str, str]
    units: tuple[float, float]
    values: tuple[float, float]
    start: tuple[float, ...]


PLANES = {
    CartpoleFamily: Plane(
        (2, 3),
        ((-ANGLE_LIMIT, ANGLE_LIMIT), (-SPIN, SPIN)),
        ("angle (degrees)", "angular velocity (rad/s)"),
        (math.pi / 180, 1.0),
        (0.0, 100.0),
        (0.0, 0.0, 0.1, 0.0),
    ),
    MountainCarFamily: Plane(
        (0, 1),
        ((POSITIONS[0], GOAL), (-MAX_SPEED, MAX_SPEED)),
        ("position", "velocity (per step)"),
        (1.0, 1.0),
        (-90.0, 0.0),
        (-0.5, 0.0),
    ),
}


@dataclass(frozen=True)
class Snapshot:
    """Greedy values and actions (61, 61) after some iterations, lowest row first.

    path (steps, 2): where the greedy policy goes from the plane's start, on the plane.
    """

    iteration: int
    values: np.ndarray
    actions: np.ndarray
    path: np.ndarray


def snapshots(
    experiment: Experiment, label: str, run: int, pool: np.ndarray, at: Sequence[int]
) -> list[Snapshot]:
    """Compute one run anew and look at its mean Q-function at some iterations, 0 the start."""
    batch = prepare(experiment, label, experiment.algorithms[label], [run], pool)
    return [_look_at(experiment, run, batch.agent.mu.detach(), t) for t in batch.moments(at)]


def _look_at(experiment: Experiment, run: int, mu: Tensor, iteration: int) -> Snapshot:
    q, plane = domain(experiment.family).q(), PLANES[type(experiment.family)]

    def values(states: Tensor) -> Tensor:
        return q.q(mu, q.prepare(states.unsqueeze(0)))[0].mean(0)

    tasks = targets(experiment, [run])
    best = values(grid(plane, tasks.obs_dim)).max(0)
    state, path, none = torch.tensor([plane.start]), [], torch.zeros(1, 0)
    for _ in range(tasks.horizon):
        path.append(state[0, list(plane.axes)])
        state, _, terminal = tasks.step(state, values(state).argmax(0), none)
        if terminal:
            break
    path.append(state[0, list(plane.axes)])
    shape = NODES, NODES
    return Snapshot(
        iteration,
        best.values.view(shape).numpy(),
        best.indices.view(shape).numpy(),
        torch.stack(path).numpy(),
    )


def grid(plane: Plane, obs_dim: int) -> Tensor:
    """States (61 * 61, obs_dim) over the plane, row by row, the lowest first."""
    across, up = (torch.linspace(*ends, NODES) for ends in plane.ends)
    states = torch.zeros(NODES * NODES, obs_dim)
    states[:, list(plane.axes)] = torch.cartesian_prod(up, across).flip(1)
    return states


def snapshot_picture(
    experiment: Experiment, taken: Mapping[str, Sequence[Snapshot]], index: int
) -> str:
    """One iteration of several runs, side by side, as an HTML picture."""
    plane = PLANES[type(experiment.family)]
    shown = {label: snapshots[index] for label, snapshots in taken.items()}
    iteration = next(iter(shown.values())).iteration
    with look():
        figure = BookFigure(figsize=(7.6, 3.6))
        axes = figure.subplots(1, len(shown), sharey=True, squeeze=False)[0]
        for ax, (label, snapshot) in zip(axes, shown.items(), strict=True):
            image = _draw(ax, plane, snapshot)
            ax.set(title=label, xlabel=plane.labels[0])
        axes[0].set_ylabel(plane.labels[1])
        figure.colorbar(image, ax=axes, label="greedy value", shrink=0.9)
        figure.suptitle(f"iteration {iteration:,}", x=0.01, ha="left", fontsize=10)
        words = "; ".join(
            f"{label}: greedy value {s.values.min():.0f} to {s.values.max():.0f}, "
            f"{len(s.path) - 1} steps from the start"
            for label, s in shown.items()
        )
        alt = f"Values after {iteration} iterations. {words}."
        return image_html(small_png(figure, 128), alt)


def _draw(ax: Axes, plane: Plane, snapshot: Snapshot) -> AxesImage:
    (left, right), (low, high) = (
        np.array(ends) / unit for ends, unit in zip(plane.ends, plane.units, strict=True)
    )
    image = ax.imshow(
        snapshot.values,
        origin="lower",
        extent=(left, right, low, high),
        aspect="auto",
        cmap="viridis",
        norm=Normalize(*plane.values),
    )
    across, up = np.linspace(left, right, NODES), np.linspace(low, high, NODES)
    borders = np.arange(snapshot.actions.max()) + 0.5
    if len(borders):
        ax.contour(across, up, snapshot.actions, borders, colors="white", linewidths=1)
    ax.plot(*(snapshot.path / plane.units).T, ".-", color="#D55E00", ms=3, lw=0.8)
    ax.set(xlim=(left, right), ylim=(low, high))
    ax.grid(False)
    return image
