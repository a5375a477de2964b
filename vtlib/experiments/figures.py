"""The figures of the rooms pages, drawn from stored runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from matplotlib.figure import Figure

from vtlib.claims import Returns
from vtlib.domains import domain
from vtlib.envs.draw import draw_rooms
from vtlib.envs.rooms import Rooms
from vtlib.experiments import named
from vtlib.experiments.experiment import Experiment, slider_name
from vtlib.experiments.reading import optimum, returns
from vtlib.experiments.rooms import FIXED_LOWER
from vtlib.experiments.work import load_result
from vtlib.planning import plan
from vtlib.plots import (
    COLOURS,
    BookFigure,
    Curve,
    curve,
    image_html,
    learning_figure,
    look,
    power_of_ten,
    small_png,
)
from vtlib.stats import mean_interval
from vtlib.store import results_folder
from vtlib.streams import generator

KINDS = {"learning return": "learning", "greedy return": "greedy"}


def two_panels(algorithms: Mapping[str, tuple[str, Returns]]) -> dict[str, list[Curve]]:
    """Learning and greedy panels of {label: (algorithm whose look to take, returns)}."""
    return {
        title: [
            curve(label, algorithm, runs.iterations, getattr(runs, kind))
            for label, (algorithm, runs) in algorithms.items()
        ]
        for title, kind in KINDS.items()
    }


def stored_panels(name: str, labels: Sequence[str]) -> dict[str, list[Curve]]:
    """Learning and greedy panels of an experiment's algorithms."""
    return two_panels({label: (label, returns(name, label)) for label in labels})


def returns_figure(name: str, labels: Sequence[str]) -> Figure:
    """Learning and greedy return of an experiment's algorithms, with the mean optimum dashed."""
    with look():
        best = float(optimum(name).mean())
        return learning_figure(stored_panels(name, labels), best, limits_of(named(name)))


def learning_return_figure(name: str, labels: Sequence[str]) -> Figure:
    """Only the learning return of an experiment's algorithms, with the mean optimum dashed."""
    (title, curves), *_ = stored_panels(name, labels).items()
    with look():
        best = float(optimum(name).mean())
        return learning_figure({title: curves}, best, limits_of(named(name)))


def limits_of(experiment: Experiment) -> tuple[float, float]:
    """Limits of the axis of returns."""
    return domain(experiment.family).limits


def starts_figure(name: str, others: Mapping[str, str]) -> Figure:
    """Learning return of algorithms from the minimiser of the KL, and from their other start."""
    panels = {}
    for label, other in others.items():
        first, second = returns(name, label), returns(name, f"{label}-{other}")
        colour = COLOURS[label]
        panels[f"{label}, dashed from the {other}"] = [
            Curve("minimiser of the KL", first.iterations, first.learning, colour),
            Curve("other start", second.iterations, second.learning, colour, (0, (2, 1))),
        ]
    with look():
        return learning_figure(panels, float(optimum(name).mean()), limits_of(named(name)))


def environment_figure(doors: Sequence[Sequence[float]], experiment: str, walks: int = 5) -> Figure:
    """Rooms tasks with a few walks of the planned optimal policy, drawn from the environment."""
    tasks = Rooms.from_doors(doors)
    figure = BookFigure(figsize=(7.6, 2.9), layout="constrained")
    axes = figure.subplots(1, len(tasks), squeeze=False)[0]
    for index, ax in enumerate(axes):
        draw_rooms(ax, tasks, index)
        for path in optimal_walks(tasks, index, walks, experiment):
            ax.plot(*path.T, color=COLOURS["GVT"], lw=0.9, alpha=0.7)
        ax.set_title(f"doors at {', '.join(f'{x:g}' for x in doors[index])}", fontsize=9)
    axes[0].annotate("start", (0.35, 0.35), fontsize=9)
    axes[0].annotate("goal", (7.3, 9.2), fontsize=9)
    return figure


def optimal_walks(tasks: Rooms, index: int, walks: int, experiment: str) -> list[np.ndarray]:
    """Positions (steps, 2) of episodes under the planned optimal policy of one task."""
    best = plan(tasks, index, None)
    copies = tasks.select([index] * walks)
    drawn = generator(experiment, index, "walks").standard_normal((Rooms.horizon, walks, 2))
    noise = torch.from_numpy(drawn.astype(np.float32))
    state = copies.start(torch.zeros(walks, 2))
    paths, alive = [state], torch.ones(walks, dtype=torch.bool)
    for h in range(Rooms.horizon):
        after, _, terminal = copies.step(state, best.greedy(state), noise[h])
        state = torch.where(alive.unsqueeze(1), after, state)
        alive = alive & ~terminal
        paths.append(state)
    return list(torch.stack(paths, 1).numpy())


def sources_figure(sources: Mapping[str, np.ndarray], required: float) -> Figure:
    """How long each source was trained, and what its greedy policy earns of the optimum."""
    with look():
        figure = BookFigure(figsize=(7.6, 2.6))
        left, right = figure.subplots(1, 2)
        thousands = sources["iterations"] / 1000
        left.hist(thousands, bins=np.arange(19.5, thousands.max() + 2), color=COLOURS["NT"])
        left.set(xlabel="thousand iterations of training", ylabel="sources")
        share = sources["greedy"] / sources["optimum"]
        right.hist(share, bins=20, color=COLOURS["NT"])
        right.axvline(required, color="black", ls="--", lw=1)
        right.set(xlabel="greedy return over planned optimum", ylabel="sources")
    return figure


def head_of(runs: Returns, other: Returns) -> Returns:
    """As many runs and iterations as another result has; both count from the same first run."""
    r, t = other.learning.shape
    return Returns(
        runs.iterations[:t], runs.learning[:r, :t], runs.greedy[:r, :t], runs.optimum[:r]
    )


def door_distance(name: str) -> np.ndarray:
    """Distance (R,) of each target's lower door from where the lower door of every source is."""
    doors, _ = load_result(name, "tasks", results_folder())
    return np.abs(doors["doors"][:, 0] - FIXED_LOWER)


def distance_figure(name: str, labels: Sequence[str]) -> Figure:
    """Share of the optimum at the end against the distance of the lower door, run by run."""
    distance = door_distance(name)
    with look():
        figure = BookFigure(figsize=(7.6, 3.0))
        axes = figure.subplots(1, len(labels), sharey=True, squeeze=False)[0]
        for ax, label in zip(axes, labels, strict=True):
            runs = returns(name, label)
            share = runs.learning[:, -1] / runs.optimum
            slope, level = np.polyfit(distance, share, 1)
            ends = np.array([0.0, distance.max()])
            ax.scatter(distance, share, color=COLOURS[label], s=18, alpha=0.8)
            ax.plot(ends, level + slope * ends, color=COLOURS[label])
            ax.set(title=label, xlabel="distance of the lower door", ylim=(-0.03, 1.05))
        axes[0].set_ylabel("learning return over optimum")
    return figure


def slider_picture(
    experiment: Experiment, sliders: Experiment, lambda_: float, psi: float, components: int
) -> str:
    """One setting of the sliders as an HTML picture, with no transfer and GVT for reference."""
    label = f"{components}-MGVT"
    mine = returns(sliders.name, slider_name(lambda_, psi, components))
    shown = [x for x in ("NT", "DDQN", "GVT") if x in experiment.algorithms]
    references = {x: (x, head_of(returns(experiment.name, x), mine)) for x in shown}
    panels = two_panels(references | {label: (label, mine)})
    with look():
        title = setting_title(experiment, lambda_, psi, components)
        best = float(mine.optimum.mean())
        figure = learning_figure(panels, best, limits_of(experiment), title)
        end = mean_interval(mine.learning[:, -1]).centre
        alt = f"Returns with {setting_words(lambda_, psi, components)}; "
        return image_html(small_png(figure), alt + f"final learning return {end:.2f}.")


def setting_title(experiment: Experiment, lambda_: float, psi: float, components: int) -> str:
    """A setting of the sliders in symbols, the thesis' own marked."""
    base = experiment.transfer_settings("1-MGVT")
    thesis = (lambda_, psi) == (base.lambda_, base.psi) and components in (1, 3)
    title = f"λ = {power_of_ten(lambda_)}, ψ = {psi:g}, {_counted(components)}"
    return title + (" (the thesis' setting)" if thesis else "")


def setting_words(lambda_: float, psi: float, components: int) -> str:
    """A setting of the sliders in words, for those who hear a picture."""
    return f"lambda = {lambda_:.0e}, psi = {psi:g}, {_counted(components)}"


def _counted(components: int) -> str:
    return f"{components} component{'s' if components > 1 else ''}"
