"""Numbers of all experiments that the first page, the conclusions and the scorecard quote."""

import functools
from collections.abc import Mapping

from vtbook.claims import Claim, Runs
from vtbook.experiments.cartpole import CARTPOLE, CARTPOLE_NOTHING
from vtbook.experiments.maze import MAZE_NOTHING, MAZE_TARGETS
from vtbook.experiments.mountain_car import CAR, CAR_NOTHING
from vtbook.tables import PROTOCOLS, tally
from vtbook.verdicts import PAGES
from vtlib.stats import Interval


@functools.cache
def page_claims() -> Mapping[str, list[Claim]]:
    """The claims of every page."""
    return {page: judge() for page, judge in PAGES.items()}


def counts() -> dict[str, int]:
    """How many facts have each verdict, how many there are, and how many rows stand behind them.

    The names are such as "published-reproduced", "published-all" and "published-rows".
    """
    pages, numbers = page_claims().values(), {}
    for protocol in PROTOCOLS:
        verdicts = tally(pages, protocol)
        numbers[f"{protocol}-all"] = sum(verdicts.values())
        numbers |= {f"{protocol}-{verdict}": count for verdict, count in verdicts.items()}
        rows = [claim for claims in pages for claim in claims if not claim.ours]
        numbers[f"{protocol}-rows"] = sum(protocol in claim.numbers for claim in rows)
    return numbers


def over_nothing() -> dict[str, Interval]:
    """How much more 1-MGVT as published earns over a run than its own learner without sources."""
    pairs = {"poles": (CARTPOLE.published, CARTPOLE_NOTHING), "cars": (CAR.published, CAR_NOTHING)}
    for number, nothing in MAZE_NOTHING.items():
        pairs[f"maze-{number}"] = MAZE_TARGETS[number].published, nothing
    return {
        name: Runs.of(ours, "1-MGVT").gain_until(Runs.of(nothing, "NT"), ours.iterations)
        for name, (ours, nothing) in pairs.items()
    }
