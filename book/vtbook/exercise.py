"""Train with settings of the reader's own, beside the stored runs of an algorithm."""

from __future__ import annotations

import numpy as np
from attrs import evolve

from vtbook import processors
from vtbook.stored import returns
from vtlab.experiment import Algorithm, Experiment
from vtlab.run import run_batch
from vtlab.store import weights
from vtlib.checks import check_one_of, check_whole
from vtlib.stats import Interval, mean_interval


def try_settings(
    experiment: Experiment, label: str, settings: Algorithm, runs: int, iterations: int
) -> str:
    """Make the first runs of an algorithm again with other settings, and say what that changes.

    The stored runs have the same tasks, sources and random numbers. Returns are averaged over the
    iterations, intervals are 95 %, differences are paired by run. Raises ValueError for a label
    that the experiment lacks, fewer than two runs, or more runs or iterations than are stored.
    """
    check_one_of("label", label, experiment.algorithms)
    check_whole("runs", runs, 2, experiment.runs)
    check_whole("iterations", iterations, experiment.every, experiment.iterations)
    own = evolve(
        experiment,
        algorithms={label: settings},
        counts={label: experiment.sources_of(label)},
        iterations=iterations,
        visits=False,
        probes=0,
        probe=None,
    )
    sources = weights(experiment.pool)
    new = run_batch(own, label, range(runs), sources, threads=processors())["learning"].mean(1)
    kept = returns(experiment, label).isel(run=slice(runs))
    old = kept.learning.sel(iteration=slice(iterations)).mean("iteration").values
    return "\n".join(
        [
            f"{label}, {runs} runs, mean learning return over {iterations:,} iterations",
            f"  stored      {_said(mean_interval(old))}",
            f"  yours       {_said(mean_interval(np.asarray(new)))}",
            f"  difference  {_said(mean_interval(new - old), '+')}",
        ]
    )


def _said(number: Interval, sign: str = "") -> str:
    low, high = f"{number.low:{sign}.3g}", f"{number.high:{sign}.3g}"
    return f"{number.centre:{sign}.3g} ({low} to {high})".replace("-", "−")
