"""Figures laid out for a telephone, which stay as they were."""

import itertools

import numpy as np
from matplotlib.text import Text

from vtbook.narrow_figures import SMALLEST, WIDTH, narrow
from vtbook.plots import BookFigure, look


def drawn(rows, columns):
    """A figure with a title above each column and a label beside each row."""
    figure = BookFigure(figsize=(7.6, 3.5))
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for column, ax in enumerate(axes[0]):
        ax.set_title(f"no. {column}", color=f"C{column}")
        ax.plot([0, column], label="a line", lw=1)
    for row, ax in enumerate(axes[:, 0]):
        ax.set_ylabel(f"row {row}", fontsize=6)
    axes[-1, 0].set_xlabel("time")
    figure.legend(loc="outside lower center", ncols=4)
    return figure, axes


def test_panels_stand_below_each_other_and_say_what_they_shared():
    with look():
        figure, axes = drawn(2, 3)
        axes[0, 0].set_title("")
        axes[1, 0].set_title("below")
        figure = narrow(figure)
        axes = np.array(figure.axes).reshape(axes.shape)
        figure.draw_without_rendering()
        assert figure.get_size_inches()[0] == WIDTH
        boxes = [ax.get_position() for ax in axes.flat]
        assert all(a.y0 > b.y1 for a, b in itertools.pairwise(boxes))
        assert axes[1, 2].get_title("left") == "no. 2"
        assert axes[0, 0].get_title("left") == ""  # and none from below
        # a title's colour stays with its words
        (title,) = (x for x in axes[1, 2].findobj(Text) if x.get_text() == "no. 2")
        assert title.get_color() == "C2"
        assert axes[1, 2].get_ylabel() == "row 1"
        assert axes[1, 0].get_xlabel() == "time"
        assert axes[0, 1].yaxis.get_tick_params()["labelleft"]
        texts = [one for one in figure.findobj(Text) if one.get_text()]
        assert min(one.get_fontsize() for one in texts) >= SMALLEST
