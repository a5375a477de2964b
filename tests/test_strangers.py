"""What others can put in without touching the library, each as a script outside the package."""

import os
import subprocess
import sys
from pathlib import Path

import vtlib

ROOT = Path(vtlib.__file__).parents[1]

# An experiment in an environment of one's own: its tasks, its record, and two configurations.
CORRIDORS = '''
import torch
from attrs import frozen

from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.envs.base import TaskBatch, TaskFamily
from vtlib.experiments.experiment import Experiment, Pool
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
    right: float = 0.9  # how often the goal is on the right

    parameters = ("goal",)
    limits = (0.0, 1.0)

    def q(self):
        return MLP((1, 8, 2))

    def optimum(self, tasks):
        return torch.full((len(tasks),), Corridors.gamma**3)

    def sample(self, rng, count):
        draws = torch.from_numpy(rng.random(count)).float()
        return Corridors(torch.where(draws < self.right, 1.0, -1.0))


FAMILY, LEARNER = CorridorFamily(), MellowTDSettings(epsilon_steps=100, gamma=0.9, minibatch=10)
LENGTH = {"iterations": 200, "limit": 400, "check_every": 100, "episodes": 5}
POOL = Pool("corridors", FAMILY, count=3, settings=LEARNER, **LENGTH)
ALGORITHMS = {
    "GVT": Settings("gaussian", lambda_=1e-3, gamma=0.9, alpha_L=1e-3, n_samples=3),
    "NT": DDQNSettings(epsilon_steps=100, gamma=0.9),
}
MINE = Experiment("mine", POOL, FAMILY, ALGORITHMS, runs=2, sources=2, iterations=200, every=100)
EXPERIMENTS = {"mine": MINE}
'''

READ = """
from pathlib import Path

from corridors import MINE, POOL
from vtlib.experiments import live_check, load, returns
from vtlib.experiments.whole import verify

if __name__ == "__main__":
    root = Path("results")
    found = returns(MINE, "GVT", root)
    assert found.learning.dims == ("run", "iteration") and found.learning.shape == (2, 2)
    assert (found.greedy <= 1).all()
    assert load(POOL, "sources", root).goal.dims == ("source",)
    for owner, label, found in verify(MINE, root=root):
        assert not found.wrong and not found.parted, f"{owner.name}/{label}"
    print(live_check(MINE, "NT", 1, root))
"""

# A posterior of another form, moved by Adam, in one file, and the one line that makes it known.
ISOTROPIC = '''
import torch

from vtlib.posteriors import COVARIANCES


class Isotropic:
    """w = mu + sigma z, with one sigma for each component."""

    def __init__(self, start, precision, descent, noise, n_samples):
        self.mu, self._noise, self._n = start.mu, noise, n_samples
        self._precision, self._sigma_min = precision, descent.sigma_min
        self._sigma = torch.full((*self.mu.shape[:2], 1, 1), start.variance**0.5)
        self._adam = torch.optim.Adam([self._sigma], lr=descent.alpha)

    def sample(self):
        runs, components, d = self.mu.shape
        draws = self._noise.normal(components * self._n * d)
        self._z = draws.view(runs, components, self._n, d)
        return self.mu.unsqueeze(2) + self._sigma * self._z

    def step(self, gradients, kl_weight):
        used, d = gradients.shape[2:]
        trace = self._precision.diagonal(d).sum(-1).view(-1, 1, 1, 1)
        slope = (gradients * self._z[:, :, -used:]).sum((2, 3), keepdim=True)
        self._sigma.grad = slope + kl_weight * (trace * self._sigma - d / self._sigma)
        self._adam.step()
        self._sigma.clamp_(min=self._sigma_min)

    @property
    def scale_tril(self):
        return torch.diag_embed(self._sigma.squeeze(3).expand_as(self.mu))


COVARIANCES["isotropic"] = Isotropic
'''

# Runs of the thesis' cartpoles with it, from sources that come with the book.
TRAIN = """
from pathlib import Path

from attrs import evolve

import isotropic
from vtbook.experiments.cartpole import CARTPOLE, CARTPOLES, GVT, MGVT
from vtlib.experiments import returns, store
from vtlib.experiments.schedule import complete
from vtlib.experiments.whole import check_runs

BASES = {"GVT": GVT, "2-MGVT": evolve(MGVT, components=2)}
ALGORITHMS = {label: evolve(base, covariance="isotropic") for label, base in BASES.items()}
MINE = evolve(CARTPOLE.published, name="mine", algorithms=ALGORITHMS, runs=2, iterations=200)

if __name__ == "__main__":
    root = Path("results")
    store.save(store.path_of(CARTPOLES, "sources", root), *store.stored(CARTPOLES, "sources"))
    complete([MINE], root, jobs=1, quiet=True)
    for label in ALGORITHMS:
        found = returns(MINE, label, root)
        assert found.attrs["config"]["algorithm"]["covariance"] == "isotropic"
        assert check_runs(MINE, label, range(2), root).alike == [0, 1], label
        print(label, float(found.learning.isel(iteration=-1).mean()))
"""

# Whatever of the library can be imported without running it.
IMPORTS = """
import importlib
import pkgutil
import sys

import vtlib

for module in pkgutil.walk_packages(vtlib.__path__, "vtlib."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
print(*(name for name in sys.modules if name.startswith("vtbook")))
"""


def python(folder: Path, *arguments: str, **modules: str) -> subprocess.CompletedProcess[str]:
    """What Python says in a folder with some modules, where nothing but results may be left."""
    for name, text in modules.items():
        (folder / f"{name}.py").write_text(text)
    path = os.pathsep.join([str(ROOT), str(folder)])
    done = subprocess.run(
        [sys.executable, "-W", "error", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    assert {p.name for p in folder.iterdir() if p.suffix not in (".py", ".dist-info")} <= {
        "results"
    }
    return done


def test_an_experiment_of_ones_own_that_a_package_offers_is_run_by_its_name(tmp_path):
    offered = tmp_path / "corridors-1.0.dist-info"
    offered.mkdir()
    (offered / "METADATA").write_text("Metadata-Version: 2.1\nName: corridors\nVersion: 1.0\n")
    (offered / "entry_points.txt").write_text("[vtlib.experiments]\nours = corridors:EXPERIMENTS\n")
    usage = python(tmp_path, "-m", "vtlib", "verify", "--help", corridors=CORRIDORS).stdout
    assert {"ours", "mine"} <= set(usage.replace(",", " ").split())
    command = "-m vtlib run mine --jobs 2 --results results"
    assert python(tmp_path, *command.split()).stdout == "mine is complete under results\n"
    done = python(tmp_path, "script.py", script=READ)
    said = "Run 1 of NT, computed anew just now, has the stored fingerprints.\n"
    assert (done.stdout, done.stderr) == (said, "")


def test_an_experiment_without_a_name_trains_with_a_posterior_of_ones_own(tmp_path):
    done = python(tmp_path, "script.py", script=TRAIN, isotropic=ISOTROPIC)
    means = dict(line.split() for line in done.stdout.splitlines())
    assert (means.keys(), done.stderr) == ({"GVT", "2-MGVT"}, "")
    # far more than the 20 of chance
    assert all(float(value) > 30 for value in means.values()), means


def test_the_library_imports_nothing_of_the_book(tmp_path):
    assert python(tmp_path, "script.py", script=IMPORTS).stdout == "\n"
