"""What differs between the environments: Q-function, first weights, optimum, what is solved."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from vtlib.envs.cartpole import Cartpole, CartpoleFamily
from vtlib.envs.episodes import Tasks
from vtlib.envs.maze import MazeFamily
from vtlib.envs.mountain_car import MountainCarFamily
from vtlib.envs.rooms import Rooms, RoomsFamily
from vtlib.planning import optimal_return
from vtlib.planning_maze import maze_optimum
from vtlib.planning_mountain_car import car_optimum
from vtlib.qfunctions import MLP, QFunction, RBFLinear
from vtlib.streams import generator

Family = RoomsFamily | CartpoleFamily | MountainCarFamily | MazeFamily
CART_RETURN = (1 - Cartpole.gamma**Cartpole.horizon) / (1 - Cartpole.gamma)  # of a whole episode


@dataclass(frozen=True)
class Domain:
    """One environment's side of the experiments.

    q: its Q-function. optimum: best mean return (R,) of tasks. parameters: the fields of its tasks
    that differ between them. scale: deviation of a network's first weights, 0 for linear Q.
    passes: whether greedy returns (R, E) of E episodes, against the optimum (R,), solve each task
    to the required share.
    limits: of the axis of returns in figures.
    for_sources: the tasks as sources are trained on them. window: how many of the last episodes the
    learning return is a mean of.
    """

    q: Callable[[], QFunction]
    optimum: Callable[[Any], Tensor]  # Any: its own kind of tasks
    parameters: tuple[str, ...]
    scale: float
    passes: Callable[[Tensor, Tensor, float], Tensor]
    limits: tuple[float, float]
    for_sources: Callable[[Any], Tasks] = lambda tasks: tasks
    window: int = 50


def rooms_q() -> RBFLinear:
    """The rooms' Q-function: 121 normalised radial bases for each of 4 actions, 484 weights."""
    return RBFLinear(torch.arange(11.0), 1 / 9, Rooms.n_actions)


def near_optimum(returns: Tensor, optimum: Tensor, required: float) -> Tensor:
    """Whether mean returns (R, E) miss the optimum (R,) by at most 1 - required of its size."""
    return returns.mean(1) >= optimum - (1 - required) * optimum.abs()


def balances(returns: Tensor, optimum: Tensor, required: float) -> Tensor:
    """Whether the required share of episodes (R, E) lasts to the horizon."""
    whole = returns >= optimum.unsqueeze(1) - 1e-3
    return whole.float().mean(1) >= required


DOMAINS = {
    RoomsFamily: Domain(
        rooms_q,
        optimal_return,
        ("doors",),
        0.0,
        near_optimum,
        (-0.02, 0.9),
        lambda tasks: replace(tasks, uniform_start=True),
    ),
    CartpoleFamily: Domain(
        lambda: MLP((4, 32, 2)),
        lambda tasks: torch.full((len(tasks),), CART_RETURN),
        ("cart_mass", "pole_mass", "half_length"),
        0.1,
        balances,
        (0.0, 68.0),
    ),
    MountainCarFamily: Domain(
        lambda: MLP((2, 64, 3)), car_optimum, ("speed",), 0.1, near_optimum, (-90.0, -35.0)
    ),
    MazeFamily: Domain(
        lambda: MLP((22, 32, 32, 3)),
        maze_optimum,
        ("walls", "goal"),
        0.1,
        near_optimum,
        (-0.02, 0.9),
        window=25,
    ),
}


def domain(family: Family) -> Domain:
    """The domain that a family of tasks belongs to."""
    return DOMAINS[type(family)]


def first_weights(family: Family, name: str, runs: Sequence[int]) -> Tensor:
    """Weights (R, d) before learning, each run's from a generator of its own."""
    scale, d = domain(family).scale, domain(family).q().d
    draws = [generator(name, run, "first weights").standard_normal(d) for run in runs]
    return torch.from_numpy(scale * np.stack(draws)).float()


def parameters(family: Family, tasks: Tasks) -> dict[str, np.ndarray]:
    """What tells the tasks of a family apart, one array (R, ...) per parameter."""
    return {name: getattr(tasks, name).numpy() for name in domain(family).parameters}
