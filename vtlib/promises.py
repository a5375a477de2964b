"""Whether sources keep in a task what they promise there, and which of them plays an episode.

The values of the sources at the first state of an episode promise a return. A source either is of
the task's kind, and its returns fall short of the promise by about as much as the sources' values
differ, or it is not, and they may fall short by ten times as much. What share of the sources is of
the task's kind is unknown beforehand. A mixture with free weights learns it from returns, where
section 5.2.2 of the thesis fixes the weights at 1 / C.
"""

from __future__ import annotations

import numpy as np
from attrs import define, field

from vtlib.checks import whole

WIDE = 10.0  # how many times as far the returns of a source of another kind may fall short
KEPT = 0.5  # a source that is likelier of the task's kind than this keeps its promise
LOOKS = 32  # from this episode on the learned part plays in episodes that are powers of two
RECENT = 20  # episodes that tell what the learned part earns now
AHEAD = 1.0  # deviations of a return by which the learned part has to lead sources that are kept
LEAST = 10  # episodes after which the learned part has to show something, or may, without a trial
FLOOR = 0.01  # deviations of a return that a gain has to exceed
MARGIN = 0.5  # standard errors by which it then has to lead, or sources play half of the episodes
HALF = 0.5
# What share of the sources is of the task's kind: as likely none as anything, which is uniform.
SHARES = np.append(0.0, (np.arange(200) + 0.5) / 200)
PRIOR = np.append(0.5, np.full(200, 0.5 / 200))


def evidence(shortfall: np.ndarray) -> np.ndarray:
    """How much likelier shortfalls (n,), in spreads, are of the task's kind than of another.

    Both laws are half normal, with deviations 1 and 10. To earn more than was promised is no
    evidence against a source.
    """
    square = np.square(np.maximum(shortfall, 0.0))
    return np.asarray(WIDE * np.exp(-square * (1 - WIDE**-2) / 2))


def beliefs(factors: np.ndarray) -> tuple[np.ndarray, float]:
    """Probabilities (n,) that tried sources are of the task's kind, and that another one is.

    factors (n,): the evidence of each source tried. A share of the sources is of the task's kind;
    it is summed out, after a spike at none and a uniform slab.
    """
    own = SHARES[:, None] * factors
    either = own + 1 - SHARES[:, None]
    log_weight = np.log(PRIOR) + np.log(either).sum(1)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    return weight @ (own / either), float(weight @ SHARES)


@define
class Record:
    """What one run has seen of ``count`` sources and of what it has learned, which is the last arm.

    For each episode: played, the arm; trust, the probability beforehand that an untried source is
    of the task's kind; gained, the return; short, by how many spreads it fell short of the promise.
    The lists are the whole state: a record made of them goes on as if nothing had happened.
    judged is the first episode of a trial that decides what is kept in the end.
    """

    count: int = field(validator=whole())
    sources_play: bool = True
    played: list[int] = field(factory=list)
    trust: list[float] = field(factory=list)
    gained: list[float] = field(factory=list)
    short: list[float] = field(factory=list)
    judged: int | None = None

    def judge(self) -> None:
        """Begin the trial with the next episode."""
        self.judged = len(self.played)

    def add(self, gained: float, promise: float, spread: float) -> None:
        """Note what the arm that was chosen last earned, and how that compares with a promise."""
        missing = max(promise - gained, 0.0)
        self.gained.append(gained)
        # where sources do not differ, they keep a promise to the letter or not at all
        self.short.append(missing / spread if spread > 0 else 2 * WIDE * (missing > 0))

    def choose(self, begun: bool, coin: float, normal: np.ndarray) -> int:
        """The arm of the next episode, by a uniform number and normal ones (S,).

        begun: whether the learned part has learned anything yet; until then only sources play, if
        they may. Where no source keeps its promise, the learned part plays, unless one leads by a
        deviation. Once it has played for a while and is not ahead of the sources, half of the
        episodes go to them. In the trial what was learned plays until it has as many episodes as
        the best source, then both in turn; once one of them is clearly better it plays on.
        """
        kept, another = self.kept()
        self.trust.append(another)
        fresh = [j for j in range(self.count) if j not in self.tried][:1]
        hope = fresh if coin < another else []
        if not self.sources_play:
            arm = self.count
        elif self.judged is not None:
            own, best = self._trial(), self.best()
            clear, often = self._clearly_ahead(own), len(own) > len(self.returns(best))
            arm = best if clear < 0 or (often and not clear) else self.count
        elif not begun:
            arm = self._draw(kept, hope, normal) if kept else next(iter(fresh), self.best())
        elif self._looks():
            arm = self.count
        elif kept:
            arm = self._draw(kept, hope, normal) if self.source_leads else self.count
        elif self._lead(self.returns(self.best())) > AHEAD:
            arm = self.best()
        elif coin < HALF and self._stuck():
            arm = self._draw(self.tried, fresh, normal)
        else:
            arm = self.count
        self.played.append(arm)
        return arm

    @property
    def source_leads(self) -> bool:
        """Whether the best source is better than what was learned, as far as returns tell.

        Sources that keep their promise are, until what was learned leads by a deviation. Others
        have to lead by a standard error.
        """
        if not self.sources_play:
            return False
        best = self.returns(self.best())
        if self.kept()[0]:
            return self._lead(best) >= -AHEAD
        return self._lead(best) > AHEAD * self._error(best)

    @property
    def improved(self) -> bool:
        """Whether what was learned beats the best source in the trial, by more than an error.

        From n episodes it takes 1 + 2 / (n - 1) standard errors, about a one-sided test at 10 %. A
        trial of less than two episodes leaves it to the recent ones, if these are ten at least. A
        tie keeps the source; where no source may play there is nothing else to keep.
        """
        own = self._trial()
        if len(own) < 2:
            own = self._recent() if len(self._recent()) >= LEAST else []
        return not self.sources_play or self._clearly_ahead(own) > 0

    @property
    def lost(self) -> bool:
        """Whether what was learned has earned no more lately than the least that was ever earned.

        Before it has played: whether all returns are alike.
        """
        own = self._recent() or self.gained
        return bool(own) and max(own) <= min(self.gained)

    @property
    def tried(self) -> list[int]:
        """The sources that have played an episode to its end."""
        ended = self.played[: len(self.gained)]
        return sorted({arm for arm in ended if arm < self.count})

    def returns(self, arm: int) -> list[float]:
        """What an arm has earned, episode by episode."""
        return [x for j, x in zip(self.played, self.gained, strict=False) if j == arm]

    def kept(self) -> tuple[list[int], float]:
        """Tried sources that are likely of the task's kind, and the probability for another."""
        tried, ended = self.tried, list(zip(self.played, self.short, strict=False))
        short = np.array([np.mean([x for arm, x in ended if arm == j]) for j in tried])
        of_kind, another = beliefs(evidence(short))
        return [j for j, p in zip(tried, of_kind, strict=True) if p > KEPT], another

    def best(self) -> int:
        """The tried source with the highest mean return; the first source before any is tried."""
        return max(self.tried, key=lambda j: np.mean(self.returns(j)), default=0)

    def _trial(self) -> list[float]:
        """What was learned has earned in the trial."""
        first = len(self.gained) if self.judged is None else self.judged
        own = zip(self.played[first:], self.gained[first:], strict=False)
        return [x for arm, x in own if arm == self.count]

    def _clearly_ahead(self, own: list[float]) -> int:
        """1 where such returns beat the best source's by more than an error, -1 where they lose."""
        best = self.returns(self.best())
        if len(own) < 2 or not best:
            return 0
        scatter = np.var(own, ddof=1)
        theirs = np.var(best, ddof=1) if len(best) > 1 else scatter
        error = np.sqrt(scatter / len(own) + theirs / len(best))
        least = max((1 + 2 / (len(own) - 1)) * error, FLOOR * np.std(self.gained))
        lead = np.mean(own) - np.mean(best)
        return int(lead > least) - int(lead < -least)

    def _recent(self) -> list[float]:
        return self.returns(self.count)[-RECENT:]

    def _lead(self, returns: list[float]) -> float:
        """By how many deviations of a return sources lead the learned part, which may be 0."""
        own, scale = self._recent(), float(np.std(self.gained)) if self.gained else 0.0
        if not returns or not own or scale == 0:
            return 0.0
        return float((np.mean(returns) - np.mean(own)) / scale)

    def _error(self, returns: list[float]) -> float:
        """The standard error of that lead."""
        return float(np.sqrt(1 / max(1, len(returns)) + 1 / max(1, len(self._recent()))))

    def _stuck(self) -> bool:
        """Whether the learned part has played, but is no better than the sources are together."""
        theirs = [x for j in self.tried for x in self.returns(j)]
        behind = self._lead(theirs) >= -MARGIN * self._error(theirs)
        return behind and len(self.returns(self.count)) >= LEAST

    def _looks(self) -> bool:
        episode = len(self.played) + 1
        return episode >= LOOKS and episode.bit_count() == 1

    def _draw(self, kept: list[int], hope: list[int], normal: np.ndarray) -> int:
        """Thompson sampling among sources, which are alike beforehand."""
        returns = [self.returns(j) for j in kept] + [[] for _ in hope]
        every = [x for own in returns for x in own] or [0.0]
        centre, scale = np.mean(every), np.std(every) or 1.0  # which breaks ties
        count = np.array([len(own) for own in returns])
        means = (np.array([sum(own) for own in returns]) + centre) / (count + 1)
        arms = kept + hope
        return arms[int((means + scale / np.sqrt(count + 1) * normal[arms]).argmax())]
