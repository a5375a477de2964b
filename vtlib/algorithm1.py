"""Algorithm 1 of the thesis, line by line: one run, dense L, gradients by autograd.

Read this first. ``vtlib.transfer`` is the same algorithm for many runs at once, with the gradients
in closed form and an update of L that costs O(n d^2); the tests hold it to this file.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from vtlib.episodes import GymEpisodes
from vtlib.priors import Gaussian, kl, kl_bound, pairwise_kl, responsibilities
from vtlib.qfunctions import QFunction
from vtlib.replay import ReplayBuffer
from vtlib.rng import Rng
from vtlib.td import td_error

if TYPE_CHECKING:  # the tests hold the engine to this file
    from vtlib.transfer import Settings


def algorithm1(
    q: QFunction, sources: Tensor, s: Settings, episodes: GymEpisodes, rng: Rng
) -> Iterator[Gaussian]:
    """Learn the task of some episodes from sources (S, d); yields mu (C, d) and L (C, d, d).

    GVT or C-MGVT by the equations, in float64: of the settings' options ``family``, the others are
    those of the thesis.
    """
    C, n, d, eye = s.components, s.n_samples, q.d, torch.eye(q.d, dtype=torch.float64)
    sources = sources.double()
    streams = (rng.stream(role) for role in ("posterior", "component", "replay"))
    noise, component, replay = streams
    # lines 1 and 2: the prior p(w), and the posterior that minimises KL(q || p)
    if s.family == "gaussian":
        mu_p = sources.mean(0)  # eq. 5.5
        Sigma_p = (sources - mu_p).T @ (sources - mu_p) / len(sources)  # eq. 5.6
        p = Gaussian(mu_p, torch.linalg.cholesky(Sigma_p + s.jitter * eye))
        mu, L = p.mu[None].clone(), p.scale_tril[None].clone()
    else:
        mu = sources[torch.arange(C) % len(sources)].clone()
        L = s.sigma_p2**0.5 * eye.repeat(C, 1, 1)
    optimiser = torch.optim.Adam([mu.requires_grad_()], lr=s.alpha_mu)
    L.requires_grad_()
    D = ReplayBuffer(1, s.buffer, episodes.obs.shape[1])  # line 3
    for N in itertools.count(1):  # lines 4 to 6
        # line 7: weights w = L v + mu (eq. 5.10), one of each component to act with and n to learn
        v = noise.normal(C * (n + 1) * d).double().view(C, n + 1, d)
        w = mu.unsqueeze(1) + v @ L.mT
        i = int(component.uniform(1) * C) if C > 1 else 0
        # lines 8 to 10: act greedily for one of them, observe, remember
        values = q.q(w[None, i, :1], q.prepare(episodes.obs.double().unsqueeze(1)))
        D.add(episodes.step(values[:, 0, :, 0].argmax(-1)))
        # line 11: a minibatch
        batch = D.sample(replay.uniform(s.minibatch))
        # line 12: eq. 5.2, where psi weighs the gradient through the next state (eq. 5.4)
        w = w[:, 1:].reshape(1, C * n, d)
        now, after = (q.q(w, q.prepare(x.double())) for x in (batch.obs, batch.next_obs))
        after = s.psi * after + (1 - s.psi) * after.detach()
        a, r, end = (x.unsqueeze(1) for x in (batch.action, batch.reward, batch.terminated))
        error = td_error(now, after, a, r, end, s.gamma, s.kappa)
        if s.family == "gaussian":
            divergence = kl(Gaussian(mu, L), p).sum()  # eq. 5.7
        else:
            pairs = pairwise_kl(Gaussian(mu, L), sources, s.sigma_p2)
            tables = responsibilities(pairs.detach())  # eqs. 5.14 and 5.15
            divergence = kl_bound(pairs, *tables)  # eq. 5.13
        loss = error.square().mean() + s.lambda_ / N * divergence
        mu.grad, dL = (x.clamp(-1000, 1000) for x in torch.autograd.grad(loss, [mu, L]))
        # line 13: Adam for the means, plain descent for L, whose diagonal stays positive
        optimiser.step()
        with torch.no_grad():
            L.sub_(s.alpha_L * dL.tril())
            L.diagonal(dim1=1, dim2=2).clamp_(min=s.sigma_min)
        yield Gaussian(mu.detach(), L.detach())
