"""What the thesis claims of its figures, as rules that stored runs pass, pass partly, or fail."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Generic, ParamSpec

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike
from xarray import Dataset

from vtlib.stats import Interval, difference_interval, mean_interval, slope_interval

P = ParamSpec("P")
Part = bool | np.bool_ | np.ndarray  # one truth value

REPRODUCED, PARTLY, NOT = "reproduced", "partly reproduced", "not reproduced"
NEAR_OPTIMAL = 0.95  # a mean return of 95% of the optimum is called optimal
SOLVED = 0.9  # a run whose greedy policy earns 90% of its own optimum has solved its task
EARLY = 500  # iterations within which a start shows


@frozen
class Claim:
    """A claim of the thesis in this book's words, its verdict, the numbers behind it, the test."""

    text: str
    verdict: str
    evidence: str
    test: str


@frozen
class Rule(Generic[P]):
    """A kind of claim: its words, its test, the parts of it that must hold, its numbers.

    Called with what the claim is about it gives the claim: reproduced when every part holds,
    partly when some do, not when none does.
    """

    text: Callable[P, str]
    test: str
    parts: Callable[P, Sequence[Part]]
    evidence: Callable[P, str]

    def __call__(self, *about: P.args, **named: P.kwargs) -> Claim:
        parts = self.parts(*about, **named)
        verdict = REPRODUCED if all(parts) else PARTLY if any(parts) else NOT
        text, evidence = self.text(*about, **named), self.evidence(*about, **named)
        return Claim(text, verdict, evidence, self.test)


class Runs:
    """Stored returns of an algorithm, as ``vtlib.experiments.returns`` gives them, and its name.

    Runs of two algorithms are paired by their place.
    """

    def __init__(self, name: str, stored: Dataset) -> None:
        self.name, self.stored = name, stored
        self.times, self.optimum = stored.iteration.values, mean(stored.optimum)
        self.end = int(self.times[-1])

    def __str__(self) -> str:
        return self.name

    def at(self, t: int, kind: str = "learning") -> np.ndarray:
        """Returns (R,) at a recorded iteration; ValueError when it was not recorded."""
        if t not in self.times:
            raise ValueError(f"iteration {t} was not recorded")
        return np.asarray(self.stored[kind].sel(iteration=t))

    def shares(self, t: int) -> np.ndarray:
        """Learning returns (R,) at an iteration as shares of each run's own optimum."""
        return np.asarray(self.at(t) / self.stored.optimum.values)

    def share(self, t: int, kind: str = "learning") -> float:
        """The mean return at an iteration as a share of the mean optimum."""
        return mean(self.at(t, kind)) / self.optimum

    def solved(self, t: int) -> float:
        """Share of the runs whose greedy return is at least 90% of their own optimum."""
        return mean(self.at(t, "greedy") >= SOLVED * self.stored.optimum.values)

    def first_optimal(self) -> str:
        """When the mean learning return is optimal for the first time."""
        kept = self.stored.learning.values.mean(0) / self.optimum >= NEAR_OPTIMAL
        return f"first at {self.times[kept.argmax()]:,}" if kept.any() else "never"

    def steps(self, t: int) -> tuple[float, float]:
        """Mean changes of the mean greedy curve between evaluations, until t and afterwards."""
        steps, early = np.abs(np.diff(self.stored.greedy.values.mean(0))), self.times[1:] <= t
        return mean(steps[early]), mean(steps[~early])

    def spread(self, t: int) -> float:
        """Standard deviation of the learning return over runs."""
        return float(self.at(t).std(ddof=1))

    def until(self, t: int) -> np.ndarray:
        """Learning returns (R,) averaged until an iteration."""
        return np.asarray(self.stored.learning.values[:, self.times <= t].mean(1))


def mean(values: ArrayLike) -> float:
    """The mean of all values."""
    return float(np.asarray(values).mean())


def gain(a: Runs, b: Runs, t: int, kind: str = "learning") -> Interval:
    """How much more a earns than b at an iteration."""
    return difference_interval(a.at(t, kind), b.at(t, kind))


def gain_until(a: Runs, b: Runs, t: int) -> Interval:
    """How much more a earns than b, averaged until an iteration."""
    return difference_interval(a.until(t), b.until(t))


# Rules for the returns of one algorithm.

Alone = Rule[[Runs]]
Timed = Rule[[Runs, int]]

optimal_by = Timed(
    lambda a, t: f"{a} performs optimally by about {t:,} iterations.",
    "The mean learning return is optimal (95% of the optimum) by an iteration, or soon after.",
    lambda a, t: [a.share(t) >= NEAR_OPTIMAL, a.share(a.end) >= NEAR_OPTIMAL],
    lambda a, t: (
        f"Learning return at {t:,}: {a.share(t):.1%} of the optimum; at the end "
        f"{a.share(a.end):.1%}. {NEAR_OPTIMAL:.0%} of the optimum is reached {a.first_optimal()}."
    ),
)
not_by = Timed(
    lambda a, t: f"{a} has not converged by {t:,} iterations.",
    "The mean learning return is far from optimal (below 90%) at an iteration.",
    lambda a, t: [a.share(t) < SOLVED],
    lambda a, t: f"Learning return at {t:,}: {a.share(t):.0%} of the optimum.",
)
solves_most = Timed(
    lambda a, t: f"{a} has solved most tasks by {t:,} iterations.",
    "At an iteration the greedy policy has solved more than half of the tasks.",
    lambda a, t: [a.solved(t) > 0.5, a.solved(a.end) > 0.5],
    lambda a, t: (
        f"Greedy policy within {1 - SOLVED:.0%} of the optimum in {a.solved(t):.0%} of the runs at "
        f"{t:,} iterations, in {a.solved(a.end):.0%} at the end; the mean learning return is "
        f"{a.share(t):.0%} of the optimum at {t:,}."
    ),
)
only_beginning = Timed(
    lambda a, t: f"{a} is only beginning to find the goal after {t:,} iterations.",
    "At an iteration the learning return is above zero but below half of the optimum.",
    lambda a, t: [0 < a.share(t) < 0.5, a.share(t) < 0.5],
    lambda a, t: (
        f"Learning return at {t:,}: {mean_interval(a.at(t))}, "
        f"that is {a.share(t):.0%} of the optimum."
    ),
)
falls_with = Rule[[Runs, np.ndarray, int]](
    lambda a, distance, t: f"{a} earns less the further the task lies from its sources.",
    "The share of its optimum that a run earns falls with its distance: the slope is negative.",
    lambda a, distance, t: [slope_interval(distance, a.shares(t)).high < 0],
    lambda a, distance, t: (
        f"Per unit of distance the share of the optimum at {t:,} iterations changes by "
        f"{slope_interval(distance, a.shares(t))}."
    ),
)
starts_near_optimum = Alone(
    lambda a: f"{a} starts near the optimum.",
    "From the start the mean returns are at least 90% of the optimum.",
    lambda a: [a.share(a.times[0], "greedy") >= SOLVED, a.share(EARLY) >= SOLVED],
    lambda a: (
        f"Greedy return at {a.times[0]:,} iterations: {a.share(a.times[0], 'greedy'):.0%} of the "
        f"optimum; learning return at {EARLY:,}: {a.share(EARLY):.0%}."
    ),
)
moves_early = Timed(
    lambda a, t: f"The greedy curve of {a} moves mostly within the first {t:,} iterations.",
    "The mean greedy curve changes at least twice as fast until an iteration as afterwards.",
    lambda a, t: [a.steps(t)[0] >= 2 * a.steps(t)[1]],
    lambda a, t: (
        f"Mean change per {a.times[1] - a.times[0]} iterations: "
        "{:.2f} until {:,}, {:.2f} afterwards.".format(a.steps(t)[0], t, a.steps(t)[1])
    ),
)
ends_at_optimum = Alone(
    lambda a: f"{a} converges to the optimum.",
    "At the end both mean returns, of either sign, miss the optimum by at most 10% of its size.",
    lambda a: [
        a.optimum - mean(a.at(a.end, kind)) <= (1 - SOLVED) * abs(a.optimum)
        for kind in ("learning", "greedy")
    ],
    lambda a: (
        f"At {a.end:,} iterations the learning return is {mean(a.at(a.end)):.1f}, the "
        f"greedy one {mean(a.at(a.end, 'greedy')):.1f}; the optimum is {a.optimum:.1f}."
    ),
)

# Rules that compare two algorithms run by run.

Pair = Rule[[Runs, Runs]]
TimedPair = Rule[[Runs, Runs, int]]

better_and_steadier = TimedPair(
    lambda a, b, t: f"{a} does at least as well as {b}, with less variance.",
    "One algorithm earns at least as much as another, paired by run, with less variance.",
    lambda a, b, t: [gain(a, b, t).centre >= 0, a.spread(t) < b.spread(t)],
    lambda a, b, t: (
        f"At {t:,} iterations {a} minus {b}: {gain(a, b, t)}; standard deviation over runs "
        f"{a.spread(t):.3f} against {b.spread(t):.3f}."
    ),
)
worse_and_wider = TimedPair(
    lambda a, b, t: f"{a} stays low, with a high variance.",
    "One algorithm earns clearly less than another, paired by run, and varies more.",
    lambda a, b, t: [gain(a, b, t).high < 0, a.spread(t) > b.spread(t)],
    lambda a, b, t: (
        f"{better_and_steadier.evidence(a, b, t)} Mean {a} return {a.share(t):.0%} of the optimum."
    ),
)
no_better = TimedPair(
    lambda a, b, t: f"{a} has no clear advantage over {b}.",
    "More components bring no clear advantage: the paired difference is not clearly positive.",
    lambda a, b, t: [gain_until(a, b, a.end).low <= 0, gain(a, b, t).low <= 0],
    lambda a, b, t: (
        f"{a} minus {b}: {gain_until(a, b, a.end)} averaged over the run, {gain(a, b, t)} at "
        f"{t:,} iterations."
    ),
)
learns_faster = TimedPair(
    lambda a, b, t: f"{a} converges faster than {b}.",
    "Averaged until an iteration, the learning return is clearly higher, paired by run.",
    lambda a, b, t: [gain_until(a, b, t).low > 0],
    lambda a, b, t: (
        f"{a} minus {b}, averaged over the first {t:,} iterations: {gain_until(a, b, t)}."
    ),
)
no_advantage = TimedPair(
    no_better.text,
    "Averaged until an iteration, the learning return is not clearly higher, paired by run.",
    lambda a, b, t: [gain_until(a, b, t).low <= 0],
    learns_faster.evidence,
)
little_jump_start = Pair(
    lambda a, b: f"{a} has no great jump-start over {b}.",
    "Early on, one algorithm leads by less than 10% of the optimum's size.",
    lambda a, b: [mean(a.at(EARLY)) - mean(b.at(EARLY)) < (1 - SOLVED) * abs(a.optimum)],
    lambda a, b: (
        f"{a} minus {b} at {EARLY:,} iterations: {mean(a.at(EARLY)) - mean(b.at(EARLY)):.2f}; "
        f"optimum of size {abs(a.optimum):.1f}."
    ),
)
transfers_negatively = Pair(
    lambda a, b: f"{a} fails: it ends below {b}.",
    "At the end both returns are clearly lower than without transfer, paired by run.",
    lambda a, b: [gain(a, b, a.end, kind).high < 0 for kind in ("learning", "greedy")],
    lambda a, b: (
        f"{a} minus {b} at {a.end:,} iterations: {gain(a, b, a.end)} learning, "
        f"{gain(a, b, a.end, 'greedy')} greedy."
    ),
)
optimal_only_with = Rule[[str, str, Mapping[str, tuple[float, float]]]](
    lambda a, b, ends: f"In some tasks {a} ends at the optimum where {b} does not.",
    "In some tasks the mean greedy return ends at 90% of the optimum, and not without transfer.",
    lambda a, b, ends: [any(x >= SOLVED > y for x, y in ends.values())],
    lambda a, b, ends: (
        f"Greedy return at the end, {a} against {b}, of the optimum: "
        + "; ".join(f"{task} {x:.0%} against {y:.0%}" for task, (x, y) in ends.items())
        + "."
    ),
)
