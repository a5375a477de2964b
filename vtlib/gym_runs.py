"""Solve, transfer and resume on ordinary Gymnasium environments, one call each."""

import warnings
from collections.abc import Callable, Sequence
from itertools import islice
from typing import Any, cast

import gymnasium
import torch
from attrs import evolve
from torch import Tensor
from tqdm import tqdm

from vtlib.baselines import DDQNSettings, FineTuning, MellowTDSettings
from vtlib.checks import check_kind, check_weights, check_whole, shown
from vtlib.episodes import GymEpisodes
from vtlib.learned import Learned
from vtlib.playing import episodes_of
from vtlib.qfunctions import QFunction
from vtlib.rng import Rng
from vtlib.training import Agent, arithmetic, check_finite, iterate
from vtlib.transfer import Settings
from vtlib.trust import Trust, Trusting
from vtlib.units import sound

EVERY = 100  # iterations from one record to the next
TRIAL = 5  # what share of the iterations is a trial, the last fifth

Callback = Callable[[int, Tensor, Tensor], bool | None]


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
    between sources. ``evaluate`` says what each has reached. callback is told the iteration, the
    mean returns (R,) and the weights (R, C, d) every 100 iterations, and ends the learning by
    returning False; progress shows a bar of the iterations. Ctrl-C ends it, too, and what was
    learned is returned. Raises ValueError for spaces other than Box and Discrete, a Q-function of
    other sizes, or an environment that is given twice; Diverged when weights cease to be finite.
    """
    check_run(iterations, seed, callback)
    check_kind("settings", settings, MellowTDSettings | DDQNSettings | None)
    settings = settings or MellowTDSettings(epsilon_steps=max(1, iterations // 2))
    name = f"solve {seed}"
    episodes, rng = episodes_of(envs, q, name, settings.gamma), Rng(name, range(len(envs)))
    start = 0.1 * Rng(name, [0]).stream("initial weights").normal(q.d).expand(len(envs), -1)
    agent = settings.agent(q, start, episodes.obs_dim, rng)
    return _learn(agent, episodes, iterations, name, callback, progress, q, settings)


@arithmetic()
def transfer(
    envs: Sequence[gymnasium.Env],
    q: QFunction,
    sources: Tensor,
    iterations: int,
    settings: Trust | Settings | FineTuning | None = None,
    *,
    seed: int = 0,
    callback: Callback | None = None,
    progress: bool = False,
    device: str = "cpu",
) -> Learned:
    """Learn each environment with what sources (S, d) know, ``weights[:, 0]`` of ``solve``.

    The default, ``Trust``, plays the sources while they keep their promise and learns meanwhile.
    The last fifth of the iterations is a trial, in which what was learned before and the best
    source play greedily: what was learned is kept where it earns clearly more. A source whose
    weights are over ten times as large as most is left out, with a warning. Other settings run
    alone. Ctrl-C ends the learning and returns what was learned. device: where posteriors are kept.
    Raises as ``solve``, and ValueError for missing, bad or misshapen sources, or a device that
    torch lacks.
    """
    settings = Trust() if settings is None else settings
    check_run(iterations, seed, callback)
    check_kind("settings", settings, Trust | Settings | FineTuning)
    gamma = (settings.learner if isinstance(settings, FineTuning) else settings).gamma
    name = f"transfer {seed}"
    episodes, rng = episodes_of(envs, q, name, gamma), Rng(name, range(len(envs)))
    if isinstance(sources, Learned):  # which would be shown with all that it has
        raise ValueError("sources must be a Tensor, got Learned: pass .weights[:, 0] of it")
    check_weights("sources", sources, "source", q.d)
    check_kind("device", device, str)
    try:
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError) as error:
        raise ValueError(f"device must be one that torch has here, got {shown(device)}") from error
    if isinstance(settings, Trust) and not bool((good := sound(sources)).all()):
        bad = ", ".join(map(str, (~good).nonzero().flatten().tolist()))
        fault = f"left out are sources [{bad}], whose weights are over ten times as large as most"
        warnings.warn(f"{fault}, as where learning has diverged", stacklevel=3)
        sources = sources[good]
    shared = sources.detach().expand(len(envs), *sources.shape).to(device)
    agent: Any = settings.agent(q, shared, episodes.obs_dim, rng)
    return _learn(agent, episodes, iterations, name, callback, progress, q, settings)


def check_run(iterations: object, seed: object, callback: object) -> None:
    """Raise ValueError for arguments with which nothing can learn."""
    check_whole("iterations", iterations)
    check_whole("seed", seed, 0)
    check_kind("callback", callback, Callable | None)


@arithmetic()
def resume(
    learned: Learned,
    envs: Sequence[gymnasium.Env],
    iterations: int,
    *,
    seed: int = 0,
    callback: Callback | None = None,
    progress: bool = False,
) -> Learned:
    """Learn on from the whole state of ``Trust``, with new episodes and random numbers.

    Raises as ``solve``, and ValueError where ``learned`` is not what ``Trust`` has learned, or does
    not know its Q-function.
    """
    check_run(iterations, seed, callback)
    check_kind("learned", learned, Learned)
    check_kind("the settings of learned", learned.settings, Trust)
    settings, state = learned.settings, cast(dict[str, Tensor], learned.state)
    q = cast(QFunction, learned.q)  # which episodes_of refuses where it is none
    name = f"resume {seed} after {int(learned.steps.max())}"
    episodes, rng = episodes_of(envs, q, name, settings.gamma), Rng(name, range(len(envs)))
    if len(envs) != (runs := len(learned.weights)):
        raise ValueError(f"envs must be {runs}, one for each run of learned, got {len(envs)}")
    agent = settings.agent(q, state["sources"], episodes.obs_dim, rng)
    agent.restore(state)
    more = _learn(agent, episodes, iterations, name, callback, progress, q, settings)
    return evolve(
        more,
        iterations=torch.cat([learned.iterations, more.iterations + int(learned.steps.max())]),
        returns=torch.cat([learned.returns, more.returns], 1),
        steps=learned.steps + more.steps,
    )


def _learn(
    agent: Agent,
    episodes: GymEpisodes,
    iterations: int,
    name: str,
    callback: Callback | None,
    progress: bool,
    q: QFunction,
    settings: Any,
) -> Learned:
    runs, times, returns = len(agent.mu), [], []
    names, done = [f"run {r} of {name}" for r in range(runs)], 0
    steps, interrupted = islice(iterate(agent, episodes), iterations), False
    try:
        for t in tqdm(steps, total=iterations, unit=" steps", disable=not progress):
            done = t
            if isinstance(agent, Trusting) and iterations - t == iterations // TRIAL:
                agent.judge()
            if t % EVERY == 0:
                check_finite(agent.mu, names, t)
                times.append(t)
                returns.append(episodes.returns.mean(before=torch.nan))
                weights = agent.mu.detach().cpu().clone()
                goes_on = None if callback is None else callback(t, returns[-1], weights)
                if goes_on is not None and not goes_on:  # NumPy's and torch's False end it, too
                    break
    except KeyboardInterrupt:
        interrupted = True
    check_finite(agent.mu, names, done)
    weights, improved, state = agent.mu.detach().cpu(), torch.ones(runs, dtype=torch.bool), None
    if isinstance(agent, Trusting):
        agent.finish(episodes.fresh)
        weights, improved, state = agent.kept, agent.improved, agent.state()
    return Learned(
        weights=weights.clone(),
        iterations=torch.tensor(times, dtype=torch.int64),
        returns=torch.stack(returns, 1) if returns else torch.empty(runs, 0),
        steps=torch.full((runs,), done),
        improved=improved,
        state=state,
        q=q,
        settings=settings,
        first_action=episodes.first_action,
        interrupted=interrupted,
    )
