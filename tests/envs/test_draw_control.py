"""The drawings of cartpole and mountain car: parts in their places, labels apart and inside."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text

from vtlib.envs import Cartpole, MountainCar
from vtlib.envs.draw_control import BODY, POLE, draw_cartpole, draw_mountain_car

POLES = Cartpole.of(3, cart_mass=1.0, pole_mass=0.1, half_length=[0.5, 0.2, 1.0])
CARS = MountainCar.of(2, speed=[0.001, 0.0015])


def drawn(draw: Callable[[Axes], None], height: float = 2.9) -> Axes:
    """Axes of a figure as wide as a page's narrow column, drawn once."""
    figure = Figure(figsize=(3.6, height), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    ax = figure.add_subplot()
    draw(ax)
    figure.canvas.draw()
    return ax


def texts(ax: Axes) -> list[Text]:
    return [text for text in ax.texts if text.get_text()]


def arrows(ax: Axes) -> list[np.ndarray]:
    """Lengths and directions of the arrows, as vectors."""
    found = [text for text in ax.texts if isinstance(text, Annotation)]
    return [np.array(arrow.xy) - np.array(arrow.xyann) for arrow in found]


def check_labels(ax: Axes) -> None:
    boxes = [text.get_window_extent() for text in texts(ax)]
    assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))
    inside = ax.figure.bbox
    for box in boxes:
        assert inside.x0 <= box.x0 <= box.x1 <= inside.x1
        assert inside.y0 <= box.y0 <= box.y1 <= inside.y1


@pytest.mark.parametrize("index", [0, 1, 2])
@pytest.mark.parametrize("angle", [0.2, 0.03, 0.0, -0.03, -0.2])
def test_the_labels_of_the_cartpole_keep_apart(index: int, angle: float) -> None:
    state = [0.5, 0, angle, 0]
    ax = drawn(lambda ax: draw_cartpole(ax, POLES, index, state, labels=True), (2.9, 2, 4.5)[index])
    words = {text.get_text() for text in texts(ax)}
    names = {r"$m_\mathrm{cart}$", r"$m_\mathrm{pole}$", r"$l_\mathrm{pole}$", "$F$", "$-F$"}
    assert words == names | {"left", "right"} | ({r"$\theta$"} if angle else set())
    check_labels(ax)


@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize("position", [-1.0, -0.8, -0.52, -0.2, 0.1])
def test_the_labels_of_the_mountain_car_keep_apart(index: int, position: float) -> None:
    draw = drawn(lambda ax: draw_mountain_car(ax, CARS, index, [position, 0], labels=True), 2.6)
    assert sorted(text.get_text() for text in texts(draw)) == [
        "$v$",
        "$v$",
        "goal",
        "left",
        "right",
    ]
    if abs(position + 0.52) < 0.1:
        check_labels(draw)


def test_pictures_without_labels_have_no_words() -> None:
    assert not texts(drawn(lambda ax: draw_cartpole(ax, POLES, 0, [0, 0, 0.1, 0])))
    assert not texts(drawn(lambda ax: draw_mountain_car(ax, CARS, 0, [0, 0])))


@pytest.mark.parametrize("labels", [False, True])
@pytest.mark.parametrize("index", [0, 1, 2])
def test_the_pole_has_its_length_and_angle(index: int, labels: bool) -> None:
    ax = drawn(lambda ax: draw_cartpole(ax, POLES, index, [-1.0, 0, 0.1, 0], labels))
    (pole,) = [line for line in ax.lines if line.get_color() == POLE]
    x, y = np.diff(pole.get_xydata(), axis=0)[0]
    assert np.hypot(x, y) == pytest.approx(2 * float(POLES.half_length[index]))
    assert np.arctan2(x, y) == pytest.approx(0.1)
    assert pole.get_xydata()[0, 0] == -1.0
    assert ax.get_ylim()[1] > pole.get_xydata()[1, 1]


def test_the_length_label_spans_the_half_length() -> None:
    ax = drawn(lambda ax: draw_cartpole(ax, POLES, 0, [0, 0, 0.1, 0], labels=True))
    spans = [np.hypot(*arrow) for arrow in arrows(ax)]
    assert any(span == pytest.approx(0.5) for span in spans)


def test_arrows_are_as_long_as_the_speed_and_point_both_ways() -> None:
    lengths = []
    for index in (0, 1):
        ax = drawn(lambda ax, i=index: draw_mountain_car(ax, CARS, i, [-0.9, 0], labels=True))
        left, right = arrows(ax)
        assert left[0] < 0 < right[0]
        assert np.allclose(left, -right)
        lengths.append(np.hypot(*right))
    assert lengths[1] / lengths[0] == pytest.approx(1.5)


@pytest.mark.parametrize("position", [-1.2, -0.9, -0.5, 0.2, 0.55])
def test_the_car_stands_on_the_hill(position: float) -> None:
    ax = drawn(lambda ax: draw_mountain_car(ax, CARS, 0, [position, 0]))
    (hill,) = [line for line in ax.lines if len(line.get_xdata()) > 2]
    height = np.interp(position, *hill.get_xydata().T)
    (body,) = [p for p in ax.patches if p.get_facecolor()[:3] == to_rgb(BODY)]
    centre = (
        ax.transData.inverted()
        .transform(body.get_transform().transform(body.get_path().vertices))
        .mean(0)
    )
    assert np.hypot(*(centre - [position, height])) < 0.1


def to_rgb(color: str) -> tuple[float, ...]:
    return tuple(int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
