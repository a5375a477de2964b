"""The figures of the classic control pages: diagrams, and transfer from other sources."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from matplotlib.figure import Figure
from matplotlib.typing import LineStyleType

from vtlib.domains import domain
from vtlib.envs.cartpole import Cartpole
from vtlib.envs.draw_control import draw_cartpole, draw_mountain_car
from vtlib.envs.mountain_car import MountainCar
from vtlib.experiments.control_values import PLANES, grid
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.figures import head_of, limits_of
from vtlib.experiments.reading import returns
from vtlib.experiments.work import pool_weights
from vtlib.plots import BookFigure, Curve, curve, draw_curves, learning_figure, look
from vtlib.sources import Pool
from vtlib.store import results_folder
from vtlib.streams import generator

FIXED_POINT = 100.0  # value of balancing for ever: 1 / (1 - gamma)
POOL_COLOURS = ("#CC79A7", "#332288")
VARIANTS = {  # of the collapse, in colours that no algorithm has
    "hard maximum": "#88419d",
    "semi-gradient": "#a6761d",
    "full gradient": "#66a61e",
    "small steps": "#1b9e77",
    "buffer filled first": "#e7298a",
}
VARIANT_STYLES: tuple[LineStyleType, ...] = (
    (0, (1, 1)),
    "-.",
    (0, (5, 1.5)),
    (0, (6, 1, 1, 1)),
    "-",
)


def cartpole_diagram() -> Figure:
    """One cartpole with its parameters and force named."""
    task = Cartpole(*(torch.tensor([x]) for x in (1.0, 0.1, 0.5)))
    figure = BookFigure(figsize=(3.6, 2.9), layout="constrained")
    draw_cartpole(figure.subplots(), task, 0, torch.tensor([0.0, 0.0, 0.2, 0.0]), labels=True)
    return figure


def mountain_car_diagram() -> Figure:
    """The hill, the car and the velocities of its actions."""
    figure = BookFigure(figsize=(3.6, 2.6), layout="constrained")
    task = MountainCar(torch.tensor([0.001]))
    draw_mountain_car(figure.subplots(), task, 0, torch.tensor([-0.5, 0.0]), labels=True)
    return figure


def other_sources_figure(experiments: Mapping[str, Experiment], labels: Sequence[str]) -> Figure:
    """Learning return of algorithms from several pools of sources, a panel for each.

    All for as long as the shortest experiment, whose runs have the same targets in every panel.
    """
    shortest = min(experiments.values(), key=lambda experiment: experiment.iterations)
    until = returns(shortest.name, labels[0])
    panels = {}
    for title, experiment in experiments.items():
        stored = {label: head_of(returns(experiment.name, label), until) for label in labels}
        panels[title] = [curve(x, x, runs.iterations, runs.learning) for x, runs in stored.items()]
    with look():
        return learning_figure(panels, float(until.optimum.mean()), limits_of(shortest))


def collapse_figure(
    pools: Mapping[str, Pool], base: Experiment, variants: Experiment, label: str
) -> Figure:
    """Values and action gaps of pools' sources, and what becomes of a transfer from the last pool.

    Left a point per source: the mean over the plane of ``control_values`` of its greedy value and
    of the gap between its best and its second action. Right the learning return of ``label`` of the
    base experiment (black) and of its variants.
    """
    with look():
        figure = BookFigure(figsize=(7.6, 3.5))
        left, right = figure.subplots(1, 2)
        for (name, pool), colour in zip(pools.items(), POOL_COLOURS, strict=True):
            value, gap = values_and_gaps(pool)
            left.loglog(gap, value, "o", ms=3.5, alpha=0.7, color=colour, label=name)
        left.axhline(FIXED_POINT, color="black", lw=0.8, ls=":")
        left.set(title="sources", xlabel="gap between the actions", ylabel="value", ylim=(10, 140))
        left.legend(loc="lower right", fontsize=9)
        whole = returns(base.name, label)
        curves = [Curve("as in the thesis", whole.iterations, whole.learning, "#1a1a1a")]
        for (name, colour), style in zip(VARIANTS.items(), VARIANT_STYLES, strict=True):
            runs = returns(variants.name, name)
            curves.append(Curve(name, runs.iterations, runs.learning, colour, style))
        draw_curves(right, curves, float(whole.optimum.mean()))
        right.set(title=f"{label} from DDQN's sources", ylim=limits_of(base))
        right.set_ylabel("learning return")
        handles, names = right.get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=4, fontsize=9)
    return figure


def values_and_gaps(pool: Pool) -> tuple[np.ndarray, np.ndarray]:
    """Greedy value and gap between the two best actions, (S,) each, averaged over the plane."""
    weights = torch.from_numpy(pool_weights(pool, results_folder())).unsqueeze(0)
    q, plane = domain(pool.family).q(), PLANES[type(pool.family)]
    states = grid(plane, pool.family.sample(generator(pool.name, 0, "size"), 1).obs_dim)
    best = q.q(weights, q.prepare(states.unsqueeze(0)))[0].topk(2, 1).values
    value, gap = best[:, 0].mean(1), (best[:, 0] - best[:, 1]).mean(1)
    return value.numpy(), gap.numpy()
