"""Value maps: what a network believes over two coordinates of the state, and where that leads."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import torch
from attrs import frozen
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.image import AxesImage
from matplotlib.patheffects import withStroke
from torch import Tensor

from vtbook.paths import walks
from vtbook.plots import BookFigure, figure_html, look
from vtlab.envs.base import Plane, TaskBatch, TaskFamily
from vtlab.experiment import Experiment
from vtlab.run import prepare
from vtlab.store import load
from vtlib.transfer import VariationalTransfer

NODES = 61  # of the grid, across and up
PATH = "#D55E00"


@frozen(eq=False)
class ValueMap:
    """Values (A, 61, 61) of the actions over a plane, the lowest row first.

    path (T, 2) is where the greedy policy goes from the plane's start, in the plane's coordinates.
    """

    plane: Plane
    values: np.ndarray
    path: np.ndarray


def plane_states(plane: Plane, dimensions: int) -> Tensor:
    """States (61 * 61, dimensions) over a plane, row by row, the lowest first."""
    across, up = (torch.linspace(*ends, NODES) for ends in plane.ends)
    states = torch.zeros(NODES * NODES, dimensions)
    states[:, list(plane.axes)] = torch.cartesian_prod(up, across).flip(1)
    return states


def value_map(family: TaskFamily, task: TaskBatch, mu: Tensor) -> ValueMap:
    """The map of one run's mean Q-function, of weights mu (1, C, d), in its task.

    Raises ValueError when the family has no plane.
    """
    if (plane := family.plane) is None:
        raise ValueError(f"values cannot be mapped: {type(family).__name__} has no plane")
    q = family.q()

    def values(states: Tensor) -> Tensor:
        return q.q(mu.detach(), q.prepare(states.unsqueeze(0)))[0].mean(0)

    start, still = torch.tensor([plane.start]), torch.zeros(task.horizon, 1, task.noise_dim)
    (path,) = walks(task, lambda states: values(states).argmax(0), start, still)
    over = values(plane_states(plane, task.obs_dim)).view(-1, NODES, NODES)
    return ValueMap(plane, over.numpy(), path[:, list(plane.axes)])


def on_the_way(
    experiment: Experiment, label: str, weights: np.ndarray, at: Sequence[int]
) -> Iterator[tuple[Tensor, float]]:
    """Means (1, C, d) and the size of L at some iterations of the first run, as they are stored.

    At 0 they are those that the run starts with, from a pool's weights.
    """
    stored, agent = load(experiment, label), prepare(experiment, label, [0], weights).agent
    assert isinstance(agent, VariationalTransfer)
    for t in at:
        if t == 0:
            yield agent.mu.detach(), float(agent.scale_tril.norm())
        else:
            noted = stored.sel(iteration=t)
            yield torch.from_numpy(noted["mean"].values), float(noted["size"].values[0])


def draw_map(ax: Axes, values: ValueMap) -> AxesImage:
    """The greedy value in colours, white lines between the actions, and the path in orange."""
    plane, actions = values.plane, values.values.argmax(0)
    (left, right), (low, high) = (
        np.array(ends) / unit for ends, unit in zip(plane.ends, plane.units, strict=True)
    )
    image = ax.imshow(
        values.values.max(0),
        origin="lower",
        extent=(left, right, low, high),
        aspect="auto",
        norm=Normalize(*plane.values),
    )
    borders = np.arange(actions.max()) + 0.5
    if len(borders):
        across, up = np.linspace(left, right, NODES), np.linspace(low, high, NODES)
        lines = ax.contour(across, up, actions, borders, colors="white", linewidths=1)
        # seen on light values, too, which dark pages show as dark ones
        lines.set_path_effects([withStroke(linewidth=2.2, foreground="black")])
    ax.plot(*(values.path / plane.units).T, ".-", color=PATH, ms=3, lw=0.8)
    ax.set(xlim=(left, right), ylim=(low, high), xlabel=plane.labels[0], ylabel=plane.labels[1])
    ax.label_outer()
    ax.grid(False)
    return image


def maps_picture(maps: Mapping[str, ValueMap], iteration: int) -> str:
    """The maps of several algorithms after an iteration, side by side, as an HTML picture."""
    with look():
        figure = BookFigure(figsize=(7.6, 3.6))
        axes = figure.subplots(1, len(maps), sharey=True, squeeze=False)[0]
        for ax, (label, values) in zip(axes, maps.items(), strict=True):
            image = draw_map(ax, values)
            ax.set_title(label)
        figure.colorbar(image, ax=axes, label="greedy value", shrink=0.9)
        figure.suptitle(f"iteration {iteration:,}", x=0.01, ha="left", fontsize=10)
        words = "; ".join(
            f"{label}: greedy value {x.values.max(0).min():.0f} to {x.values.max():.0f}, "
            f"{len(x.path) - 1} steps from the start"
            for label, x in maps.items()
        )
        alt = f"Values after {iteration} iterations. {words}."
        return figure_html(figure, alt, 256)
