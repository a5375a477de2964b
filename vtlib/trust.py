"""Play the sources while they keep their promise, and learn from all that is seen meanwhile.

``vtlib.promises`` says which source plays an episode, and when what was learned plays instead. What
is learned is a Gaussian, or a mixture, whose covariance stays the prior's, so that each of its
updates costs as one of fine-tuning. It hardly explores: lost, it takes some random actions.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
import torch
from attrs import field, frozen
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from vtlib.checks import between, kind, whole
from vtlib.promises import Record
from vtlib.qfunctions import QFunction
from vtlib.replay import Transition
from vtlib.rng import Rng
from vtlib.transfer import Settings
from vtlib.units import FIRST, InUnits

STEP = 2e-3  # Adam's, in units of the sources
NARROW = 0.003  # standard deviation of the prior's components, in these units
WORTH = 0.05  # how many transitions the prior counts for
QUARTILES = torch.tensor([0.25, 0.5, 0.75], dtype=torch.float32)
NORMAL = 1.349  # deviations between the quartiles of a normal law
PARTS = "played", "trust", "gained", "short"  # of a record
RANDOM = 0.1  # share of random actions while what was learned is lost
CLIP = 1.0  # bound on a gradient's entries, which only a run that explodes reaches


@frozen
class Trust:
    """Parameters of the posterior that learns, and whether sources may play.

    Raises ValueError for a value outside its range.
    """

    transfers: ClassVar[bool] = True

    components: int = field(default=1, validator=whole())
    updates: int = field(default=8, validator=whole())
    gamma: float = field(default=0.99, validator=between(0, 1, below=True))
    # False where they are known to fail: what is learned then plays from the first episode on
    sources_play: bool = field(default=True, validator=kind(bool))

    def agent(self, q: QFunction, sources: Tensor, obs_dim: int, rng: Rng) -> Trusting:
        """An agent that transfers from sources (R, S, d)."""
        return Trusting(q, sources, obs_dim, self, rng)

    @property
    def in_units(self) -> Settings:
        """The parameters of the posterior that learns, in the units of the sources."""
        return Settings(
            components=self.components,
            gamma=self.gamma,
            lambda_=WORTH * NARROW**2,
            buffer=50_000,
            n_samples=1,
            alpha_mu=STEP,
            sigma_p2=NARROW**2,
            init="mean",
            covariance="fixed",
            clip=CLIP,
            patience=FIRST,
            responsibilities="equal",
        )


class Trusting:
    """An agent of R runs that plays sources (R, S, d), or what it learns from all steps.

    ``records`` tell what each run has seen; ``random`` is the share of random actions while lost.
    """

    def __init__(
        self, q: QFunction, sources: Tensor, obs_dim: int, settings: Trust, rng: Rng
    ) -> None:
        self.learned = InUnits(q, sources, obs_dim, settings.in_units, settings.updates, rng)
        runs, count, _ = sources.shape
        self.random = RANDOM
        self._q, self._sources, self._gamma = q, sources.detach().cpu(), settings.gamma
        self.records = [Record(count, settings.sources_play) for _ in range(runs)]
        self._coin, self._normal = rng.stream("hypothesis"), rng.stream("source")
        self._random, self._lost = rng.stream("random action"), torch.zeros(runs, dtype=torch.bool)
        self._rows, self._arm = torch.arange(runs), torch.full((runs,), -1)
        self._steps = 0
        self._judged: Tensor | None = None  # what was learned until the trial that decides
        self._gained, self._discount = torch.zeros(runs), torch.ones(runs)
        # what sources promised at the episode's start, and how far apart they were
        self._promise, self._spread = torch.zeros(runs), torch.zeros(runs)

    @property
    def best_source(self) -> Tensor:
        """Weights (R, 1, d) of the source that has earned most."""
        best = torch.tensor([record.best() for record in self.records])
        return self._sources[self._rows, best].unsqueeze(1)

    @property
    def mu(self) -> Tensor:
        """Weights (R, C, d) of what leads at present: the posterior's means, or a source."""
        mu = self.learned.mu.cpu()
        leads = torch.tensor([record.source_leads for record in self.records])
        return torch.where(leads.view(-1, 1, 1), self.best_source.expand_as(mu), mu)

    @property
    def improved(self) -> Tensor:
        """Whether what was learned is clearly better than the best source (R,)."""
        return torch.tensor([record.improved for record in self.records])

    @property
    def kept(self) -> Tensor:
        """Weights (R, C, d) to keep: what was learned where it has improved, or the best source."""
        mu = self.learned.mu.cpu() if self._judged is None else self._judged
        return torch.where(self.improved.view(-1, 1, 1), mu, self.best_source.expand_as(mu))

    def judge(self) -> None:
        """Let greedy episodes of what has been learned by now, and of a source, decide."""
        if all(record.sources_play for record in self.records):
            self._judged = self.learned.mu.cpu()
            for record in self.records:
                record.judge()

    def act(self, obs: Tensor, fresh: Tensor) -> Tensor:
        """Greedy actions (R,) of a source or of a draw; fresh (R,) marks first steps."""
        seen = self._q.prepare(obs.unsqueeze(1))
        values = self._q.q(self._sources, seen)[..., 0]
        best = values.amax(-1)
        # drawn at every step: a run's stream must not depend on when its neighbours' episodes end
        coin, normal = self._coin.uniform(1), self._normal.normal(values.shape[1])
        chance, which = self._random.uniform(2).T
        for row in fresh.nonzero().flatten().tolist():
            self._begin(row, best[row], float(coin[row]), normal[row].numpy())
        arm = self._arm.clamp(max=values.shape[1] - 1)
        shown = values[self._rows, arm].argmax(-1)
        anything = (which * values.shape[-1]).long()
        own = torch.where(
            self._lost & (chance < self.random), anything, self.learned.act(obs, fresh)
        )
        if self._judged is not None:
            own = self._q.q(self._judged, seen).mean(1)[..., 0].argmax(-1)
        return torch.where(self._arm == values.shape[1], own, shown)

    def learn(self, transition: Transition) -> None:
        """Add up returns, and let the posterior take in one transition of each run."""
        self._steps += 1
        self._gained += self._discount * transition.reward
        self._discount *= self._gamma
        self.learned.learn(transition)

    def finish(self, fresh: Tensor) -> None:
        """Count the episodes that have ended with the last step, in runs that are fresh (R,)."""
        for row in fresh.nonzero().flatten().tolist():
            self._end(row)

    def state(self) -> dict[str, Tensor]:
        """All that it takes to go on but random numbers, with runs as leading axis.

        ``played`` (R, E) has the arm of each episode that has ended, a source or S for what is
        learned, and -1 after a run's last; ``trust``, ``gained`` and ``short`` (R, E) are those of
        ``Record``.
        """
        told = {}
        for name in PARTS:
            ended = [torch.tensor(getattr(x, name)[: len(x.gained)]) for x in self.records]
            absent = -1 if name == "played" else torch.nan
            told[name] = pad_sequence(ended, batch_first=True, padding_value=absent)
        played = told["played"].long()  # of a run without episodes they are floats
        return {**self.learned.state(), **told, "played": played, "sources": self._sources}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Go on from a state, with a new episode in each run."""
        self.learned.restore(state)
        self._steps = int(state["steps"][0])
        for row, record in enumerate(self.records):
            ended = int((state["played"][row] >= 0).sum())
            for name in PARTS:
                setattr(record, name, state[name][row, :ended].tolist())

    def _begin(self, row: int, values: Tensor, coin: float, normal: np.ndarray) -> None:
        """End the episode of a run, and choose the arm of the next."""
        self._end(row)
        record = self.records[row]
        # by quantiles: one source that has learned nothing must not widen what counts as kept
        low, self._promise[row], high = values.quantile(QUARTILES)
        self._spread[row] = (high - low) / NORMAL
        self._arm[row] = record.choose(self._steps >= FIRST, coin, normal)
        self._lost[row] = record.lost

    def _end(self, row: int) -> None:
        """Note what the arm that played has earned, if one did."""
        if self._arm[row] >= 0:
            told = self._gained, self._promise, self._spread
            self.records[row].add(*(float(x[row]) for x in told))
        self._arm[row], self._gained[row], self._discount[row] = -1, 0.0, 1.0
