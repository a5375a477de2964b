"""Coverage: how often the truth lies inside central intervals, and what no weights represent."""

import torch
from torch import Tensor

from vtlab.bases import RBFLinear
from vtlab.envs.planning import GridPlan, try_out
from vtlib.qfunctions import QFunction
from vtlib.td import mellowmax

LEVELS = (0.5, 0.9, 0.95)


def posterior_samples(mu: Tensor, scale_tril: Tensor, noise: Tensor) -> Tensor:
    """Weights (R, C K, d) of mixtures with means mu (R, C, d) and factors scale_tril (R, C, d, d).

    noise: standard normal (R, C, K, d), K draws for each component.
    """
    return (mu.unsqueeze(2) + noise @ scale_tril.mT).flatten(1, 2)


def values_at(q: QFunction, weights: Tensor, obs: Tensor, action: Tensor) -> Tensor:
    """Values (R, K, B) of weights (R, K, d) at states (R, B, obs_dim) and actions (R, B)."""
    values = q.q(weights, q.prepare(obs))
    index = action[:, None, None].expand(-1, values.shape[1], 1, -1)
    return values.gather(2, index).squeeze(2)


def inside(values: Tensor, truth: Tensor) -> Tensor:
    """Share (..., R, levels) of true values (..., R, B) in the central intervals of (R, K, B).

    The shares of a calibrated posterior are the ``LEVELS``.
    """
    shares = []
    for level in LEVELS:
        ends = torch.tensor([(1 - level) / 2, (1 + level) / 2])
        low, high = values.quantile(ends, dim=1)
        shares.append(((truth >= low) & (truth <= high)).float().mean(-1))
    return torch.stack(shares, -1)


def nearest_weights(q: RBFLinear, obs: Tensor, values: Tensor) -> Tensor:
    """Weights (d,) nearest to values (B, A) at states (B, 2), by least squares over all pairs."""
    features = q.prepare(obs.unsqueeze(0))[0].T.double()
    solution: Tensor = torch.linalg.lstsq(features, values.double()).solution
    return solution.T.flatten()


def projected_weights(
    q: RBFLinear, plan: GridPlan, obs: Tensor, kappa: float, start: Tensor
) -> Tensor:
    """Weights (d,) that mellow backups at states (B, 2) leave alone, once projected on the bases.

    Newton's method finds them from start (d,); ArithmeticError when 30 steps do not.
    """
    bases = q.d // q.n_actions
    reached, reward, terminated = try_out(plan.copies, obs, plan.noise)
    after = q.prepare(reached.unsqueeze(0))[0].T * ~terminated.unsqueeze(1)
    shape = len(obs), q.n_actions, len(plan.noise)
    project = torch.linalg.pinv(q.prepare(obs.unsqueeze(0))[0].T.double())
    reward, after = reward.view(shape).mean(2).double(), after.view(*shape, bases)
    w: Tensor = start.view(q.n_actions, bases)
    for _ in range(30):
        values = after @ w.T.float()  # zero where the episode has ended, like their mellowmax
        pull = torch.einsum("bank,banm->bakm", torch.softmax(kappa * values, -1), after)
        slope = plan.copies.gamma * pull.flatten(2).double() / shape[2]
        backup = plan.copies.gamma * mellowmax(values, kappa).mean(2).double()
        constant = project @ (reward + backup - slope @ w.flatten())
        linear = torch.einsum("mb,bad->amd", project, slope).reshape(q.d, q.d)
        eye = torch.eye(q.d, dtype=torch.float64)
        before, w = w, torch.linalg.solve(eye - linear, constant.T.flatten()).view_as(w)
        if float((w - before).abs().max()) < 1e-5:
            return w.flatten()
    raise ArithmeticError("the projected mellow operator has no fixed point near the start")
