"""Exponentials that are added up, without what a sum would round away."""

from __future__ import annotations

import math

import torch
from torch import Tensor


def exp_of_differences(x: Tensor) -> Tensor:
    """exp(x) of differences x <= 0 from the largest term of a sum; x is overwritten.

    Zero where the sum, which is at least one, would round it away. Left in, such numbers and their
    products become denormal, and on those a processor is up to a hundred times slower.
    """
    rounding = torch.finfo(x.dtype).eps
    x = x.clamp_(min=math.log(rounding) - 1).exp_()
    # not in place: autograd still needs the exponentials
    return torch.nn.functional.threshold(x, rounding, 0.0)
