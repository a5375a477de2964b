"""What the page of an experiment begins with: its stored runs, and the same runs made again."""

from __future__ import annotations

import functools
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import numpy as np
from attrs import evolve
from IPython.display import HTML, display
from matplotlib.figure import Figure
from tqdm import tqdm
from xarray import Dataset

from vtbook import claims, plots, processors, published, tables
from vtbook.costs import Cost, cost
from vtbook.experiments.protocols import Protocols
from vtbook.stored import returns
from vtlab.experiment import SOURCES
from vtlab.run import run_batch
from vtlab.store import load, path_of, provenance, results_of
from vtlib.checks import check_one_of, check_whole
from vtlib.stats import Interval

RECORD = "application/papermill.record/"  # by which the book finds a number for its text
NEW = "#000000"


class Page:
    """An experiment's stored runs: ``page.runs`` by label, ``page[label]`` as its claims see them.

    curves: the name of the published curves, in book/published, if there are any. floor: the return
    that counts as nothing. ``experiment`` is as published and ``equations`` the same by the text's
    equations.
    """

    def __init__(self, protocols: Protocols, curves: str = "", floor: float = 0.0) -> None:
        self.experiment, self.equations = protocols
        self._curves, self._floor = curves, floor

    @functools.cached_property
    def runs(self) -> dict[str, Dataset]:
        """Stored returns as published, by label."""
        return {x: returns(self.experiment, x) for x in self.experiment.algorithms}

    @functools.cached_property
    def text(self) -> dict[str, Dataset]:
        """Stored returns by the equations of the text, by label."""
        return {x: returns(self.equations, x) for x in self.equations.algorithms}

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
        return claims.Runs(self.runs[label], self._floor)

    def say(
        self, name: str, value: Interval | np.ndarray | float | str, form: str = "z.2f"
    ) -> None:
        """Keep a number, one with its interval, or words, for the text of the page.

        A notebook shows it below its cell, the book in the text only.
        """
        text = tables.told(value, form)
        told = {f"{RECORD}text/plain": repr(text), "text/plain": f"{name}: {text}"}
        note = {"scrapbook": {"name": name, "mime_prefix": RECORD}}
        display(told, raw=True, metadata=note)  # type: ignore[no-untyped-call]

    def cost(self, label: str) -> Cost:
        """What an algorithm's sources cost and what they save, beside learning without transfer."""
        used = self.experiment.sources_of(label)
        return cost(self.sources, used, self.runs[label], self.runs["NT"], self._floor)

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
        for label in labels:
            check_one_of("labels", label, self.experiment.algorithms)
        check_whole("runs", runs, 1, self.experiment.runs)
        check_whole("iterations", iterations, self.experiment.every, self.experiment.iterations)
        made: dict[str, dict[str, np.ndarray]] = {}
        with interruptible() as stopped, tqdm(total=len(labels) * iterations) as bar:

            def progress(t: int) -> bool:
                bar.update(len(made) * iterations + t - bar.n)
                return not stopped.is_set()

            for label in labels:
                if not stopped.is_set():
                    made[label] = self.made(label, runs, iterations, progress)
                    bar.update(0 if stopped.is_set() else len(made) * iterations - bar.n)
        return self._over_stored(made)

    def made(
        self, label: str, runs: int, iterations: int, progress: Callable[[int], bool]
    ) -> dict[str, np.ndarray]:
        """The first runs of an algorithm, computed anew on all processors."""
        alone = {label: self.experiment.algorithms[label]}
        counts = {label: self.experiment.sources_of(label)}
        short = evolve(self.experiment, algorithms=alone, counts=counts, iterations=iterations)
        short = evolve(short, visits=False, probes=0, probe=None)
        return run_batch(short, label, range(runs), self.weights, progress, threads=processors())

    def _over_stored(self, made: Mapping[str, Mapping[str, np.ndarray]]) -> Figure:
        """Stored learning returns in colour, new ones in black, and how far these two differ."""
        with plots.look():
            figure = plots.BookFigure(figsize=(7.6, 2.9))
            panels = figure.subplots(1, len(made), sharey=True, squeeze=False)[0]
            for ax, (label, new) in zip(panels, made.items(), strict=True):
                at = new["iterations"]
                stored = self.runs[label].sel(iteration=slice(None, 2 * at[-1]))
                band = stored.iteration.values, stored.learning.values
                algorithm = label.partition("-from-")[0]  # without its number of sources
                plots.draw_curves(ax, [plots.curve(label, algorithm, *band)])
                ax.plot(at, new["learning"].T, color=NEW, lw=1)
                same = stored.learning.sel(run=new["run"], iteration=at).values
                difference = np.abs(same - new["learning"]).max()
                ax.set_title(f"{label}, {difference:.1g} from stored")
            panels[0].set_ylabel("learning return")
        return figure


@contextmanager
def interruptible() -> Iterator[threading.Event]:
    """An event that an interrupt of the kernel sets, in place of breaking off what computes."""
    stopped = threading.Event()
    before = signal.signal(signal.SIGINT, lambda *_: stopped.set())
    try:
        yield stopped
    finally:
        signal.signal(signal.SIGINT, before)
