"""Speed on one core: milliseconds per run and iteration, beside what the processor could do."""

from __future__ import annotations

import time
from collections.abc import Callable

import torch

from vtlib.baselines import MellowTDSettings
from vtlib.domains import rooms_q
from vtlib.experiments import ROOMS_EVALUATION
from vtlib.experiments.runs import prepare
from vtlib.experiments.work import pool_weights
from vtlib.store import results_folder

RUNS = 20
PUBLISHED = {"NT": 0.71, "GVT": 17.0, "1-MGVT": 17.5, "3-MGVT": 80.0}  # the 2018 code, one core


def sgemm_rate(size: int = 1500, repeats: int = 5) -> float:
    """Floating-point operations per second of a float32 matrix product on this core."""
    a = torch.ones(size, size)
    return 2 * size**3 / _best(lambda: a @ a, repeats)


def bound(algorithm, rate: float) -> float | None:
    """Milliseconds that 2 d^2 (n + 1/2) operations per component take at that rate."""
    if isinstance(algorithm, MellowTDSettings):
        return None
    operations = 2 * rooms_q().d ** 2 * (algorithm.weights + 0.5) * algorithm.components
    return 1e3 * operations / rate


def milliseconds(label: str, iterations: int = 100, repeats: int = 5) -> float:
    """Milliseconds per run and iteration of an algorithm of the rooms evaluation."""
    pool = pool_weights(ROOMS_EVALUATION.pool, results_folder())
    batch = prepare(ROOMS_EVALUATION, label, ROOMS_EVALUATION.algorithms[label], range(RUNS), pool)

    def advance() -> None:
        for _ in range(iterations):
            action = batch.agent.act(batch.episodes.obs, batch.episodes.fresh)
            batch.agent.learn(batch.episodes.step(action))

    advance()
    return 1e3 * _best(advance, repeats) / iterations / RUNS


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
    print(f"{'rooms (d = 484)':18}{'ms':>8}{'bound':>8}{'ratio':>8}{'2018 code':>12}")
    for label, published in PUBLISHED.items():
        measured = milliseconds(label)
        least = bound(ROOMS_EVALUATION.algorithms[label], rate)
        shown = f"{'-':>8}{'-':>8}" if least is None else f"{least:8.3f}{measured / least:8.1f}"
        print(f"{label:18}{measured:8.3f}{shown}{published:12.2f}", flush=True)
    return 0
