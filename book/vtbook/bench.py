"""Speed on one core: milliseconds per run and iteration, beside what the processor could do."""

import time
from collections.abc import Callable
from itertools import islice

import numpy as np
import torch

from vtlab.experiment import Experiment, Pool
from vtlab.registry import named
from vtlab.run import prepare, prepare_natively
from vtlib.rng import generator
from vtlib.training import iterate
from vtlib.transfer import Settings

RUNS = 20  # of the engine, which advance together
# milliseconds of the 2018 code, one core, in the book's experiments
PUBLISHED: dict[str, dict[str, float]] = {
    "rooms-evaluation": {"NT": 0.71, "GVT": 17.0, "1-MGVT": 17.5, "3-MGVT": 80.0},
    "cartpole": {"DDQN": 0.74, "GVT": 5.5, "1-MGVT": 8.0, "3-MGVT": 19.0},
    "mountain-car": {"DDQN": 0.9, "GVT": 17.0, "1-MGVT": 17.0, "3-MGVT": 73.0},
    "maze-8": {"DDQN": 1.2, "GVT": 180.0, "1-MGVT": 233.0, "3-MGVT": 1187.0},  # GVT: up to 500
}
PASS = 2  # operations per weight and state: a product and a sum


def sgemm_rate(size: int = 1500, repeats: int = 5) -> float:
    """Floating-point operations per second of a float32 matrix product on this core."""
    a = torch.ones(size, size)
    return 2 * size**3 / _best(lambda: a @ a, repeats)


def bound(experiment: Experiment, label: str, rate: float) -> float:
    """Milliseconds that an iteration's floating-point operations take at that rate, at the least.

    A gradient needs a pass forward and one back, at states and at next states (DDQN: two forward
    passes at the latter); the factors L need 2 d^2 (n + 1/2) operations each, with n samples.
    """
    d, algorithm = experiment.family.q().d, experiment.algorithms[label]
    if isinstance(algorithm, Settings):
        each: float = 4 * PASS * d * algorithm.minibatch * algorithm.n_samples
        each += 2 * d**2 * (algorithm.n_samples + 0.5)
        return 1e3 * algorithm.components * each / rate
    return 1e3 * 4 * PASS * d * getattr(algorithm, "minibatch", 0) / rate


def sources(pool: Pool) -> np.ndarray:
    """Random weights (count, d), which take as long as solved ones."""
    rng = generator("bench", 0, "sources")
    return 0.1 * rng.standard_normal((pool.count, pool.family.q().d), np.float32)


def engine(experiment: Experiment, label: str, iterations: int = 20) -> float:
    """Milliseconds per run and iteration of the engine, many runs at once."""
    batch = prepare(experiment, label, range(RUNS), sources(experiment.pool))
    loop = iterate(batch.agent, batch.episodes)
    return _milliseconds(lambda n: list(islice(loop, n)), iterations) / RUNS


def kernel(experiment: Experiment, label: str, iterations: int = 200) -> float | None:
    """The same of the kernels, one run at a time; None where they do not know the environment."""
    runs = prepare_natively(experiment, label, [0], sources(experiment.pool))
    return None if runs is None else _milliseconds(runs[0].advance, iterations)


def _milliseconds(work: Callable[[int], object], iterations: int, repeats: int = 5) -> float:
    work(iterations)
    return 1e3 * _best(lambda: work(iterations), repeats) / iterations


def _best(work: Callable[[], object], repeats: int) -> float:
    """Least seconds of several repeats: what the machine can do when nobody disturbs it."""
    seconds = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - began)
    return min(seconds)


def main() -> int:
    """Print the table: what is used first, its ratio to the bound, and the others beside it."""
    rate = sgemm_rate()
    print(f"one core, float32 matrix product: {rate / 1e9:.0f} GFLOP/s; ms per run and iteration")
    head = ("used", "bound", "ratio", "kernel", "engine", "2018 code")
    for name, published in PUBLISHED.items():
        (experiment,) = named(name)
        title = f"{experiment.name} (d = {experiment.family.q().d})"
        print(f"{title:28}" + "".join(f"{name:>10}" for name in head))
        for label, old in published.items():
            alone, together = kernel(experiment, label), engine(experiment, label)
            used, least = alone or together, bound(experiment, label, rate)
            row = (used, least, used / least, alone or float("nan"), together, old)
            print(f"{label:28}" + "".join(f"{x:10.3f}" for x in row), flush=True)
    return 0
