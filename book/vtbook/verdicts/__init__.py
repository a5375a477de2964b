"""The claims of chapter 6, page by page, each judged by our runs and on the published curves.

No bound is a blind prediction, because the first edition's runs had been seen. Most bounds were
committed before the runs that they judge. The bounds of three rooms and of maze 8 were committed
together with their runs, so nobody can tell which came first. The scorecard has the whole table.
"""

from collections.abc import Callable, Mapping

from vtbook.claims import Claim
from vtbook.verdicts.control import cartpole, mountain_car
from vtbook.verdicts.mazes import mazes
from vtbook.verdicts.rooms import (
    rooms_distribution_change,
    rooms_evaluation,
    rooms_exploration,
    rooms_likelihood,
    rooms_number_of_sources,
)

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
