"""Judge transfer as it comes on four kinds of tasks that the library does not know.

``python book/_ext/guide_runs.py`` computes what is missing under book/results/guide and stores it,
one file for each task: it can be interrupted, and goes on where it was.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
from attrs import frozen

from vtlib.baselines import DDQNSettings, FineTuning, MellowTDSettings
from vtlib.experiments import store
from vtlib.gym_runs import evaluate, solve, transfer
from vtlib.qfunctions import MLP

RUNS, SEED = 20, 1  # fixed before any of the runs was looked at
FOLDER = Path(__file__).resolve().parents[1] / "results" / "guide"


def cartpole(length: float) -> gym.Env:
    """Gymnasium's cartpole with half a pole of some length, 100 steps."""
    env = gym.make("CartPole-v1", max_episode_steps=100)
    env.unwrapped.length = length
    return env


def acrobot(length: float) -> gym.Env:
    """Gymnasium's Acrobot whose upper link has some length, 200 steps."""
    env = gym.make("Acrobot-v1", max_episode_steps=200)
    env.unwrapped.LINK_LENGTH_1 = length
    env.unwrapped.LINK_COM_POS_1 = length / 2
    return env


class WindyGrid(gym.Env):
    """From the left of 8 x 8 cells to a goal on the right; each step costs 1.

    In the four columns between, the wind blows the walker one cell up with a probability: down,
    where that is negative.
    """

    MOVES = np.array([[0, 1], [1, 0], [0, -1], [-1, 0]])

    def __init__(self, wind: float) -> None:
        self.wind = wind
        self.observation_space = gym.spaces.Box(-1, 1, (2,), np.float32)
        self.action_space = gym.spaces.Discrete(4)

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple:
        """Begin in the left column, in any row."""
        super().reset(seed=seed)
        self._cell = np.array([0, self.np_random.integers(8)])
        return self._seen(), {}

    def step(self, action: int) -> tuple:
        """Walk, and be blown."""
        cell = self._cell + self.MOVES[action]
        if 2 <= self._cell[0] <= 5 and self.np_random.random() < abs(self.wind):
            cell[1] += np.sign(self.wind)
        self._cell = cell.clip(0, 7)
        return self._seen(), -1.0, bool((self._cell == (7, 3)).all()), False, {}

    def _seen(self) -> np.ndarray:
        return (self._cell / 3.5 - 1).astype(np.float32)


def windy(wind: float) -> gym.Env:
    """The windy grid, 50 steps."""
    return gym.wrappers.TimeLimit(WindyGrid(wind), 50)


def lander(gravity: float) -> gym.Env:
    """Gymnasium's LunarLander under some gravity, 400 steps; only this needs the package box2d."""
    return gym.make("LunarLander-v3", gravity=gravity, max_episode_steps=400)


@frozen
class Kind:
    """Tasks of one kind: those that are solved, those that are learned next, and how long."""

    make: Callable[[float], gym.Env]
    q: MLP
    sources: tuple[float, ...]
    solving: int
    within: float
    outside: float
    learning: int
    solver: DDQNSettings | None = None  # mellow TD without


LANDING = DDQNSettings(
    epsilon_steps=25_000, minibatch=64, buffer=50_000, target_every=500, alpha=5e-4
)
KINDS = {
    "cartpole": Kind(cartpole, MLP((4, 32, 2)), (0.3, 0.4, 0.6, 0.7), 4000, 0.5, 0.08, 1000),
    "acrobot": Kind(acrobot, MLP((6, 32, 3)), (0.8, 0.9, 1.0, 1.1, 1.2), 10_000, 1.05, 1.5, 1000),
    "windy-grid": Kind(windy, MLP((2, 32, 4)), (0.0, 0.2, 0.4, 0.6, 0.8), 10_000, 0.5, -0.5, 1000),
    "lunar-lander": Kind(
        lander, MLP((8, 64, 4)), (-6.0, -8.0, -9.0, -11.0), 100_000, -10.0, -2.0, 1000, LANDING
    ),
}
TUNING = MellowTDSettings(epsilon_steps=1, epsilon_start=0.02, minibatch=200)


def solved(name: str, folder: Path, seed: int) -> torch.Tensor:
    """Weights (S, d) of the sources of a kind, stored after they were learned."""
    kind, path = KINDS[name], folder / f"{name}-sources"
    if not store.exists(path):
        began = time.perf_counter()
        half = MellowTDSettings(epsilon_steps=kind.solving // 2, minibatch=100)
        envs = [kind.make(x) for x in kind.sources]
        weights = solve(envs, kind.q, kind.solving, kind.solver or half, seed=seed).weights[:, 0]
        own = evaluate(envs, kind.q, weights.unsqueeze(1), seed=seed).mean(1)
        arrays = {"weights": weights.numpy(), "own": own.numpy()}
        store.save(path, arrays, provenance(began, seed))
    return torch.from_numpy(store.read(path)[0]["weights"])


def judge(name: str, parameter: float, folder: Path, seed: int) -> store.Arrays:
    """Returns (R,) of greedy play on fresh episodes, of each source and each way to learn."""
    kind, sources = KINDS[name], solved(name, folder, seed)
    envs = [kind.make(parameter) for _ in range(RUNS)]

    def earned(weights: torch.Tensor) -> np.ndarray:
        return evaluate(envs, kind.q, weights, seed=seed).mean(1).numpy()

    alone = np.stack([earned(w.expand(RUNS, 1, -1)) for w in sources])
    best = int(alone.mean(1).argmax())
    tuning = transfer(
        envs, kind.q, sources[[best]], kind.learning, FineTuning(TUNING), trials=0, seed=seed
    )
    ours = transfer(envs, kind.q, sources, kind.learning, seed=seed)
    nothing = solve(envs, kind.q, kind.learning, seed=seed)
    return {
        "sources": alone,
        "from nothing": earned(nothing.weights),
        "best source": alone[best],
        "fine-tuned": earned(tuning.weights),
        "transfer": earned(ours.weights),
        "improved": ours.improved.numpy(),
        "steps": ours.steps.numpy(),
    }


def provenance(began: float, seed: int) -> store.Note:
    """What is noted beside a result."""
    return {"seed": seed, "seconds": time.perf_counter() - began, **store.machine()}


def main() -> None:
    """Compute and store what is missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=FOLDER)
    parser.add_argument("--seed", type=int, default=SEED)
    options = parser.parse_args()
    torch.set_num_threads(1)
    store.check_writable(options.folder)
    for name, kind in KINDS.items():
        for place in ("within", "outside"):
            path = options.folder / f"{name}-{place}"
            if store.exists(path):
                continue
            began = time.perf_counter()
            arrays = judge(name, getattr(kind, place), options.folder, options.seed)
            store.save(path, arrays, provenance(began, options.seed))
            print(f"{path.name}: {time.perf_counter() - began:.0f} s", flush=True)


if __name__ == "__main__":
    main()
