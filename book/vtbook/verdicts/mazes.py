"""The claims of section 6.3, of the mazes.

Whoever set the bounds knew the published curves. Those of the main maze were committed together
with its runs as published, and before its runs by the equations and those of the other mazes.
"""

from collections.abc import Sequence

from attrs import evolve

from vtbook.claims import MIXTURES, OPTIMAL, Claim, Figure, difference
from vtbook.experiments.maze import ITERATIONS, MAIN, MAZE_TARGETS, TARGETS

OTHER_MAZES = tuple(number for number in TARGETS if number != MAIN)
START, END = 600, 16_800  # the published curves end at 16,900


def mazes() -> list[Claim]:
    """Section 6.3: the main maze of Figure 6.12, and those that have no 3-MGVT there."""
    return [
        evolve(claim, text=f"Maze {number}: {claim.text}")
        for number in (MAIN, *OTHER_MAZES)
        for claim in _of(number, MIXTURES if number == MAIN else ("1-MGVT",))
    ]


def _of(number: int, mixtures: Sequence[str]) -> list[Claim]:
    figure = Figure(MAZE_TARGETS[number]._asdict(), f"maze-{number}")
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
        *(
            figure.claim(
                f"Some runs of {x} come to the optimum.",
                "share of runs whose greedy policy is optimal in the last ten evaluations",
                lambda a: a.solved(ITERATIONS),
                x,
                kind="greedy",
                printed=False,
                low=0.05,
            )
            for x in mixtures
        ),
        *figure.earns("{} does not converge to the optimum.", ("DDQN",), END, high=OPTIMAL),
        *(
            figure.claim(
                f"Sources solved by DDQN leave {x} level with DDQN or ahead of it.",
                f"{x} minus DDQN, greedy return at {END:,}, of the optimum",
                lambda a, b: a.gain(b, END, "greedy"),
                x,
                "DDQN",
                kind="greedy",
                low=0.0,
            )
            for x in mixtures
        ),
    ]
    if len(mixtures) == 1:
        return claims
    alike = "Three components gain as much as one."
    return [
        *claims,
        *figure.ahead(alike, ("3-MGVT",), ("1-MGVT",), END, low=-0.15, high=0.15, ours=True),
    ]
