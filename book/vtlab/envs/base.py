"""What an environment of the laboratory is: tasks in batches, and a record of all else."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Self, cast

import numpy as np
import torch
from attrs import evolve, frozen
from numpy.typing import ArrayLike
from torch import Tensor

from vtlib.checks import shown
from vtlib.qfunctions import QFunction
from vtlib.rng import generator


@frozen(eq=False, slots=False)
class TaskBatch(ABC):
    """R tasks, one per row, with dynamics that are pure functions of state, action and noise.

    Subclasses are frozen attrs classes. `parameters` names the fields with a row for each task;
    what other fields hold is common to all. `start` takes uniform numbers (R, start_dim) in [0, 1)
    and gives first states. `step` takes states (R, state_dim), actions (R,) int64 and normal noise
    (R, noise_dim). It gives next states, rewards (R,) float32 and terminated (R,) bool, and refuses
    other shapes by a ValueError.
    """

    parameters: ClassVar[tuple[str, ...]]
    n_actions: ClassVar[int]
    obs_dim: ClassVar[int]
    state_dim: ClassVar[int]
    noise_dim: ClassVar[int]
    start_dim: ClassVar[int]
    horizon: ClassVar[int]
    gamma: ClassVar[float]

    @abstractmethod
    def start(self, u: Tensor) -> Tensor:
        """First states (R, state_dim) of uniform numbers."""

    @abstractmethod
    def step(self, state: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Next states, rewards, and whether these are terminal."""

    def __len__(self) -> int:
        return len(getattr(self, self.parameters[0]))

    def observe(self, state: Tensor) -> Tensor:
        """Observations (R, obs_dim) of the states (R, obs_dim): the states themselves."""
        return state

    def select(self, index: Tensor | np.ndarray | Sequence[int]) -> Self:
        """The tasks at `index`, in that order; an index may repeat."""
        rows, batch = torch.as_tensor(index), cast(Any, self)
        return cast(Self, evolve(batch, **{n: getattr(self, n)[rows] for n in self.parameters}))

    def _check_step(self, state: Tensor, action: Tensor, noise: Tensor) -> None:
        shapes = (len(self), self.state_dim), (len(self),), (len(self), self.noise_dim)
        got = tuple(state.shape), tuple(action.shape), tuple(noise.shape)
        if got != shapes:
            raise ValueError(f"state, action, noise must have shapes {shapes}, got {got}")


class ParameterBatch(TaskBatch):
    """Tasks without noise, told apart by positive, finite float32 (R,); ValueError otherwise."""

    noise_dim: ClassVar[int] = 0

    def __attrs_post_init__(self) -> None:
        for name in self.parameters:
            value = getattr(self, name)
            # Written so that NaN is refused too.
            wrong = ~((value > 0) & (value < math.inf))
            if bool(wrong.any()):
                raise ValueError(f"{name} must be positive and finite, got {value[wrong][0]:g}")

    @classmethod
    def of(cls, count: int, **parameters: ArrayLike) -> Self:
        """`count` tasks, each parameter a number for all or a vector (count,); else ValueError."""
        vectors = {}
        for name, value in parameters.items():
            array = float_array(name, value)
            if array.shape not in ((), (count,)):
                raise ValueError(
                    f"{name} must be a number or have shape ({count},), got shape {array.shape}"
                )
            vectors[name] = torch.from_numpy(np.full(count, array))
        return cls(**vectors)


@frozen
class TaskFamily(ABC):
    """A distribution over tasks, and the one record of what its environment brings to experiments.

    `parameters` are the fields that tell its tasks apart, `limits` those of the axis of returns in
    figures, `scale` the deviation of a network's first weights (0 for a linear Q-function),
    `window` how many of the last episodes the learning return is a mean of, and `kernel` the name
    of its kernel in `vtlab.native`, if any.
    """

    parameters: ClassVar[tuple[str, ...]]
    limits: ClassVar[tuple[float, float]]
    scale: ClassVar[float] = 0.1
    window: ClassVar[int] = 50
    kernel: ClassVar[str] = ""

    # Tasks are Any here, because each family has its own class of them.

    @abstractmethod
    def q(self) -> QFunction:
        """The Q-function of the environment's experiments."""

    @abstractmethod
    def optimum(self, tasks: Any) -> Tensor:
        """Best mean discounted return (R,) that an episode of each task can earn."""

    @abstractmethod
    def sample(self, rng: np.random.Generator, count: int) -> TaskBatch:
        """Draw `count` tasks, independent and alike."""

    def solved(self, returns: Tensor, optimum: Tensor, required: float) -> Tensor:
        """Whether the mean of returns (R, E) reaches a share of the optimum (R,), bool (R,)."""
        return returns.mean(1) >= optimum - (1 - required) * optimum.abs()

    def for_sources(self, tasks: Any) -> Any:
        """The tasks as sources learn them: as they are, unless a family says otherwise."""
        return tasks

    def draw_tasks(self, stream: str, runs: Sequence[int]) -> TaskBatch:
        """One task for each run, whatever the other runs are."""
        tasks: list[Any] = [self.sample(generator(stream, run, "task"), 1) for run in runs]
        rows = {name: torch.cat([getattr(x, name) for x in tasks]) for name in self.parameters}
        return cast(TaskBatch, evolve(tasks[0], **rows))

    def source_tasks(self, stream: str, sources: Sequence[int]) -> TaskBatch:
        """The tasks of some sources of a pool, each drawn from a generator of its own."""
        return TaskFamily.draw_tasks(self, stream, sources)

    def first_weights(self, stream: str, runs: Sequence[int]) -> Tensor:
        """Weights (R, d) before learning, each run's from a generator of its own."""
        rngs, d = [generator(stream, run, "first weights") for run in runs], self.q().d
        numbers = np.stack([rng.standard_normal(d) for rng in rngs])
        return torch.from_numpy(self.scale * numbers).float()

    def kernel_parameters(self, tasks: Any, row: int) -> list[float]:
        """The numbers that tell a task apart for the kernel, at most five."""
        return [float(getattr(tasks, name)[row]) for name in self.parameters]

    def values(self, tasks: Any) -> dict[str, np.ndarray]:
        """What tells some tasks of the family apart, one array (R, ...) per parameter."""
        return {name: getattr(tasks, name).numpy() for name in self.parameters}


def float_array(name: str, value: ArrayLike) -> np.ndarray:
    """A number, or numbers in nested lists of one shape, as float32; ValueError for others."""
    array = np.asarray(value)
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{name} must be a number or an array of numbers, got {shown(value)}")
    with np.errstate(over="ignore"):  # callers refuse infinity
        return array.astype(np.float32)
