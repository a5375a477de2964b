"""The drawings: parts in their places, labels apart and inside."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import torch
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.text import Annotation

from vtlib.envs import Cartpole, Mazes, MountainCar, Rooms
from vtlib.envs.cartpole.draw import draw_cartpole
from vtlib.envs.draw import ARROW, BODY, FLAG, POLE
from vtlib.envs.maze.draw import draw_maze
from vtlib.envs.mountain_car.draw import draw_mountain_car
from vtlib.envs.rooms.draw import draw_rooms

POLES = Cartpole.of(3, cart_mass=1.0, pole_mass=0.1, half_length=[0.5, 0.2, 1.0])
CARS = MountainCar.of(2, speed=[0.001, 0.0015])
MAZES = Mazes.of(["north-east 0", "south-west 14"])


def drawn(draw, *arguments, height: float = 2.9, **options) -> Axes:
    """Axes of a figure as wide as a page's narrow column, drawn once."""
    figure = Figure(figsize=(3.6, height), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    ax = figure.add_subplot()
    draw(ax, *arguments, **options)
    figure.canvas.draw()
    return ax


def words(ax: Axes) -> set[str]:
    """The labels, which neither overlap nor leave the figure."""
    labels = [text for text in ax.texts if text.get_text()]
    boxes, inside = [text.get_window_extent() for text in labels], ax.figure.bbox
    assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))
    for box in boxes:
        assert inside.x0 <= box.x0 <= box.x1 <= inside.x1
        assert inside.y0 <= box.y0 <= box.y1 <= inside.y1
    return {text.get_text() for text in labels}


def arrows(ax: Axes) -> list[np.ndarray]:
    """Lengths and directions of the arrows, as vectors."""
    found = [text for text in ax.texts if isinstance(text, Annotation)]
    return [np.array(arrow.xy) - np.array(arrow.xyann) for arrow in found]


def test_the_drawing_of_rooms_leaves_the_doors_open() -> None:
    ax = drawn(draw_rooms, Rooms.from_doors([[5.0, 5.0], [2.0, 7.0]]), 1)
    walls = [line.get_xydata().tolist() for line in ax.lines if len(line.get_xdata()) == 2]
    gaps = [(left[1][0], right[0][0]) for left, right in zip(walls[::2], walls[1::2], strict=True)]
    assert gaps == [(1.5, 2.5), (6.5, 7.5)]


@pytest.mark.parametrize(("index", "height"), [(0, 2.9), (1, 2.0), (2, 4.5)])
@pytest.mark.parametrize("labels", [False, True])
def test_a_cartpole_and_its_labels(index: int, height: float, labels: bool) -> None:
    names = {r"$m_\mathrm{cart}$", r"$m_\mathrm{pole}$", r"$l_\mathrm{pole}$", r"$\theta$"}
    names |= {"$F$", "$-F$", "left", "right"}
    half = float(POLES.half_length[index])
    for angle in (0.2, 0.03):
        state = [-1.0, 0, angle, 0]
        ax = drawn(draw_cartpole, POLES, index, state, labels, height=height)
        assert words(ax) == (names if labels else set())
        assert any(np.hypot(*arrow) == pytest.approx(half) for arrow in arrows(ax)) == labels
        (pole,) = [line for line in ax.lines if line.get_color() == POLE]
        x, y = np.diff(pole.get_xydata(), axis=0)[0]
        assert (np.hypot(x, y), np.arctan2(x, y)) == pytest.approx((2 * half, angle))
        assert pole.get_xydata()[0, 0] == -1.0
        assert ax.get_ylim()[1] > pole.get_xydata()[1, 1]


def test_the_labels_of_the_mountain_car_and_arrows_as_long_as_the_speed() -> None:
    lengths = []
    for index in (0, 1):
        ax = drawn(draw_mountain_car, CARS, index, [-0.52, 0], labels=True, height=2.6)
        assert words(ax) == {"$v$", "goal", "left", "right"}
        left, right = arrows(ax)
        assert left[0] < 0 < right[0]
        assert np.allclose(left, -right)
        lengths.append(np.hypot(*right))
    assert lengths[1] / lengths[0] == pytest.approx(1.5)


@pytest.mark.parametrize("position", [-1.2, -0.5, 0.55])
def test_the_car_stands_on_the_hill(position: float) -> None:
    ax = drawn(draw_mountain_car, CARS, 0, [position, 0])
    assert not words(ax)
    (hill,) = [line for line in ax.lines if len(line.get_xdata()) > 2]
    height = np.interp(position, *hill.get_xydata().T)
    (body,) = [p for p in ax.patches if p.get_facecolor()[:3] == to_rgb(BODY)]
    outline = body.get_transform().transform(body.get_path().vertices)
    centre = ax.transData.inverted().transform(outline).mean(0)
    assert np.hypot(*(centre - [position, height])) < 0.1


# --- mazes ------------------------------------------------------------------------------------


def drawn_maze(state: list[float] | None = None) -> Axes:
    figure = Figure(figsize=(4, 4), dpi=100)
    FigureCanvasAgg(figure)
    ax = figure.add_axes((0, 0, 1, 1))
    draw_maze(ax, MAZES, 1, state)
    figure.canvas.draw()
    return ax


def test_cells_are_drawn_where_they_are_and_without_seams() -> None:
    picture = np.asarray(drawn_maze().figure.canvas.buffer_rgba())[..., :3].astype(int)
    # Middles of the cells, [x, y] from bottom left.
    middles = picture[20::40, 20::40][::-1].transpose(1, 0, 2)
    maze = MAZES.walls[1].numpy()
    assert (middles[maze].sum(1) < 300).all()
    free = ~maze
    free[0, 0] = False
    assert (middles[free] == 255).all()
    assert middles[0, 0].tolist() == [round(255 * part) for part in to_rgb(FLAG)]
    # Row 7 from above of "south-west 14" begins with three walls.
    assert (np.ptp(picture[260, 6:114], axis=0) == 0).all()


def test_the_robot_stands_in_its_place_and_its_rays_end_where_they_read() -> None:
    state = [0.5, 2.5, -math.pi / 2]
    ax = drawn_maze(state)
    (robot,) = [patch for patch in ax.patches if isinstance(patch, Circle)]
    assert robot.center == pytest.approx((0.5, 2.5))
    seen = MAZES.select([1]).observe(torch.tensor([state]))[0]
    lines = [line for line in ax.lines if line.get_color() in (ARROW, FLAG)]
    rays = [line for line in lines if len(line.get_xdata()) == 2]
    lengths = [np.hypot(*np.diff(ray.get_xydata(), axis=0)[0]) for ray in rays]
    np.testing.assert_allclose(lengths, seen[4:13], atol=1e-5)
    colors = [ray.get_color() for ray in rays]
    assert colors == [FLAG if flag else ARROW for flag in seen[13:]]
    assert {ARROW, FLAG} == set(colors)
    assert len(lines) - len(rays) == int((seen[4:13] < 2).sum())
