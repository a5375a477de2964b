"""What the page of an experiment begins with: its stored runs, and numbers for its text."""

import functools
from collections.abc import Mapping

import numpy as np
from IPython.display import HTML, display
from matplotlib.figure import Figure
from xarray import Dataset

from vtbook import claims, published, rerun, tables
from vtbook.costs import Cost, cost
from vtbook.experiments.mountain_car import floor_of
from vtlab.experiment import SOURCES, Experiment
from vtlab.stats import Interval
from vtlab.store import load, path_of, provenance, results_of, returns

RECORD = "application/papermill.record/"  # by which the book finds a number for its text


class Page:
    """An experiment's stored runs: ``page.runs`` by label, ``page[label]`` as its claims see them.

    curves: the name of the published curves, in book/published, if there are any.
    """

    def __init__(self, experiment: Experiment, curves: str = "") -> None:
        self.experiment, self._curves = experiment, curves

    @functools.cached_property
    def runs(self) -> dict[str, Dataset]:
        """Stored returns by label."""
        return {x: returns(self.experiment, x) for x in self.experiment.algorithms}

    @functools.cached_property
    def printed(self) -> dict[str, Mapping[str, published.PublishedCurve]]:
        """The published curves by kind and label."""
        return {x: published.curves(self._curves, x) for x in ("learning", "greedy")}

    @functools.cached_property
    def sources(self) -> Dataset:
        """The stored sources: their weights, and what it took to solve them."""
        return load(self.experiment.pool, SOURCES)

    @property
    def weights(self) -> np.ndarray:
        """Weights (count, d) of the sources."""
        return np.asarray(self.sources.weights)

    def __getitem__(self, label: str) -> claims.Runs:
        return claims.Runs(self.runs[label], floor_of(self.experiment))

    def say(
        self, name: str, value: Interval | np.ndarray | float | str, form: str = "z.2f"
    ) -> None:
        """Keep a number, a number with its interval, or words, for the text of the page.

        A notebook shows it below its cell, the book in the text only.
        """
        text = tables.words(value, form)
        data = {f"{RECORD}text/plain": repr(text), "text/plain": f"{name}: {text}"}
        note = {"scrapbook": {"name": name, "mime_prefix": RECORD}}
        display(data, raw=True, metadata=note)  # type: ignore[no-untyped-call]

    def cost(self, label: str) -> Cost:
        """What an algorithm's sources cost and what they save, beside learning without transfer."""
        count, floor = self.experiment.sources_of(label), floor_of(self.experiment)
        without = self.runs["NT" if "NT" in self.runs else "DDQN"]
        return cost(self.sources, count, self.runs[label], without, floor)

    def settings(self) -> HTML:
        """Every parameter of the stored runs, and what it took to compute them, as tables."""
        notes = [provenance(path_of(*result)) for result in results_of(self.experiment)]
        both = tables.settings_table(self.experiment) + tables.cost_table(notes)
        return HTML(both)  # type: ignore[no-untyped-call]

    def rerun(self, *labels: str, runs: int = 2, iterations: int = 500) -> Figure:
        """Compute the first runs of some algorithms anew and draw them over all that are stored.

        The kernel's interrupt ends the computation, and what is done by then is drawn. The whole
        experiment is ``runs=page.experiment.runs, iterations=page.experiment.iterations``. Raises
        ValueError for unknown labels, or for more runs or iterations than are stored.
        """
        made = rerun.rerun(self.experiment, labels, runs, iterations)
        return rerun.rerun_figure(self.runs, made)
