"""The claims of chapter 6, page by page, each judged in both protocols and on the published curves.

Bounds were set after the first edition's runs had been seen and before those that are judged here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from vtbook.claims import Claim
from vtbook.judged.control import cartpole, mountain_car
from vtbook.judged.mazes import OTHER_MAZES, mazes
from vtbook.judged.rooms import (
    rooms_distribution_change,
    rooms_evaluation,
    rooms_exploration,
    rooms_likelihood,
    rooms_number_of_sources,
)

__all__ = ["OTHER_MAZES", "PAGES"]

# The pages in the book's order.
PAGES: Mapping[str, Callable[[], list[Claim]]] = {
    judge.__name__: judge
    for judge in (
        rooms_evaluation,
        rooms_distribution_change,
        rooms_exploration,
        rooms_likelihood,
        rooms_number_of_sources,
        cartpole,
        mountain_car,
        mazes,
    )
}
