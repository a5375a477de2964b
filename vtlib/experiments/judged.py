"""What the thesis claims of each figure, judged by the stored runs: one function for each page."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from vtlib import claims, visits
from vtlib.claims import Claim, Returns
from vtlib.experiments import (
    CAR,
    CARTPOLE,
    MAZE_TARGETS,
    ROOMS_CHANGE,
    ROOMS_EVALUATION,
    ROOMS_EXPLORATION,
    ROOMS_LIKELIHOOD,
    ROOMS_SOURCES,
)
from vtlib.experiments.counts import learning_at
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.exploration import visited
from vtlib.experiments.figures import door_distance
from vtlib.experiments.likelihood import share_by_task, task_likelihood
from vtlib.experiments.reading import returns

MIXTURES = "1-MGVT", "3-MGVT"
DOOR = 5.0  # of every target in section 6.1.3
LIKELIHOOD_AT = (500, 1_000, 4_000)
SOURCES_AT = (1_000, 1_950)
FEW, MANY = 2, 10  # sources


def rooms_evaluation() -> list[Claim]:
    """Section 6.1.1, Figure 6.2."""
    runs = _runs(ROOMS_EVALUATION)
    return [
        claims.optimal_by("1-MGVT", runs["1-MGVT"], 5_000),
        claims.solves_most("GVT", runs["GVT"], 5_000),
        claims.only_beginning("No transfer", runs["NT"], 7_000),
        claims.better_and_steadier("1-MGVT", runs["1-MGVT"], "GVT", runs["GVT"], 10_000),
        claims.no_better("3-MGVT", runs["3-MGVT"], "1-MGVT", runs["1-MGVT"], 10_000),
    ]


def rooms_distribution_change() -> list[Claim]:
    """Section 6.1.2, Figure 6.3."""
    runs = _runs(ROOMS_CHANGE)
    gvt, one = runs["GVT"], runs["1-MGVT"]
    return [
        *(claims.optimal_by(label, runs[label], 10_000) for label in MIXTURES),
        claims.worse_and_wider("GVT", gvt, "1-MGVT", one, 10_000),
        claims.falls_with("GVT", gvt, door_distance(ROOMS_CHANGE.name), 10_000),
    ]


def rooms_exploration() -> list[Claim]:
    """Section 6.1.3, Figure 6.4."""
    seen = {label: visited(ROOMS_EXPLORATION.name, label) for label in ("NT", "GVT", "1-MGVT")}
    arrived = {label: visits.arrivals(at) for label, at in seen.items()}
    at_door = {label: visits.share_at_door(at, DOOR) for label, at in seen.items()}
    even = visits.uniform_share_at_door()
    measures = {"cells visited": visits.cells_visited, "effective cells": visits.effective_cells}
    pairs = {name: (f(seen["1-MGVT"]), f(seen["GVT"])) for name, f in measures.items()}
    return [
        claims.never_arrives("ε-greedy", arrived["NT"]),
        claims.arrives("GVT", arrived["GVT"]),
        claims.arrives("1-MGVT", arrived["1-MGVT"]),
        claims.gathers_at_door("GVT", at_door["GVT"], even),
        claims.gathers_at_door("1-MGVT", at_door["1-MGVT"], even),
        claims.covers_more("1-MGVT", "GVT", pairs),
    ]


def rooms_likelihood() -> list[Claim]:
    """Section 6.1.4, Figure 6.5."""
    density = task_likelihood(ROOMS_LIKELIHOOD)
    last = LIKELIHOOD_AT[-1]

    def means(label: str, t: int) -> np.ndarray:
        shares: np.ndarray = share_by_task(ROOMS_LIKELIHOOD, label, t).mean(1)
        return shares

    return [
        *(
            claims.falls_behind_on_unlikely(
                "GVT", means("GVT", t), "1-MGVT", means("1-MGVT", t), density, f"At {t:,}"
            )
            for t in LIKELIHOOD_AT
        ),
        claims.optimal_for_all("1-MGVT", means("1-MGVT", last), f"At {last:,}"),
        claims.optimal_for_all("GVT", means("GVT", last), f"At {last:,}"),
    ]


def rooms_number_of_sources() -> list[Claim]:
    """Section 6.1.5, Figure 6.6."""

    def learning(label: str, count: int, t: int) -> np.ndarray:
        return learning_at(ROOMS_SOURCES, label, count, t)

    def halves(first: str, second: str) -> Claim:
        pairs = {
            f"at {t:,} iterations": (learning(first, FEW, t), learning(second, FEW, t))
            for t in SOURCES_AT
        }
        return claims.earns_half(first, second, pairs)

    def closes(first: str, second: str) -> Claim:
        t = SOURCES_AT[-1]
        few, many = ((learning(first, n, t), learning(second, n, t)) for n in (FEW, MANY))
        return claims.gap_closes(first, few, second, many, f"At {t:,} iterations")

    return [
        halves("GVT", "1-MGVT"),
        halves("GVT", "2-MGVT"),
        closes("GVT", "1-MGVT"),
        closes("GVT", "2-MGVT"),
    ]


def cartpole() -> list[Claim]:
    """Section 6.2.1, Figure 6.8."""
    runs = _runs(CARTPOLE)
    transfer = "GVT", *MIXTURES
    return [
        *(claims.starts_near_optimum(label, runs[label]) for label in transfer),
        *(claims.optimal_by(label, runs[label], 2_000) for label in transfer),
        claims.not_by("DDQN", runs["DDQN"], 2_000),
        *(claims.moves_early(label, runs[label], 2_000) for label in transfer),
    ]


def mountain_car() -> list[Claim]:
    """Section 6.2.2, Figure 6.10."""
    runs = _runs(CAR)
    ddqn, gvt, end = runs["DDQN"], runs["GVT"], CAR.iterations
    return [
        claims.no_advantage("GVT", gvt, "DDQN", ddqn, end),
        *(claims.learns_faster(label, runs[label], "DDQN", ddqn, end) for label in MIXTURES),
        *(claims.learns_faster(label, runs[label], "GVT", gvt, end) for label in MIXTURES),
        *(claims.little_jump_start(label, runs[label], "DDQN", ddqn) for label in MIXTURES),
        *(claims.ends_at_optimum(label, runs[label]) for label in MIXTURES),
    ]


def mazes() -> list[Claim]:
    """Section 6.3, Figure 6.12."""
    runs = {f"{corner} 3": _runs(e) for corner, e in MAZE_TARGETS.items()}
    found = []
    for maze, mine in runs.items():
        ddqn, end = mine["DDQN"], int(mine["DDQN"].iterations[-1])
        each = [
            claims.transfers_negatively("GVT", mine["GVT"], "DDQN", ddqn),
            *(claims.learns_faster(x, mine[x], "DDQN", ddqn, end) for x in MIXTURES),
        ]
        found += [claims.in_task(maze, claim) for claim in each]
    of = {x: {maze: mine[x] for maze, mine in runs.items()} for x in ("DDQN", *MIXTURES)}
    return found + [claims.optimal_only_with(x, of[x], "DDQN", of["DDQN"]) for x in MIXTURES]


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


def _runs(experiment: Experiment) -> dict[str, Returns]:
    return {label: returns(experiment.name, label) for label in experiment.algorithms}
