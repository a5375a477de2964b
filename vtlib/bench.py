"""Speed on one core: milliseconds per run and iteration, beside what the processor could do."""

from __future__ import annotations

import cProfile
import pstats
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from vtlib.domains import domain
from vtlib.experiments import CAR, CARTPOLE, MAZE_TARGETS, ROOMS_EVALUATION, Experiment
from vtlib.experiments.experiment import Algorithm
from vtlib.experiments.runs import Batch, prepare
from vtlib.experiments.work import pool_weights
from vtlib.store import results_folder
from vtlib.transfer import Settings

RUNS = 20
# milliseconds of the 2018 code, one core
PUBLISHED = (
    (ROOMS_EVALUATION, {"NT": 0.71, "GVT": 17.0, "1-MGVT": 17.5, "3-MGVT": 80.0}),
    (CARTPOLE, {"DDQN": 0.74, "GVT": 5.5, "1-MGVT": 8.0, "3-MGVT": 19.0}),
    (CAR, {"DDQN": 0.9, "GVT": 17.0, "1-MGVT": 17.0, "3-MGVT": 73.0}),
    (
        MAZE_TARGETS["north-east"],
        {"DDQN": 1.2, "GVT": 180.0, "1-MGVT": 233.0, "3-MGVT": 1187.0},  # GVT: up to 500
    ),
)
# functions, by their files, whose time is that of a part of an iteration
PARTS = {
    "factor": ("factor", ("look_ahead", "product", "step")),
    "network": ("transfer", ("td_gradients",)),
    "noise": ("streams", ("normal",)),
}
PASS = 2  # operations per weight and state: a product and a sum


def sgemm_rate(size: int = 1500, repeats: int = 5) -> float:
    """Floating-point operations per second of a float32 matrix product on this core."""
    a = torch.ones(size, size)
    return 2 * size**3 / _best(lambda: a @ a, repeats)


def bound(experiment: Experiment, algorithm: Algorithm, rate: float) -> float:
    """Milliseconds that an iteration's floating-point operations take at that rate, at the least.

    A gradient needs a pass forward and one back, at states and at next states (DDQN: two forward
    passes at the latter); the factors L need 2 d^2 (n + 1/2) operations each, with n samples.
    """
    d = domain(experiment.family).q().d
    if isinstance(algorithm, Settings):
        each: float = 4 * PASS * d * algorithm.batch * algorithm.weights
        each += 2 * d**2 * (algorithm.weights + 0.5)
        return 1e3 * algorithm.components * each / rate
    return 1e3 * 4 * PASS * d * algorithm.batch / rate


def ready(experiment: Experiment, label: str) -> Batch:
    """Runs of an algorithm of an experiment, ready to advance; KeyError when it has none such."""
    pool = pool_weights(experiment.pool, results_folder())
    return prepare(experiment, label, experiment.algorithms[label], range(RUNS), pool)


def milliseconds(batch: Batch, iterations: int = 50, repeats: int = 5) -> float:
    """Milliseconds per run and iteration."""
    _advance(batch, iterations)
    return 1e3 * _best(lambda: _advance(batch, iterations), repeats) / iterations / RUNS


def shares(batch: Batch, iterations: int = 50) -> dict[str, float]:
    """The share of each part in the time of an iteration, by the profiler."""
    profile = cProfile.Profile()
    profile.runcall(_advance, batch, iterations)
    stats: Any = pstats.Stats(profile)  # Any: its types leave out what it counted
    found = dict.fromkeys(PARTS, 0.0)
    for (file, _, function), (_, _, _, seconds, _) in stats.stats.items():
        for part, (stem, functions) in PARTS.items():
            if Path(file).stem.startswith(stem) and function in functions:
                found[part] += seconds
    return {part: seconds / stats.total_tt for part, seconds in found.items()}


def _advance(batch: Batch, iterations: int) -> None:
    for _ in range(iterations):
        batch.advance()


def _best(work: Callable[[], object], repeats: int) -> float:
    """Least seconds of several repeats: what the machine can do when nobody disturbs it."""
    seconds = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - began)
    return min(seconds)


def main() -> int:
    """Print the table."""
    rate = sgemm_rate()
    print(f"one core, float32 matrix product: {rate / 1e9:.0f} GFLOP/s; batch of {RUNS} runs")
    for experiment, published in PUBLISHED:
        title = f"{experiment.name} (d = {domain(experiment.family).q().d})"
        parts = "".join(f"{part:>9}" for part in PARTS)
        print(f"{title:28}{'ms':>8}{'bound':>8}{'ratio':>8}{'2018 code':>12}{parts}")
        for label, old in published.items():
            algorithm, batch = experiment.algorithms[label], ready(experiment, label)
            measured, least = milliseconds(batch), bound(experiment, algorithm, rate)
            row = f"{measured:8.3f}{least:8.3f}{measured / least:8.1f}{old:12.2f}"
            if isinstance(algorithm, Settings):
                row += "".join(f"{share:9.0%}" for share in shares(batch).values())
            print(f"{label:28}{row}", flush=True)
    return 0
