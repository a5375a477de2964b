"""Ink and paper of the illustrations: Okabe and Ito's colours, pictures with few colours."""

from __future__ import annotations

from matplotlib.figure import Figure

from vtlib.plots import image_html, small_png

BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#6b6b6b"


def picture_html(figure: Figure, alt: str) -> str:
    """A figure as an HTML picture, small enough for a slider's set."""
    return image_html(small_png(figure, 64), alt)
