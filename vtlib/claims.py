"""What the thesis claims of its figures, as checks that stored runs pass, pass partly, or fail."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from html import escape
from typing import ParamSpec

import numpy as np

from vtlib.stats import Interval, difference_interval, mean_interval, slope_interval

P = ParamSpec("P")
Pair = tuple[np.ndarray, np.ndarray]
REPRODUCED, PARTLY, NOT = "reproduced", "partly reproduced", "not reproduced"
NEAR_OPTIMAL = 0.95  # a mean return of 95% of the optimum is called optimal
SOLVED = 0.9  # a run whose greedy policy earns 90% of its own optimum has solved its task


@dataclass(frozen=True)
class Claim:
    """A claim of the thesis in this book's words, its verdict, the numbers behind it, the test."""

    text: str
    verdict: str
    evidence: str
    test: str = ""


@dataclass(frozen=True)
class Returns:
    """Stored returns (R, T) of one algorithm at iterations (T,), with each run's optimum (R,)."""

    iterations: np.ndarray
    learning: np.ndarray
    greedy: np.ndarray
    optimum: np.ndarray

    def at(self, iteration: int, kind: str = "learning") -> np.ndarray:
        """Returns (R,) at a recorded iteration; ValueError when it was not recorded."""
        found = np.flatnonzero(self.iterations == iteration)
        if not len(found):
            raise ValueError(f"iteration {iteration} was not recorded")
        returns: np.ndarray = getattr(self, kind)[:, found[0]]
        return returns

    def solved(self, iteration: int) -> float:
        """Share of runs whose greedy return is at least 90% of their optimum."""
        return float((self.at(iteration, "greedy") >= SOLVED * self.optimum).mean())


def _check(judge: Callable[P, Claim]) -> Callable[P, Claim]:
    """The same check, whose claims tell by its docstring what is tested."""

    @wraps(judge)
    def told(*arguments: P.args, **named: P.kwargs) -> Claim:
        return replace(judge(*arguments, **named), test=(judge.__doc__ or "").partition("\n")[0])

    return told


def verdict(passed: Sequence[bool]) -> str:
    """Reproduced when every part passes, partly when some do, not when none does."""
    if all(passed):
        return REPRODUCED
    return PARTLY if any(passed) else NOT


@_check
def optimal_by(name: str, runs: Returns, iteration: int) -> Claim:
    """The mean learning return is optimal (95% of the optimum) by an iteration, or soon after."""
    share = _mean(runs.at(iteration)) / _mean(runs.optimum)
    later = _mean(runs.learning[:, -1]) / _mean(runs.optimum)
    kept = runs.learning.mean(0) / _mean(runs.optimum) >= NEAR_OPTIMAL
    when = f"first at {runs.iterations[kept.argmax()]:,}" if kept.any() else "never"
    return Claim(
        f"{name} performs optimally by about {iteration:,} iterations.",
        verdict([share >= NEAR_OPTIMAL, later >= NEAR_OPTIMAL]),
        f"Learning return at {iteration:,}: {share:.1%} of the optimum; at the end {later:.1%}. "
        f"{NEAR_OPTIMAL:.0%} of the optimum is reached {when}.",
    )


@_check
def solves_most(name: str, runs: Returns, iteration: int) -> Claim:
    """At an iteration the greedy policy has solved more than half of the tasks."""
    share, end = runs.solved(iteration), runs.solved(int(runs.iterations[-1]))
    earned = _mean(runs.at(iteration)) / _mean(runs.optimum)
    return Claim(
        f"{name} has solved most tasks by {iteration:,} iterations.",
        verdict([share > 0.5, end > 0.5]),
        f"Greedy policy within {1 - SOLVED:.0%} of the optimum in {share:.0%} of the runs at "
        f"{iteration:,} iterations, in {end:.0%} at the end; the mean learning return is "
        f"{earned:.0%} of the optimum at {iteration:,}.",
    )


@_check
def only_beginning(name: str, runs: Returns, iteration: int) -> Claim:
    """At an iteration the learning return is above zero but below half of the optimum."""
    value, optimum = mean_interval(runs.at(iteration)), _mean(runs.optimum)
    return Claim(
        f"{name} is only beginning to find the goal after {iteration:,} iterations.",
        verdict([bool(0 < value.centre < 0.5 * optimum), bool(value.centre < 0.5 * optimum)]),
        f"Learning return at {iteration:,}: {_interval(value)}, "
        f"that is {value.centre / optimum:.0%} of the optimum.",
    )


@_check
def better_and_steadier(first: str, a: Returns, second: str, b: Returns, iteration: int) -> Claim:
    """One algorithm earns at least as much as another, paired by run, with less variance."""
    gain = difference_interval(a.at(iteration), b.at(iteration))
    spread_a, spread_b = a.at(iteration).std(ddof=1), b.at(iteration).std(ddof=1)
    return Claim(
        f"{first} does at least as well as {second}, with less variance.",
        verdict([bool(gain.centre >= 0), bool(spread_a < spread_b)]),
        f"At {iteration:,} iterations {first} minus {second}: {_interval(gain)}; standard "
        f"deviation over runs {spread_a:.3f} against {spread_b:.3f}.",
    )


@_check
def worse_and_wider(first: str, a: Returns, second: str, b: Returns, iteration: int) -> Claim:
    """One algorithm earns clearly less than another, paired by run, and varies more."""
    gain = difference_interval(a.at(iteration), b.at(iteration))
    spread_a, spread_b = a.at(iteration).std(ddof=1), b.at(iteration).std(ddof=1)
    return Claim(
        f"{first} stays low, with a high variance.",
        verdict([bool(gain.high < 0), bool(spread_a > spread_b)]),
        f"At {iteration:,} iterations {first} minus {second}: {_interval(gain)}; standard "
        f"deviation over runs {spread_a:.3f} against {spread_b:.3f}. Mean {first} return "
        f"{_mean(a.at(iteration)) / _mean(a.optimum):.0%} of the optimum.",
    )


@_check
def falls_with(name: str, runs: Returns, distance: np.ndarray, iteration: int) -> Claim:
    """The share of its optimum that a run earns falls with its distance: the slope is negative."""
    share = runs.at(iteration) / runs.optimum
    slope = slope_interval(distance, share)
    return Claim(
        f"{name} earns less the further the task lies from its sources.",
        verdict([bool(slope.high < 0)]),
        f"Per unit of distance the share of the optimum at {iteration:,} iterations changes by "
        f"{_interval(slope)}.",
    )


@_check
def no_better(first: str, a: Returns, second: str, b: Returns, iteration: int) -> Claim:
    """More components bring no clear advantage: the paired difference is not clearly positive."""
    during = difference_interval(a.learning.mean(1), b.learning.mean(1))
    end = difference_interval(a.at(iteration), b.at(iteration))
    return Claim(
        f"{first} has no clear advantage over {second}.",
        verdict([bool(during.low <= 0), bool(end.low <= 0)]),
        f"{first} minus {second}: {_interval(during)} averaged over the run, {_interval(end)} at "
        f"{iteration:,} iterations.",
    )


@_check
def never_arrives(name: str, arrivals: np.ndarray) -> Claim:
    """Fewer than half of the runs ever arrive at the goal.

    arrivals: (R,), how often each run does.
    """
    return Claim(
        f"{name} does not reach the goal.",
        verdict([bool((arrivals > 0).mean() < 0.5)]),
        f"{_arrived(arrivals)}",
    )


@_check
def arrives(name: str, arrivals: np.ndarray) -> Claim:
    """At least nine runs in ten arrive at the goal.

    arrivals: (R,), how often each run does.
    """
    return Claim(
        f"{name} reaches the goal.",
        verdict([bool((arrivals > 0).mean() >= 0.9)]),
        f"{_arrived(arrivals)}",
    )


def _arrived(arrivals: np.ndarray) -> str:
    reached = int((arrivals > 0).sum())
    return (
        f"{reached} of {len(arrivals)} runs arrive at least once; the median run arrives "
        f"{np.median(arrivals):g} times."
    )


@_check
def gathers_at_door(name: str, share: np.ndarray, even: float) -> Claim:
    """Visits lie at the door clearly more often than if they were spread evenly.

    share: (R,) of each run's visits; even: that of evenly spread ones.
    """
    value = mean_interval(share)
    return Claim(
        f"The visits of {name} gather at the door.",
        verdict([bool(value.low > even)]),
        f"Share of the lower room's visits that lie at the door: {_interval(value)}; spread evenly "
        f"{even:.3f}.",
    )


@_check
def covers_more(first: str, second: str, pairs: Mapping[str, Pair]) -> Claim:
    """By each measure the first covers clearly more.

    pairs: {name of the measure: (first's (R,), second's (R,))}.
    """
    gains = {name: difference_interval(a, b) for name, (a, b) in pairs.items()}
    numbers = "; ".join(
        f"{name} {_mean(a):.1f} against {_mean(b):.1f}, difference {_interval(gains[name])}"
        for name, (a, b) in pairs.items()
    )
    return Claim(
        f"{first} covers the lower room more widely than {second}.",
        verdict([bool(gain.low > 0) for gain in gains.values()]),
        f"{numbers}.",
    )


@_check
def falls_behind_on_unlikely(
    first: str, a: np.ndarray, second: str, b: np.ndarray, likelihood: np.ndarray, when: str
) -> Claim:
    """One earns clearly less on the unlikeliest third, and less so the likelier the task.

    a and b (tasks,) are mean shares of each task's optimum, likelihood (tasks,) its density.
    """
    gap = np.asarray(a) - np.asarray(b)
    unlikely = likelihood <= np.quantile(likelihood, 1 / 3)
    behind, slope = mean_interval(gap[unlikely]), slope_interval(likelihood, gap)
    return Claim(
        f"{when} iterations {first} falls behind {second} on unlikely tasks.",
        verdict([bool(behind.high < 0), bool(slope.low > 0)]),
        f"{first} minus {second}, as a share of the optimum: {_interval(behind)} on the "
        f"{int(unlikely.sum())} least likely tasks, {_mean(gap[~unlikely]):.3f} on the others; "
        f"slope over the density {_interval(slope)}.",
    )


@_check
def optimal_for_all(name: str, share: np.ndarray, when: str) -> Claim:
    """Every task's mean return is at least 90% of its optimum.

    share: (tasks,) of the optimum.
    """
    return Claim(
        f"{name} is near-optimal for all tasks.",
        verdict([bool((share >= SOLVED).all()), bool(_mean(share) >= SOLVED)]),
        f"{when} {int((share >= SOLVED).sum())} of {len(share)} tasks reach {SOLVED:.0%} of their "
        f"optimum; the least earns {share.min():.0%}, the mean {_mean(share):.0%}.",
    )


ABOUT_HALF = 2 / 3  # at most this share of another return is called about half of it


@_check
def earns_half(first: str, second: str, pairs: Mapping[str, Pair]) -> Claim:
    """At each time the first earns at most two thirds of what the second earns.

    pairs: {when: (first's (R,), second's (R,))}.
    """
    means = {when: (_mean(a), _mean(b)) for when, (a, b) in pairs.items()}
    numbers = "; ".join(f"{when} {a:.2f} against {b:.2f}" for when, (a, b) in means.items())
    return Claim(
        f"With two sources {first} earns about half of what {second} does.",
        verdict([a <= ABOUT_HALF * b for a, b in means.values()]),
        f"{first} against {second} {numbers}.",
    )


@_check
def gap_closes(first: str, few: Pair, second: str, many: Pair, when: str) -> Claim:
    """A clear difference with few sources, no clear one with many, and a smaller one.

    few and many: returns (R,) of the first and of the second algorithm.
    """
    start, end = difference_interval(*few), difference_interval(*many)
    closer = bool(np.abs(end.centre) < np.abs(start.centre))
    met = bool(end.low <= 0 <= end.high)
    # curves that were never clearly apart, or stay apart, earn nothing for how they began
    from_apart = met and not start.low <= 0 <= start.high
    return Claim(
        f"{first} and {second} meet as sources grow.",
        verdict([closer, met, from_apart]),
        f"{when} {first} minus {second}: {_interval(start)} with the fewest sources, "
        f"{_interval(end)} with the most.",
    )


EARLY = 500  # iterations within which a start shows


@_check
def starts_near_optimum(name: str, runs: Returns) -> Claim:
    """From the start the mean returns are at least 90% of the optimum."""
    greedy = _mean(runs.greedy[:, 0]) / _mean(runs.optimum)
    learning = _mean(runs.at(EARLY)) / _mean(runs.optimum)
    return Claim(
        f"{name} starts near the optimum.",
        verdict([greedy >= SOLVED, learning >= SOLVED]),
        f"Greedy return at {runs.iterations[0]:,} iterations: {greedy:.0%} of the optimum; "
        f"learning return at {EARLY:,}: {learning:.0%}.",
    )


@_check
def not_by(name: str, runs: Returns, iteration: int) -> Claim:
    """The mean learning return is far from optimal (below 90%) at an iteration."""
    share = _mean(runs.at(iteration)) / _mean(runs.optimum)
    return Claim(
        f"{name} has not converged by {iteration:,} iterations.",
        verdict([share < SOLVED]),
        f"Learning return at {iteration:,}: {share:.0%} of the optimum.",
    )


@_check
def moves_early(name: str, runs: Returns, until: int) -> Claim:
    """The mean greedy curve changes at least twice as fast until an iteration as afterwards."""
    steps = np.abs(np.diff(runs.greedy.mean(0)))
    early = runs.iterations[1:] <= until
    first, later = _mean(steps[early]), _mean(steps[~early])
    every = runs.iterations[1] - runs.iterations[0]
    return Claim(
        f"The greedy curve of {name} moves mostly within the first {until:,} iterations.",
        verdict([first >= 2 * later]),
        f"Mean change per {every} iterations: {first:.2f} until {until:,}, {later:.2f} afterwards.",
    )


@_check
def learns_faster(first: str, a: Returns, second: str, b: Returns, until: int) -> Claim:
    """Averaged until an iteration, the learning return is clearly higher, paired by run."""
    gain = _early_gain(a, b, until)
    return Claim(
        f"{first} converges faster than {second}.",
        verdict([bool(gain.low > 0)]),
        f"{first} minus {second}, averaged over the first {until:,} iterations: {_interval(gain)}.",
    )


@_check
def no_advantage(first: str, a: Returns, second: str, b: Returns, until: int) -> Claim:
    """Averaged until an iteration, the learning return is not clearly higher, paired by run."""
    gain = _early_gain(a, b, until)
    return Claim(
        f"{first} has no clear advantage over {second}.",
        verdict([bool(gain.low <= 0)]),
        f"{first} minus {second}, averaged over the first {until:,} iterations: {_interval(gain)}.",
    )


def _early_gain(a: Returns, b: Returns, until: int) -> Interval:
    early = a.iterations <= until
    return difference_interval(a.learning[:, early].mean(1), b.learning[:, early].mean(1))


@_check
def little_jump_start(first: str, a: Returns, second: str, b: Returns) -> Claim:
    """Early on, one algorithm leads by less than 10% of the optimum's size."""
    lead = _mean(a.at(EARLY)) - _mean(b.at(EARLY))
    size = abs(_mean(a.optimum))
    return Claim(
        f"{first} has no great jump-start over {second}.",
        verdict([lead < (1 - SOLVED) * size]),
        f"{first} minus {second} at {EARLY:,} iterations: {lead:.2f}; optimum of size {size:.1f}.",
    )


@_check
def ends_at_optimum(name: str, runs: Returns) -> Claim:
    """At the end both mean returns, of either sign, miss the optimum by at most 10% of its size."""
    optimum = _mean(runs.optimum)
    ends = [_mean(runs.learning[:, -1]), _mean(runs.greedy[:, -1])]
    return Claim(
        f"{name} converges to the optimum.",
        verdict([optimum - end <= (1 - SOLVED) * abs(optimum) for end in ends]),
        f"At {int(runs.iterations[-1]):,} iterations the learning return is {ends[0]:.1f}, the "
        f"greedy one {ends[1]:.1f}; the optimum is {optimum:.1f}.",
    )


@_check
def transfers_negatively(first: str, a: Returns, second: str, b: Returns) -> Claim:
    """At the end both returns are clearly lower than without transfer, paired by run."""
    end = int(a.iterations[-1])
    learning = difference_interval(a.at(end), b.at(end))
    greedy = difference_interval(a.at(end, "greedy"), b.at(end, "greedy"))
    return Claim(
        f"{first} fails: it ends below {second}.",
        verdict([bool(learning.high < 0), bool(greedy.high < 0)]),
        f"{first} minus {second} at {end:,} iterations: {_interval(learning)} learning, "
        f"{_interval(greedy)} greedy.",
    )


@_check
def optimal_only_with(
    first: str, a: Mapping[str, Returns], second: str, b: Mapping[str, Returns]
) -> Claim:
    """In some tasks the mean greedy return ends at 90% of the optimum, and not without transfer."""
    ends = {
        task: [_mean(x.greedy[:, -1]) / _mean(x.optimum) for x in (runs, b[task])]
        for task, runs in a.items()
    }
    passed = [with_ >= SOLVED > without for with_, without in ends.values()]
    numbers = "; ".join(f"{task} {x:.0%} against {y:.0%}" for task, (x, y) in ends.items())
    return Claim(
        f"In some tasks {first} ends at the optimum where {second} does not.",
        verdict([any(passed)]),
        f"Greedy return at the end, {first} against {second}, of the optimum: {numbers}.",
    )


def in_task(task: str, claim: Claim) -> Claim:
    """A claim about one task by its name."""
    return replace(claim, text=f"In {task}: {claim.text}")


def table(claims: Sequence[Claim]) -> str:
    """The claims as an HTML table with their verdicts and numbers."""
    rows = "".join(
        f"<tr><td>{escape(c.text)}</td><td class='verdict {c.verdict.split()[0]}'>"
        f"{escape(c.verdict)}</td><td>{escape(c.evidence)}</td></tr>"
        for c in claims
    )
    head = "<tr><th>Claim</th><th>Verdict</th><th>Numbers</th></tr>"
    return f"<table class='claims'><thead>{head}</thead><tbody>{rows}</tbody></table>"


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values))


def _interval(value: Interval) -> str:
    return f"{value.centre:.3f} (95% interval {value.low:.3f} to {value.high:.3f})"
