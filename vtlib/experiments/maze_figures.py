"""The figures of the maze page: the mazes, returns on the four targets, and where robots go."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from vtlib.claims import Returns
from vtlib.domains import domain
from vtlib.envs.draw_maze import draw_maze
from vtlib.envs.maze import MazeFamily, Mazes
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.figures import KINDS, limits_of
from vtlib.experiments.mazes import CORNERS, DIAGONAL, MAZES
from vtlib.experiments.probes import value_and_spread
from vtlib.experiments.protocol import html_table
from vtlib.experiments.reading import optimum, returns
from vtlib.experiments.runs import prepare, targets
from vtlib.planning_maze import plan_maze
from vtlib.plots import COLOURS, BookFigure, Curve, curve, draw_curves, image_html, look, small_png
from vtlib.qfunctions import QFunction
from vtlib.streams import Stream, generator
from vtlib.transfer import VariationalTransfer

STARTS = 6  # walks drawn in a maze
REMEMBERED = 200  # states at which beliefs are looked at
DIAGONAL_COLOUR, DIAGONAL_STYLE = "#a6761d", (0, (4, 1.5))


@dataclass(frozen=True)
class Walk:
    """An episode's states (T, 3), the first one included, and whether it ends at the goal."""

    states: np.ndarray
    arrived: bool


def _maze(experiment: Experiment, run: int = 0) -> Mazes:
    """The target maze of one run."""
    tasks = targets(experiment, [run])
    assert isinstance(tasks, Mazes)
    return tasks


def _name(experiment: Experiment) -> str:
    """The name of an experiment's target maze."""
    assert isinstance(experiment.family, MazeFamily)
    return experiment.family.names[0]


def gallery(best: Sequence[float]) -> Figure:
    """All mazes of the pool, a row for each corner, with their planned optimal returns."""
    names = MAZES.family.names
    tasks = Mazes.of(names)
    with look():
        figure = BookFigure(figsize=(7.6, 6.9))
        axes = figure.subplots(len(CORNERS), len(names) // len(CORNERS))
        for index, (ax, name, value) in enumerate(zip(axes.flat, names, best, strict=True)):
            draw_maze(ax, tasks, index)
            ax.set_title(f"{name}: {value:.2f}", fontsize=8)
    return figure


def targets_figure(experiments: Mapping[str, Experiment]) -> Figure:
    """The target mazes, each with walks of the planned policy and what one robot sees."""
    with look():
        figure = BookFigure(figsize=(7.6, 2.3))
        axes = figure.subplots(1, len(experiments), squeeze=False)[0]
        for ax, experiment in zip(axes, experiments.values(), strict=True):
            tasks = _maze(experiment)
            walks = _optimal_walks(tasks, experiment.name)
            _draw_walks(ax, tasks, walks, COLOURS["GVT"], along=0.5)
            ax.set_title(_name(experiment), fontsize=9)
    return figure


def returns_grid(experiments: Mapping[str, Experiment], labels: Sequence[str]) -> Figure:
    """Learning and greedy return, a row for each target maze, with its optimum dashed."""
    with look():
        figure = BookFigure(figsize=(7.6, 2.0 * len(experiments) + 0.6))
        axes = figure.subplots(len(experiments), 2, sharex=True, sharey=True)
        for row, experiment in zip(axes, experiments.values(), strict=True):
            stored = {label: returns(experiment.name, label) for label in labels}
            best = float(optimum(experiment.name).mean())
            for ax, (title, kind) in zip(row, KINDS.items(), strict=True):
                curves = [
                    curve(x, x, runs.iterations, getattr(runs, kind)) for x, runs in stored.items()
                ]
                draw_curves(ax, curves, best)
                ax.set(title=f"{_name(experiment)}, {title}", ylim=limits_of(experiment))
                ax.label_outer()
            row[0].set_ylabel("discounted return")
        handles, names = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=5)
    return figure


def returns_table(experiments: Mapping[str, Experiment], labels: Sequence[str]) -> str:
    """Returns in each maze as an HTML table: learning over the run, greedy at its end.

    Both are means over runs, in percent of the optimum.
    """
    rows = [
        [_name(experiment), *(_shares(returns(experiment.name, label)) for label in labels)]
        for experiment in experiments.values()
    ]
    return html_table(["maze", *labels], rows)


def _shares(runs: Returns) -> str:
    learning = (runs.learning.mean(1) / runs.optimum).mean()
    greedy = (runs.greedy[:, -1] / runs.optimum).mean()
    return f"{learning:.0%} / {greedy:.0%}"


def covariance_figure(experiments: Mapping[str, Experiment]) -> Figure:
    """Learning return of 1-MGVT with full and with diagonal covariance, a panel per target."""
    with look():
        figure = BookFigure(figsize=(7.6, 2.7))
        axes = figure.subplots(1, len(experiments), sharey=True, squeeze=False)[0]
        for ax, experiment in zip(axes, experiments.values(), strict=True):
            full, diagonal = (returns(experiment.name, x) for x in ("1-MGVT", DIAGONAL))
            narrow = DIAGONAL_COLOUR, DIAGONAL_STYLE
            curves = [
                Curve("full covariance", full.iterations, full.learning, COLOURS["1-MGVT"]),
                Curve("diagonal covariance", diagonal.iterations, diagonal.learning, *narrow),
            ]
            draw_curves(ax, curves, float(full.optimum.mean()))
            ax.set(title=_name(experiment), ylim=limits_of(experiment))
        axes[0].set_ylabel("learning return")
        handles, names = axes[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=3)
    return figure


def walks_on_the_way(
    experiment: Experiment, label: str, run: int, pool: np.ndarray, at: Sequence[int]
) -> list[list[Walk]]:
    """Compute one run anew; where its greedy policy goes after some iterations, 0 the start."""
    batch = prepare(experiment, label, experiment.algorithms[label], [run], pool)
    tasks, q = _maze(experiment, run), domain(experiment.family).q()
    return [
        walk(tasks, experiment.name, lambda s: _greedy(q, batch.agent.mu.detach(), tasks, s))
        for _ in batch.moments(at)
    ]


def beliefs_on_the_way(
    experiment: Experiment, label: str, run: int, pool: np.ndarray, at: Sequence[int]
) -> list[tuple[float, float]]:
    """Compute one run anew; the mean's value and the samples' spread after some iterations.

    At remembered states, so none of the iterations may be 0.
    """
    settings = experiment.transfer_settings(label)
    batch = prepare(experiment, label, settings, [run], pool)
    q, agent = domain(experiment.family).q(), batch.agent
    assert isinstance(agent, VariationalTransfer)
    chosen, noise = (Stream(experiment.stream, [run], x) for x in ("probes", "probe samples"))
    found = []
    for _ in batch.moments(at):
        obs = agent.remembered(chosen.uniform(REMEMBERED)).obs
        value, spread = value_and_spread(q, agent, obs, noise, settings.kappa)
        found.append((float(value), float(spread)))
    return found


def _greedy(q: QFunction, mu: Tensor, tasks: Mazes, states: Tensor) -> Tensor:
    obs = tasks.select([0] * len(states)).observe(states)
    return q.q(mu, q.prepare(obs.unsqueeze(0)))[0].mean(0).argmax(0)


def walk(tasks: Mazes, name: str, policy: Callable[[Tensor], Tensor]) -> list[Walk]:
    """Episodes of a policy, states (B, 3) to actions (B,), in the first of some tasks.

    Starts and noise are the same for every policy of that name.
    """
    rng = generator(name, 0, "walks")
    copies = tasks.select([0] * STARTS)
    state = copies.start(torch.from_numpy(rng.random((STARTS, Mazes.start_dim))))
    paths, over = [state], torch.zeros(STARTS, dtype=torch.bool)
    lengths = torch.full((STARTS,), Mazes.horizon)
    for h in range(Mazes.horizon):
        noise = torch.from_numpy(rng.standard_normal((STARTS, Mazes.noise_dim)))
        state, _, terminal = copies.step(state, policy(state), noise)
        paths.append(state)
        lengths[terminal & ~over] = h + 1
        over |= terminal
    whole = torch.stack(paths, 1).numpy()
    return [
        Walk(states[: length + 1], bool(arrived))
        for states, length, arrived in zip(whole, lengths.tolist(), over.tolist(), strict=True)
    ]


def walks_picture(
    experiment: Experiment, taken: Mapping[str, Sequence[Sequence[Walk]]], at: Sequence[int], i: int
) -> str:
    """The walks of several algorithms after the i-th of some iterations, as an HTML picture."""
    tasks = _maze(experiment)
    shown = {label: walks[i] for label, walks in taken.items()}
    with look():
        figure = BookFigure(figsize=(7.6, 4.1))
        axes = figure.subplots(1, len(shown), squeeze=False)[0]
        for ax, (label, walks) in zip(axes, shown.items(), strict=True):
            _draw_walks(ax, tasks, walks, COLOURS[label], along=1.0)
            ax.set_title(label)
        figure.suptitle(f"iteration {at[i]:,}", x=0.01, ha="left", fontsize=10)
        words = "; ".join(
            f"{label}: {sum(w.arrived for w in walks)} of {len(walks)} robots reach the goal"
            for label, walks in shown.items()
        )
        alt = f"Walks of the greedy policies after {at[i]} iterations. {words}."
        return image_html(small_png(figure), alt)


def _optimal_walks(tasks: Mazes, name: str) -> list[Walk]:
    plan = plan_maze(tasks, 0)
    return walk(tasks, name, lambda states: plan.q(states).argmax(1))


def _draw_walks(ax: Axes, tasks: Mazes, walks: Sequence[Walk], colour: str, along: float) -> None:
    """Walks with their starts as dots, and the first one's robot that far along its way."""
    first = walks[0].states
    draw_maze(ax, tasks, 0, first[round(along * (len(first) - 1))], rays=True)
    for one in walks:
        ax.plot(*one.states[:, :2].T, color=colour, lw=1.1, alpha=0.8)
        ax.plot(*one.states[0, :2], "o", color=colour, ms=3.5)
