"""What the drawings of all environments share: colours, arrows, bare axes, and pictures of them."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

# The colour-blind safe palette of the book's figures.
INK, GREY, GROUND, WALL = "#1a1a1a", "#8a8a8a", "#e6e6e6", "#3c3c3c"
BODY, POLE, FLAG = "#0072B2", "#E69F00", "#009E73"


def picture(draw: Callable[[Axes], None], size: tuple[int, int]) -> np.ndarray:
    """What `draw` puts on axes, (height, width, 3) uint8; `size` is in pixels, width first."""
    figure = Figure(figsize=(size[0] / 100, size[1] / 100), dpi=100)
    canvas = FigureCanvasAgg(figure)
    draw(figure.add_axes((0.05, 0.05, 0.9, 0.9)))
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def bare(ax: Axes, xlim: tuple[float, float], ylim: tuple[float, float]) -> None:
    """Equal scales and nothing but the drawing."""
    ax.set(xlim=xlim, ylim=ylim, aspect="equal")
    ax.set_axis_off()


def framed(ax: Axes, side: float, color: str) -> None:
    """A square of a given side with a frame, and without ticks."""
    ax.set(xlim=(0, side), ylim=(0, side), aspect="equal", xticks=[], yticks=[])
    ax.grid(False)
    for spine in ax.spines.values():
        spine.set(color=color, linewidth=2, visible=True)
