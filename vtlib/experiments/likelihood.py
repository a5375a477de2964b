"""Return against the likelihood of the task (section 6.1.4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.typing import LineStyleType

from vtlib.claims import Returns
from vtlib.experiments.experiment import Experiment, slider_name
from vtlib.experiments.figures import setting_title, setting_words
from vtlib.experiments.reading import returns
from vtlib.experiments.rooms import LIKELIHOOD_DOORS
from vtlib.experiments.work import load_result
from vtlib.plots import (
    COLOURS,
    OPTIMUM,
    STYLES,
    BookFigure,
    curve,
    draw_curves,
    image_html,
    look,
    small_png,
)
from vtlib.stats import mean_interval
from vtlib.store import results_folder


def density(doors: np.ndarray) -> np.ndarray:
    """Density of door positions under the Normal distribution that tasks are drawn from."""
    mean, deviation = LIKELIHOOD_DOORS
    z = (np.asarray(doors) - mean) / deviation
    densities: np.ndarray = np.exp(-(z**2) / 2) / (deviation * np.sqrt(2 * np.pi))
    return densities


def task_likelihood(experiment: Experiment) -> np.ndarray:
    """Density (tasks,) of each target's door."""
    tasks, _ = load_result(experiment.name, "tasks", results_folder())
    return density(tasks["doors"][:: experiment.runs_per_task, 0])


def share_by_task(experiment: Experiment, label: str, iteration: int) -> np.ndarray:
    """Learning return over optimum (tasks, runs per task) at an iteration."""
    stored = returns(experiment.name, label)
    shares: np.ndarray = stored.at(iteration) / stored.optimum
    return shares.reshape(-1, experiment.runs_per_task)


def likelihood_figure(
    experiment: Experiment, labels: Sequence[str], iterations: Sequence[int]
) -> Figure:
    """Mean share of the optimum with its interval, task by task, at some iterations."""
    with look():
        figure = BookFigure(figsize=(7.6, 3.4))
        axes = figure.subplots(1, len(iterations), sharey=True, squeeze=False)[0]
        for ax, iteration in zip(axes, iterations, strict=True):
            for label in labels:
                shares = share_by_task(experiment, label, iteration)
                draw_tasks(ax, label, task_likelihood(experiment), shares)
            ax.set_title(f"after {iteration:,} iterations")
        _finish(figure, axes)
    return figure


def starts_figure(
    experiment: Experiment, others: Experiment, starts: Mapping[str, str], iteration: int
) -> Figure:
    """Task by task at an iteration: algorithms as above, and dashed from their other start."""
    with look():
        figure = BookFigure(figsize=(7.6, 3.4))
        axes = figure.subplots(1, len(starts), sharey=True, squeeze=False)[0]
        for ax, (label, other) in zip(axes, starts.items(), strict=True):
            shares = share_by_task(experiment, label, iteration)
            draw_tasks(ax, label, task_likelihood(experiment), shares, "-")
            shares = share_by_task(others, f"{label}-{other}", iteration)
            draw_tasks(ax, label, task_likelihood(others), shares, (0, (2, 1)))
            ax.set_title(f"{label}, dashed from the {other}")
        _finish(figure, axes)
    return figure


def draw_tasks(
    ax: Axes,
    label: str,
    likelihood: np.ndarray,
    shares: np.ndarray,
    style: LineStyleType | None = None,
) -> None:
    """One point per task at its likelihood (tasks,), with the interval over its runs (axis 1)."""
    order = np.argsort(likelihood)
    band = mean_interval(shares[order].T)
    error = np.stack([band.centre - band.low, band.high - band.centre])
    ax.errorbar(
        likelihood[order],
        band.centre,
        error,
        lw=1.2,
        marker="o",
        ms=3.5,
        color=COLOURS[label],
        ls=style or STYLES.get(label, "-"),
        label=label,
    )


def _finish(figure: Figure, axes: Sequence[Axes]) -> None:
    for ax in axes:
        ax.axhline(1.0, color=OPTIMUM, ls="--", lw=1.1, label="planned optimum")
        ax.set(xlabel="density of the task's door", ylim=(-0.03, 1.08))
    axes[0].set_ylabel("learning return over optimum")
    handles: dict[str, Artist] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4)


def slider_picture(
    experiment: Experiment, sliders: Experiment, lambda_: float, psi: float, components: int
) -> str:
    """One setting of the sliders as an HTML picture, with GVT for reference.

    Left the learning return averaged over all tasks; right each task's at the last iteration.
    """
    label, name = f"{components}-MGVT", slider_name(lambda_, psi, components)
    mine, reference = returns(sliders.name, name), _first_runs(experiment, "GVT", sliders)
    likelihood = task_likelihood(experiment)
    last = f"{mine.iterations[-1]:,}"
    with look():
        figure = BookFigure(figsize=(7.6, 3.5))
        left, right = figure.subplots(1, 2)
        curves = [
            curve(one, one, runs.iterations, runs.learning / runs.optimum[:, None])
            for one, runs in (("GVT", reference), (label, mine))
        ]
        draw_curves(left, curves)
        left.set(title="mean over all tasks", ylabel="learning return over optimum")
        for one in curves:
            right.plot(likelihood, one.returns[:, -1], "o", ms=4, color=one.colour)
        right.set_title(f"each task after {last} iterations")
        right.set_xlabel("density of the task's door")
        for ax in (left, right):
            ax.axhline(1.0, color=OPTIMUM, ls="--", lw=1.1, label="planned optimum")
            ax.set_ylim(-0.03, 1.08)
        handles, labels = left.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
        title = setting_title(experiment, lambda_, psi, components)
        figure.suptitle(title, x=0.01, ha="left", fontsize=10)
        alt = f"Returns with {setting_words(lambda_, psi, components)}; mean share of the optimum "
        alt += f"after {last} iterations {curves[1].returns[:, -1].mean():.2f}."
        return image_html(small_png(figure), alt)


def _first_runs(experiment: Experiment, label: str, sliders: Experiment) -> Returns:
    """One run of each task, for as long as the sliders' runs."""
    stored = returns(experiment.name, label)
    rows, t = slice(None, None, experiment.runs_per_task), sliders.iterations // sliders.every
    return Returns(
        stored.iterations[:t],
        stored.learning[rows, :t],
        stored.greedy[rows, :t],
        stored.optimum[rows],
    )
