"""Solve, transfer and resume on ordinary Gymnasium environments, one call each."""

import warnings
from collections.abc import Callable, Sequence
from functools import partial
from itertools import islice
from typing import Any

import gymnasium
import torch
from attrs import evolve
from torch import Tensor
from tqdm import tqdm

from vtlib.baselines import DDQNSettings, FineTuning, MellowTDSettings
from vtlib.checks import check_kind, check_weights, check_whole, shown
from vtlib.episodes import GymEpisodes
from vtlib.learned import Learned
from vtlib.playing import check_envs, episodes_of, greedy_episodes, stream_name
from vtlib.qfunctions import QFunction
from vtlib.recommended import Recommended
from vtlib.rng import Rng
from vtlib.training import Agent, arithmetic, check_finite, iterate
from vtlib.transfer import Settings, VariationalTransfer

EVERY = 100  # iterations from one record to the next

Callback = Callable[[int, Tensor, Tensor], bool | None]


@arithmetic()
def solve(
    envs: Sequence[gymnasium.Env],
    q: QFunction,
    iterations: int,
    settings: MellowTDSettings | DDQNSettings | None = None,
    *,
    trials: int = 10,
    seed: int = 0,
    callback: Callback | None = None,
    progress: bool = False,
) -> Learned:
    """Learn each environment from scratch, by mellow TD unless settings say DDQN.

    All start from one common initialisation, which keeps the hidden units of a network comparable
    between sources. In the end each plays ``trials`` greedy episodes, which ``reached`` keeps and
    ``steps`` leaves out; a warning names those that earn no more than the initial weights do.
    callback is told the iteration, the mean returns (R,) and the weights (R, C, d) every 100
    iterations, and ends the learning by returning False; progress shows a bar of all steps. Ctrl-C
    ends it, too, and what was learned is returned. It has no ``device``, unlike ``transfer``: only
    posteriors are kept elsewhere than on the processor. Raises ValueError for spaces other than
    Box and Discrete, a Q-function of other sizes or that draws random numbers, or an environment
    that is given twice; Diverged when weights cease to be finite.
    """
    check_whole("iterations", iterations)
    check_trials(trials)
    check_kind("callback", callback, Callable | None)
    check_kind("settings", settings, MellowTDSettings | DDQNSettings | None)
    settings = settings or MellowTDSettings(epsilon_steps=max(1, iterations // 2))
    name = stream_name("solve", seed)
    episodes, rng = episodes_of(envs, q, name, settings.gamma), Rng(name, range(len(envs)))
    start = 0.1 * Rng(name, [0]).stream("initial weights").normal(q.d).expand(len(envs), -1)
    agent = settings.agent(q, start, episodes.obs_dim, rng)
    bar = tqdm(total=iterations, unit=" steps", disable=not progress)
    learned = _learn(agent, episodes, iterations, name, callback, bar)
    learned = evolve(learned, q=q, settings=settings, seed=seed)
    if trials and not learned.interrupted:
        play = partial(_play, envs, q, episodes=trials, name=f"{name} trial", gamma=settings.gamma)
        learned = _with_reached(learned, start.unsqueeze(1), partial(play, bar=bar))
    bar.close()
    return learned


def _with_reached(learned: Learned, start: Tensor, play: Any) -> Learned:
    """What was learned with the returns that it reached, and a warning where that is nothing."""
    try:
        reached, before = (play(weights=weights)[0] for weights in (learned.weights, start))
    except KeyboardInterrupt:
        return evolve(learned, interrupted=True)
    except ValueError as error:  # learning took long, and an endless episode must not lose it
        warnings.warn(f"what was reached is not known: {error}", stacklevel=4)
        return learned
    gain = reached - before
    noise = gain.std(1, correction=0) / (gain.shape[1] - 1) ** 0.5
    nothing = ~((gain.mean(1) > 0) & (gain.mean(1) >= noise))
    if bool(nothing.any()):
        runs = ", ".join(map(str, nothing.nonzero().flatten().tolist()))
        fault = f"runs {runs} of solve learned nothing: greedy play earns no more than"
        warnings.warn(f"{fault} the initial weights do, which is no source", stacklevel=4)
    return evolve(learned, reached=reached)


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
    standard error of the difference more than the best source; with trials = 0 none is played, nor
    after Ctrl-C, which ends the learning and returns what was learned.
    The default is ``Recommended``. sources: ``weights[:, 0]`` of ``solve``. device: where
    posteriors are kept. Raises as ``solve``, and ValueError for missing, bad or misshapen sources,
    one trial, or a device that torch lacks.
    """
    check_whole("iterations", iterations)
    check_trials(trials)
    check_kind("callback", callback, Callable | None)
    check_envs(envs)
    check_kind("q", q, QFunction)
    if isinstance(sources, Learned):
        raise ValueError("sources must be a Tensor, got what solve returns: pass .weights[:, 0]")
    check_kind("sources", sources, Tensor)
    check_weights("sources", sources, "source", q.d)
    settings = Recommended() if settings is None else settings
    if isinstance(settings, MellowTDSettings | DDQNSettings):
        kind = type(settings).__name__
        raise ValueError(f"settings must transfer, got {kind}: wrap it in FineTuning")
    check_kind("settings", settings, Settings | FineTuning | Recommended)
    # only posteriors are kept elsewhere than on the processor
    place = "cpu" if isinstance(settings, FineTuning) else device
    try:
        torch.empty(0, device=place)
    except (RuntimeError, AssertionError, TypeError) as error:
        raise ValueError(f"device must be one that torch has here, got {shown(device)}") from error
    gamma = (settings.learner if isinstance(settings, FineTuning) else settings).gamma
    name, sources = stream_name("transfer", seed), sources.detach().cpu()
    shared = sources.expand(len(envs), *sources.shape)
    steps = torch.zeros(len(envs), dtype=torch.int64)
    bar = tqdm(total=iterations, unit=" steps", disable=not progress)
    play = partial(_play, envs, q, episodes=trials, name=f"{name} trial", gamma=gamma, bar=bar)
    if trials:
        plays = [play(weights=source) for source in shared.split(1, 1)]
        steps += sum(length for _, length in plays)
        returns = torch.stack([episodes for episodes, _ in plays], 1)
        order = torch.argsort(-returns.mean(2), dim=1, stable=True)
        shared = shared.gather(1, order.unsqueeze(2).expand_as(shared))
    episodes, rng = episodes_of(envs, q, name, gamma), Rng(name, range(len(envs)))
    agent = settings.agent(q, shared.to(place), episodes.obs_dim, rng)
    learned = _learn(agent, episodes, iterations, name, callback, bar)
    learned = evolve(learned, steps=learned.steps + steps, q=q, settings=settings, seed=seed)
    try:
        if not trials or learned.interrupted:
            return learned
        last, length = play(weights=learned.weights)
    except KeyboardInterrupt:
        return evolve(learned, interrupted=True)
    finally:
        bar.close()
    gain = last - returns[torch.arange(len(envs)), order[:, 0]]
    improved = gain.mean(1) >= gain.std(1, correction=0) / (trials - 1) ** 0.5
    weights = torch.where(improved.view(-1, 1, 1), learned.weights, shared[:, :1])
    return evolve(learned, weights=weights, steps=learned.steps + length, improved=improved)


@arithmetic()
def resume(
    learned: Learned,
    envs: Sequence[gymnasium.Env],
    iterations: int,
    *,
    callback: Callback | None = None,
    progress: bool = False,
) -> Learned:
    """Learn on from what was learned, with its settings: its means take the sources' place.

    The replay memory and the optimiser begin anew, and exploration goes on where it ended; nothing
    is tried. Raises as ``solve``, and ValueError where ``learned`` does not know its Q-function.
    """
    check_kind("learned", learned, Learned)
    check_whole("iterations", iterations)
    check_kind("callback", callback, Callable | None)
    q, settings, gamma = learned.q, learned.settings, learned.gamma
    name = f"{stream_name('resume', learned.seed)} after {int(learned.steps.max())}"
    episodes, rng = episodes_of(envs, q, name, gamma), Rng(name, range(len(envs)))  # type: ignore[arg-type]
    check_weights("envs", learned.weights, len(envs), "component", q.d)  # type: ignore[union-attr]
    weights = learned.weights
    if isinstance(settings, MellowTDSettings | DDQNSettings):
        settings, weights = evolve(settings, epsilon_start=settings.epsilon_end), weights[:, 0]
    agent = settings.agent(q, weights, episodes.obs_dim, rng)
    with tqdm(total=iterations, unit=" steps", disable=not progress) as bar:
        more = _learn(agent, episodes, iterations, name, callback, bar)
    return evolve(
        more,
        iterations=torch.cat([learned.iterations, more.iterations + int(learned.steps.max())]),
        returns=torch.cat([learned.returns, more.returns], 1),
        steps=learned.steps + more.steps,
        **{x: getattr(learned, x) for x in ("q", "settings", "seed")},
    )


def check_trials(trials: object) -> None:
    """Raise ValueError for a number of trials that has no standard error."""
    check_whole("trials", trials, 0)
    if trials == 1:
        raise ValueError("trials must be 0 or at least 2, got 1: one has no standard error")


def _play(
    envs: Sequence[gymnasium.Env],
    q: QFunction,
    weights: Tensor,
    episodes: int,
    name: str,
    gamma: float,
    bar: Any,
) -> tuple[Tensor, Tensor]:
    """Greedy returns (R, episodes) of weights (R, C, d), and steps (R,) played to get them."""

    def tick() -> None:
        bar.total += 1
        bar.update()

    played = greedy_episodes(envs, q, weights, episodes, name, gamma, tick)
    return played.returns, played.lengths.sum(1)


def _learn(
    agent: Agent,
    episodes: GymEpisodes,
    iterations: int,
    name: str,
    callback: Callback | None,
    bar: Any,
) -> Learned:
    runs, times, returns = len(agent.mu), [], []
    names, done = [f"run {r} of {name}" for r in range(runs)], 0
    interrupted = False
    try:
        for t in islice(iterate(agent, episodes), iterations):
            done = t
            bar.update()
            if t % EVERY == 0:
                check_finite(agent.mu, names, t)
                times.append(t)
                returns.append(episodes.returns.mean(before=torch.nan))
                if not _goes_on(callback, t, returns[-1], agent.mu):
                    break
    except KeyboardInterrupt:
        interrupted = True
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
        first_action=episodes.first_action,
        interrupted=interrupted,
    )


def _goes_on(callback: Callback | None, t: int, returns: Tensor, mu: Tensor) -> bool:
    """Whether a callback lets the learning go on; NumPy's and torch's False end it, too."""
    answer = None if callback is None else callback(t, returns, mu.detach().cpu().clone())
    return answer is None or bool(answer)
