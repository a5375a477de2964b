"""The claims of section 6.1, in the rooms."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from vtbook import likelihood, visits
from vtbook.claims import (
    MIXTURES,
    OPTIMAL,
    TRANSFER,
    Claim,
    Figure,
    Printed,
    Runs,
    difference,
    share_interval,
)
from vtbook.comparisons import slope_interval
from vtbook.experiments import rooms
from vtbook.experiments.grids import count_name
from vtbook.published import PublishedCurve, rows
from vtlab.stats import Interval, difference_interval, mean_interval
from vtlab.store import load

DOOR = 5.0  # of every target in section 6.1.3
CLEAR = 0.75  # of the moves: halfway from no direction to always
SOURCES_AT = (1_000, 1_950)
FEW, MANY = 2, 10  # sources


def rooms_evaluation() -> list[Claim]:
    """Section 6.1.1, Figure 6.2; its learning curves are drawn to 15,000 iterations."""
    figure, end = Figure(rooms.ROOMS_EVALUATION, "rooms-evaluation"), 14_900
    solved = figure.runs["1-MGVT"].optimal(5_000)
    only = "Without transfer the agent only begins to reach the goal after 7,000."
    more = "More components bring no clear advantage."
    return [
        *figure.earns("{} is optimal after about 5,000 iterations.", MIXTURES, 5_000, low=OPTIMAL),
        figure.claim(
            "GVT has probably solved most tasks by then.",
            "share of runs whose greedy policy is optimal in ten evaluations around 5,000 (1-MGVT "
            f"passes in {solved.sum()} of {len(solved)} runs)",
            lambda a: a.solved(5_000),
            "GVT",
            kind="greedy",
            printed=False,
            low=0.5,
        ),
        *figure.earns(only, ("NT",), 7_000, high=0.25),
        *figure.ahead("{} is ahead of no transfer.", TRANSFER, ("NT",), end, low=0.0),
        *figure.ahead("{} slightly surpasses {}.", ("1-MGVT",), ("GVT",), end, low=0.0),
        figure.claim(
            "It does so with less variance.",
            "standard deviation of 1-MGVT by that of GVT at 5,000",
            lambda a, b: a.spread(b, 5_000),
            "1-MGVT",
            "GVT",
            high=1.0,
        ),
        *figure.ahead(more, ("3-MGVT",), ("1-MGVT",), end, high=0.05),
    ]


def rooms_distribution_change() -> list[Claim]:
    """Section 6.1.2, Figure 6.3."""
    figure, end = Figure(rooms.ROOMS_CHANGE, "rooms-distribution-change"), 14_900
    doors = load(rooms.ROOMS_CHANGE, "tasks").doors.values
    away = np.abs(np.abs(doors[:, 0]) - rooms.FIXED_LOWER)
    return [
        *figure.earns("{} reaches optimal performance all the same.", MIXTURES, end, low=OPTIMAL),
        *figure.ahead("{} is clearly ahead of {}.", MIXTURES, ("GVT",), end, low=0.0),
        *figure.earns("GVT stays low.", ("GVT",), end, high=0.8),
        figure.claim(
            "GVT varies more from run to run than 1-MGVT.",
            "standard deviation of GVT by that of 1-MGVT at 10,000",
            lambda a, b: a.spread(b, 10_000),
            "GVT",
            "1-MGVT",
            low=1.0,
        ),
        figure.claim(
            "GVT earns less the further a task lies from its sources.",
            "slope of the share of the optimum at 10,000 over the lower door's distance",
            lambda a: slope_interval(away, a.at(10_000) / a.scale),
            "GVT",
            printed=False,
            high=0.0,
            ours=True,
        ),
    ]


def _places(runs: Runs) -> np.ndarray:
    return np.asarray(runs.stored.visited.values)


def _arrived(runs: Runs) -> Interval:
    return share_interval(visits.arrivals(_places(runs)) > 0)


def _at_door(runs: Runs) -> Interval:
    even = visits.uniform_share_at_door()
    return mean_interval(visits.share_at_door(_places(runs), DOOR) / even)


def _clear(runs: Runs) -> Interval:
    progress = visits.progress(_places(runs))
    return mean_interval(progress[np.isfinite(progress)])


def _coverage(runs: Runs) -> dict[str, np.ndarray]:
    return visits.coverage(_places(runs))


def rooms_exploration() -> list[Claim]:
    """Section 6.1.3, Figure 6.4, of which no numbers were published."""
    figure = Figure(rooms.ROOMS_EXPLORATION)
    pair, arrive = ("GVT", "1-MGVT"), "share of runs that ever arrive"
    none = "ε-greedy exploration mostly does not reach the goal."
    at_door = "share of the lower room's visits that lie at the door, by an even spread's"
    clear = "When {} has passed the wall, its path to the goal is clear."
    nearer = "share of moves beyond the wall that lead nearer to the goal, of runs with any"
    wider = "1-MGVT explores the lower room more widely than GVT: {}."
    claims = [figure.claim(none, "share of runs of NT that ever arrive", _arrived, "NT", high=0.5)]
    for text, number, measure, low in (
        ("{} reaches the goal.", arrive, _arrived, 0.5),
        ("{} goes to the middle of the wall.", at_door, _at_door, 1.0),
        (clear, nearer, _clear, CLEAR),
    ):
        claims += [figure.claim(text, number, measure, x, low=low) for x in pair]
    for name in _coverage(figure.runs["GVT"]):
        claims.append(
            figure.claim(
                wider,
                f"{name}, {{}} minus {{}}",
                lambda *pair, name=name: difference_interval(*(_coverage(x)[name] for x in pair)),
                *reversed(pair),
                words=(name,),
                low=0.0,
            )
        )
    return claims


def rooms_likelihood() -> list[Claim]:
    """Section 6.1.4, Figure 6.5: returns by the likelihood of the task, in five bins."""
    experiment, end = rooms.ROOMS_LIKELIHOOD, likelihood.AT[-1]
    ours, printed = likelihood.binned(experiment), likelihood.printed(experiment)
    behind = "At {} iterations GVT falls behind 1-MGVT on the unlikeliest tasks."
    claims = []
    for t in likelihood.AT:
        points = (printed[label, t][0] for label in likelihood.LABELS)
        claims.append(
            Claim(
                behind.format(f"{t:,}"),
                "GVT minus 1-MGVT in the lowest fifth of the likelihood, of the optimum",
                likelihood.gap(experiment, t),
                difference(*points),
                high=0.0,
                fact=behind,
            )
        )
    for text, label, low, high in (
        (f"At {end:,} 1-MGVT is optimal for all tasks, however likely.", "1-MGVT", OPTIMAL, np.inf),
        (f"At {end:,} GVT is not.", "GVT", -np.inf, OPTIMAL),
    ):
        number = "learning return in the worst fifth of several doors, of the optimum there"
        worst, theirs = (_worst(bins[label, end]) for bins in (ours, printed))
        claims.append(Claim(text, number, worst, theirs, low, high, ours=label == "GVT"))
    return claims


def _worst(fifths: Sequence[Interval]) -> Interval:
    """The fifth whose interval begins lowest."""
    return min(fifths, key=lambda fifth: fifth.low)


def _printed_by_count(scale: float) -> dict[str, Printed]:
    """The published points of each algorithm and number of sources as curves of two iterations."""
    curves = {}
    tables = [rows(f"rooms-number-of-sources-{t}") for t in SOURCES_AT]
    for points in zip(*tables, strict=True):
        bands = (np.array([point[x] for point in points]) for x in ("mean", "low", "high"))
        curve = PublishedCurve(np.array(SOURCES_AT), *bands)
        name = count_name(points[0]["algorithm"], points[0]["sources"])
        curves[name] = Printed(curve, curve, scale)
    return curves


def rooms_number_of_sources() -> list[Claim]:
    """Section 6.1.5, Figure 6.6."""
    experiment, (first, last) = rooms.ROOMS_SOURCES, SOURCES_AT
    scale = Runs.of(experiment, count_name("GVT", FEW)).scale
    figure = Figure(experiment, printed=_printed_by_count(scale))
    half = "At {} iterations GVT from two sources earns about half of what {} does."
    grows = f"The gap of GVT from two sources to {{}} grows until {last:,} iterations."
    alike = "At {} iterations GVT and {} are alike from many sources."
    about: dict[str, Any] = {"low": 0.4, "high": 0.75, "stronger": "low"}
    near: dict[str, Any] = {"low": -0.15, "high": 0.15}
    claims: list[Claim] = []
    for other in ("1-MGVT", "2-MGVT"):
        few, many = ([count_name(x, n) for x in ("GVT", other)] for n in (FEW, MANY))
        by, more = (
            f"GVT by {other}",
            f"{other} minus GVT at {last:,}, less the same at {first:,}, of the optimum",
        )
        gap = f"GVT minus {other} from {MANY} sources, of the optimum"
        at = {t: (f"{t:,}", other) for t in SOURCES_AT}
        claims += [
            *(
                figure.claim(half, by, lambda a, b, t=t: a.ratio(b, t), *few, words=words, **about)
                for t, words in at.items()
            ),
            figure.claim(
                grows, more, lambda a, b: b.growth(a, first, last), *few, words=(other,), low=0.0
            ),
            *(
                figure.claim(alike, gap, lambda a, b, t=t: a.gain(b, t), *many, words=words, **near)
                for t, words in at.items()
            ),
        ]
    return claims
