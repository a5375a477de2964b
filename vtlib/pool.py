"""A pool of sources that grows with each task: weights, with what they earned, where and when."""

import datetime
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Self

import gymnasium
import numpy as np
import torch
from attrs import Factory, define, frozen
from torch import Tensor

from vtlib.checks import check_kind, check_name, check_weights, check_whole
from vtlib.files import TornResult
from vtlib.learned import Learned, load_arrays, save_arrays
from vtlib.playing import Played, play
from vtlib.qfunctions import QFunction, described, from_description

EPISODES = 20  # that a source plays before it joins


@frozen(eq=False)
class Source:
    """Weights (d,), the task that they solve, their greedy returns (20,) there, and a day."""

    task: str
    weights: Tensor
    returns: Tensor
    date: str


@define(eq=False)
class Pool:
    """Sources of one Q-function, in the order in which they came."""

    q: QFunction
    sources: list[Source] = Factory(list)

    @property
    def weights(self) -> Tensor:
        """All weights (S, d), as ``transfer`` takes them."""
        return torch.stack([x.weights for x in self.sources])

    def add(self, task: str, learned: Learned, env: gymnasium.Env, run: int = 0) -> bool:
        """Add a run's weights under the name of its task; whether they joined.

        Of several components the one joins that earns most in env, for neither their mean nor
        their vote is a weight vector that any of them stands for. Its returns are of other
        episodes. Weights that are in the pool already stay out, with a warning. Raises ValueError
        for a task's name that is taken, and as ``evaluate``.
        """
        check_name("task", task)
        check_kind("learned", learned, Learned)
        if task in (x.task for x in self.sources):
            raise ValueError(f"task must be new to the pool, got {task!r}, which is there")
        gamma = learned.gamma
        check_weights("learned", learned.weights, "run", "component", self.q.d)
        check_whole("run", run, 0, len(learned.weights) - 1)
        rows = learned.weights[run].unique(dim=0)
        earned = [play([env], self.q, w.view(1, 1, -1), EPISODES, gamma=gamma) for w in rows]
        best = rows[int(torch.stack([x.returns.mean() for x in earned]).argmax())].clone()
        for source in self.sources:
            if torch.allclose(source.weights, best):
                fault = f"the weights of {task!r} are those of {source.task!r}"
                warnings.warn(f"{fault} in the pool already: they are not added", stacklevel=2)
                return False
        fresh = play([env], self.q, best.view(1, 1, -1), EPISODES, gamma=gamma, seed=1)
        today = datetime.date.today().isoformat()
        self.sources.append(Source(task, best, fresh.returns[0], today))
        return True

    def evaluate(
        self, envs: Sequence[gymnasium.Env], episodes: int = EPISODES, *, gamma: float = 0.99
    ) -> list[Played]:
        """Greedy episodes (R, episodes) of each source in some environments."""
        runs = len(envs)
        return [
            play(envs, self.q, x.weights.expand(runs, 1, -1), episodes, gamma=gamma)
            for x in self.sources
        ]

    def save(self, path: str | Path) -> None:
        """Write the pool to one .npz of plain arrays, at once."""
        arrays = {}
        for part, size in (("weights", self.q.d), ("returns", EPISODES)):
            rows = [getattr(x, part).numpy() for x in self.sources]
            arrays[part] = np.array(rows, np.float32).reshape(-1, size)
        tasks, dates = ([getattr(x, part) for x in self.sources] for part in ("task", "date"))
        save_arrays(path, arrays, {"q": described(self.q), "tasks": tasks, "dates": dates})

    @classmethod
    def load(cls, path: str | Path, q: QFunction | None = None) -> Self:
        """What was saved; q and errors as of ``Learned.load``."""
        arrays, about = load_arrays(path, "Pool.save")
        try:
            parts = [torch.from_numpy(arrays[name]) for name in ("weights", "returns")]
            rows = zip(about["tasks"], *parts, about["dates"], strict=True)
            sources, spec = [Source(*row) for row in rows], about["q"]
        except Exception as error:  # what is not such a file may raise anything
            raise TornResult(f"{path} is not what Pool.save wrote") from error
        return cls(from_description(spec, q), sources)

    def __str__(self) -> str:
        means = [(x, float(np.mean(x.returns.numpy()))) for x in self.sources]
        return "\n".join(f"{x.task}: greedy return {mean:.3f}, {x.date}" for x, mean in means)
