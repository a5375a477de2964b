"""What runs, stores and verifies experiments. Packages offer theirs to the command line."""

import functools
from collections.abc import Mapping
from importlib.metadata import entry_points

from vtlib.experiments.experiment import Experiment
from vtlib.experiments.heads import live_check
from vtlib.experiments.store import load, returns

__all__ = ["installed", "known", "live_check", "load", "named", "returns"]

GROUP = "vtlib.experiments"


@functools.cache
def installed() -> Mapping[str, Mapping[str, Experiment]]:
    """Collections of experiments, by name, that installed packages offer.

    A package offers one by an entry point of the group "vtlib.experiments", which leads to a
    mapping from names to experiments. Without it an experiment of one's own runs, stores and
    verifies all the same, from Python.
    """
    return {one.name: one.load() for one in entry_points(group=GROUP)}


def known() -> dict[str, Experiment]:
    """All experiments that installed packages offer, by their names."""
    return {name: e for offered in installed().values() for name, e in offered.items()}


def named(name: str) -> list[Experiment]:
    """The experiments that a name stands for, of one or of a collection; ValueError for none."""
    if name in installed():
        return list(installed()[name].values())
    if name not in known():
        raise ValueError(f"unknown experiment {name!r}; known are {', '.join(known())}")
    return [known()[name]]
