"""The first runs of an algorithm made again: as they are stored, or with other settings."""

import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np
from attrs import evolve
from matplotlib.figure import Figure
from tqdm import tqdm
from xarray import Dataset

from vtbook import plots
from vtbook.tables import words
from vtlab.experiment import Algorithm, Experiment
from vtlab.run import run_batch
from vtlab.stats import mean_interval
from vtlab.store import returns, weights
from vtlab.workers import processors
from vtlib.checks import check_one_of, check_whole

NEW = "#000000"
SAME = 1e-5  # a difference that rounding makes
Arrays = dict[str, np.ndarray]


def first_runs(
    experiment: Experiment,
    label: str,
    runs: int,
    iterations: int,
    sources: np.ndarray,
    progress: Callable[[int], bool] | None = None,
    settings: Algorithm | None = None,
) -> Arrays:
    """The first runs of an algorithm, or of settings in its place, computed on all processors.

    Visits and probes are left out, because kernels compute returns alone.
    """
    short = evolve(
        experiment,
        algorithms={label: settings or experiment.algorithms[label]},
        counts={label: experiment.sources_of(label)},
        iterations=iterations,
        visits=False,
        probes=0,
        probe=None,
    )
    return run_batch(short, label, range(runs), sources, progress, threads=processors())


def check_stored(
    experiment: Experiment, labels: Sequence[str], runs: int, least: int, iterations: int
) -> None:
    """Raise ValueError for unknown labels, and for runs or iterations that are not stored."""
    for label in labels:
        check_one_of("labels", label, experiment.algorithms)
    check_whole("runs", runs, least, experiment.runs)
    check_whole("iterations", iterations, experiment.every, experiment.iterations)


def rerun(
    experiment: Experiment, labels: Sequence[str], runs: int, iterations: int
) -> dict[str, Arrays]:
    """The first runs of some algorithms; the kernel's interrupt ends them, and keeps what is done.

    Raises ValueError for unknown labels, or for more runs or iterations than are stored.
    """
    check_stored(experiment, labels, runs, 1, iterations)
    made: dict[str, Arrays] = {}
    sources = weights(experiment.pool)
    with interruptible() as stopped, tqdm(total=len(labels) * iterations) as bar:

        def progress(t: int) -> bool:
            bar.update(len(made) * iterations + t - bar.n)
            return not stopped.is_set()

        for label in labels:
            if not stopped.is_set():
                made[label] = first_runs(experiment, label, runs, iterations, sources, progress)
    return made


@contextmanager
def interruptible() -> Iterator[threading.Event]:
    """An event that an interrupt of the kernel sets, where it arrives: in the main thread alone."""
    stopped, main = threading.Event(), threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGINT, lambda *_: stopped.set()) if main else None
    try:
        yield stopped
    finally:
        if main:
            signal.signal(signal.SIGINT, before)


def rerun_figure(stored: Mapping[str, Dataset], made: Mapping[str, Arrays]) -> Figure:
    """Stored learning returns in colour, new ones in black, and how far these two differ."""
    with plots.look():
        figure = plots.BookFigure(figsize=(7.6, 2.9))
        panels = figure.subplots(1, len(made), sharey=True, squeeze=False)[0]
        for ax, (label, new) in zip(panels, made.items(), strict=True):
            at = new["iterations"]
            around = stored[label].sel(iteration=slice(None, 2 * at[-1]))
            band = around.iteration.values, around.learning.values
            algorithm = label.partition("-from-")[0]  # without its number of sources
            plots.draw_curves(ax, [plots.curve(label, algorithm, *band)])
            ax.plot(at, new["learning"].T, color=NEW, lw=1)
            same = around.learning.sel(run=new["run"], iteration=at).values
            difference = np.abs(same - new["learning"]).max()
            told = "as stored" if difference < SAME else f"up to {difference:.1g} off"
            ax.set_title(f"{label}: {told}")
        panels[0].set_ylabel("learning return")
    return figure


def try_settings(
    experiment: Experiment, label: str, settings: Algorithm, runs: int, iterations: int
) -> str:
    """Make the first runs of an algorithm again with other settings, and say what that changes.

    The stored runs have the same tasks, sources and random numbers. Returns are averaged over the
    iterations, intervals are 95 %, differences are paired by run. Raises ValueError for a label
    that the experiment lacks, fewer than two runs, or more runs or iterations than are stored.
    """
    check_stored(experiment, [label], runs, 2, iterations)
    sources = weights(experiment.pool)
    new = first_runs(experiment, label, runs, iterations, sources, settings=settings)
    yours = new["learning"].mean(1)
    stored = returns(experiment, label).isel(run=slice(runs)).sel(iteration=slice(iterations))
    old = stored.learning.mean("iteration").values
    return "\n".join(
        [
            f"{label}, {runs} runs, mean learning return over {iterations:,} iterations",
            f"  stored      {words(mean_interval(old), '.3g')}",
            f"  yours       {words(mean_interval(yours), '.3g')}",
            f"  difference  {words(mean_interval(yours - old), '+.3g')}",
        ]
    )
