"""What others can put in without touching the library, each as a script outside the package."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import vtlib

ROOT = Path(vtlib.__file__).parents[1]

# An experiment in an environment of one's own: its tasks, its record, and two configurations.
ENVIRONMENT = '''
from pathlib import Path

import torch
from attrs import frozen

from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.envs.base import TaskBatch, TaskFamily
from vtbook.experiments import EXPERIMENTS
from vtlib.experiments import load, returns
from vtlib.experiments.heads import live_check
from vtlib.experiments.whole import verify
from vtlib.experiments.experiment import Experiment, Pool
from vtlib.experiments.schedule import complete
from vtlib.qfunctions import MLP
from vtlib.transfer import Settings


@frozen(eq=False)
class Corridors(TaskBatch):
    """From the middle of a corridor to an end of each task's own, left or right."""

    goal: torch.Tensor  # (R,) float32, -1 or 1

    parameters = ("goal",)
    n_actions, obs_dim, state_dim, noise_dim, start_dim, horizon, gamma = 2, 1, 1, 1, 1, 20, 0.9

    def start(self, u):
        return 0.2 * u - 0.1

    def step(self, state, action, noise):
        self._check_step(state, action, noise)
        moved = state + 0.25 * (2 * action.unsqueeze(1) - 1) + 0.01 * noise
        arrived = (moved * self.goal.unsqueeze(1) >= 1).squeeze(1)
        return moved.clamp(-1, 1), arrived.float(), arrived


@frozen
class CorridorFamily(TaskFamily):
    right: float = 0.5  # how often the goal is on the right

    parameters = ("goal",)
    limits = (0.0, 1.0)

    def q(self):
        return MLP((1, 8, 2))

    def optimum(self, tasks):
        return torch.full((len(tasks),), Corridors.gamma**3)

    def sample(self, rng, count):
        draws = torch.from_numpy(rng.random(count)).float()
        return Corridors(torch.where(draws < self.right, 1.0, -1.0))


LEARNER = MellowTDSettings(epsilon_steps=100, gamma=0.9, minibatch=10)
POOL = Pool(
    "corridors",
    CorridorFamily(right=0.9),
    count=4,
    iterations=300,
    limit=600,
    check_every=100,
    episodes=5,
    settings=LEARNER,
)
MINE = Experiment(
    "mine",
    POOL,
    CorridorFamily(right=0.9),
    {
        "GVT": Settings("gaussian", lambda_=1e-3, gamma=0.9, alpha_L=1e-3, n_samples=3),
        "NT": DDQNSettings(epsilon_steps=100, gamma=0.9),
    },
    runs=4,
    sources=3,
    iterations=300,
    every=100,
)

if __name__ == "__main__":
    root = Path("results")
    complete([MINE], root, jobs=2, quiet=True)
    assert "mine" not in EXPERIMENTS
    found = returns(MINE, "GVT", root)
    assert found.learning.dims == ("run", "iteration") and found.learning.shape == (4, 3)
    assert (found.greedy <= 1).all()
    assert load(POOL, "sources", root).goal.dims == ("source",)
    for owner, label, found in verify(MINE, root=root):
        assert not found.wrong and not found.parted, f"{owner.name}/{label}"
    print(live_check(MINE, "NT", 1, root))
'''

# A posterior of another form in one file, and the one line that makes it known.
LOW_RANK = '''
import torch

from vtlib.posteriors import COVARIANCES

RANK = 2


class LowRank:
    """w = mu + sigma z + F y, with y of few dimensions: covariance diag(sigma^2) + F F^T.

    The divergence's gradients are P sigma - diag(C) sigma and P F - C F, with C the inverse of
    the covariance by Woodbury's identity, which needs nothing of d x d.
    """

    def __init__(self, start, precision, descent, noise, n_samples):
        self.mu, self._noise, self._n = start.mu, noise, n_samples
        W = precision.W
        # the columns are those of a run, which all its components share
        self._precision = precision if W is None else precision._replace(W=W.unsqueeze(1))
        self._descent = descent
        self._sigma = torch.full_like(self.mu, start.variance**0.5)
        columns = torch.arange(1, RANK + 1) * start.variance**0.5
        self._F = 0.1 * columns * torch.ones(*self.mu.shape, RANK)

    def sample(self):
        runs, components, d = self.mu.shape
        draws = self._noise.normal(components * self._n * (d + RANK))
        draws = draws.view(runs, components, self._n, d + RANK)
        self._z, self._y = draws[..., :d], draws[..., d:]
        spread = self._sigma.unsqueeze(2) * self._z + self._y @ self._F.mT
        return self.mu.unsqueeze(2) + spread

    def step(self, gradients, kl_weight):
        used, (alpha, sigma_min, *_) = gradients.shape[2], self._descent
        scaled = self._F / self._sigma.square().unsqueeze(-1)
        small = torch.linalg.inv(torch.eye(RANK) + self._F.mT @ scaled)
        pulled = scaled @ small  # C F
        inverse = self._sigma.square().reciprocal() - (pulled * scaled).sum(-1)
        own = self._precision.diagonal(self.mu.shape[-1]) - inverse
        across = self._precision.times(self._F) - pulled
        by_sigma = (gradients * self._z[:, :, -used:]).sum(2) + kl_weight * own * self._sigma
        by_F = gradients.mT @ self._y[:, :, -used:] + kl_weight * across
        self._sigma = (self._sigma - alpha * by_sigma).clamp(min=sigma_min)
        self._F = self._F - alpha * by_F

    @property
    def scale_tril(self):
        covariance = torch.diag_embed(self._sigma.square()) + self._F @ self._F.mT
        return torch.linalg.cholesky(covariance)


COVARIANCES["low-rank"] = LowRank
'''

# Another optimiser for L in one file: Adam in place of plain gradient descent.
ADAM = """
import torch

from vtlib.posteriors import COVARIANCES
from vtlib.posteriors.dense import Dense


class Adam(Dense):
    def _start(self, start):
        super()._start(start)
        self._adam = torch.optim.Adam([self._L], lr=self._alpha)

    def _descend(self, gradients, z, kl_weight):
        diagonal = self._L.diagonal(dim1=-2, dim2=-1)
        gradient = gradients.mT @ z + kl_weight * self._precision.times(self._L)
        gradient.diagonal(dim1=-2, dim2=-1).sub_(kl_weight / diagonal)
        self._L.grad = gradient.tril()
        self._adam.step()
        diagonal.clamp_(min=self._sigma_min)


COVARIANCES["adam"] = Adam
"""

# Runs of the thesis' cartpoles with both, from sources that come with the book.
TRAIN = """
from pathlib import Path

from attrs import evolve

import adam
import low_rank
from vtlib.experiments import returns, store
from vtbook.experiments.cartpole import CARTPOLE, CARTPOLES, GVT, MGVT
from vtlib.experiments.whole import check_runs
from vtlib.experiments.schedule import complete

MINE = evolve(
    CARTPOLE.published,
    name="mine",
    algorithms={
        f"{label}-{name}": evolve(base, covariance=name)
        for name in ("low-rank", "adam")
        for label, base in (
            ("GVT", GVT),
            ("2-MGVT", evolve(MGVT, components=2)),
        )
    },
    runs=2,
    iterations=200,
)

if __name__ == "__main__":
    root = Path("results")
    store.save(store.path_of(CARTPOLES, "sources", root), *store.stored(CARTPOLES, "sources"))
    complete([MINE], root, jobs=1, quiet=True)
    for label in MINE.algorithms:
        found = returns(MINE, label, root)
        assert label.endswith(found.attrs["config"]["algorithm"]["covariance"])
        print(label, float(found.learning.isel(iteration=-1).mean()))
    for label in MINE.algorithms:
        assert check_runs(MINE, label, range(2), root).alike == [0, 1], label
"""


def run(folder: Path, script: str, **modules: str) -> str:
    """What a script prints that stands with some modules in a folder; stderr must stay empty."""
    for name, text in {**modules, "script": script}.items():
        (folder / f"{name}.py").write_text(text)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-W", "error", "script.py"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    left = {p.name for p in folder.iterdir()} - {f"{x}.py" for x in modules}
    assert left <= {"script.py", "results"}
    return done.stdout


def test_an_experiment_in_an_environment_of_ones_own_runs_stores_and_verifies(tmp_path):
    said = run(tmp_path, ENVIRONMENT)
    assert said == "Run 1 of NT, computed anew just now, has the stored fingerprints.\n"


def test_a_posterior_and_an_optimiser_of_ones_own_train(tmp_path):
    said = run(tmp_path, TRAIN, low_rank=LOW_RANK, adam=ADAM)
    means = dict(line.split() for line in said.splitlines())
    assert means.keys() == {f"{x}-{y}" for x in ("GVT", "2-MGVT") for y in ("low-rank", "adam")}
    # far more than the 20 of chance
    assert all(float(value) > 30 for value in means.values()), means
