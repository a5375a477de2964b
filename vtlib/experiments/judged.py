"""What the thesis claims of each figure, judged by the stored runs: one function for each page.

Rules for returns are those of ``vtlib.claims``; those that a single page needs stand before it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from attrs import evolve
from scipy.stats import norm

from vtlib import claims, visits
from vtlib.claims import SOLVED, Claim, Rule, Runs, mean
from vtlib.experiments import load, returns, rooms
from vtlib.experiments.cartpole import CARTPOLE
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.maze import MAZE_TARGETS
from vtlib.experiments.mountain_car import CAR
from vtlib.stats import Interval, difference_interval, mean_interval, slope_interval

Pair = tuple[np.ndarray, np.ndarray]
Measures = Mapping[str, np.ndarray]
MIXTURES = "1-MGVT", "3-MGVT"
DOOR = 5.0  # of every target in section 6.1.3
LIKELIHOOD_AT = (500, 1_000, 4_000)
SOURCES_AT = (1_000, 1_950)
FEW, MANY = 2, 10  # sources
ABOUT_HALF = 2 / 3  # at most this share of another return is called about half of it


def rooms_evaluation() -> list[Claim]:
    """Section 6.1.1, Figure 6.2."""
    runs = _runs(rooms.ROOMS_EVALUATION, NT="No transfer")
    return [
        claims.optimal_by(runs["1-MGVT"], 5_000),
        claims.solves_most(runs["GVT"], 5_000),
        claims.only_beginning(runs["NT"], 7_000),
        claims.better_and_steadier(runs["1-MGVT"], runs["GVT"], 10_000),
        claims.no_better(runs["3-MGVT"], runs["1-MGVT"], 10_000),
    ]


def rooms_distribution_change() -> list[Claim]:
    """Section 6.1.2, Figure 6.3."""
    runs = _runs(rooms.ROOMS_CHANGE)
    doors = load(rooms.ROOMS_CHANGE, "tasks").doors.values
    return [
        *(claims.optimal_by(runs[label], 10_000) for label in MIXTURES),
        claims.worse_and_wider(runs["GVT"], runs["1-MGVT"], 10_000),
        claims.falls_with(runs["GVT"], np.abs(doors[:, 0] - rooms.FIXED_LOWER), 10_000),
    ]


# About runs that arrive so often (R,) at the goal.
never_arrives = Rule[[str, np.ndarray]](
    lambda a, arrivals: f"{a} does not reach the goal.",
    "Fewer than half of the runs ever arrive at the goal.",
    lambda a, arrivals: [mean(arrivals > 0) < 0.5],
    lambda a, arrivals: (
        f"{int((arrivals > 0).sum())} of {len(arrivals)} runs arrive at least once; the median run "
        f"arrives {np.median(arrivals):g} times."
    ),
)
arrives = Rule[[str, np.ndarray]](
    lambda a, arrivals: f"{a} reaches the goal.",
    "At least nine runs in ten arrive at the goal.",
    lambda a, arrivals: [mean(arrivals > 0) >= 0.9],
    never_arrives.evidence,
)
# About shares (R,) of each run's visits, and that of evenly spread ones.
gathers_at_door = Rule[[str, np.ndarray, float]](
    lambda a, share, even: f"The visits of {a} gather at the door.",
    "Visits lie at the door clearly more often than if they were spread evenly.",
    lambda a, share, even: [mean_interval(share).low > even],
    lambda a, share, even: (
        f"Share of the lower room's visits that lie at the door: {mean_interval(share)}; spread "
        f"evenly {even:.3f}."
    ),
)
# About measures (R,) of what each of both covers, by their names.
covers_more = Rule[[str, Measures, str, Measures]](
    lambda a, own, b, other: f"{a} covers the lower room more widely than {b}.",
    "By each measure the first covers clearly more.",
    lambda a, own, b, other: [difference_interval(own[x], other[x]).low > 0 for x in own],
    lambda a, own, b, other: (
        "; ".join(
            f"{x} {mean(own[x]):.1f} against {mean(other[x]):.1f}, difference "
            f"{difference_interval(own[x], other[x])}"
            for x in own
        )
        + "."
    ),
)


def rooms_exploration() -> list[Claim]:
    """Section 6.1.3, Figure 6.4."""
    experiment = rooms.ROOMS_EXPLORATION
    seen = {x: returns(experiment, x).visited.values for x in ("NT", "GVT", "1-MGVT")}
    arrived = {label: visits.arrivals(places) for label, places in seen.items()}
    even, covered = visits.uniform_share_at_door(), visits.coverage(seen["GVT"])
    return [
        never_arrives("ε-greedy", arrived["NT"]),
        *(arrives(x, arrived[x]) for x in ("GVT", "1-MGVT")),
        *(gathers_at_door(x, visits.share_at_door(seen[x], DOOR), even) for x in ("GVT", "1-MGVT")),
        covers_more("1-MGVT", visits.coverage(seen["1-MGVT"]), "GVT", covered),
    ]


# About the density (tasks,) of tasks and how much more a earns in each, of its optimum.
falls_behind_on_unlikely = Rule[[str, str, np.ndarray, np.ndarray, int]](
    lambda a, b, density, gap, t: f"At {t:,} iterations {a} falls behind {b} on unlikely tasks.",
    "One earns clearly less on the unlikeliest third, and less so the likelier the task.",
    lambda a, b, density, gap, t: [
        mean_interval(gap[_unlikely(density)]).high < 0,
        slope_interval(density, gap).low > 0,
    ],
    lambda a, b, density, gap, t: (
        f"{a} minus {b}, as a share of the optimum: {mean_interval(gap[_unlikely(density)])} on "
        f"the {_unlikely(density).sum()} least likely tasks, {mean(gap[~_unlikely(density)]):.3f} "
        f"on the others; slope over the density {slope_interval(density, gap)}."
    ),
)
# About mean shares (tasks,) of each task's optimum.
optimal_for_all = Rule[[str, np.ndarray, int]](
    lambda a, share, t: f"{a} is near-optimal for all tasks.",
    "Every task's mean return is at least 90% of its optimum.",
    lambda a, share, t: [(share >= SOLVED).all(), mean(share) >= SOLVED],
    lambda a, share, t: (
        f"At {t:,} {(share >= SOLVED).sum()} of {len(share)} tasks reach {SOLVED:.0%} of their "
        f"optimum; the least earns {share.min():.0%}, the mean {mean(share):.0%}."
    ),
)


def _unlikely(density: np.ndarray) -> np.ndarray:
    """The least likely third of the tasks."""
    return np.asarray(density <= np.quantile(density, 1 / 3))


def rooms_likelihood() -> list[Claim]:
    """Section 6.1.4, Figure 6.5."""
    each, runs = rooms.ROOMS_LIKELIHOOD.runs_per_task, _runs(rooms.ROOMS_LIKELIHOOD)
    doors = load(rooms.ROOMS_LIKELIHOOD, "tasks").doors.values[::each, 0]
    density = norm.pdf(doors, *rooms.LIKELIHOOD_DOORS)

    def shares(label: str, t: int) -> np.ndarray:
        """Mean share of each task's optimum (tasks,) over its runs."""
        return np.asarray(runs[label].shares(t).reshape(-1, each).mean(1))

    gaps = {t: shares("GVT", t) - shares("1-MGVT", t) for t in LIKELIHOOD_AT}
    end = LIKELIHOOD_AT[-1]
    return [
        *(falls_behind_on_unlikely("GVT", "1-MGVT", density, gap, t) for t, gap in gaps.items()),
        *(optimal_for_all(x, shares(x, end), end) for x in ("1-MGVT", "GVT")),
    ]


# About {iteration: (a's returns (R,), b's (R,))}.
earns_half = Rule[[str, str, Mapping[int, Pair]]](
    lambda a, b, pairs: f"With two sources {a} earns about half of what {b} does.",
    "At each time the first earns at most two thirds of what the second earns.",
    lambda a, b, pairs: [mean(x) <= ABOUT_HALF * mean(y) for x, y in pairs.values()],
    lambda a, b, pairs: (
        f"{a} against {b} "
        + "; ".join(
            f"at {t:,} iterations {mean(x):.2f} against {mean(y):.2f}"
            for t, (x, y) in pairs.items()
        )
        + "."
    ),
)
# About how much more a earns at an iteration, with few and with many sources.
gap_closes = Rule[[str, str, Interval, Interval, int]](
    lambda a, b, few, many, t: f"{a} and {b} meet as sources grow.",
    "A clear difference with few sources, no clear one with many, and a smaller one.",
    # Curves that were never clearly apart, or stay apart, earn nothing for how they began.
    lambda a, b, few, many, t: [
        np.abs(many.centre) < np.abs(few.centre),
        many.low <= 0 <= many.high,
        many.low <= 0 <= many.high and not few.low <= 0 <= few.high,
    ],
    lambda a, b, few, many, t: (
        f"At {t:,} iterations {a} minus {b}: {few} with the fewest sources, {many} with the most."
    ),
)


def rooms_number_of_sources() -> list[Claim]:
    """Section 6.1.5, Figure 6.6."""

    def learned(label: str, count: int, t: int) -> np.ndarray:
        stored = returns(rooms.ROOMS_SOURCES, rooms.count_name(label, count))
        return Runs(label, stored).at(t)

    def halves(a: str, b: str) -> Claim:
        return earns_half(a, b, {t: (learned(a, FEW, t), learned(b, FEW, t)) for t in SOURCES_AT})

    def closes(a: str, b: str) -> Claim:
        last = SOURCES_AT[-1]
        few, many = (
            difference_interval(learned(a, n, last), learned(b, n, last)) for n in (FEW, MANY)
        )
        return gap_closes(a, b, few, many, last)

    return [judge("GVT", x) for judge in (halves, closes) for x in ("1-MGVT", "2-MGVT")]


def cartpole() -> list[Claim]:
    """Section 6.2.1, Figure 6.8."""
    runs = _runs(CARTPOLE)
    transfer = [runs[label] for label in ("GVT", *MIXTURES)]
    return [
        *(claims.starts_near_optimum(one) for one in transfer),
        *(claims.optimal_by(one, 2_000) for one in transfer),
        claims.not_by(runs["DDQN"], 2_000),
        *(claims.moves_early(one, 2_000) for one in transfer),
    ]


def mountain_car() -> list[Claim]:
    """Section 6.2.2, Figure 6.10."""
    runs, end = _runs(CAR), CAR.iterations
    ddqn, gvt, *mixtures = (runs[label] for label in ("DDQN", "GVT", *MIXTURES))
    return [
        claims.no_advantage(gvt, ddqn, end),
        *(claims.learns_faster(one, ddqn, end) for one in mixtures),
        *(claims.learns_faster(one, gvt, end) for one in mixtures),
        *(claims.little_jump_start(one, ddqn) for one in mixtures),
        *(claims.ends_at_optimum(one) for one in mixtures),
    ]


def mazes() -> list[Claim]:
    """Section 6.3, Figure 6.12."""
    tasks = {f"{corner} 3": _runs(e) for corner, e in MAZE_TARGETS.items()}
    found, ends = [], {}
    for task, runs in tasks.items():
        ddqn, end = runs["DDQN"], runs["DDQN"].end
        each = [
            claims.transfers_negatively(runs["GVT"], ddqn),
            *(claims.learns_faster(runs[x], ddqn, end) for x in MIXTURES),
        ]
        found += [evolve(claim, text=f"In {task}: {claim.text}") for claim in each]
        ends[task] = {label: one.share(one.end, "greedy") for label, one in runs.items()}
    for x in MIXTURES:
        pairs = {task: (shares[x], shares["DDQN"]) for task, shares in ends.items()}
        found.append(claims.optimal_only_with(x, "DDQN", pairs))
    return found


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


def _runs(experiment: Experiment, **names: str) -> dict[str, Runs]:
    """The runs by their labels, called so in claims unless another name is given."""
    labels = experiment.algorithms
    return {label: Runs(names.get(label, label), returns(experiment, label)) for label in labels}
