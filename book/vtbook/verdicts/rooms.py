"""The claims of section 6.1, in the rooms."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from vtbook import likelihood, visits
from vtbook.claims import (
    EARLY,
    MIXTURES,
    OPTIMAL,
    TRANSFER,
    Claim,
    Figure,
    Runs,
    difference,
    share_interval,
)
from vtbook.comparisons import slope_interval
from vtbook.experiments import rooms
from vtbook.experiments.grids import count_name
from vtbook.published import rows
from vtlab.store import load, returns
from vtlib.stats import Interval, difference_interval, mean_interval

Measure = Callable[..., Interval]
DOOR = 5.0  # of every target in section 6.1.3
CLEAR = 0.75  # of the moves: halfway from no direction to always
SOURCES_AT = (1_000, 1_950)
FEW, MANY = 2, 10  # sources


def rooms_evaluation() -> list[Claim]:
    """Section 6.1.1, Figure 6.2; its learning curves are drawn to 15,000 iterations."""
    figure, end = Figure(rooms.ROOMS_EVALUATION._asdict(), "rooms-evaluation"), 14_900
    apart = {
        protocol: load(rooms.ROOMS_CALIBRATION, label)
        for protocol, label in (("published", "3-MGVT"), ("equations", "3-MGVT, equations"))
    }
    return [
        *(
            figure.claim(
                f"{x} is optimal after about 5,000 iterations.",
                "learning return at 5,000, of the optimum",
                lambda a: a.share(5_000),
                x,
                low=OPTIMAL,
            )
            for x in MIXTURES
        ),
        figure.claim(
            "GVT has probably solved most tasks by then.",
            "share of runs whose greedy policy is optimal in ten evaluations around 5,000",
            lambda a: a.solved(5_000),
            "GVT",
            kind="greedy",
            printed=False,
            low=0.5,
        ),
        figure.claim(
            "Without transfer the agent only begins to reach the goal after 7,000.",
            "learning return of NT at 7,000, of the optimum",
            lambda a: a.share(7_000),
            "NT",
            high=0.25,
        ),
        *(
            figure.ahead(
                f"{x} is ahead of no transfer.",
                x,
                "NT",
                end,
                low=0.0,
            )
            for x in TRANSFER
        ),
        figure.claim(
            "1-MGVT starts ahead of no transfer.",
            f"1-MGVT minus NT at {EARLY}, of the optimum",
            lambda a, b: a.gain(b, EARLY),
            "1-MGVT",
            "NT",
            low=0.0,
        ),
        figure.ahead(
            "1-MGVT slightly surpasses GVT.",
            "1-MGVT",
            "GVT",
            end,
            low=0.0,
        ),
        figure.claim(
            "It does so with less variance.",
            "standard deviation of 1-MGVT by that of GVT at 5,000",
            lambda a, b: a.spread(b, 5_000),
            "1-MGVT",
            "GVT",
            high=1.0,
        ),
        figure.ahead(
            "More components bring no clear advantage.",
            "3-MGVT",
            "1-MGVT",
            end,
            high=0.05,
        ),
        Claim(
            "The components quickly come to the same region (as published they begin there).",
            "deviation between the components' values at 5,000, of the mean value, in the runs "
            "on calibration",
            {
                protocol: mean_interval((one.apart.sel(iteration=5_000) / one.truth[:, 0]).values)
                for protocol, one in apart.items()
            },
            None,
            high=0.05,
        ),
    ]


def rooms_distribution_change() -> list[Claim]:
    """Section 6.1.2, Figure 6.3."""
    figure, end = Figure(rooms.ROOMS_CHANGE._asdict(), "rooms-distribution-change"), 14_900
    away = np.abs(load(rooms.ROOMS_CHANGE.published, "tasks").doors.values[:, 0])
    away = np.abs(away - rooms.FIXED_LOWER)
    return [
        *(
            figure.claim(
                f"{x} reaches optimal performance all the same.",
                f"learning return at {end:,}, of the optimum",
                lambda a: a.share(end),
                x,
                low=OPTIMAL,
            )
            for x in MIXTURES
        ),
        *(
            figure.ahead(
                f"{x} is clearly ahead of GVT.",
                x,
                "GVT",
                end,
                low=0.0,
            )
            for x in MIXTURES
        ),
        figure.claim(
            "GVT stays low.",
            f"learning return of GVT at {end:,}, of the optimum",
            lambda a: a.share(end),
            "GVT",
            high=0.8,
        ),
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


def _finite(x: np.ndarray) -> np.ndarray:
    return np.asarray(x[np.isfinite(x)])


def rooms_exploration() -> list[Claim]:
    """Section 6.1.3, Figure 6.4, of which no numbers were published."""
    protocols = rooms.ROOMS_EXPLORATION._asdict()
    seen = {
        protocol: {x: returns(experiment, x).visited.values for x in ("NT", "GVT", "1-MGVT")}
        for protocol, experiment in protocols.items()
    }

    def claim(text: str, number: str, measure: Measure, *labels: str, **bounds: Any) -> Claim:
        found = {
            protocol: measure(*(places[x] for x in labels)) for protocol, places in seen.items()
        }
        return Claim(text, number, found, None, **bounds)

    def arrived(places: np.ndarray) -> Interval:
        return share_interval(visits.arrivals(places) > 0)

    even = visits.uniform_share_at_door()
    return [
        claim(
            "ε-greedy exploration mostly does not reach the goal.",
            "share of runs of NT that ever arrive",
            arrived,
            "NT",
            high=0.5,
        ),
        *(
            claim(f"{x} reaches the goal.", "share of runs that ever arrive", arrived, x, low=0.5)
            for x in ("GVT", "1-MGVT")
        ),
        *(
            claim(
                f"{x} goes to the middle of the wall.",
                "share of the lower room's visits that lie at the door, by an even spread's",
                lambda places: mean_interval(visits.share_at_door(places, DOOR) / even),
                x,
                low=1.0,
            )
            for x in ("GVT", "1-MGVT")
        ),
        *(
            claim(
                f"When {x} has passed the wall, its path to the goal is clear.",
                "share of moves beyond the wall that lead nearer to the goal, of runs with any",
                lambda places: mean_interval(_finite(visits.progress(places))),
                x,
                low=CLEAR,
            )
            for x in ("GVT", "1-MGVT")
        ),
        *(
            Claim(
                f"1-MGVT explores the lower room more widely than GVT: {name}.",
                f"{name}, 1-MGVT minus GVT",
                {
                    protocol: difference_interval(
                        *(visits.coverage(places[x])[name] for x in ("1-MGVT", "GVT"))
                    )
                    for protocol, places in seen.items()
                },
                None,
                low=0.0,
            )
            for name in visits.coverage(seen["published"]["GVT"])
        ),
    ]


def rooms_likelihood() -> list[Claim]:
    """Section 6.1.4, Figure 6.5: returns by the likelihood of the task, in five bins."""
    bins, end = likelihood.binned(), likelihood.AT[-1]

    def claim(text: str, number: str, measure: Measure, *about: Any, **bounds: Any) -> Claim:
        found = {name: measure(x, *about) for name, x in bins.items()}
        return Claim(text, number, found, found.pop("printed"), **bounds)

    def lowest(found: likelihood.Bins, label: str) -> Interval:
        return min(found[label, end], key=lambda one: float(one.low))

    return [
        *(
            claim(
                f"At {t:,} iterations GVT falls behind 1-MGVT on the unlikeliest tasks.",
                "GVT minus 1-MGVT in the lowest fifth of the likelihood, of the optimum",
                lambda x, t: difference(x["GVT", t][0], x["1-MGVT", t][0]),
                t,
                high=0.0,
            )
            for t in likelihood.AT
        ),
        claim(
            f"At {end:,} 1-MGVT is optimal for all tasks, however likely.",
            "learning return in the worst fifth, of the optimum there",
            lowest,
            "1-MGVT",
            low=OPTIMAL,
        ),
        claim(
            f"At {end:,} GVT is not.",
            "learning return in the worst fifth, of the optimum there",
            lowest,
            "GVT",
            high=OPTIMAL,
            ours=True,
        ),
    ]


def rooms_number_of_sources() -> list[Claim]:
    """Section 6.1.5, Figure 6.6."""
    printed = {t: rows(f"rooms-number-of-sources-{t}") for t in SOURCES_AT}

    def seen(label: str, count: int, t: int) -> Interval:
        table = printed[t]
        row = table[(table["algorithm"] == label) & (table["sources"] == count)][0]
        return Interval(row["mean"], row["low"], row["high"])

    def found(measure: Measure, other: str, count: int, t: int) -> dict[str, Interval]:
        found = {}
        for protocol, experiment in rooms.ROOMS_SOURCES._asdict().items():
            a, b = (Runs(returns(experiment, count_name(x, count))) for x in ("GVT", other))
            found[protocol] = measure(a, b, t)
        return found

    def ratio(a: Interval, b: Interval) -> Interval:
        value = a.centre / b.centre
        half = np.hypot(a.high - a.centre, value * (b.high - b.centre)) / b.centre
        return Interval(value, value - half, value + half)

    def grown(a: Runs, b: Runs, t: int) -> Interval:
        at_last, at_first = (b.at(one) - a.at(one) for one in (t, first))
        return mean_interval((at_last - at_first) / a.scale)

    scale = float(returns(rooms.ROOMS_SOURCES.published, "GVT-from-2").optimum.mean())
    first, last = SOURCES_AT
    claims = []
    for other in ("1-MGVT", "2-MGVT"):
        for t in SOURCES_AT:
            claims.append(
                Claim(
                    f"At {t:,} iterations GVT from two sources earns about half of what "
                    f"{other} does.",
                    f"GVT by {other}",
                    found(Runs.ratio, other, FEW, t),
                    ratio(seen("GVT", FEW, t), seen(other, FEW, t)),
                    low=0.4,
                    high=0.75,
                    stronger="low",
                )
            )
        behind = [difference(seen(other, FEW, t), seen("GVT", FEW, t)) for t in SOURCES_AT]
        claims.append(
            Claim(
                f"The gap of GVT from two sources to {other} grows until {last:,} iterations.",
                f"{other} minus GVT at {last:,}, less the same at {first:,}, of the optimum",
                found(grown, other, FEW, last),
                Interval(*(x / scale for x in difference(*reversed(behind)))),
                low=0.0,
            )
        )
        for t in SOURCES_AT:
            apart = difference(seen("GVT", MANY, t), seen(other, MANY, t))
            claims.append(
                Claim(
                    f"At {t:,} iterations GVT and {other} are alike from many sources.",
                    f"GVT minus {other} from {MANY} sources, of the optimum",
                    found(Runs.gain, other, MANY, t),
                    Interval(*(x / scale for x in apart)),
                    low=-0.15,
                    high=0.15,
                )
            )
    return claims
