"""Solve, transfer and evaluate on ordinary Gymnasium environments, one call each."""

import io
from collections.abc import Callable, Sequence
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Self

import attrs
import gymnasium
import numpy as np
import torch
from attrs import evolve, frozen
from torch import Tensor
from tqdm import tqdm

from vtlib.baselines import DDQNSettings, FineTuning, MellowTDSettings
from vtlib.checks import check_between, check_kind, check_weights, check_whole, shown
from vtlib.episodes import GymEpisodes
from vtlib.files import TornResult, write_bytes
from vtlib.qfunctions import QFunction
from vtlib.recommended import Recommended
from vtlib.rng import Rng, generator
from vtlib.training import Agent, arithmetic, check_finite, iterate
from vtlib.transfer import Settings, VariationalTransfer

EVERY = 100  # iterations from one record to the next
LONGEST = 100_000  # steps after which an episode is given up

Callback = Callable[[int, Tensor], bool | None]


@frozen(eq=False)
class Learned:
    """What R runs end with.

    weights (R, C, d): final weights, those of each component's mean for a posterior. iterations
    (T,) and returns (R, T): mean discounted return of the last 50 episodes, NaN before the first
    has ended. steps (R,): of the environment, trials included. improved (R,): whether the weights
    learned are kept; else they are those of the best source (see ``transfer``). mu (R, C, d) and
    scale_tril (R, C, d, d): means and factors L of the posterior learned, kept or not, or L's
    diagonals (R, C, d) where it is diagonal; None without a posterior.
    """

    weights: Tensor
    iterations: Tensor
    returns: Tensor
    steps: Tensor
    improved: Tensor
    mu: Tensor | None = None
    scale_tril: Tensor | None = None

    def __attrs_post_init__(self) -> None:
        (runs, components, d), (times,) = self.weights.shape, self.iterations.shape
        shapes = [tuple(x.shape) for x in (self.returns, self.steps, self.improved)]
        means, factors = (None if x is None else x.shape for x in (self.mu, self.scale_tril))
        shape = (runs, components, d)
        posteriors = (None, None), (shape, shape), (shape, (*shape, d))
        if shapes != [(runs, times), (runs,), (runs,)] or (means, factors) not in posteriors:
            raise ValueError(
                f"arrays must fit weights {tuple(shape)} and {times} records, got "
                f"{shapes}, mu {means}, scale_tril {factors}"
            )

    def save(self, path: str | Path) -> None:
        """Write everything to one .npz of plain arrays, at once, and make its folder if need be."""
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        buffer = io.BytesIO()
        parts = attrs.asdict(self, recurse=False).items()
        arrays = {k: v.cpu().numpy() for k, v in parts if v is not None}
        np.savez_compressed(buffer, **arrays)
        write_bytes(Path(path), buffer.getvalue())

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """What was saved; TornResult names a file that is not whole or holds something else."""
        whole = io.BytesIO(Path(path).read_bytes())
        try:
            with np.load(whole, allow_pickle=False) as stored:
                return cls(**{name: torch.from_numpy(stored[name]) for name in stored})
        except Exception as error:  # what is not such a file may raise anything
            raise TornResult(f"{path} is not what Learned.save wrote") from error


@arithmetic()
def solve(
    envs: Sequence[gymnasium.Env],
    q: QFunction,
    iterations: int,
    settings: MellowTDSettings | DDQNSettings | None = None,
    *,
    seed: int = 0,
    callback: Callback | None = None,
    progress: bool = False,
) -> Learned:
    """Learn each environment from scratch, by mellow TD unless settings say DDQN.

    All start from one common initialisation, which keeps the hidden units of a network comparable
    between sources. callback is told the iteration and the mean returns (R,) every 100 iterations,
    and ends the learning by returning False; progress shows a bar. It has no ``device``,
    unlike ``transfer``: only posteriors are kept elsewhere than on the processor. Raises ValueError
    for spaces other than Box and Discrete, a Q-function of other sizes or that draws random
    numbers, or an environment that is given twice; Diverged when weights cease to be finite.
    """
    check_whole("iterations", iterations)
    check_kind("callback", callback, Callable | None)
    check_kind("settings", settings, MellowTDSettings | DDQNSettings | None)
    settings = settings or MellowTDSettings(epsilon_steps=max(1, iterations // 2))
    name = _name("solve", seed)
    episodes, rng = _episodes(envs, q, name, settings.gamma), Rng(name, range(len(envs)))
    start = 0.1 * Rng(name, [0]).stream("initial weights").normal(q.d).expand(len(envs), -1)
    agent = settings.agent(q, start, episodes.obs_dim, rng)
    return _learn(agent, episodes, iterations, name, callback, progress)


@arithmetic()
def transfer(
    envs: Sequence[gymnasium.Env],
    q: QFunction,
    sources: Tensor,
    iterations: int,
    settings: Settings | FineTuning | Recommended | None = None,
    *,
    trials: int = 20,
    seed: int = 0,
    callback: Callback | None = None,
    progress: bool = False,
    device: str = "cpu",
) -> Learned:
    """Learn each environment with a prior from sources (S, d): Algorithm 1, made safe.

    Each source first plays ``trials`` greedy episodes; the best come first, where components start.
    In the end the posterior's means play as many, and are kept where they earn at least the
    standard error of the difference more than the best source; with trials = 0 none is played.
    The default is ``Recommended``. sources: ``weights[:, 0]`` of ``solve``. device: where
    posteriors are kept. Raises as ``solve``, and ValueError for missing, bad or misshapen sources,
    one trial, or a device that torch lacks.
    """
    check_whole("iterations", iterations)
    check_whole("trials", trials, 0)
    if trials == 1:
        raise ValueError("trials must be 0 or at least 2: one has no standard error")
    check_kind("callback", callback, Callable | None)
    check_kind("envs", envs, Sequence)
    check_kind("q", q, QFunction)
    check_kind("sources", sources, Tensor)
    check_weights("sources", sources, "source", q.d)
    settings = Recommended() if settings is None else settings
    check_kind("settings", settings, Settings | FineTuning | Recommended)
    # only posteriors are kept elsewhere than on the processor
    place = "cpu" if isinstance(settings, FineTuning) else device
    try:
        torch.empty(0, device=place)
    except (RuntimeError, AssertionError, TypeError) as error:
        raise ValueError(f"device must be one that torch has here, got {shown(device)}") from error
    gamma = (settings.learner if isinstance(settings, FineTuning) else settings).gamma
    name, sources = _name("transfer", seed), sources.detach().cpu()
    shared = sources.expand(len(envs), *sources.shape)
    steps = torch.zeros(len(envs), dtype=torch.int64)
    play = partial(_play, envs, q, episodes=trials, name=f"{name} trial", gamma=gamma)
    if trials:
        plays = [play(weights=source) for source in shared.split(1, 1)]
        steps += sum(length for _, length in plays)
        returns = torch.stack([episodes for episodes, _ in plays], 1)
        order = torch.argsort(-returns.mean(2), dim=1, stable=True)
        shared = shared.gather(1, order.unsqueeze(2).expand_as(shared))
    episodes, rng = _episodes(envs, q, name, gamma), Rng(name, range(len(envs)))
    agent = settings.agent(q, shared.to(place), episodes.obs_dim, rng)
    learned = _learn(agent, episodes, iterations, name, callback, progress)
    learned = evolve(learned, steps=learned.steps + steps)
    if not trials:
        return learned
    last, length = play(weights=learned.weights)
    gain = last - returns[torch.arange(len(envs)), order[:, 0]]
    improved = gain.mean(1) >= gain.std(1, correction=0) / (trials - 1) ** 0.5
    weights = torch.where(improved.view(-1, 1, 1), learned.weights, shared[:, :1])
    return evolve(learned, weights=weights, steps=learned.steps + length, improved=improved)


@arithmetic()
def evaluate(
    envs: Sequence[gymnasium.Env],
    q: QFunction,
    weights: Tensor,
    episodes: int = 20,
    *,
    gamma: float = 0.99,
    seed: int = 0,
) -> Tensor:
    """Discounted returns (R, episodes) of greedy policies on fresh episodes.

    The values of C weight vectors of weights (R, C, d) are averaged. Raises as ``solve``.
    """
    check_whole("episodes", episodes)
    check_between("gamma", gamma, 0, 1)
    check_kind("envs", envs, Sequence)
    check_kind("q", q, QFunction)
    check_kind("weights", weights, Tensor)
    check_weights("weights", weights, len(envs), "component", q.d)
    return _play(envs, q, weights, episodes, _name("evaluate", seed), gamma)[0]


def _play(
    envs: Sequence[gymnasium.Env],
    q: QFunction,
    weights: Tensor,
    episodes: int,
    name: str,
    gamma: float,
) -> tuple[Tensor, Tensor]:
    """Greedy returns (R, episodes) of weights (R, C, d), and steps (R,) played to get them."""
    play, count = _episodes(envs, q, name, gamma), torch.zeros(len(envs), dtype=torch.int64)
    steps, since = torch.zeros_like(count), torch.zeros_like(count)
    running, discount = torch.zeros(len(envs)), torch.ones(len(envs))
    returns = torch.zeros(len(envs), episodes)
    while bool((count < episodes).any()):
        action = q.q(weights, q.prepare(play.obs.unsqueeze(1))).mean(1)[..., 0].argmax(-1)
        running += discount * play.step(action).reward
        discount *= gamma
        steps += count < episodes
        since += 1
        for row in (play.fresh & (count < episodes)).nonzero().flatten().tolist():
            returns[row, count[row]] = running[row]
            count[row] += 1
        running[play.fresh], discount[play.fresh], since[play.fresh] = 0.0, 1.0, 0
        if int(since.max()) > LONGEST:
            fault = f"an episode has not ended after {LONGEST:,} steps"
            raise ValueError(f"{fault}: gymnasium.wrappers.TimeLimit ends it")
    return returns, steps


def _name(task: str, seed: int) -> str:
    check_whole("seed", seed, 0)
    return f"{task} {seed}"


def _episodes(envs: Sequence[gymnasium.Env], q: QFunction, name: str, gamma: float) -> GymEpisodes:
    check_kind("envs", envs, Sequence)
    check_kind("q", q, QFunction)
    if len({id(getattr(env, "unwrapped", env)) for env in envs}) < len(envs):
        raise ValueError("each run needs an environment of its own, one is given twice")
    limit, runs = np.iinfo(np.int32).max, range(len(envs))
    seeds = [int(generator(name, run, "environment").integers(limit)) for run in runs]
    episodes = GymEpisodes(envs, seeds, gamma)
    try:
        # weights of many sizes, because weights of zero would hide what a unit draws
        w, obs = torch.linspace(-1, 1, q.d).view(1, 1, -1), episodes.obs[:1].unsqueeze(1)
        values, repeated = (q.q(w, q.prepare(obs)) for _ in range(2))
    except Exception as error:  # a user's Q-function may raise anything
        raise ValueError(f"the Q-function cannot value an observation: {error}") from error
    same = values.shape == repeated.shape
    if not (same and torch.allclose(values, repeated, 1e-4, 1e-4, equal_nan=True)):
        raise ValueError("the Q-function must give the same values each time, it draws others")
    if not values.shape[2] == q.n_actions == episodes.n_actions:
        counts = f"{episodes.n_actions} actions, got {q.n_actions} and {values.shape[2]} values"
        raise ValueError(f"the Q-function must have the environments' {counts}")
    return episodes


def _learn(
    agent: Agent,
    episodes: GymEpisodes,
    iterations: int,
    name: str,
    callback: Callback | None,
    progress: bool,
) -> Learned:
    runs, times, returns = len(agent.mu), [], []
    names, done = [f"run {r} of {name}" for r in range(runs)], 0
    loop = islice(iterate(agent, episodes), iterations)
    for t in tqdm(loop, total=iterations, disable=not progress):
        done = t
        if t % EVERY == 0:
            check_finite(agent.mu, names, t)
            times.append(t)
            returns.append(episodes.returns.mean(before=torch.nan))
            answer = None if callback is None else callback(t, returns[-1])
            if answer is not None and not answer:  # NumPy's and torch's False, too
                break
    check_finite(agent.mu, names, done)
    mu = agent.mu.detach().cpu().clone()
    factors = None
    if isinstance(agent, VariationalTransfer):
        factors = agent.scale_tril if agent.deviations is None else agent.deviations
        factors = factors.detach().cpu().clone()
    return Learned(
        weights=mu,
        iterations=torch.tensor(times, dtype=torch.int64),
        returns=torch.stack(returns, 1) if returns else torch.empty(runs, 0),
        steps=torch.full((runs,), done),
        improved=torch.ones(runs, dtype=torch.bool),
        mu=None if factors is None else mu,
        scale_tril=factors,
    )
