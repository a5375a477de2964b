"""Transfer in a corridor of ten cells: a prior from old value functions, walks, and Bayes' rule."""

from collections.abc import Sequence

import numpy as np
from attrs import frozen
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vtbook.browser_panel import panel
from vtbook.plots import COLOURS, BookFigure, look

CELLS, START = 10, 4
DISCOUNT = 0.8
TREASURE = 7  # of the new task
OLD_TREASURES = (0, 0, 1, 1, 2, 7, 8, 8, 9, 9)
NOISE = 0.05  # standard deviation of a target about the value that it is taken for
SWEEPS = 30  # targets settle sooner
STEPS = (  # the titles of the storyboard's pictures
    "1  Ten old value functions make a belief",
    "2  Draw one value function from it",
    "3  Act on the draw: no treasure here",
    "4  Update: the other side it must be",
)
JITTER = 1e-3  # added to the variances of ten functions, which span nine directions
NARROW = 0.02  # standard deviation of a prior without links, and of the targets that then count


@frozen(eq=False)
class Belief:
    """A Gaussian over the values of the cells: mean (10,) and covariance (10, 10)."""

    mean: np.ndarray
    covariance: np.ndarray


def values(treasure: int) -> np.ndarray:
    """The optimal values (10,): 1 at the treasure, discounted once for each step to it."""
    return np.asarray(DISCOUNT ** np.abs(np.arange(CELLS) - treasure))


def prior(links: bool = True) -> Belief:
    """The mean and the covariance of ten old value functions, or their mean and one variance."""
    old = np.array([values(x) for x in OLD_TREASURES])
    if not links:
        return Belief(old.mean(0), NARROW**2 * np.eye(CELLS))
    return Belief(old.mean(0), np.cov(old.T) + JITTER * np.eye(CELLS))


def neighbours(cell: int) -> list[int]:
    """The cells beside one, left before right."""
    return [x for x in (cell - 1, cell + 1) if 0 <= x < CELLS]


def walk(drawn: np.ndarray) -> list[int]:
    """The cells from the start to the peak of a value function, or to a treasure on the way."""
    cells, peak = [START], int(np.argmax(drawn))
    while cells[-1] not in (TREASURE, peak):
        cells.append(cells[-1] + int(np.sign(peak - cells[-1])))
    return cells


def posterior(before: Belief, seen: Sequence[int], noise: float = NOISE) -> Belief:
    """What is believed after visits of some cells.

    Each visit is an observation of its cell's value with Gaussian noise: the TD target 1 at the
    treasure, and elsewhere the discounted mean value of the better neighbour. The rule is the
    conjugate one; targets are computed again from the new mean until they settle.
    """
    mean = before.mean
    for _ in range(SWEEPS):
        targets = [DISCOUNT * max(mean[neighbours(x)]) for x in range(CELLS)]
        targets[TREASURE] = 1.0
        mean, covariance = before.mean, before.covariance
        for cell in seen:
            gain = covariance[cell] / (covariance[cell, cell] + noise**2)
            mean = mean + gain * (targets[cell] - mean[cell])
            covariance = covariance - np.outer(gain, covariance[cell])
    return Belief(mean, covariance)


def storyboard() -> Figure:
    """Four pictures of one round: the prior, a draw, the walk that it leads to, the posterior."""
    before, rng = prior(), np.random.default_rng(1)
    drawn = rng.multivariate_normal(before.mean, before.covariance, method="cholesky")
    cells = walk(drawn)
    with look():
        figure = BookFigure(figsize=(7.6, 5.2), layout="constrained")
        axes = figure.subplots(2, 2, sharex=True, sharey=True).ravel()
        for ax, title in zip(axes, STEPS, strict=True):
            _draw_corridor(ax, title)
        for ax, belief in zip(axes, [before] * 3 + [posterior(before, cells)], strict=True):
            _draw_belief(ax, belief)
        for ax in axes[1:3]:
            ax.plot(drawn, color=COLOURS["1-MGVT"], lw=2.6)
        for ax in axes[2:]:
            _draw_walk(ax, cells, moving=ax is axes[2])
        for treasure in OLD_TREASURES:
            axes[0].plot(values(treasure), color="#4a4a4a", lw=0.9)
        figure.supylabel("value of a cell", fontsize=10)
    return figure


def _draw_corridor(ax: Axes, title: str) -> None:
    ax.set_title(title)
    ax.set(xlim=(-0.5, CELLS - 0.5), ylim=(-0.55, 1.45), yticks=(0, 0.5, 1))
    ax.set_xticks(range(CELLS), [str(x + 1) for x in range(CELLS)])
    ax.grid(visible=False)
    for x in range(CELLS):
        face = "#f3d36b" if x == TREASURE else "white"
        ax.bar(x, 0.2, 0.96, -0.5, color=face, edgecolor="#6b6b6b", linewidth=0.8)


def _draw_belief(ax: Axes, belief: Belief) -> None:
    width = 2 * np.sqrt(belief.covariance.diagonal())
    band = belief.mean - width, belief.mean + width
    ax.fill_between(range(CELLS), *band, color=COLOURS["GVT"], alpha=0.22, lw=0)
    ax.plot(belief.mean, color=COLOURS["GVT"], lw=1.2)


def _draw_walk(ax: Axes, cells: list[int], moving: bool) -> None:
    ax.plot(cells, [-0.4] * len(cells), "o", color=COLOURS["1-MGVT"], ms=4)
    if moving:
        arrow = {"arrowstyle": "->", "color": COLOURS["1-MGVT"], "lw": 1.8}
        ax.annotate("", (cells[-1] - 0.3, -0.4), (cells[0], -0.4), arrowprops=arrow)


def corridor() -> str:
    """HTML of the corridor for a reader to draw, act and update in; hidden without scripts."""
    setup = {
        "old": [values(x).tolist() for x in OLD_TREASURES],
        "start": START,
        "treasure": TREASURE,
        "discount": DISCOUNT,
        "noise": NOISE,
        "sweeps": SWEEPS,
        "jitter": JITTER,
        "narrow": {"jitter": NARROW**2, "noise": NARROW},
        "colours": {"belief": COLOURS["GVT"], "draw": COLOURS["1-MGVT"]},
    }
    return panel("corridor", setup)
