"""Checks of what callers pass; each refusal is one line: the name, what is allowed, the value.

Configurations are stored as JSON, so their numbers are Python's: a whole number of NumPy's becomes
one, its others are refused, and so is True for 1.
"""

from collections.abc import Callable, Collection
from typing import Any, TypeGuard, get_args

import numpy as np
import torch
from torch import Tensor

LARGEST = 10**9  # largest whole number: nothing larger makes sense or fits into memory
TINY, HUGE = 1e-37, 1e38  # float32 holds the positive numbers between
SHOWN = 200  # characters of a value in an error


def one_line(text: object) -> str:
    """A text without line ends and other control characters, which are escaped."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in str(text))


def shown(value: object) -> str:
    """A value as an error shows it: one line that is not too long."""
    if isinstance(value, Tensor | np.ndarray):
        return f"{type(value).__name__} of shape {tuple(value.shape)}"
    text = one_line(repr(value))
    return text if len(text) <= SHOWN else text[:SHOWN] + "..."


def check_whole(name: str, value: object, least: int = 1, most: int = LARGEST) -> None:
    """Raise ValueError unless value is an integer, of Python's or NumPy's, between two others."""
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not (whole and least <= value <= most):  # type: ignore[operator]
        allowed = f"a whole number from {least} to {most}"
        raise ValueError(f"{name} must be {allowed}, got {shown(value)}")


def check_positive(name: str, value: object) -> None:
    """Raise ValueError unless value is a positive number that float32 can work with."""
    if not (_is_number(value) and TINY <= value <= HUGE):
        raise ValueError(f"{name} must be positive, from {TINY:g} to {HUGE:g}, got {shown(value)}")


def check_between(name: str, value: object, low: float, high: float, below: bool = False) -> None:
    """Raise ValueError unless value is a number from low to high; below leaves out high itself."""
    if not (_is_number(value) and low <= value <= high and not (below and value == high)):
        end = ")" if below else "]"
        raise ValueError(f"{name} must lie in [{low:g}, {high:g}{end}, got {shown(value)}")


def check_one_of(name: str, value: object, allowed: Collection[str]) -> None:
    """Raise ValueError unless value is one of some texts."""
    if not (isinstance(value, str) and value in allowed):
        raise ValueError(f"{name} must be one of {', '.join(allowed)}, got {shown(value)}")


def check_kind(name: str, value: object, kind: Any) -> None:
    """Raise ValueError unless value is an instance of a class, or of one of a union's classes."""
    if not isinstance(value, kind):
        kinds = " or ".join(x.__name__ for x in get_args(kind) or (kind,))
        raise ValueError(f"{name} must be of type {kinds}, got {shown(value)}")


def check_weights(name: str, weights: Any, *shape: str | int) -> None:
    """Raise ValueError unless weights are a finite float32 tensor of a shape.

    An axis that is given in words may have any size but 0.
    """
    check_kind(name, weights, Tensor)
    sizes = tuple(weights.shape)
    if len(sizes) != len(shape) or not all(
        size > 0 and (isinstance(axis, str) or size == axis)
        for size, axis in zip(sizes, shape, strict=True)
    ):
        axes = ", ".join(f"at least 1 {a}" if isinstance(a, str) else str(a) for a in shape)
        raise ValueError(f"{name} must have shape ({axes}), got {sizes}")
    if weights.dtype != torch.float32:
        raise ValueError(f"{name} must be float32, got {weights.dtype}")
    if not bool(weights.isfinite().all()):
        raise ValueError(f"{name} must be finite, got NaN or infinity")


Validator = Callable[[Any, Any, Any], None]  # of an attrs field: instance, attribute, value


def _for_fields(check: Callable[..., None]) -> Callable[..., Validator]:
    """A check for fields of attrs classes, from what the check takes after a value."""
    return lambda *rest, **named: lambda _, field, value: check(field.name, value, *rest, **named)


def whole(least: int = 1, most: int = LARGEST) -> Validator:
    """``check_whole`` for a field, which holds Python's number afterwards."""

    def check(instance: Any, field: Any, value: Any) -> None:
        check_whole(field.name, value, least, most)
        object.__setattr__(instance, field.name, int(value))  # the class may be frozen

    return check


positive = _for_fields(check_positive)
between = _for_fields(check_between)
one_of = _for_fields(check_one_of)
kind = _for_fields(check_kind)


def _is_number(value: object) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool)
