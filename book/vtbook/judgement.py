"""What the judged runs say of the method that trusts its sources, beside each of its rivals."""

from functools import cache

import numpy as np
from attrs import frozen

from vtbook.comparisons import holm, paired_p
from vtbook.experiments.compared import mean_shares
from vtbook.experiments.protocols import FROM_MEAN
from vtbook.experiments.trust import EIGHT, LEFT_OUT, LOSS, OURS, PICKED, PLACES, Place
from vtbook.experiments.trust_parts import ALONE, PARTS, REUSE
from vtlab.stats import Interval, difference_interval

LEVEL = 0.05
NAMES = {
    OURS: "Trust",
    "untouched": "best source, untouched",
    "NT": "no transfer",
    FROM_MEAN: "fine-tuned",
}
METHODS = *NAMES.values(), PICKED, "DDQN, fine-tuned", "1-MGVT", "3-MGVT"
#: Run after the judgement.
LATER = {
    REUSE: REUSE,
    f"{PICKED}, 8 steps": f"{PICKED}{EIGHT}",
    "no transfer, 8 steps": f"NT{EIGHT}",
}
#: The best of the mixtures and fine-tuning with four or eight gradient steps, picked afterwards.
MORE = "mixture or fine-tuned, 4–8 steps"


@frozen
class Contrast:
    """The method beside a rival in a place: difference in shares of the optimum, adjusted P."""

    place: str
    rival: str
    gain: Interval
    p: float

    @property
    def verdict(self) -> str:
        """Better or worse by the adjusted test, as good where no loss is left, else undecided."""
        if self.p < LEVEL:
            return "better" if self.gain.centre > 0 else "worse"
        return "as good" if self.gain.low >= -LOSS else "undecided"


@cache
def earned(place: Place) -> dict[str, np.ndarray]:
    """What each run of each algorithm earned (R,), as a share of the optimum."""
    return {x: mean_shares(place.experiment, x, place.first) for x in place.experiment.algorithms}


@cache
def contrasts() -> tuple[Contrast, ...]:
    """The method beside every rival in every place; P values are adjusted over all of them."""
    pairs = [
        (place.title, rival, earned(place)[OURS], values)
        for place in PLACES
        for rival, values in earned(place).items()
        if rival != OURS
    ]
    # runs that are all alike have no P value: nothing tells them apart
    p = [paired_p(a, b) if (a != b).any() else 1.0 for *_, a, b in pairs]
    adjusted = holm(np.array(p + LEFT_OUT * [1.0]))[: len(p)]
    return tuple(
        Contrast(place, rival, difference_interval(a, b), float(value))
        for (place, rival, a, b), value in zip(pairs, adjusted, strict=True)
    )


def shortfalls() -> dict[str, float]:
    """How far behind the best of a place each algorithm is where it is farthest behind.

    In shares of the optimum, by means, of those that ran in all places but one or in all.
    """
    means = [{x: each.mean() for x, each in earned(place).items()} for place in PLACES]
    behind: dict[str, list[float]] = {}
    for here in means:
        for label, mean in here.items():
            behind.setdefault(label, []).append(float(max(here.values()) - mean))
    return {x: max(each) for x, each in behind.items() if len(each) >= len(PLACES) - 1}


def without_a_part(place: Place, label: str = ALONE) -> np.ndarray:
    """What each run of a control earned (R,) where the method is judged, in the same shares."""
    return mean_shares(PARTS[place.title], label, place.first)


@cache
def earned_by_method() -> dict[str, np.ndarray]:
    """The mean share of the optimum of each method in each place (P,), NaN where it did not run."""
    shares = {name: np.full(len(PLACES), np.nan) for name in (*METHODS, *LATER, MORE)}
    for k, place in enumerate(PLACES):
        for label, runs in earned(place).items():
            name = MORE if label.endswith(" updates") else NAMES.get(label, label)
            if name in shares:
                shares[name][k] = np.fmax(shares[name][k], runs.mean())
        for name, label in LATER.items():
            shares[name][k] = without_a_part(place, label).mean()
    return shares
