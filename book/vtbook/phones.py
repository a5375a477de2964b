"""A figure as a telephone shows it: its panels one below the other, in type that can be read."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.text import Text

WIDTH = 3.8  # inches, at 96 pixels to an inch what a page leaves of 390 pixels
SMALLEST = 9.5  # points
TALLEST = 2.3  # inches, of a panel of curves
LETTERS = 54  # in a line of that width
MANY = 6  # panels, of which more stand in two columns


@contextmanager
def narrow(figure: Figure) -> Iterator[None]:
    """Lay out a figure for a telephone as long as the context lasts."""
    undo: list[Callable[[], Any]] = []

    def change(setter: Callable[[Any], Any], old: Any, new: Any) -> None:
        undo.append(partial(setter, old))
        setter(new)

    try:
        _place(figure, change)
        _label(figure, change)
        yield
    finally:
        for step in reversed(undo):
            step()


def _panels(figure: Figure) -> list[Axes]:
    """The axes of a figure that stand on its grid, without the scales of colours."""
    return [ax for ax in figure.axes if ax.get_subplotspec() and not hasattr(ax, "_colorbar")]


def _place(figure: Figure, change: Callable[..., None]) -> None:
    """Put the panels below each other, in two columns where there are many."""
    panels = _panels(figure)
    grid = panels[0].get_subplotspec().get_gridspec()
    columns = 1 if len(panels) <= MANY else 2
    rows = -(-len(panels) // columns)
    wide, high = figure.get_size_inches()
    height = WIDTH / columns * (high / grid.nrows) / (wide / grid.ncols)
    if panels[0].get_aspect() == "auto":
        height = min(height, TALLEST)
    change(figure.set_size_inches, (wide, high), (WIDTH, rows * height + 0.9))
    places = GridSpec(rows, columns, figure=figure)
    for ax, place in zip(panels, places, strict=False):
        change(ax.set_subplotspec, ax.get_subplotspec(), place)


def _label(figure: Figure, change: Callable[..., None]) -> None:
    """Say at each panel what it shared with its neighbours; larger type, shorter lines."""
    panels = _panels(figure)
    for ax in panels:
        for axis, side, group in (
            (ax.xaxis, "labelbottom", ax.get_shared_x_axes()),
            (ax.yaxis, "labelleft", ax.get_shared_y_axes()),
        ):
            change(
                lambda shown, axis=axis, side=side: axis.set_tick_params(**{side: shown}),
                axis.get_tick_params().get(side, True),
                True,
            )
            told = [getattr(one, f"get_{axis.axis_name}label")() for one in group.get_siblings(ax)]
            change(axis.set_label_text, axis.get_label_text(), next(filter(None, told), ""))
        change(ax.set_title, ax.get_title("left"), textwrap.fill(ax.get_title("left"), LETTERS))
    legends = [
        figure.legend(
            one.legend_handles,
            [text.get_text() for text in one.get_texts()],
            loc="outside lower center",
            ncols=2,
        )
        for one in figure.legends
    ]
    old = figure.legends[: len(legends)]
    change(partial(setattr, figure, "legends"), old, legends)
    for text in figure.findobj(Text):
        change(text.set_fontsize, text.get_fontsize(), max(text.get_fontsize(), SMALLEST))
