"""The claims of section 6.3, of the mazes.

Whoever set the bounds knew the published curves. Those of the main maze were committed together
with its runs, and before those of the other mazes. The row on the optimum, which is over all of
them, came after the runs.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from attrs import evolve

from vtbook.claims import MIXTURES, OPTIMAL, Claim, Figure, difference, share_interval
from vtbook.experiments.maze import ITERATIONS, MAIN, MAZE_TARGETS, TARGETS

START, END = 600, 16_800  # the published curves end at 16,900


def mazes() -> list[Claim]:
    """Section 6.3: the main maze of Figure 6.12, and those that have no 3-MGVT there."""
    numbers = sorted(TARGETS, key=lambda number: number != MAIN)
    figures = {number: Figure(MAZE_TARGETS[number], f"maze-{number}") for number in numbers}
    each = [
        evolve(claim, text=f"Maze {number}: {claim.text}")
        for number, figure in figures.items()
        for claim in _of(figure, MIXTURES if number == MAIN else ("1-MGVT",))
    ]
    return [*each, _some_optimal(figures.values())]


def _some_optimal(figures: Iterable[Figure]) -> Claim:
    """One row over all mazes and mixtures: none of twenty runs would leave it open."""
    mixtures = [figure.runs[x] for figure in figures for x in MIXTURES if x in figure.runs]
    return Claim(
        "Some runs of the mixtures come to the optimum.",
        "share of runs, in all mazes, whose greedy policy is optimal in the last ten evaluations",
        share_interval(np.concatenate([runs.optimal(ITERATIONS) for runs in mixtures])),
        None,
        low=0.05,
    )


def _of(figure: Figure, mixtures: Sequence[str]) -> list[Claim]:
    claims = [
        *figure.earns("{} fails.", ("GVT",), END, high=0.1),
        *figure.ahead("{} shows negative transfer.", ("GVT",), ("DDQN",), END, high=0.0),
        figure.claim(
            "What GVT can do at the beginning, it loses.",
            f"learning return at {END:,} minus that at {START}, of the optimum",
            lambda a: difference(a.share(END), a.share(START)),
            "GVT",
            high=0.0,
        ),
        *figure.ahead("{} learns faster than {}.", mixtures, ("GVT", "DDQN"), END, low=0.0),
        *figure.earns("{} has no good jump-start.", mixtures, START, high=0.25),
        *figure.earns("{} does not converge to the optimum.", ("DDQN",), END, high=OPTIMAL),
    ]
    if len(mixtures) == 1:
        return claims
    alike = "Three components gain as much as one."
    return [
        *claims,
        *figure.ahead(alike, ("3-MGVT",), ("1-MGVT",), END, low=-0.15, high=0.15, ours=True),
    ]
