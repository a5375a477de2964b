"""A figure as a telephone shows it: its panels one below the other, in type that can be read."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec, SubplotSpec
from matplotlib.text import Text

WIDTH = 3.8  # inches, at 96 pixels to an inch what a page leaves of 390 pixels
SMALLEST = 9.5  # points
LOWEST, TALLEST = {1: 2.1, 2: 1.5}, 2.3  # inches, of curves with what is written around them
BESIDE = 24  # letters in a line of a label
LETTERS = {1: 46, 2: 15, 4: 8}  # in the title of a panel, by the columns
MANY = {True: (6,), False: (2, 8)}  # panels of curves, or maps: more have twice the columns
Panels = dict[Axes, SubplotSpec]
Change = Callable[[Callable[[Any], Any], Any, Any], None]


def panels_of(figure: Figure) -> Panels:
    """Where on its grid each panel of a figure stands; nothing for a drawing without a grid."""
    # a scale of colours follows the panels that it is for
    axes = [ax for ax in figure.axes if not hasattr(ax, "_colorbar")]
    return {ax: place for ax in axes if (place := ax.get_subplotspec())}


@contextmanager
def narrow(figure: Figure) -> Iterator[None]:
    """Lay out a figure with panels for a telephone as long as the context lasts."""
    undo: list[Callable[[], Any]] = []

    def change(setter: Callable[[Any], Any], old: Any, new: Any) -> None:
        undo.append(partial(setter, old))
        setter(new)

    panels = panels_of(figure)
    curves = all(ax.get_aspect() == "auto" for ax in panels)
    columns = 2 ** sum(len(panels) > most for most in MANY[curves])
    try:
        _label(panels, LETTERS[columns], change)
        lines = _write(figure, change)
        _place(figure, panels, columns, lines, change)
        yield
    finally:
        for step in reversed(undo):
            step()


def _label(panels: Panels, letters: int, change: Change) -> None:
    """Say at each panel what it leaves to a neighbour: its title, and labels of curves' axes."""
    for ax, place in panels.items():
        row = [one for one, its in panels.items() if its.rowspan == place.rowspan]
        column = [one for one, its in panels.items() if its.colspan == place.colspan]
        shared = [
            ("x", "labelbottom", ax.get_shared_x_axes(), column),
            ("y", "labelleft", ax.get_shared_y_axes(), row),
        ]
        for letter, side, group, near in shared if ax.get_aspect() == "auto" else ():
            axis = getattr(ax, f"{letter}axis")
            near = [one for one in near if one is not ax and group.joined(one, ax)]
            if near:
                show = partial(
                    lambda axis, side, on: axis.set_tick_params(**{side: on}), axis, side
                )
                change(show, axis.get_tick_params().get(side, True), True)
                told = [getattr(one, f"get_{letter}label")() for one in [ax, *near]]
                label = textwrap.fill(next(filter(None, told), ""), BESIDE)
                change(axis.set_label_text, told[0], label)
        titles = [one.get_title("left") for one in [ax, *column]]
        title = textwrap.fill(next(filter(None, titles), ""), letters)
        change(ax.set_title, titles[0], title)


def _write(figure: Figure, change: Change) -> int:
    """Legends of two columns where there is room, larger type; the number of legends' lines."""
    old, lines = list(figure.legends), 0
    for one in old:
        words = [text.get_text() for text in one.get_texts()]
        lines_and_dots = filter(None, one.legend_handles)
        columns = 2 if max(map(len, words), default=0) < 20 else 1
        figure.legend(lines_and_dots, words, loc="outside lower center", ncols=columns)
        lines += -(-len(words) // columns)
    new = figure.legends[len(old) :]
    change(partial(setattr, figure, "legends"), old, new)
    for text in figure.findobj(Text):
        change(text.set_fontsize, text.get_fontsize(), max(text.get_fontsize(), SMALLEST))
    return lines


def _place(figure: Figure, panels: Panels, columns: int, lines: int, change: Change) -> None:
    """Put the panels below each other, as wide as they find room."""
    rows, grid = -(-len(panels) // columns), next(iter(panels.values())).get_gridspec()
    wide, high = figure.get_size_inches()
    height = WIDTH / columns * (high / grid.nrows) / (wide / grid.ncols)
    if all(ax.get_aspect() == "auto" for ax in panels):
        height = min(max(height, LOWEST[columns]), TALLEST)
    change(figure.set_size_inches, (wide, high), (WIDTH, rows * height + 0.3 + 0.2 * lines))
    below = GridSpec(rows, columns, figure=figure)
    for index, (ax, place) in enumerate(panels.items()):
        change(ax.set_subplotspec, place, below[index])
