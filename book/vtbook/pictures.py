"""What the moving formulas share: their colours, and how a drawing becomes part of a page."""

from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vtbook.plots import BookFigure, figure_html, look

# Okabe and Ito's palette, told apart with any colour vision.
BLUE, ORANGE, GREEN, GREY, BLACK = "#0072B2", "#D55E00", "#009E73", "#6b6b6b", "#1a1a1a"
FONT = 11  # points, of what stands in a drawing
FINE: dict[Any, Any] = {  # by matplotlib's names of its settings, beside those of every figure
    "legend.fontsize": 8.5,
    "legend.handlelength": 1.4,
    "legend.columnspacing": 1.2,
    "lines.linewidth": 1.5,
}

Draw = Callable[..., str]


def picture(width: float, height: float) -> Callable[[Draw], Draw]:
    """Turn a function that draws on a figure of these inches, and returns its text, into HTML."""

    def turned(draw: Draw) -> Draw:
        @wraps(draw)
        def html(*args: Any, **kwargs: Any) -> str:
            with look(), mpl.rc_context(FINE):
                figure = BookFigure(figsize=(width, height))
                text = draw(figure, *args, **kwargs)
                return figure_html(figure, text)

        return html

    return turned


def legend_below(figure: Figure, ax: Axes, columns: int) -> None:
    """Put one legend below all axes, with the labels of one of them."""
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)


def arrow(
    ax: Axes,
    start: Iterable[float],
    end: Iterable[float],
    color: str = ORANGE,
    style: str = "-|>",
    width: float = 2.0,
) -> None:
    """Draw an arrow between two points of the drawing, its head in proportion to its width."""
    properties = {"arrowstyle": style, "color": color, "lw": width, "shrinkA": 0, "shrinkB": 0}
    properties["mutation_scale"] = 8 + 3 * width  # size of the head in points
    (x, y), (end_x, end_y) = start, end
    ax.annotate("", (end_x, end_y), (x, y), arrowprops=properties)
