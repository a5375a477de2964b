"""Optimal values of rooms tasks by dynamic programming on a grid, the noise integrated."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from statistics import NormalDist

import torch
from torch import Tensor

from vtlib.checks import check_positive
from vtlib.envs.rooms import SIDE, Rooms
from vtlib.mellow import mellowmax

SPACING = 1 / 6
QUADRATURE = 9
START_CELLS = 50
LOOK_AHEAD_CHUNK = 4096


@dataclass(frozen=True, eq=False)
class Grid:
    """Nodes of one rectangular grid per room, so that no interpolation reaches through a wall.

    `bottom` and `cell` (rooms,) are each room's lowest node and the height of its cells; `width` is
    that of every cell; `columns` nodes make a row, `rows` rows a room; `nodes` (N, 2) are ordered
    room by room, row by row.
    """

    task: Rooms
    bottom: Tensor
    cell: Tensor
    width: float
    columns: int
    rows: int
    nodes: Tensor

    def locate(self, state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The four nodes around each state (B, 2): column (B, 4), row (B, 4), weight (B, 4).

        Rows are counted from the lowest row of the lowest room; the weights are bilinear.
        """
        room = self.task.room(state)
        x, y = state.unbind(1)
        across = (x / self.width).clamp(0, self.columns - 1)
        up = ((y - self.bottom[room]) / self.cell[room]).clamp(0, self.rows - 1)
        left = across.floor().clamp(max=self.columns - 2)
        low = up.floor().clamp(max=self.rows - 2)
        right_weight, high_weight = across - left, up - low
        left_weight, low_weight = 1 - right_weight, 1 - high_weight
        column, row = left.long(), low.long() + room * self.rows
        return (
            torch.stack([column, column + 1, column, column + 1], 1),
            torch.stack([row, row, row + 1, row + 1], 1),
            torch.stack(
                [
                    left_weight * low_weight,
                    right_weight * low_weight,
                    left_weight * high_weight,
                    right_weight * high_weight,
                ],
                1,
            ),
        )

    def interpolate(self, values: Tensor, state: Tensor) -> Tensor:
        """Values (B,) at the states (B, 2) from those of the nodes (N,)."""
        column, row, weight = self.locate(state)
        return (weight * values[row * self.columns + column]).sum(1)


def make_grid(task: Rooms, spacing: float = SPACING) -> Grid:
    """The grid of one task, its cells about `spacing` wide and high."""
    edges = torch.cat([torch.zeros(1), task.walls, torch.full((1,), SIDE)])
    bottom, top = edges[:-1], edges[1:].clone()
    # A wall itself belongs to the room above: the room below ends just short of it.
    top[:-1] = torch.nextafter(top[:-1], bottom[:-1])
    columns = max(2, round(SIDE / spacing) + 1)
    rows = max(2, round(float((top - bottom).max()) / spacing) + 1)
    cell = (top - bottom) / (rows - 1)
    x = torch.linspace(0, SIDE, columns)
    heights = torch.stack(
        [torch.linspace(float(b), float(t), rows) for b, t in zip(bottom, top, strict=True)]
    )
    heights = torch.minimum(heights, top[:, None]).flatten()
    nodes = torch.stack([x.repeat(len(heights)), heights.repeat_interleave(columns)], 1)
    return Grid(task, bottom, cell, SIDE / (columns - 1), columns, rows, nodes)


def gaussian_quadrature(count: int) -> Tensor:
    """Points (count^2, 2) whose plain mean stands for one over two standard normal numbers.

    `count` points of equal probability on each axis, scaled to unit variance.
    """
    # Values jump at door posts and at the goal's rim.  Gauss-Hermite points, best for smooth
    # functions, lie too far apart near zero for that: 9 of them overrate a task by 0.001, 9 of
    # these by 0.0002.
    quantiles = [NormalDist().inv_cdf((i + 0.5) / count) for i in range(count)]
    points = torch.tensor(quantiles, dtype=torch.float64)
    points = (points / points.square().mean().sqrt()).float()
    return torch.cartesian_prod(points, points)


def _try_out(
    task: Rooms, state: Tensor, action: int, noise: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """One step of `Rooms.step` from B states under each of K noises.

    States (B K, 2) reached, reward (B, K), terminal (B, K).
    """
    count, points = len(state), len(noise)
    total = count * points
    tasks = task.select(torch.zeros(total, dtype=torch.int64))
    reached, reward, terminal = tasks.step(
        state.repeat_interleave(points, 0), torch.full((total,), action), noise.repeat(count, 1)
    )
    return reached, reward.view(count, points), terminal.view(count, points)


@dataclass(frozen=True, eq=False)
class Model:
    """The task as a finite Markov decision process over the grid's nodes.

    `transition` (A N, N) is sparse, its rows sum to at most one (a terminal step goes nowhere);
    `reward` (A N,) is the expected reward; rows are ordered action by action.  `kappa` None stands
    for the maximum over actions, a number for its mellowmax (eq. 5.3).
    """

    transition: Tensor
    reward: Tensor
    kappa: float | None = None

    def backup(self, value: Tensor) -> Tensor:
        """Bellman backup: node values (N,) to better ones (N,)."""
        q = (self.reward + Rooms.gamma * (self.transition @ value)).view(Rooms.n_actions, -1)
        return q.amax(0) if self.kappa is None else mellowmax(q, self.kappa, 0)


def make_model(grid: Grid, noise: Tensor, kappa: float | None = None) -> Model:
    """Average `Rooms.step` itself over the noises (K, 2), from every node with every action."""
    parts = [_transitions(grid, action, noise) for action in range(Rooms.n_actions)]
    counts, columns, values, reward = (torch.cat(part) for part in zip(*parts, strict=True))
    starts = torch.cat([torch.zeros(1, dtype=torch.int64), counts.cumsum(0)])
    with warnings.catch_warnings():
        # Said by torch once per process of every CSR tensor; only its product with a vector is
        # used, and the tests hold that against rollouts.
        warnings.filterwarnings("ignore", message="Sparse CSR tensor support is in beta")
        transition = torch.sparse_csr_tensor(
            starts, columns, values, (len(counts), len(grid.nodes)), check_invariants=False
        )
    return Model(transition, reward, kappa)


def _transitions(grid: Grid, action: int, noise: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Rows of one action: entries per row (N,), their columns, their values; reward (N,).

    One noise lands among four nodes and many noises among the same ones.  They are added up in a
    small window of nodes around the lowest and leftmost that a row reaches, which is far cheaper
    than sorting all entries.
    """
    count = len(grid.nodes)
    reached, reward, terminal = _try_out(grid.task, grid.nodes, action, noise)
    column, row, weight = grid.locate(reached)
    weight = (weight * ~terminal.view(-1, 1) / len(noise)).view(count, -1)
    column, row = column.view(count, -1), row.view(count, -1)
    first_column, first_row = column.amin(1, keepdim=True), row.amin(1, keepdim=True)
    column, row = column - first_column, row - first_row
    wide, high = int(column.max()) + 1, int(row.max()) + 1
    window = torch.zeros(count, high * wide).scatter_add_(1, row * wide + column, weight)
    source, slot = window.nonzero(as_tuple=True)
    target_column = first_column[source, 0] + slot % wide
    target_row = first_row[source, 0] + slot // wide
    return (
        torch.bincount(source, minlength=count),
        target_row * grid.columns + target_column,
        window[source, slot],
        reward.mean(1),
    )


@dataclass(frozen=True, eq=False)
class Plan:
    """Values of one task, for any state, by one step of `Rooms.step` and the grid's values.

    `after` (T, N) holds the nodes' optimal values once the first of 1 to T steps to go is made; a
    plan for an endless episode has T = 1.  Where a method takes `steps_to_go`, None means all that
    were planned; a number outside 1..T raises ValueError.
    """

    grid: Grid
    noise: Tensor
    after: Tensor

    def q(self, states: Tensor, steps_to_go: int | None = None) -> Tensor:
        """Optimal action values (B, A) at the states (B, 2)."""
        after = self.after[self._row(steps_to_go)]
        chunks = _checked_states(states).split(LOOK_AHEAD_CHUNK)
        return torch.cat([self._look_ahead(chunk, after) for chunk in chunks])

    def value(self, states: Tensor, steps_to_go: int | None = None) -> Tensor:
        """Optimal discounted return (B,) from the states (B, 2)."""
        return self.q(states, steps_to_go).amax(1)

    def greedy(self, states: Tensor, steps_to_go: int | None = None) -> Tensor:
        """Optimal actions (B,) int64 at the states (B, 2)."""
        return self.q(states, steps_to_go).argmax(1)

    def _look_ahead(self, state: Tensor, after: Tensor) -> Tensor:
        # Not an interpolation of the nodes' action values: beside a door post that would mix
        # nodes that face the door with nodes that face the wall, and its greedy policy would push
        # against the wall for ever in 1 to 2 % of the episodes.
        q = []
        for action in range(Rooms.n_actions):
            reached, reward, terminal = _try_out(self.grid.task, state, action, self.noise)
            value = self.grid.interpolate(after, reached).view_as(reward)
            q.append((reward + Rooms.gamma * ~terminal * value).mean(1))
        return torch.stack(q, 1)

    def _row(self, steps_to_go: int | None) -> int:
        planned = len(self.after)
        steps = planned if steps_to_go is None else steps_to_go
        if not 1 <= steps <= planned:
            raise ValueError(f"steps_to_go must lie in 1..{planned}, got {steps}")
        return steps - 1


def plan(
    tasks: Rooms,
    index: int,
    sweeps: int | None = Rooms.horizon,
    *,
    spacing: float = SPACING,
    quadrature: int = QUADRATURE,
    tolerance: float = 1e-6,
    kappa: float | None = None,
) -> Plan:
    """Optimal values of task `index` with up to `sweeps` steps to go, or endlessly with None.

    `spacing` is the grid's in units of length, `quadrature` the number of noise points per axis;
    endless sweeps stop when no value changes by more than `tolerance`.  With `kappa` the values are
    those of the mellow Bellman operator (eq. 5.3) in place of the optimal ones.  Raises ValueError
    when an argument is out of range.  The task's doors may lie on any device; the plan is made on
    the CPU.
    """
    _check_plan(len(tasks), index, sweeps, spacing, quadrature, tolerance, kappa)
    grid = make_grid(tasks.select([index]).to("cpu"), spacing)
    noise = gaussian_quadrature(quadrature)
    model = make_model(grid, noise, kappa)
    if sweeps is None:
        return Plan(grid, noise, _converge(model, tolerance)[None])
    after = torch.zeros(sweeps, len(grid.nodes))
    for step in range(1, sweeps):
        after[step] = model.backup(after[step - 1])
    return Plan(grid, noise, after)


def optimal_return(tasks: Rooms) -> Tensor:
    """Best expected discounted return (R,) of each task over one episode cut at the horizon.

    From (0, 0), or the mean over starts anywhere in the square for tasks with `uniform_start`.
    """
    return torch.stack(
        [plan(tasks, index).value(_starts(tasks)).mean() for index in range(len(tasks))]
    )


def _starts(tasks: Rooms) -> Tensor:
    if not tasks.uniform_start:
        return tasks.start(torch.zeros(1, 2))
    middles = (torch.arange(START_CELLS) + 0.5) / START_CELLS
    return tasks.start(torch.cartesian_prod(middles, middles))


def _converge(model: Model, tolerance: float) -> Tensor:
    value = torch.zeros(model.transition.shape[1])
    while True:
        better = model.backup(value)
        if (better - value).abs().max() <= tolerance:
            return better
        value = better


def _checked_states(states: Tensor) -> Tensor:
    if states.ndim != 2 or states.shape[1] != Rooms.obs_dim:
        raise ValueError(f"states must have shape (B, 2), got {tuple(states.shape)}")
    if not bool(((states >= 0) & (states <= SIDE)).all()):
        raise ValueError(f"states must lie in [0, {SIDE:g}], got one outside or NaN")
    return states


def _check_plan(
    count: int,
    index: int,
    sweeps: int | None,
    spacing: float,
    quadrature: int,
    tolerance: float,
    kappa: float | None,
) -> None:
    if not 0 <= index < count:
        raise ValueError(f"index must lie in 0..{count - 1}, got {index}")
    if sweeps is not None and sweeps < 1:
        raise ValueError(f"sweeps must be at least 1, or None, got {sweeps}")
    if not 0.02 <= spacing <= 1:
        raise ValueError(f"spacing must lie in [0.02, 1], got {spacing}")
    if not 2 <= quadrature <= 50:
        raise ValueError(f"quadrature must lie in 2..50, got {quadrature}")
    # Below this float32 rounding may never settle.
    if not 1e-6 <= tolerance < math.inf:
        raise ValueError(f"tolerance must be at least 1e-06, got {tolerance}")
    if kappa is not None:
        check_positive("kappa", kappa)
