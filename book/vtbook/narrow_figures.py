"""A figure as a telephone shows it: its panels one below the other, in type that can be read."""

import copy
import textwrap
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec, GridSpecBase, SubplotSpec
from matplotlib.text import Text

WIDTH = 3.8  # inches, at 96 pixels to an inch what a page leaves of 390 pixels
SMALLEST = 9.5  # points
LOWEST, TALLEST = {1: 2.1, 2: 1.5, 3: 1.5}, 2.3  # inches, of curves with what is around them
ROWS, OF_ROW = 12, 0.17  # more names beside a panel than these make it taller, by inches each
BESIDE = 24  # letters in a line of a label, and half of them below a panel with so many names
LETTERS = {1: 46, 2: 15, 3: 13, 4: 8, 5: 6}  # in the title of a panel, by the columns
MANY = {True: (8,), False: (4, 8)}  # panels of curves, or maps: more have twice the columns
Panels = dict[Axes, SubplotSpec]


def panels_of(figure: Figure) -> Panels:
    """Where on its grid each panel of a figure stands; nothing for a drawing without a grid."""
    # a scale of colours follows the panels that it is for
    axes = [ax for ax in figure.axes if not hasattr(ax, "_colorbar")]
    return {ax: place for ax in axes if (place := ax.get_subplotspec())}


def narrow(figure: Figure) -> Figure:
    """A copy of a figure with panels, laid out for a telephone."""
    figure = copy.deepcopy(figure)
    panels = panels_of(figure)
    columns = _columns(panels)
    if columns != _grid(panels).ncols:
        for ax in panels:
            _share(panels, ax)
    for ax in panels:
        _entitle(ax, LETTERS[columns])
    _place(figure, panels, columns, _write(figure))
    return figure


def _grid(panels: Panels) -> GridSpecBase:
    return next(iter(panels.values())).get_gridspec()


def _curves(panels: Panels) -> bool:
    return all(ax.get_aspect() == "auto" for ax in panels)


def _large(panels: Panels) -> list[Axes]:
    """Panels that take several cells of the grid."""
    return [ax for ax, place in panels.items() if len(place.rowspan) * len(place.colspan) > 1]


def _columns(panels: Panels) -> int:
    """How many panels stand side by side: a table of three columns keeps them, if it is long."""
    if large := _large(panels):
        return len({place.colspan.start for ax, place in panels.items() if ax not in large})
    columns = 2 ** sum(len(panels) > most for most in MANY[_curves(panels)])
    return 3 if columns == 2 and _grid(panels).ncols == 3 else columns


def _beside(panels: Panels, ax: Axes) -> tuple[list[Axes], list[Axes]]:
    """The panels of a panel's column and of its row."""
    own = panels[ax]
    column = [ax for ax, place in panels.items() if place.colspan == own.colspan]
    return column, [ax for ax, place in panels.items() if place.rowspan == own.rowspan]


def _share(panels: Panels, ax: Axes) -> None:
    """Say at a panel what it leaves to a neighbour: its title, and labels of curves' axes."""
    column, row = _beside(panels, ax)
    for side, axis, group, near in (
        ("bottom", ax.xaxis, ax.get_shared_x_axes(), column),
        ("left", ax.yaxis, ax.get_shared_y_axes(), row),
    ):
        near = [panel for panel in near if panel is not ax and group.joined(panel, ax)]
        if near and ax.get_aspect() == "auto":
            shown: dict[str, Any] = {f"label{side}": True}
            axis.set_tick_params(**shown)
            labels = [getattr(panel, f"{axis.axis_name}axis").label for panel in near]
            _repeat([axis.label, *labels])
            axis.label.set_text(textwrap.fill(axis.label.get_text(), BESIDE))
    above = [x for x in column if panels[x].rowspan.start < panels[ax].rowspan.start]
    _repeat([_title(x) for x in (ax, *above)])


def _title(ax: Axes) -> Text:
    return ax.set_title(ax.get_title("left"), loc="left")


def _repeat(texts: list[Text]) -> None:
    """Let the first of some texts say what any of them does, in the same colour."""
    source = next(filter(Text.get_text, texts), texts[0])
    texts[0].set(text=source.get_text(), color=source.get_color())


def _entitle(ax: Axes, letters: int) -> None:
    """Break a panel's title into lines, the last of which stood at its right, and its label."""
    titles = ax.get_title("left"), ax.get_title("right")
    ax.set_title("\n".join(textwrap.fill(text, letters) for text in titles if text))
    ax.set_title("", loc="right")
    room = BESIDE // (1 + (_names(ax) > ROWS))
    ax.set_xlabel(textwrap.fill(ax.get_xlabel(), room))


def _names(ax: Axes) -> int:
    """The lines of the names beside a panel, with one to keep longer names apart."""
    lines = (1 + name.get_text().count("\n") for name in ax.get_yticklabels())
    return sum(n + (n > 1) for n in lines)


def _write(figure: Figure) -> int:
    """Legends of two columns where there is room, larger type; the number of legends' lines."""
    old, lines = list(figure.legends), 0
    for legend in old:
        words = [text.get_text() for text in legend.get_texts()]
        lines_and_dots = filter(None, legend.legend_handles)
        columns = 2 if max(map(len, words), default=0) < 20 else 1
        figure.legend(lines_and_dots, words, loc="outside lower center", ncols=columns)
        lines += -(-len(words) // columns)
    figure.legends = figure.legends[len(old) :]
    for text in figure.findobj(Text):
        text.set_fontsize(max(text.get_fontsize(), SMALLEST))
    return lines


def _place(figure: Figure, panels: Panels, columns: int, lines: int) -> None:
    """Put the panels below each other, large ones first, as wide as they find room."""
    large, grid = _large(panels), _grid(panels)
    small = [ax for ax in panels if ax not in large]
    rows = -(-len(small) // columns)
    wide, high = figure.get_size_inches()
    height = WIDTH / columns * (high / grid.nrows) / (wide / grid.ncols)
    if _curves(panels):
        height = min(max(height, LOWEST[columns]), TALLEST)
        if (names := max(map(_names, panels))) > ROWS:
            height = OF_ROW * names + 0.5
    figure.set_size_inches(WIDTH, (columns * len(large) + rows) * height + 0.3 + 0.2 * lines)
    ratios = [columns] * len(large) + [1] * rows
    below = GridSpec(len(ratios), columns, figure=figure, height_ratios=ratios)
    for index, ax in enumerate(large):
        ax.set_subplotspec(below[index, :])
    for index, ax in enumerate(small):
        row, column = divmod(index, columns)
        ax.set_subplotspec(below[len(large) + row, column])
