"""Judge transfer as it comes on five kinds of tasks that the library does not know.

``python -m vtlab guide`` computes what is missing under book/results/guide and stores it, one file
for each task: it can be interrupted, and goes on where it was. ``python -m vtlab verify guide``
computes everything again, stores nothing, and says what differs.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from attrs import frozen
from gymnasium.envs.toy_text.frozen_lake import generate_random_map

from vtlab import store
from vtlab.permutation import same_distribution_p
from vtlab.stats import difference_interval
from vtlib import Learned, evaluate, solve, transfer
from vtlib.baselines import DDQNSettings, FineTuning, MellowTDSettings
from vtlib.qfunctions import MLP
from vtlib.rng import generator

RUNS, SEED, SOLVED = 10, 8, 1  # fixed before any of the runs was looked at
WAYS = ("from nothing", "best source", "fine-tuned", "transfer")
UNLEARNED = ("sources", "best source", "weights", "own")
LEVEL = 1e-3  # below which a p value tells two distributions apart
LOSS = -0.02  # of the way from the worst to the best, that transfer may lose
NAME = "guide"  # of their folder among the results


def cartpole(length: float) -> gym.Env:
    """Gymnasium's cartpole with half a pole of some length, 100 steps."""
    env = gym.make("CartPole-v1", max_episode_steps=100)
    pole: Any = env.unwrapped
    pole.length, pole.polemass_length = length, pole.masspole * length
    return env


def acrobot(length: float) -> gym.Env:
    """Gymnasium's Acrobot whose upper link has some length, 200 steps."""
    env = gym.make("Acrobot-v1", max_episode_steps=200)
    links: Any = env.unwrapped
    links.LINK_LENGTH_1, links.LINK_COM_POS_1 = length, length / 2
    return env


def lake(place: tuple[int, bool]) -> gym.Env:
    """Gymnasium's frozen lake of 6 x 6 cells, by the seed of its map and whether it is slippery."""
    seed, slippery = place
    env = gym.make(
        "FrozenLake-v1", desc=generate_random_map(6, seed=seed), is_slippery=slippery,
        max_episode_steps=50,
    )  # fmt: skip
    return gym.wrappers.FlattenObservation(env)


class KeyAndDoor(gym.Env[np.ndarray, np.int64]):
    """A room of 6 x 6 cells: fetch a key, then leave by a door, which pays 1."""

    MOVES = np.array([[0, 1], [1, 0], [0, -1], [-1, 0]])

    def __init__(self, key: tuple[int, int], door: tuple[int, int]) -> None:
        self.key, self.door = key, door
        self.observation_space = gym.spaces.Box(-1, 1, (3,), np.float32)
        self.action_space = gym.spaces.Discrete(4)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Begin anywhere, without the key."""
        super().reset(seed=seed)
        self._cell, self._has = self.np_random.integers(6, size=2), False
        return self._seen(), {}

    def step(self, action: np.int64) -> Any:
        """Walk; a wall stops the walker."""
        self._cell = (self._cell + self.MOVES[action]).clip(0, 5)
        self._has |= tuple(self._cell) == self.key
        out = self._has and tuple(self._cell) == self.door
        return self._seen(), float(out), out, False, {}

    def _seen(self) -> np.ndarray:
        return np.append(self._cell / 2.5 - 1, 2.0 * self._has - 1).astype(np.float32)


def room(place: tuple[tuple[int, int], tuple[int, int]]) -> gym.Env:
    """The room with its key and its door in some cells, 50 steps."""
    return gym.wrappers.TimeLimit(KeyAndDoor(*place), 50)


def lander(gravity: float) -> gym.Env:
    """Gymnasium's LunarLander under some gravity, 400 steps; only this needs the package box2d."""
    return gym.make("LunarLander-v3", gravity=gravity, max_episode_steps=400)


@frozen
class Kind:
    """Tasks of one kind: those that are solved, those that are learned next, and how long."""

    make: Callable[[Any], gym.Env]
    q: MLP
    sources: tuple[Any, ...]
    solving: int
    within: Any
    outside: Any
    learning: int = 1000
    solver: DDQNSettings | None = None  # mellow TD without


LANDING = DDQNSettings(
    epsilon_steps=25_000, minibatch=64, buffer=50_000, target_every=500, alpha=5e-4
)
DOOR = (5, 3)
KEYS = tuple(((x, y), DOOR) for x, y in ((0, 0), (0, 5), (2, 1), (2, 4)))
KINDS = {
    "cartpole": Kind(cartpole, MLP((4, 32, 2)), (0.3, 0.4, 0.6, 0.7), 4000, 0.5, 0.08),
    "acrobot": Kind(acrobot, MLP((6, 32, 3)), (0.8, 0.9, 1.0, 1.1, 1.2), 10_000, 1.05, 1.5),
    "frozen-lake": Kind(
        lake, MLP((36, 32, 4)), tuple((k, False) for k in range(5)), 20_000, (5, False), (5, True)
    ),
    "key-and-door": Kind(
        room, MLP((3, 64, 4)), KEYS, 40_000, ((1, 3), DOOR), ((1, 3), (3, 0)), 3000
    ),
    "lunar-lander": Kind(
        lander, MLP((8, 64, 4)), (-6.0, -8.0, -9.0, -11.0), 100_000, -10.0, -2.0, solver=LANDING
    ),
}
TUNING = MellowTDSettings(epsilon_steps=1, epsilon_start=0.02, minibatch=200)
TASKS = [f"{name}-{place}" for name in KINDS for place in ("sources", "within", "outside")]


def solved(name: str, stored: store.Arrays | None) -> store.Arrays:
    """Weights (S, d) of the sources of a kind, or those stored, and what they earn at home (S,)."""
    kind = KINDS[name]
    envs = [kind.make(x) for x in kind.sources]
    if stored is None:
        half = MellowTDSettings(epsilon_steps=kind.solving // 2, minibatch=100)
        weights = whole(solve(envs, kind.q, kind.solving, kind.solver or half, seed=SOLVED)).weights
    else:
        weights = torch.from_numpy(stored["weights"]).unsqueeze(1)
    own = evaluate(envs, kind.q, weights, seed=SOLVED).mean(1)
    return {"weights": weights[:, 0].numpy(), "own": own.numpy()}


def whole(learned: Learned) -> Learned:
    """What was learned to the end; Ctrl-C, which ended the learning alone, now ends the command."""
    if learned.interrupted:
        raise KeyboardInterrupt
    return learned


def judge(name: str, parameter: Any, sources: torch.Tensor, runs: int) -> store.Arrays:
    """Returns (R,) of greedy play on fresh episodes, of each source and each way to learn."""
    kind = KINDS[name]
    envs = [kind.make(parameter) for _ in range(runs)]

    def earned(weights: torch.Tensor) -> np.ndarray:
        return evaluate(envs, kind.q, weights, seed=SEED).mean(1).numpy()

    alone = np.stack([earned(w.expand(runs, 1, -1)) for w in sources])
    best = int(alone.mean(1).argmax())
    ours = whole(transfer(envs, kind.q, sources, kind.learning, seed=SEED))
    tuned = transfer(envs, kind.q, sources[[best]], kind.learning, FineTuning(TUNING), seed=SEED)
    tuning = whole(tuned)
    nothing = whole(solve(envs, kind.q, kind.learning, seed=SEED))
    return {
        "sources": alone,
        "from nothing": earned(nothing.weights),
        "best source": alone[best],
        "fine-tuned": earned(tuning.weights),
        "transfer": earned(ours.weights),
        "improved": ours.improved.numpy(),
        "steps": ours.steps.numpy(),
    }


def computed(task: str, folder: Path, runs: int = RUNS, again: bool = True) -> store.Arrays:
    """The arrays of a task, of its first runs; its sources are solved again, or those stored."""
    name, place = task.rsplit("-", 1)
    path = folder / f"{name}-sources"
    if place == "sources":
        return solved(name, None if again else store.read(path)[0])
    sources = torch.from_numpy(store.read(path)[0]["weights"])
    return judge(name, getattr(KINDS[name], place), sources, runs)


def differing(task: str, folder: Path, runs: int = RUNS) -> list[str]:
    """Which stored arrays of a task are not those of its first runs, computed again.

    On another processor rounding sends learning elsewhere. There sources are not solved again, what
    is played without learning may differ in one of twenty numbers, and what was learned has to have
    the distribution of what is stored.
    """
    stored, note = store.read(folder / task)
    same = note.get("processor") == store.machine()["processor"]
    again = computed(task, folder, runs, again=same)
    return sorted(stored.keys() ^ again.keys()) + [
        key
        for key in sorted(stored.keys() & again.keys())
        # all that is stored, or of so many runs alone
        if not alike(key, stored[key][..., : None if runs == RUNS else runs], again[key], same)
    ]


def alike(key: str, stored: np.ndarray, again: np.ndarray, same: bool) -> bool:
    """Whether an array is the stored one, as far as rounding lets it be."""
    if stored.shape != again.shape or stored.dtype != again.dtype or not np.isfinite(stored).all():
        return False
    rounding = 1e-3 * (stored.dtype.kind == "f")
    close = np.isclose(stored, again, rounding, rounding)
    if same or key in UNLEARNED:
        return bool(close.mean() >= (1 if same else 0.95))
    rng = generator(f"guide {key}", 0, "comparison")
    return same_distribution_p(stored.astype(float), again.astype(float), rng) > LEVEL


def scale(returns: store.Arrays) -> float:
    """How far the best and the worst way are apart, by their means."""
    return float(np.ptp([returns[way].mean() for way in WAYS]))


def verdict(returns: store.Arrays, way: str) -> str:
    """Whether transfer loses no more than LOSS beside another way: holds, fails or undecided.

    Where all ways earn the same, which may be nothing, none can lose, and nothing is decided.
    """
    over = difference_interval(returns["transfer"], returns[way])
    least = LOSS * scale(returns)
    if over.low >= least and least < 0:
        return "holds"
    return "fails" if over.high < least else "undecided"


def main() -> int:
    """Compute and store what is missing."""
    complete(TASKS, store.results_folder() / NAME)
    return 0


def complete(tasks: list[str], folder: Path) -> None:
    """Compute and store what is missing of some tasks."""
    store.check_writable(folder)
    for task in tasks:
        if store.exists(folder / task):
            continue
        began = time.perf_counter()
        arrays, seconds = computed(task, folder), time.perf_counter() - began
        store.save(folder / task, arrays, {"seed": SEED, "seconds": seconds, **store.machine()})
        print(f"{task}: {seconds:.0f} s", flush=True)


def verify(root: Path, rng: np.random.Generator | None = None) -> int:
    """Say of all tasks, or of one that rng draws, what is stored otherwise; how many are."""
    folder, wrong = root / NAME, 0
    for task in TASKS if rng is None else [str(rng.choice(TASKS))]:
        arrays = differing(task, folder)
        verdict = f"DIFFERS in {', '.join(arrays)}" if arrays else "verified"
        print(f"{NAME}/{task}: {verdict}", flush=True)
        wrong += bool(arrays)
    return wrong
