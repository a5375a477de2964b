"""Whole runs in C++, one at a time: the same as the engine's, up to rounding.

A run's factors stay in the processor's cache, where the engine walks those of many runs through
memory. ``train_natively`` stands for ``vtlab.training.train`` where ``supports`` says so. Random
numbers are those of the engine's streams.
"""

import ctypes
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise, repeat
from typing import Any

import numpy as np
import torch
from torch import Tensor

from vtlab.envs.base import TaskBatch, TaskFamily
from vtlab.native.build import RUNS
from vtlab.training import FINGERPRINTS, recorded
from vtlib.baselines import FineTuning, MellowTDSettings
from vtlib.native import kernels
from vtlib.posteriors.dense import start_factors
from vtlib.rng import generator
from vtlib.training import check_finite
from vtlib.transfer import Settings

LEARNER, GAUSSIAN, MIXTURE, FIXED = range(4)
LANES, MOST_COMPONENTS, MOST_SOURCES, MOST_BATCH, WINDOW = 16, 3, 10, 512, 50
MOST_PARAMETERS = 5  # of a task
DISCOUNT = 0.99  # as all families have it
LINE = 64  # bytes that a cache line has, at multiples of which the kernel's arrays lie
AHEAD = 16  # iterations whose random numbers are drawn at a time
NO_CLIP = 3e38
INTEGERS = (
    "family components sources n_samples minibatch buffer equal diagonal_kl epsilon_steps "
    "updates patience"
)
NUMBERS = (
    "lambda_ psi kappa gamma alpha_mu alpha_L sigma_min clip kl_clip scale "
    "epsilon_start epsilon_end weight deviation"
)
PLACES = ("settings", "mu", "sources", "W", "L", "observation")  # in the order of runs.cpp
# The streams of a run, in the order of ``Random`` in algorithm.h.
ROLES = ("posterior", "component", "replay", "noise", "start", "exploration")


class _Settings(ctypes.Structure):
    """As ``Settings`` in algorithm.h."""

    _fields_ = [
        *((name, ctypes.c_int32) for name in INTEGERS.split()),
        *((name, ctypes.c_float) for name in NUMBERS.split()),
        ("task", ctypes.c_float * MOST_PARAMETERS),
    ]


def supports(family: TaskFamily, algorithm: Any, sources: int) -> bool:
    """Whether the kernels can run an algorithm, with so many sources, on tasks of a family."""
    library = kernels(RUNS)
    if library is None or not vars(type(family)).get("kernel") or family.window != WINDOW:
        return False
    if getattr(library, f"{family.kernel}_weights")() != family.q().d:
        return False
    # of settings that repeat another's gradient steps: those, and how often
    algorithm, _ = getattr(algorithm, "repeated", (algorithm, 1))
    if type(algorithm) is FineTuning:
        algorithm = algorithm.learner
    # a derived class may have another agent, so only these classes themselves are supported
    if type(algorithm) not in (MellowTDSettings, Settings) or algorithm.gamma != DISCOUNT:
        return False
    if algorithm.minibatch > MOST_BATCH:
        return False
    return not algorithm.transfers or bool(
        algorithm.components <= MOST_COMPONENTS
        and algorithm.n_samples < LANES
        and sources <= MOST_SOURCES
        and algorithm.covariance in ("full", *["fixed"] * (algorithm.family == "mixture"))
        and (algorithm.act, algorithm.patience) == ("step", 0)
    )


def kernel_settings(algorithm: Any) -> dict[str, Any]:
    """What the kernel needs to know of an algorithm, by the names of its fields there."""
    s = algorithm
    fields = {x: getattr(s, x) for x in f"{INTEGERS} {NUMBERS}".split() if hasattr(s, x)}
    fields |= {"updates": 1, "weight": 1.0}
    if not s.transfers:
        return {**fields, "family": LEARNER, "components": 1, "alpha_mu": s.alpha, "clip": NO_CLIP}
    gaussian = s.family == "gaussian"
    mixture = FIXED if s.covariance == "fixed" else MIXTURE
    return {
        **fields,
        "family": GAUSSIAN if gaussian else mixture,
        "deviation": max(s.sigma_p2**0.5, s.sigma_min),
        "clip": NO_CLIP if s.clip is None else s.clip,
        "kl_clip": NO_CLIP if s.kl_clip is None else s.kl_clip,
        "equal": s.responsibilities == "equal",
        "diagonal_kl": s.kl == "diagonal",
        "scale": 1 / (s.jitter if gaussian else s.sigma_p2),
    }


class NativeRun:
    """One run in the kernel's memory, on the task in a row of a batch.

    start: sources (S, d) if the algorithm transfers, else first weights (d,). mu (C, d) are the
    present means, L the first factor's entries. Random numbers have the names of an experiment's.
    """

    def __init__(
        self,
        family: TaskFamily,
        tasks: TaskBatch,
        row: int,
        algorithm: Any,
        start: Tensor,
        name: str,
        run: int,
    ) -> None:
        self._updates: int
        algorithm, self._updates = getattr(algorithm, "repeated", (algorithm, 1))
        if isinstance(algorithm, FineTuning):
            start = algorithm.first_weights(start.unsqueeze(0))[0]
            algorithm = algorithm.learner
        library = kernels(RUNS)
        self._call = {
            part: getattr(library, f"{family.kernel}_{part}")
            for part in ("bytes", "place", "begin", "iterate", "learning")
        }
        self._call["bytes"].restype, self._call["learning"].restype = ctypes.c_int64, ctypes.c_float
        self._call["place"].restype = ctypes.c_void_p
        self._algorithm, self._tasks, self._d = algorithm, tasks, family.q().d
        self._rng = {role: generator(name, run, role) for role in ROLES}
        size = self._call["bytes"](algorithm.buffer) + LINE
        self._memory = np.zeros(size, np.uint8)
        begin = self._memory.ctypes.data
        self._at = ctypes.c_void_p(begin + -begin % LINE)
        self._settings = _Settings.from_buffer(self._memory.data, self._place("settings"))
        wide = -(-self._d // LANES) * LANES
        most = {"mu": MOST_COMPONENTS, "sources": MOST_SOURCES, "W": MOST_SOURCES}
        self.mu, self._sources, self._W = (
            self._floats(name, rows * wide).reshape(rows, wide)[:, : self._d]
            for name, rows in most.items()
        )
        self.L = self._floats("L", kernels().posterior_size(self._d))
        self._observation = self._floats("observation", tasks.obs_dim)
        factors = self._set(start, family.kernel_parameters(tasks, row))
        noise = self._numbers("posterior", 1)
        if self.mu.shape[0] > 1:
            self._numbers("component", 1)  # the engine draws one before its first step
        place = self._numbers("start", 1)
        self._call["begin"](self._at, factors.ctypes, noise.ctypes, place.ctypes)

    def _place(self, name: str) -> int:
        """Where a part of the kernel's run lies, in bytes of the memory."""
        address: int = self._call["place"](self._at, PLACES.index(name))
        return address - self._memory.ctypes.data

    def _floats(self, name: str, count: int) -> np.ndarray:
        """The first numbers of a part of the kernel's run, as an array that shares its memory."""
        return self._memory[self._place(name) :][: 4 * count].view(np.float32)

    def _set(self, first: Tensor, parameters: list[float]) -> np.ndarray:
        """Hand over all that a run begins with, but the factors L (C, d, d), which are returned."""
        s, to = self._algorithm, self._settings
        for name, value in kernel_settings(s).items():
            setattr(to, name, value)
        to.updates = self._updates
        to.task[:] = [*parameters, *[0.0] * (MOST_PARAMETERS - len(parameters))]
        if not s.transfers:
            self.mu = self.mu[:1]
            self.mu[:] = first.numpy()
            return np.zeros(0, np.float32)
        to.sources = len(first)
        prior = s.prior(first.unsqueeze(0))
        start = prior.start(s.components, s.init)
        self.mu = self.mu[: s.components]
        self.mu[:] = start.mu[0].numpy()
        if prior.precision.W is not None:
            self._sources[0] = prior.mu[0, 0].numpy()
            self._W[: len(first)] = prior.precision.W[0].T.numpy()
        elif to.equal:  # only their mean matters
            self._sources[0], to.sources = first.mean(0).numpy(), 1
        else:
            self._sources[: len(first)] = first.numpy()
        return np.ascontiguousarray(start_factors(start, s.sigma_min).numpy())

    def _numbers(self, role: str, iterations: int) -> np.ndarray:
        s, tasks, rng = self._algorithm, self._tasks, self._rng[role]
        count = {
            "posterior": s.components * (s.n_samples + 1) * self._d if s.transfers else 0,
            "component": int(s.transfers and s.components > 1),
            "replay": s.minibatch,
            "noise": tasks.noise_dim,
            "start": tasks.start_dim,
            "exploration": 0 if s.transfers else 2,
        }[role]
        normal = role in ("posterior", "noise")
        draw: Any = rng.standard_normal if normal else rng.random
        numbers: np.ndarray = draw(iterations * count, np.float32)
        return numbers

    def advance(self, iterations: int) -> None:
        """Run some iterations."""
        for done in range(0, iterations, AHEAD):
            count = min(AHEAD, iterations - done)
            times = dict.fromkeys(("posterior", "replay"), count * self._updates)
            numbers = [self._numbers(role, times.get(role, count)) for role in ROLES]
            pointers = (ctypes.c_void_p * len(ROLES))(*(array.ctypes.data for array in numbers))
            self._call["iterate"](self._at, count, pointers)

    @property
    def learning(self) -> float:
        """Mean return of the last finished episodes."""
        return float(self._call["learning"](self._at))

    @property
    def fingerprint(self) -> np.ndarray:
        """As ``vtlab.training.fingerprint``, (4,)."""
        mu = self.mu.astype(np.float64)
        with np.errstate(all="ignore"):  # a run that has diverged is named at its next record
            sums = mu.sum(), (mu**2).sum()
        return np.array([*sums, sum(self._observation.tolist()), self.learning])


def train_natively(
    runs: Sequence[NativeRun],
    evaluate: Callable[[Tensor], Tensor | None],
    iterations: int,
    every: int,
    names: list[str],
    progress: Callable[[int], bool] | None = None,
    threads: int = 1,
) -> dict[str, np.ndarray]:
    """As ``vtlab.training.train``; each run goes on alone from one record to the next.

    As many run at once as there are threads, because kernels leave Python's lock to other threads.
    """
    measured, learning, greedy, prints = [], [], [], []
    records = range(every, iterations + 1, every)
    times = sorted({*records, *(f for f in FINGERPRINTS if f <= iterations)})
    with ThreadPoolExecutor(threads) as pool:
        for before, t in pairwise([0, *times]):
            list(pool.map(NativeRun.advance, runs, repeat(t - before)))
            if t in FINGERPRINTS:
                prints.append([run.fingerprint for run in runs])
            if t in records:
                mu = torch.from_numpy(np.stack([run.mu for run in runs]))
                check_finite(mu, names, t)
                measured.append(t)
                learning.append([run.learning for run in runs])
                greedy.append(evaluate(mu))
                if progress is not None and not progress(t):
                    break
    return recorded(len(runs), measured, learning, greedy, prints)
