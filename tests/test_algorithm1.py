"""The engine, many runs in float32 and closed form, against the algorithm line by line."""

import pytest
import torch

from vtlab.bases import RBFLinear
from vtlab.envs import CartpoleFamily, MazeFamily, MountainCarFamily, RoomsFamily
from vtlab.episodes import Episodes
from vtlib.algorithm1 import algorithm1
from vtlib.qfunctions import MLP
from vtlib.rng import Rng
from vtlib.training import iterate
from vtlib.transfer import Settings

# A family, a Q-function and the sources' size. But for the first, whose L only then is updated in
# blocks, Q-functions are smaller than in the experiments: the algorithm's time grows with d^3.
ROOMS = RoomsFamily(), RBFLinear(torch.arange(11.0), 1 / 9, 4), 0.3
COARSE = RoomsFamily(), RBFLinear(torch.arange(0.0, 11.0, 2.0), 1 / 9, 4), 0.3
CARTPOLE = CartpoleFamily(), MLP((4, 16, 2)), 1.0
FAR = CartpoleFamily(), MLP((4, 16, 2)), 4.0  # from all values: gradients are bounded by the clip
CAR = MountainCarFamily(), MLP((2, 16, 3)), 1.0
MAZE = MazeFamily(), MLP((22, 4, 4, 3)), 0.3
CART = {"lambda_": 1e-3, "minibatch": 500, "n_samples": 5, "alpha_L": 1e-4}
DENSE = Settings(components=3, psi=0.0, covariance="dense", **CART)
FASTER = {**CART, "alpha_L": 1e-3}


def assert_close(ours, exact, most, unit):
    """No entry differs by more than `most` units, and half of them by 2e-5 at most."""
    apart = (ours.double() - exact).abs().flatten() / unit
    assert apart.max() < most
    # above the diagonal none does
    assert not apart.any() or apart[apart > 0].median() < 2e-5


@pytest.mark.parametrize(
    ("case", "settings"),
    [
        pytest.param(COARSE, Settings("gaussian", lambda_=1e-4), id="rooms GVT"),
        pytest.param(ROOMS, Settings(components=3), id="rooms 3-MGVT"),
        pytest.param(FAR, Settings("gaussian", psi=0.0, **CART), id="cartpole GVT, psi 0, clipped"),
        pytest.param(CARTPOLE, DENSE, id="cartpole 3-MGVT, psi 0"),
        pytest.param(FAR, Settings(components=3, psi=1.0, **CART), id="the same, psi 1, clipped"),
        pytest.param(CAR, Settings("gaussian", psi=1.0, **FASTER), id="mountain car GVT, psi 1"),
        pytest.param(MAZE, Settings(components=3, alpha_L=1e-3), id="maze 3-MGVT"),
    ],
)
def test_the_engine_is_algorithm_1(case, settings):
    (family, q, scale), runs, others = case, Rng("oracle", [0]), Rng("oracle", [0])
    sources = scale * runs.stream("sources").normal(5 * q.d).view(5, q.d)
    tasks = family.draw_tasks("oracle", [0])
    ours, theirs = (Episodes(tasks, runs.stream("noise"), runs.stream("start")) for _ in range(2))
    agent = settings.agent(q, sources[None], tasks.obs_dim, runs)
    start, clipped = agent.scale_tril[0].clone(), False
    # the engine chooses a component before it begins; the algorithm's first is its second
    component = runs.stream("component")
    component.uniform(1)
    others.stream = lambda role: component if role == "component" else runs.stream(role)
    exact, loop = algorithm1(q, sources, settings, theirs, others), iterate(agent, ours)
    for t in range(max(200, tasks.horizon + 20)):
        next(loop)
        mu, L = next(exact)
        clipped = clipped or bool(agent.mu.grad.abs().max() == settings.clip)
        assert torch.equal(ours.obs, theirs.obs), t
        if t < 2 or t % 20 == 19:
            # Adam's step has the gradient's sign. Where rounding decides about that, a mean
            # differs by some steps alpha_mu of 1e-3, and by its samples L, too.
            assert_close(agent.mu[0], mu, most=5e-3, unit=1.0)
            assert_close(agent.scale_tril[0], L, most=1e-2, unit=L.abs().max().item())
    assert clipped == (case is FAR)
    assert (agent.scale_tril[0] - start).abs().max() > 0.05 * start.abs().max()
