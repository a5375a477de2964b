"""What others can put in without touching the library, as modules outside the package."""

import importlib
import os
import subprocess
import sys
from pathlib import Path

import vtlib
from vtlib.experiments import load, returns
from vtlib.experiments.whole import verify
from vtlib.posteriors import COVARIANCES

ROOT = Path(vtlib.__file__).parents[1]

# An experiment in an environment of one's own with a posterior of one's own: the tasks, their
# record, and the one line that makes the posterior known.
CORRIDORS = '''
import torch
from attrs import frozen

from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.envs.base import TaskBatch, TaskFamily
from vtlib.experiments.experiment import Experiment, Pool
from vtlib.posteriors import COVARIANCES
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
        moved = state + 0.25 * (2 * action.unsqueeze(1) - 1) + 0.01 * noise
        arrived = (moved * self.goal.unsqueeze(1) >= 1).squeeze(1)
        return moved.clamp(-1, 1), arrived.float(), arrived


@frozen
class CorridorFamily(TaskFamily):
    parameters = ("goal",)
    limits = (0.0, 1.0)

    def q(self):
        return MLP((1, 8, 2))

    def optimum(self, tasks):
        return torch.full((len(tasks),), Corridors.gamma**3)

    def sample(self, rng, count):
        return Corridors(torch.where(torch.from_numpy(rng.random(count)) < 0.9, 1.0, -1.0))


class Isotropic:
    """w = mu + sigma z, with the one sigma that it began with."""

    def __init__(self, start, precision, descent, noise, n_samples):
        self.mu, self._sigma, self._noise = start.mu, start.variance**0.5, noise
        self._shape = torch.Size([*self.mu.shape[:2], n_samples, self.mu.shape[2]])

    def sample(self):
        draws = self._noise.normal(self._shape[1:].numel()).view(self._shape)
        return self.mu.unsqueeze(2) + self._sigma * draws

    def step(self, gradients, kl_weight):
        assert gradients.shape[2] < self._shape[2]

    @property
    def scale_tril(self):
        return torch.diag_embed(torch.full_like(self.mu, self._sigma))


COVARIANCES["isotropic"] = Isotropic
LEARNER = MellowTDSettings(epsilon_steps=100, gamma=0.9, minibatch=10)
LENGTH = {"iterations": 200, "limit": 400, "check_every": 100, "episodes": 5}
POOL = Pool("corridors", CorridorFamily(), count=3, settings=LEARNER, **LENGTH)
ALGORITHMS = {
    "GVT": Settings("gaussian", covariance="isotropic", lambda_=1e-3, gamma=0.9, n_samples=3),
    "NT": DDQNSettings(epsilon_steps=100, gamma=0.9),
}
SIZE = {"runs": 2, "sources": 2, "iterations": 200, "every": 100}
EXPERIMENTS = {"mine": Experiment("mine", POOL, POOL.family, ALGORITHMS, **SIZE)}
'''


def test_an_experiment_with_a_posterior_of_ones_own_is_run_by_its_name(tmp_path, monkeypatch):
    (tmp_path / "corridors.py").write_text(CORRIDORS)
    offered = tmp_path / "corridors-1.0.dist-info"
    offered.mkdir()
    (offered / "METADATA").write_text("Metadata-Version: 2.1\nName: corridors\nVersion: 1.0\n")
    (offered / "entry_points.txt").write_text("[vtlib.experiments]\nours = corridors:EXPERIMENTS\n")
    before, root = {*tmp_path.iterdir()}, tmp_path / "results"
    path = os.pathsep.join([str(ROOT), str(tmp_path)])
    command = "-W error -m vtlib run ours --jobs 1 --results results"
    done = subprocess.run(
        [sys.executable, *command.split()],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert (done.returncode, done.stdout) == (0, "ours is complete under results\n"), done.stderr
    assert {*tmp_path.iterdir()} == {*before, root}
    # the same from Python, as long as the test runs
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(COVARIANCES, "isotropic", None)
    mine = importlib.import_module("corridors").EXPERIMENTS["mine"]
    found = returns(mine, "GVT", root)
    assert found.attrs["config"]["algorithm"]["covariance"] == "isotropic"
    assert found.learning.dims == ("run", "iteration")
    assert (found.learning[:, -1] > 0.8 * found.optimum).all()
    assert load(mine.pool, "sources", root).goal.dims == ("source",)
    for owner, label, whole in verify(mine, root=root):
        assert (whole.wrong, whole.parted) == ({}, {}), f"{owner.name}/{label}"


def test_the_library_knows_nothing_of_the_book():
    assert not [p for p in (ROOT / "vtlib").rglob("*.py") if "vtbook" in p.read_text("utf-8")]
