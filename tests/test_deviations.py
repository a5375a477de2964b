"""The deviations: each switch does what it says and nothing else, and the page's numbers add up."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict

import pytest
import torch
from torch import Tensor

from vtlib.envs.episodes import Episodes
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments import ROOMS_CORNER, ROOMS_DEVIATIONS, ROOMS_EVALUATION
from vtlib.experiments.deviations import (
    CORNER_SOURCES,
    DeviatingSettings,
    DeviatingTransfer,
    DiagonalPullFactors,
    unmasked_cotangent,
)
from vtlib.experiments.rooms import GVT, MGVT, THREE_ROOMS
from vtlib.experiments.runs import chosen_sources, prepare, targets
from vtlib.factor import CholeskyFactors
from vtlib.gaussian import Precision, low_rank_precision
from vtlib.mellow import mellowmax, td_cotangent
from vtlib.qfunctions import RBFLinear
from vtlib.replay import Transition
from vtlib.sources import SourceTraining, draw_tasks
from vtlib.streams import Stream
from vtlib.transfer import CLIP, Settings, VariationalTransfer, initial_posterior, td_gradients

BASES = RBFLinear(torch.arange(0.0, 10.1, 2.5), 2.0, 4)
RUNS = [0, 1, 2]


def draw(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def agent(settings: Settings, sources: Tensor | None = None) -> VariationalTransfer:
    """An agent for three runs, of the class that belongs to its settings."""
    kind = DeviatingTransfer if isinstance(settings, DeviatingSettings) else VariationalTransfer
    given = draw(3, 4, BASES.d) if sources is None else sources
    noise, component, replay = (Stream("test", RUNS, x) for x in ("noise", "component", "replay"))
    return kind(BASES, given, 2, settings, noise, component, replay)


def changed(base: Settings, **changes: object) -> DeviatingSettings:
    return DeviatingSettings(**{**asdict(base), **changes})


def course(learner: VariationalTransfer, iterations: int = 50) -> tuple[Tensor, ...]:
    """Means, factors and what was seen, after some iterations in the rooms."""
    tasks = draw_tasks(RoomsFamily(rooms=2), "test", RUNS)
    episodes = Episodes(tasks, Stream("test", RUNS, "steps"), Stream("test", RUNS, "starts"))
    seen = []
    for _ in range(iterations):
        learner.learn(episodes.step(learner.act(episodes.obs, episodes.fresh)))
        seen.append(episodes.obs)
    return learner.mu.detach().clone(), learner.L.clone(), torch.stack(seen)


BASE = {
    "GVT": GVT,
    "1-MGVT": MGVT,
    "3-MGVT": Settings(components=3),
    "diagonal": Settings(covariance="diagonal"),
}


@pytest.mark.parametrize("name", BASE)
def test_with_every_switch_off_nothing_differs_bit_for_bit(name: str) -> None:
    ours, switched = course(agent(BASE[name])), course(agent(changed(BASE[name])))
    for a, b in zip(ours, switched, strict=True):
        assert torch.equal(a, b)


@pytest.mark.parametrize(
    ("base", "change"),
    [
        (GVT, {"kl": "diagonal"}),
        (MGVT, {"responsibilities": "equal"}),
        (GVT, {"jitter": 1e-2}),
        (GVT, {"clip": 1e-6}),
        (MGVT, {"time_limit": 3}),
    ],
)
def test_each_switch_changes_something(base: Settings, change: dict[str, object]) -> None:
    ours, switched = course(agent(base)), course(agent(changed(base, **change)))
    assert not torch.equal(ours[1], switched[1]) or not torch.equal(ours[0], switched[0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kl": "none"}, "kl must be one of"),
        ({"psi_at_end": "x"}, "psi_at_end must be one of"),
        ({"responsibilities": "x"}, "responsibilities must be one of"),
        ({"jitter": 0.0}, "jitter must be finite and positive"),
        ({"clip": math.inf}, "clip must be None, or finite"),
        ({"time_limit": -1}, "time_limit must be a whole number"),
        ({"kl": "diagonal", "covariance": "diagonal"}, "no entries off the diagonal"),
        ({"psi": 2.0}, "psi must lie"),
    ],
)
def test_settings_outside_their_range_are_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        changed(MGVT, **change)


# --- the divergence of the diagonal -------------------------------------------------------------


def precisions() -> dict[str, Precision]:
    return {
        "isotropic": Precision(100.0),
        "low rank": low_rank_precision(0.3 * draw(2, 6, 3, seed=1), 0.01),
    }


def stepped(
    kind: type[CholeskyFactors], precision: Precision, clip: float, gradients: Tensor
) -> tuple[Tensor, Tensor]:
    """L before and after one step."""
    L = 0.1 * draw(2, 6, 6, seed=2).tril()
    L.diagonal(dim1=1, dim2=2).abs_().add_(0.05)
    factors = kind(L.clone(), precision, 0.01, 1e-4, clip)
    factors.step(gradients, draw(2, 3, 6, seed=4), 0.3)
    return L, factors.L


@pytest.mark.parametrize("name", precisions())
@pytest.mark.parametrize("clip", [1e9, 0.5], ids=["free", "clipped"])
def test_off_the_diagonal_only_the_td_error_is_felt(name: str, clip: float) -> None:
    """The gradient is that of the KL with the diagonal of L alone, by autograd."""
    precision, gradients = precisions()[name], draw(2, 3, 6, seed=3)
    L, after = stepped(DiagonalPullFactors, precision, clip, gradients)
    sigma = L.diagonal(dim1=1, dim2=2).double().clone().requires_grad_()
    P = precision.times(torch.eye(6).expand(2, 6, 6)).double()
    trace = (P.diagonal(dim1=1, dim2=2) * sigma.square()).sum()
    (on_diagonal,) = torch.autograd.grad(0.5 * trace - sigma.log().sum(), sigma)
    whole = torch.einsum("mni,mnj->mij", gradients, draw(2, 3, 6, seed=4))
    whole = whole + 0.3 * torch.diag_embed(on_diagonal.float())
    expected = L - 0.01 * whole.clamp(-clip, clip).tril()
    expected.diagonal(dim1=1, dim2=2).clamp_(min=1e-4)
    torch.testing.assert_close(after, expected, rtol=1e-4, atol=1e-5)
    if clip > 1:
        L, still = stepped(DiagonalPullFactors, precision, clip, torch.zeros(2, 3, 6))
        off = ~torch.eye(6, dtype=torch.bool).expand(2, 6, 6)
        assert torch.equal(still[off], L[off])
        L, moved = stepped(CholeskyFactors, precision, clip, torch.zeros(2, 3, 6))
        below = torch.ones(6, 6).tril(-1).bool().expand(2, 6, 6)
        assert (moved[below] != L[below]).all()


# --- terminal states in the psi part ------------------------------------------------------------


def values(seed: int) -> Tensor:
    return draw(2, 3, 4, 5, seed=seed)


def transitions() -> tuple[Tensor, Tensor, Tensor]:
    g = torch.Generator().manual_seed(1)
    action = torch.randint(4, (2, 1, 5), generator=g)
    return action, draw(2, 1, 5, seed=5), torch.rand(2, 1, 5, generator=g) < 0.5


@pytest.mark.parametrize("psi", [0.0, 0.5, 1.0])
def test_the_unmasked_psi_part_follows_its_formula(psi: float) -> None:
    q, q_next, (action, reward, terminal) = values(1), values(2), transitions()
    at_state, at_next = unmasked_cotangent(q, q_next, action, reward, terminal, psi, 0.9, 20.0)
    alive = 0.9 * ~terminal
    index = action.expand(2, 3, 5).unsqueeze(-2)
    chosen = q.gather(-2, index).squeeze(-2)
    error = reward + alive * mellowmax(q_next, 20.0, -2) - chosen
    share = torch.softmax(20.0 * q_next, -2)
    torch.testing.assert_close(at_next, (2 / 5 * psi * 0.9 * error).unsqueeze(-2) * share)
    masked = td_cotangent(q, q_next, action, reward, terminal, psi, 0.9, 20.0)
    assert torch.equal(at_state, masked[0])
    living = (~terminal).expand(2, 3, 5).unsqueeze(-2).expand_as(at_next)
    assert torch.equal(at_next[living], masked[1][living])
    assert (masked[1][~living] == 0).all()


def test_the_agent_differs_by_that_part_alone() -> None:
    learner = agent(changed(MGVT, psi_at_end="unmasked"))
    batch = Transition(
        5 + draw(3, 6, 2, seed=1),
        torch.zeros(3, 6, dtype=torch.int64),
        draw(3, 6, seed=2),
        5 + draw(3, 6, 2, seed=3),
        torch.ones(3, 6, dtype=torch.bool),
    )
    w = draw(3, 2, BASES.d, seed=4)
    extra = learner._td_gradients(w, batch) - agent(MGVT)._td_gradients(w, batch)

    def loss_past_the_end(w: Tensor) -> Tensor:
        """The psi part at terminal states, with the errors held at their values."""
        following = BASES.q(w, BASES.prepare(batch.next_obs))
        chosen = BASES.q(w, BASES.prepare(batch.obs))[:, :, 0]
        error = (batch.reward.unsqueeze(1) - chosen).detach()
        return 2 * MGVT.psi * MGVT.gamma * (error * mellowmax(following, MGVT.kappa, -2)).mean(-1)

    leaf = w.clone().requires_grad_()
    (expected,) = torch.autograd.grad(loss_past_the_end(leaf).sum(), leaf)
    torch.testing.assert_close(extra, expected, rtol=1e-3, atol=1e-5)
    assert expected.abs().max() > 0.01
    alive = batch._replace(terminal=torch.zeros(3, 6, dtype=torch.bool))
    torch.testing.assert_close(
        learner._td_gradients(w, alive), td_gradients(BASES, w, alive, 0.5, 0.99, 100.0)
    )


# --- clipping, responsibilities, jitter, time limit ---------------------------------------------


def huge() -> Transition:
    """A transition whose gradient is far beyond the bound."""
    obs = torch.full((3, 2), 5.0)
    action, terminal = torch.zeros(3, dtype=torch.int64), torch.ones(3, dtype=torch.bool)
    return Transition(obs, action, torch.full((3,), 1e6), obs, terminal)


def test_without_clipping_a_gradient_beyond_the_bound_passes() -> None:
    largest: dict[str, float] = {}
    for name, settings in (("clipped", MGVT), ("free", changed(MGVT, clip=None))):
        learner = agent(settings)
        before = learner.L.clone()
        learner.learn(huge())
        assert learner.mu.grad is not None
        largest[name] = float(learner.mu.grad.abs().max())
        reach = float((learner.L - before).abs().max()) / settings.alpha_L
        assert (reach > 2 * CLIP) == (name == "free")
    assert largest["clipped"] == CLIP
    assert largest["free"] > 10 * CLIP


def test_equal_responsibilities_pull_towards_the_mean_of_the_sources() -> None:
    learner = agent(changed(BASE["3-MGVT"], responsibilities="equal"))
    sources = draw(3, 4, BASES.d)
    expected = (learner.mu - sources.mean(1, keepdim=True)) / (3 * MGVT.sigma_p2)
    torch.testing.assert_close(learner._kl_gradient(), expected)
    # where all sources are equally far the exact responsibilities are equal, too
    twins = torch.stack([torch.eye(BASES.d)[:4]] * 3)
    settings = changed(MGVT, init="mean", responsibilities="equal")
    pull = agent(settings, twins)._kl_gradient()
    exact = agent(Settings(init="mean"), twins)._kl_gradient()
    torch.testing.assert_close(pull, exact, rtol=0, atol=1e-2)


@pytest.mark.parametrize("jitter", [1e-6, 1e-2])
def test_the_jitter_is_the_least_variance_of_prior_and_posterior(jitter: float) -> None:
    sources = draw(3, 4, BASES.d).double().float()
    posterior, precision = initial_posterior(sources, GVT, jitter)
    covariance = posterior.L[:, 0].double() @ posterior.L[:, 0].double().mT
    least = torch.linalg.eigvalsh(covariance)[:, 0]
    torch.testing.assert_close(least, torch.full_like(least, jitter), rtol=0.05, atol=1e-7)
    assert precision.scale == pytest.approx(1 / jitter)
    started = agent(changed(GVT, jitter=jitter), sources)
    torch.testing.assert_close(started.L, posterior.L)


def test_an_episode_that_runs_out_of_time_ends_in_a_terminal_state() -> None:
    learner = agent(changed(MGVT, time_limit=2))
    seen: list[list[bool]] = []
    add: Callable[[Transition], None] = learner._buffer.add
    learner._buffer.add = lambda t: (seen.append(t.terminal.tolist()), add(t))[1]
    plain = huge()._replace(reward=torch.zeros(3), terminal=torch.zeros(3, dtype=torch.bool))
    # the second run's episode ends by itself after one step, the third's lasts throughout
    for fresh in ([True] * 3, [False, True, False], [True, False, True]):
        learner.act(plain.obs, torch.tensor(fresh))
        learner.learn(plain)
    assert seen == [[False] * 3, [True, False, True], [False, True, False]]


# --- the runs -----------------------------------------------------------------------------------


@pytest.mark.parametrize("experiment", [ROOMS_DEVIATIONS, ROOMS_CORNER], ids=lambda e: e.name)
def test_runs_have_a_twin_in_the_rooms_evaluation(experiment) -> None:
    runs = range(experiment.runs)
    assert experiment.runs == ROOMS_EVALUATION.runs
    assert torch.equal(targets(experiment, runs).doors, targets(ROOMS_EVALUATION, runs).doors)
    assert (chosen_sources(experiment, runs) == chosen_sources(ROOMS_EVALUATION, runs)).all()
    assert experiment.every == ROOMS_EVALUATION.every
    for label, algorithm in experiment.algorithms.items():
        base = GVT if label.startswith("GVT") else MGVT
        differing = {k for k, v in asdict(base).items() if asdict(algorithm)[k] != v}
        assert differing <= {"init", "sigma_min", "act"}


def test_an_experiment_gets_the_agent_of_its_settings() -> None:
    pool = draw(50, 484).numpy()
    for label, algorithm in ROOMS_DEVIATIONS.algorithms.items():
        batch = prepare(ROOMS_DEVIATIONS, label, algorithm, [0], pool)
        deviates = isinstance(algorithm, DeviatingSettings)
        assert type(batch.agent) is (DeviatingTransfer if deviates else VariationalTransfer)


def test_corner_sources_are_those_of_the_pool_but_for_their_starts() -> None:
    corner, square = (SourceTraining(pool, [0, 1]) for pool in (CORNER_SOURCES, THREE_ROOMS))
    assert torch.equal(corner.tasks.doors, square.tasks.doors)
    assert (corner.episodes.obs == 0).all()
    assert (square.episodes.obs > 0).all()
    assert CORNER_SOURCES.limit == THREE_ROOMS.iterations
