"""What the thesis claims of its figures: one number for each claim, and the bounds it has to keep.

The number is measured alike of our runs and of the published curves: ``Runs`` and ``Printed`` give
the same answers.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from attrs import field, frozen
from scipy.stats import binomtest
from xarray import Dataset

from vtbook.comparisons import ratio_interval, spread_interval
from vtbook.experiments.mountain_car import floor_of
from vtbook.published import PublishedCurve, curves
from vtlab.experiment import Experiment
from vtlab.stats import Interval, mean_interval
from vtlab.store import returns
from vtlib.rng import generator

REPRODUCED, NOT = "reproduced", "not reproduced"
UNDECIDED, STRONGER = "undecided", "stronger than claimed"
VERDICTS = STRONGER, REPRODUCED, UNDECIDED, NOT  # from the best to the worst
OPTIMAL = 0.9  # a return that misses the optimum by at most a tenth is called optimal
EARLY = 500  # iterations within which a start shows
EVALUATIONS = 10  # of the greedy policy, before it is said to be optimal
MIXTURES, TRANSFER = ("1-MGVT", "3-MGVT"), ("GVT", "1-MGVT", "3-MGVT")


@frozen
class Claim:
    """A claim of the thesis in this book's words, and the number that decides about it.

    The claim holds where the number lies between low and high. Beyond the bound that ``stronger``
    names, "low" or "high", the claim is an understatement. Where both bounds are one value, the
    claim is that nothing differs from it, and holds where the interval contains that value.
    measure: what the number is, in words.
    printed: the number of the published curves, where there is one. ours: the claim is this book's
    and not the thesis'. overlap: the share of the recorded iterations at which our intervals meet
    the published ones, the least of several curves.
    fact: the sentence with its places {} unfilled, which counts once however many claims fill it.
    """

    text: str
    measure: str
    number: Interval
    printed: Interval | None
    low: float = -np.inf
    high: float = np.inf
    stronger: str = ""
    ours: bool = False
    overlap: float | None = None
    fact: str = field()

    @fact.default
    def _own_fact(self) -> str:
        return self.text

    @property
    def verdict(self) -> str:
        """Whether the claim holds."""
        return self.judge(self.number)

    def judge(self, number: Interval) -> str:
        """The verdict on a number: undecided when its interval holds both answers."""
        if self.low == self.high:
            return REPRODUCED if number.low <= self.low <= number.high else NOT
        if number.low >= self.low and number.high <= self.high:
            return REPRODUCED
        below, above = number.high < self.low, number.low > self.high
        if (below and self.stronger == "low") or (above and self.stronger == "high"):
            return STRONGER
        return NOT if below or above else UNDECIDED

    @property
    def bounds(self) -> str:
        """What the number has to keep, in words."""
        low, high = (f"{x:g}".replace("-", "−") for x in (self.low, self.high))
        if low == high:
            return f"the interval contains {low}"
        if np.isinf(self.high):
            return f"at least {low}"
        return f"at most {high}" if np.isinf(self.low) else f"{low} to {high}"


@frozen(eq=False)
class Runs:
    """Stored returns of an algorithm; shares are of the way from a floor to the mean optimum."""

    stored: Dataset
    floor: float = 0.0

    @classmethod
    def of(cls, experiment: Experiment, label: str) -> Runs:
        """The stored runs of an algorithm."""
        return cls(returns(experiment, label), floor_of(experiment))

    @property
    def scale(self) -> float:
        """The mean optimum above the floor."""
        return float(self.stored.optimum.mean()) - self.floor

    def at(self, t: int, kind: str = "learning") -> np.ndarray:
        """Returns (R,) at a recorded iteration; KeyError when it was not recorded."""
        return np.asarray(self.stored[kind].sel(iteration=t))

    def until(self, t: int) -> np.ndarray:
        """Learning returns (R,) averaged until an iteration."""
        return np.asarray(self.stored.learning.sel(iteration=slice(None, t)).mean("iteration"))

    def shares_until(self, t: int) -> np.ndarray:
        """The learning return (R,) averaged until an iteration."""
        return (self.until(t) - self.floor) / self.scale

    def shares(self, t: int, kind: str = "learning") -> np.ndarray:
        """The return (R,) at an iteration."""
        return (self.at(t, kind) - self.floor) / self.scale

    def share(self, t: int, kind: str = "learning") -> Interval:
        """The mean return at an iteration."""
        return mean_interval(self.shares(t, kind))

    def gain(self, other: Runs, t: int) -> Interval:
        """How much more this algorithm earns than another at an iteration, paired by run."""
        return mean_interval((self.at(t) - other.at(t)) / self.scale)

    def gain_until(self, other: Runs, t: int) -> Interval:
        """How much more this algorithm earns than another until an iteration, paired by run."""
        return mean_interval((self.until(t) - other.until(t)) / self.scale)

    def growth(self, other: Runs, start: int, end: int) -> Interval:
        """How much its lead over another algorithm grows from one iteration to a later one."""
        gap, before = (self.at(t) - other.at(t) for t in (end, start))
        return mean_interval((gap - before) / self.scale)

    def spread(self, other: Runs, t: int) -> Interval:
        """Standard deviation over runs at an iteration, by that of another algorithm."""
        return spread_interval(self.at(t), other.at(t), generator("claims", t, "spread"))

    def ratio(self, other: Runs, t: int) -> Interval:
        """Mean return at an iteration by that of another algorithm, paired by run."""
        return ratio_interval(self.at(t), other.at(t))

    def solved(self, t: int) -> Interval:
        """Share of the runs that are optimal around an iteration."""
        return share_interval(self.optimal(t))

    def optimal(self, t: int) -> np.ndarray:
        """Whether the greedy policy of each run (R,) misses its own optimum by at most a tenth.

        An evaluation has but ten episodes, so the mean of the ten nearest to t is taken.
        """
        away = np.abs(self.stored.iteration.values - t)
        greedy = self.stored.greedy.values[:, np.argsort(away, kind="stable")[:EVALUATIONS]]
        own = self.stored.optimum.values - self.floor
        return np.asarray(greedy.mean(1) - self.floor >= OPTIMAL * own)

    @property
    def fallen(self) -> int:
        """How many runs end below 90% of their own optimum."""
        end, own = self.stored.learning.values[:, -1], self.stored.optimum.values - self.floor
        return int((end - self.floor < OPTIMAL * own).sum())


def runs_of(experiment: Experiment) -> dict[str, Runs]:
    """The stored runs of an experiment by label."""
    return {label: Runs.of(experiment, label) for label in experiment.algorithms}


@frozen(eq=False)
class Printed:
    """Published curves of an algorithm, on the scale of our runs of the same experiment."""

    learning: PublishedCurve
    greedy: PublishedCurve
    scale: float
    floor: float = 0.0

    def share(self, t: int, kind: str = "learning") -> Interval:
        """The mean return at an iteration."""
        return Interval(*((x - self.floor) / self.scale for x in getattr(self, kind).at(t)))

    def gain(self, other: Printed, t: int) -> Interval:
        """How much more this algorithm earns than another; the pairing of runs is lost."""
        return difference(self.share(t), other.share(t))

    def gain_until(self, other: Printed, t: int) -> Interval:
        """How much more this algorithm earns than another until an iteration."""
        gap = difference(self.learning.until(t), other.learning.until(t))
        return Interval(*(x / self.scale for x in gap))

    def growth(self, other: Printed, start: int, end: int) -> Interval:
        """How much its lead over another algorithm grows from one iteration to a later one."""
        return difference(self.gain(other, end), self.gain(other, start))

    def spread(self, other: Printed, t: int) -> Interval:
        """Width of the band at an iteration, divided by another algorithm's; it has no interval."""
        a, b = self.learning.at(t), other.learning.at(t)
        return Interval(*[(a.high - a.low) / (b.high - b.low)] * 3)

    def ratio(self, other: Printed, t: int) -> Interval:
        """Mean return at an iteration by that of another algorithm."""
        a, b = self.learning.at(t), other.learning.at(t)
        ratio = a.centre / b.centre
        half = np.hypot(a.high - a.centre, ratio * (b.high - b.centre)) / b.centre
        return Interval(ratio, ratio - half, ratio + half)


def difference(a: Interval, b: Interval) -> Interval:
    """a - b of independent means."""
    centre, half = a.centre - b.centre, np.hypot(a.high - a.centre, b.high - b.centre)
    return Interval(centre, centre - half, centre + half)


def share_interval(yes: np.ndarray) -> Interval:
    """Share of runs (R,) for which something is so, with Wilson's 95 % interval."""
    share = binomtest(int(yes.sum()), len(yes))
    return Interval(share.statistic, *share.proportion_ci(method="wilson"))


@frozen(eq=False)
class Figure:
    """An experiment, with its published figure's curves if there are any."""

    experiment: Experiment
    name: str = ""
    runs: Mapping[str, Runs] = field(init=False)
    printed: Mapping[str, Printed] = field()

    @runs.default
    def _load(self) -> Mapping[str, Runs]:
        return runs_of(self.experiment)

    @printed.default
    def _read(self) -> Mapping[str, Printed]:
        if not self.name:
            return {}
        learning, greedy = (curves(self.name, kind) for kind in ("learning", "greedy"))
        ours = next(iter(self.runs.values()))
        return {x: Printed(learning[x], greedy[x], ours.scale, ours.floor) for x in learning}

    def claim(
        self,
        text: str,
        number: str,
        measure: Callable[..., Interval],
        *labels: str,
        kind: str = "learning",
        printed: bool = True,
        words: Sequence[str] = (),
        **bounds: Any,
    ) -> Claim:
        """A claim whose number is measured of the runs with some labels, of a kind of return.

        The labels fill the places {} of the number's name, and of the text where no words do.
        """
        overlap = drawing = None
        if printed and self.printed:
            drawing = measure(*(self.printed[x] for x in labels))
        if self.name and self.printed.keys() >= {*labels}:
            overlap = min(self.overlap(x, kind) for x in labels)
        rest = {"overlap": overlap, "fact": text, **bounds}
        own, ours = text.format(*(words or labels)), measure(*(self.runs[x] for x in labels))
        return Claim(own, number.format(*labels), ours, drawing, **rest)

    def earns(self, text: str, labels: Iterable[str], t: int, **bounds: Any) -> list[Claim]:
        """A claim about what each of some algorithms, {} in the text, earns at an iteration."""
        name = "" if "{}" in text else " of {}"
        number = f"learning return{name} at {t:,}, {self._unit}"
        return [self.claim(text, number, lambda a: a.share(t), x, **bounds) for x in labels]

    def ahead(
        self, text: str, labels: Iterable[str], others: Iterable[str], end: int, **bounds: Any
    ) -> list[Claim]:
        """A claim about how much more some algorithms earn than each of others until an iteration.

        Both have their places, {}, in the text.
        """
        number = f"{{}} minus {{}}, averaged until {end:,}, {self._unit}"
        return [
            self.claim(text, number, lambda a, b: a.gain_until(b, end), *pair, **bounds)
            for pair in itertools.product(labels, others)
        ]

    @property
    def _unit(self) -> str:
        """What a share is a share of."""
        ours = next(iter(self.runs.values()))
        return "of the way to the optimum" if ours.floor else "of the optimum"

    def overlap(self, label: str, kind: str) -> float:
        """Share of the recorded iterations at which our 95 % interval meets the published one."""
        ours, theirs = self.runs[label].stored[kind], getattr(self.printed[label], kind)
        both = np.isin(ours.iteration.values, theirs.iterations)
        band, at = mean_interval(ours.values[:, both]), np.isin(theirs.iterations, ours.iteration)
        return float(np.mean((band.low <= theirs.high[at]) & (theirs.low[at] <= band.high)))
