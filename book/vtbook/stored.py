"""Stored results as a page reads them: each once, however many of its parts ask for it."""

from __future__ import annotations

from pathlib import Path

from xarray import Dataset

from vtlab import store
from vtlab.experiment import TASKS, Experiment, Pool

_READ: dict[Path, tuple[Pool | Experiment, Dataset]] = {}


def load(owner: Pool | Experiment, label: str) -> Dataset:
    """A stored result as ``vtlab.store.load`` gives it, which is read when it is first asked for.

    For an owner of the same name that is configured otherwise it is read again, and refused.
    """
    path = store.path_of(owner, label)
    if path not in _READ or _READ[path][0] != owner:
        _READ[path] = owner, store.load(owner, label)
    return _READ[path][1].copy()


def returns(experiment: Experiment, label: str) -> Dataset:
    """The stored runs of an algorithm, and each run's planned optimum."""
    return load(experiment, label).assign(optimum=load(experiment, TASKS).optimum)
