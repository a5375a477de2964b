"""Trust the sources while they keep their promise, and learn from all that is seen meanwhile.

The value of a source at the first state of an episode promises a return. Either the sources are of
the task's kind, and a return falls short of what they promise by no more than they differ among
themselves; or they are not, and it may be anything. Sources play for as long as returns speak for
the first, and a posterior that learns from every step plays otherwise.
"""

from __future__ import annotations

from math import comb
from typing import ClassVar

import torch
from attrs import field, frozen
from torch import Tensor

from vtlib.checks import between, check_kind, check_weights, whole
from vtlib.qfunctions import QFunction, greedy
from vtlib.recommended import InUnits, Recommended
from vtlib.replay import Transition
from vtlib.rng import Rng

BROKEN = 2.16  # spreads by which a return falls short: a law ten times as wide is then likelier
LOOKS = 32  # from this episode on the posterior plays in episodes that are powers of two
RECENT = 20  # episodes that tell what the posterior can do now


def trusted(kept: int, broken: int) -> float:
    """The probability that more than half of the sources keep their promise in this task.

    The share of those that do has a uniform prior; kept and broken are how often promises were.
    """
    n = kept + broken + 1
    return sum(comb(n, i) for i in range(kept + 1)) / 2**n


class Record:
    """What one run has seen of S sources and of what it has learned, which is arm S."""

    def __init__(self, count: int) -> None:
        self.count, self.episodes, self.kept, self.broken = count, 0, 0, 0
        self.returns: list[list[float]] = [[] for _ in range(count + 1)]

    def add(self, arm: int, gained: float, promise: float, spread: float) -> None:
        """Note what an arm has earned in an episode, and whether a promise was kept."""
        self.returns[arm].append(gained)
        if arm < self.count:
            short = promise - gained > BROKEN * spread
            self.broken, self.kept = self.broken + short, self.kept + (not short)

    def choose(self, coin: float, normal: Tensor) -> int:
        """The arm of the next episode, by a uniform number and S + 1 normal ones."""
        self.episodes += 1
        learned, source = self.count, self._source(normal)
        if self.episodes == 1:
            return source
        default = source if coin < trusted(self.kept, self.broken) else learned
        look = self.episodes >= LOOKS and self.episodes.bit_count() == 1
        if look:
            return learned
        lead = self.lead()
        if lead is None or abs(lead) <= 1:
            return default
        return source if lead > 0 else learned

    def lead(self) -> float | None:
        """By how many deviations of a return the best source is ahead of what was learned."""
        tried, recent = self._tried(), self.returns[-1][-RECENT:]
        if not tried or not recent:
            return None
        best = max(sum(self.returns[j]) / len(self.returns[j]) for j in tried)
        every = torch.tensor([x for arm in self.returns for x in arm])
        scale = float(every.std()) if len(every) > 1 else 0.0
        gap = best - sum(recent) / len(recent)
        return gap / scale if scale > 0 else 0.0

    def best(self) -> int:
        """The source with the highest mean return, drawn to the mean of all."""
        means, _ = self._beliefs()
        return int(means.argmax())

    def _tried(self) -> list[int]:
        return [j for j in range(self.count) if self.returns[j]]

    def _beliefs(self) -> tuple[Tensor, Tensor]:
        """Mean and deviation (S,) of what each source earns: sources are alike beforehand."""
        every = torch.tensor([x for arm in self.returns[:-1] for x in arm])
        scale = float(every.std()) if len(every) > 1 else 1.0
        centre = float(every.mean()) if len(every) else 0.0
        n = torch.tensor([float(len(arm)) for arm in self.returns[:-1]])
        total = torch.tensor([sum(arm) for arm in self.returns[:-1]])
        return (total + centre) / (n + 1), scale / (n + 1).sqrt()

    def _source(self, normal: Tensor) -> int:
        means, deviations = self._beliefs()
        return int((means + deviations * normal[:-1]).argmax())


@frozen
class Trust:
    """Parameters of the method, the same for every task.

    components, updates, gamma: of the posterior that learns. Raises ValueError for a value outside
    its range.
    """

    transfers: ClassVar[bool] = True

    components: int = field(default=3, validator=whole())
    updates: int = field(default=8, validator=whole())
    gamma: float = field(default=0.99, validator=between(0, 1, below=True))

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> Trusting:
        """An agent that transfers from sources (R, S, d)."""
        return Trusting(q, sources, obs_dim, self, rng)


class Trusting:
    """An agent of R runs that plays sources (R, S, d), or what it learns from all steps."""

    def __init__(
        self, q: QFunction, sources: Tensor, obs_dim: int, settings: Trust, rng: Rng
    ) -> None:
        check_kind("sources", sources, Tensor)
        check_weights("sources", sources, "run", "source", q.d)
        runs, count, _ = sources.shape
        self._q, self._sources, self._gamma = q, sources, settings.gamma
        learner = Recommended(settings.components, settings.updates, settings.gamma)
        self.learned = InUnits(q, sources, obs_dim, learner, rng)
        self.records = [Record(count) for _ in range(runs)]
        self._coin, self._normal = rng.stream("hypothesis"), rng.stream("source")
        self._rows, self._arm = torch.arange(runs), torch.full((runs,), -1)
        self._gained, self._discount = torch.zeros(runs), torch.ones(runs)
        self._promise, self._apart = torch.zeros(runs), torch.zeros(runs)
        self._values = torch.zeros(3, runs)  # count, sum and sum of squares along the episode

    @property
    def mu(self) -> Tensor:
        """Weights (R, C, d) of what leads at present: the posterior's means, or a source."""
        mu = self.learned.mu
        leads = [self._leading(record) for record in self.records]
        best = torch.tensor([record.best() for record in self.records])
        source = self._sources[self._rows, best].unsqueeze(1).expand_as(mu)
        return torch.where(torch.tensor(leads).view(-1, 1, 1), source, mu)

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Greedy actions (R,) of a source or of a draw; fresh (R,) marks first steps."""
        values = self._q.q(self._sources, self._q.prepare(obs.unsqueeze(1)))[..., 0].amax(-1)
        coin, normal = self._coin.uniform(1), self._normal.normal(len(self._sources[0]) + 1)
        for row in fresh.nonzero().flatten().tolist():
            self._begin(row, values[row], float(coin[row]), normal[row])
        mean = values.mean(1) - self._promise
        self._values += torch.stack([torch.ones_like(mean), mean, mean.square()])
        own = self.learned.act(obs, fresh)
        source = self._sources[self._rows, self._arm.clamp(max=self._sources.shape[1] - 1)]
        shown = greedy(self._q, source.unsqueeze(1), obs)
        return torch.where(self._arm == self._sources.shape[1], own, shown)

    def learn(self, transition: Transition) -> None:
        """Add up returns, and let the posterior take in one transition of each run."""
        self._gained += self._discount * transition.reward
        self._discount *= self._gamma
        self.learned.learn(transition)

    def _begin(self, row: int, values: Tensor, coin: float, normal: Tensor) -> None:
        record = self.records[row]
        if self._arm[row] >= 0:
            n, total, squares = self._values[:, row].tolist()
            along = max(squares / n - (total / n) ** 2, 0.0)
            spread = float(self._apart[row].square() + along) ** 0.5
            promise = float(self._promise[row])
            record.add(int(self._arm[row]), float(self._gained[row]), promise, spread)
        self._arm[row] = record.choose(coin, normal)
        self._promise[row] = values.mean()
        self._apart[row] = values.std(correction=0) if len(values) > 1 else 0.0
        self._gained[row], self._discount[row] = 0.0, 1.0
        self._values[:, row] = 0.0

    def _leading(self, record: Record) -> bool:
        lead = record.lead()
        if lead is not None and abs(lead) > 1:
            return lead > 0
        return trusted(record.kept, record.broken) > 0.5 or record.episodes < 2
