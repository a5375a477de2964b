"""What the drawings of all environments share: colours and bare axes."""

from matplotlib.axes import Axes

# The colour-blind safe palette of the book's figures.
INK, GREY, GROUND, WALL = "#1a1a1a", "#8a8a8a", "#e6e6e6", "#3c3c3c"
BODY, POLE, FLAG = "#0072B2", "#E69F00", "#009E73"


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
