"""Numbers of all experiments that several pages quote."""

import functools
from collections.abc import Mapping

import numpy as np

from vtbook.claims import Claim, Runs
from vtbook.decomposition import course
from vtbook.experiments.cartpole import CARTPOLE, CARTPOLE_NOTHING
from vtbook.experiments.maze import MAZE_NOTHING, MAZE_TARGETS
from vtbook.experiments.mountain_car import CAR, CAR_NOTHING
from vtbook.tables import tally
from vtbook.verdicts import PAGES
from vtlab.stats import Interval, mean_interval


@functools.cache
def page_claims() -> Mapping[str, list[Claim]]:
    """The claims of every page."""
    return {page: judge() for page, judge in PAGES.items()}


def counts() -> dict[str, int]:
    """How many facts have each verdict, how many there are, "all", and "rows" behind them."""
    pages = page_claims().values()
    verdicts, rows = tally(pages), sum(not claim.ours for claims in pages for claim in claims)
    return {**verdicts, "all": sum(verdicts.values()), "rows": rows}


def over_nothing() -> dict[str, Interval]:
    """How much more 1-MGVT as published earns over a run than its own learner without sources."""
    pairs = {"poles": (CARTPOLE, CARTPOLE_NOTHING), "cars": (CAR, CAR_NOTHING)}
    return {
        name: Runs.of(ours, "1-MGVT").gain_until(Runs.of(nothing, "NT"), ours.iterations)
        for name, (ours, nothing) in pairs.items()
    }


def mazes_over_nothing() -> dict[str, Interval]:
    """How much more 1-MGVT earns than its own learner without sources, over four mazes together.

    Averaged over the whole run, paired by run; also of that learner where sources guide it, and
    "by maze", where the four mazes and not their runs are what is independent.
    """
    gaps: dict[str, list[np.ndarray]] = {}
    for number, nothing in MAZE_NOTHING.items():
        ours = course(MAZE_TARGETS[number], "1-MGVT")
        alone, guided = course(nothing, "NT"), course(nothing, "NT, guided")
        for name, gap in {
            "as published": ours - alone,
            "guided": guided - alone,
            "1-MGVT minus guided": ours - guided,
        }.items():
            gaps.setdefault(name, []).append(gap)
    means = np.array([gap.mean() for gap in gaps["as published"]])
    pooled = {name: mean_interval(np.concatenate(each)) for name, each in gaps.items()}
    return {**pooled, "by maze": mean_interval(means)}
