"""Batches of tasks that differ in a few positive numbers each: physical parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import ClassVar, Self

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from vtlib.checks import check_kind, check_whole, shown


def checked_rows(index: Tensor | np.ndarray | Sequence[int], count: int) -> Tensor:
    """Integers that index a batch of `count` tasks, as a tensor; ValueError for anything else."""
    try:
        rows = torch.as_tensor(index)
    except (TypeError, ValueError, RuntimeError, OverflowError):
        raise ValueError(f"index must be a list of integers, got {shown(index)}") from None
    if rows.ndim != 1 or rows.dtype.is_floating_point or rows.dtype == torch.bool:
        raise ValueError(f"index must be a list of integers, got {shown(index)}")
    if len(rows) and not -count <= int(rows.min()) <= int(rows.max()) < count:
        raise ValueError(f"index must lie in 0..{count - 1}, got {shown(index)}")
    return rows


def float_array(name: str, value: ArrayLike) -> np.ndarray:
    """A number, or numbers in nested lists of one shape, as float32; ValueError for others."""
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        array = np.asarray(None)
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{name} must be a number or an array of numbers, got {shown(value)}")
    with np.errstate(over="ignore"):  # what becomes infinite is refused by those that ask
        return array.astype(np.float32)


@dataclass(frozen=True, eq=False)
class ParameterBatch:
    """R fully observed tasks without noise; each field of a subclass is one of their parameters.

    Parameters have shape (R,), are float32, positive and finite; ValueError otherwise.
    """

    obs_dim: ClassVar[int]
    noise_dim: ClassVar[int] = 0

    def __post_init__(self) -> None:
        parameters = self.parameters()
        for name, value in parameters.items():
            check_kind(name, value, Tensor)
        shapes = {name: tuple(value.shape) for name, value in parameters.items()}
        if len(set(shapes.values())) != 1 or any(len(shape) != 1 for shape in shapes.values()):
            raise ValueError(f"parameters must be vectors of one length, got shapes {shapes}")
        for name, value in parameters.items():
            if value.dtype != torch.float32:
                raise ValueError(f"{name} must be float32, got {value.dtype}")
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

    @classmethod
    def uniform(cls, rng: np.random.Generator, count: int, **ranges: tuple[float, float]) -> Self:
        """Draw `count` tasks, each parameter uniform in its range.  ValueError when count < 1."""
        check_whole("count", count)
        return cls.of(count, **{name: rng.uniform(*ends, count) for name, ends in ranges.items()})

    @classmethod
    def concatenate(cls, tasks: Sequence[Self]) -> Self:
        """All tasks of several batches, in their order.  Raises ValueError when there is none."""
        if not tasks:
            raise ValueError("there must be at least one batch of tasks to join")
        names = [field.name for field in fields(cls)]
        return cls(**{name: torch.cat([getattr(t, name) for t in tasks]) for name in names})

    def parameters(self) -> dict[str, Tensor]:
        """The parameters (R,) by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def __len__(self) -> int:
        return len(next(iter(self.parameters().values())))

    def observe(self, state: Tensor) -> Tensor:
        """Observations (R, obs_dim) of the states (R, obs_dim): the states themselves."""
        return state

    def select(self, index: Tensor | np.ndarray | Sequence[int]) -> Self:
        """The tasks at `index`, in that order; an index may repeat.  Raises ValueError outside."""
        values = self.parameters()
        rows = checked_rows(index, len(self)).to(next(iter(values.values())).device)
        return type(self)(**{name: value[rows] for name, value in values.items()})

    def to(self, device: torch.device | str) -> Self:
        """The same tasks on another device."""
        return type(self)(**{name: v.to(device) for name, v in self.parameters().items()})

    def _check_step(self, state: Tensor, action: Tensor, noise: Tensor) -> None:
        runs = len(self)
        shapes = (runs, self.obs_dim), (runs,), (runs, self.noise_dim)
        got = tuple(state.shape), tuple(action.shape), tuple(noise.shape)
        if got != shapes:
            raise ValueError(f"state, action, noise must have shapes {shapes}, got {got}")
